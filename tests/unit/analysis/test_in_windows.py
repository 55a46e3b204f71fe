"""A run is measured row group by row group: the figures of its whole, in memory that does not grow
with its length.
"""

from __future__ import annotations

import time
import tracemalloc
import weakref
from collections.abc import Iterator, Sequence
from math import nan

import numpy as np
import pyarrow as pa
import pytest

from jbclog.analysis.joints import port_reader, values
from jbclog.analysis.joints.port_reader import PortReader, raw_series
from jbclog.analysis.joints.port_rows import COLUMNS, Clock, kind_of
from jbclog.analysis.joints.windows import Windows, placed
from jbclog.analysis.metrics.measures import PortFigures, measure_port
from jbclog.analysis.port_data import Floats
from jbclog.analysis.run_metrics import joints_and_metrics
from jbclog.core.rows import PortKey
from support.records.long_run import LongRun, MadeSamples
from support.records.made_series import line, made, rest, steps

THREE_HOURS_S, HALF_A_DAY_S, TWO_DAYS_S = 10_800.0, 43_200.0, 172_800.0
MOST_BYTES, MOST_BYTES_AT_10_HZ = 20e6, 20e6  # the slopes between all pairs of means of rest
BYTES_A_JOINT = 250.0
BYTES_A_SECOND = 3.0  # the mean of each 10 s of idling is kept


def whole(run: LongRun) -> dict[str, tuple[float | None, int, float | None, str | None]]:
    facts, (rows,) = run.manifest.stations[0], run.groups("samples", COLUMNS)
    clock = Clock(facts.period_s, [], round((run.manifest.t0_utc or 0.0) * 1e6))
    measured = measure_port(placed(raw_series(facts, rows, clock)), kind_of(facts))
    return {one.name: (one.value, one.n, one.coverage, one.why) for one in measured.figures}


@pytest.mark.parametrize(
    ("family", "hz", "is_free"), [("dde", 10.0, False), ("dde", 10.0, True), ("jtse", 1.0, False)]
)
def test_the_figures_are_those_of_the_whole_record(
    family: str, hz: float, is_free: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    seconds = 2500.0
    known = whole(LongRun(seconds, hz, family, is_free, group=1_000_000))
    for most_rows, most_kept, group in ((1, 1000, 777), (1_000_000, 50_000, 12_345)):
        monkeypatch.setattr(port_reader, "MOST_ROWS", most_rows)
        monkeypatch.setattr(values, "MOST_KEPT", most_kept)
        joints, metrics, *_ = joints_and_metrics(LongRun(seconds, hz, family, is_free, group))
        for row in metrics:
            value, n, coverage, why = known[row.metric]
            assert (row.n, row.coverage, row.why) == (
                n,
                pytest.approx(coverage, nan_ok=True),
                why,
            ), row
            assert (row.value is None) == (value is None)
            assert (
                row.value == pytest.approx(value, rel=1e-6, abs=1e-9, nan_ok=True)
                if value is not None
                else True
            )
        assert joints.num_rows == (known["joints"][0] or 0)
    assert (
        known["joints"][0] is None if family == "jtse" else 380 < (known["joints"][0] or nan) < 425
    )


@pytest.mark.parametrize("window_s", [3.0, 11.0, 13.0, 20.0])
def test_a_heat_up_on_the_edge_of_windows_is_one(window_s: float) -> None:
    course = line((0, 100), (10, 100), (15.1, 356), (20, 350), (240, 350))
    series = rest(made(240, course, steps((0, 0), (10, 1000), (15, 100))), (0, 10))
    port = PortFigures(series)
    windows = Windows(port.take, window_s)
    windows.take(series)
    windows.end()
    names = ("heat_up_time_s", "overshoot_c", "settling_time_s")
    found = {one.name: one for one in port.measured("air", None, []).figures}
    known = {one.name: one for one in measure_port(series, "air").figures}
    assert [found[name] for name in names] == [known[name] for name in names]
    assert found["heat_up_time_s"].n == 1


def test_values_are_the_same_as_they_are_and_as_they_are_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pieces = [
        np.random.default_rng(7).integers(-4, 9, size).astype(np.float64)
        for size in (3, 400, 1, 350, 2)
    ]
    monkeypatch.setattr(values, "MOST_KEPT", 500)
    counted = values.Values(3)
    for piece in pieces:
        counted.add(piece)
    every = np.concatenate(pieces)
    assert counted.n == len(every)
    assert [counted.mean, counted.sd, counted.range, counted.median] == pytest.approx(
        [every.mean(), every.std(ddof=1), np.ptp(every), np.median(every)], rel=1e-12
    )


@pytest.mark.parametrize("is_free", [False, True])
def test_a_joint_has_the_time_of_the_row_next_to_it(
    is_free: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(port_reader, "MOST_ROWS", 1)
    run = LongRun(1500.0, 10.0, is_free=is_free, group=999)
    joints = joints_and_metrics(run)[0]
    rows = [group["time"].cast("int64").to_numpy() for group in run.groups("samples", ["time"])]
    seconds = (np.concatenate(rows) - (run.manifest.t0_utc_us or 0)) / 1e6
    for name in ("start", "stop"):
        place = np.searchsorted(seconds, joints[f"{name}_s"].to_numpy() - 1e-5)
        assert (joints[name].cast("int64").to_numpy() == np.concatenate(rows)[place]).all()


def test_a_sweep_reads_the_motor_only_where_there_is_a_feeder(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A week is decoded four times."""
    monkeypatch.setattr(port_reader, "MOST_ROWS", 1)
    asked: list[Sequence[str]] = []
    rows = MadeSamples.rows

    def noted(samples: MadeSamples, key: PortKey, columns: Sequence[str]) -> Iterator[pa.Table]:
        asked.append(columns)
        return rows(samples, key, columns)

    monkeypatch.setattr(MadeSamples, "rows", noted)
    joints_and_metrics(LongRun(600.0, 10.0))
    sweeps = [columns for columns in asked if "temperature_c" in columns]
    assert [set(COLUMNS) - set(columns) for columns in sweeps] == 4 * [{"motor"}]


@pytest.mark.parametrize(("most_rows", "most_alive"), [(6000, 12), (3000, 6)])
def test_the_rows_of_a_port_are_kept_unless_they_are_too_many(
    most_rows: int, most_alive: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(port_reader, "MOST_ROWS", most_rows)
    run = LongRun(600.0, 10.0, group=500)
    samples = run.samples_by_port(COLUMNS)
    facts = run.stations[0]
    reader = PortReader(facts, 1, samples, [], run.manifest.t0_utc_us)
    seen, alive = list[weakref.ref[Floats]](), list[int]()
    for piece in reader._pieces():
        seen.append(weakref.ref(piece.rows.temperature))
        alive.append(sum(rows() is not None for rows in seen))
    assert len(alive) == 12
    assert max(alive) == most_alive


def memory(run: LongRun) -> tuple[float, int, float]:
    """The most bytes, joints, and µs of CPU a row."""
    joints_and_metrics(LongRun(60.0, 10.0))  # what is imported by it
    began = time.process_time()
    tracemalloc.start()
    joints = joints_and_metrics(run)[0]
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most, joints.num_rows, 1e6 * (time.process_time() - began) / run.rows


@pytest.mark.parametrize(("family", "is_free"), [("dde", True), ("jtse", False)])
def test_memory_is_the_same_for_three_hours_and_half_a_day(
    family: str, is_free: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(port_reader, "MOST_ROWS", 1)
    monkeypatch.setattr(values, "MOST_KEPT", 1000)
    few, _, _ = memory(LongRun(THREE_HOURS_S, 0.1, family, is_free, 500))
    many, _, _ = memory(LongRun(HALF_A_DAY_S, 0.1, family, is_free, 500))
    assert few < MOST_BYTES
    assert many < 1.1 * few + BYTES_A_SECOND * (HALF_A_DAY_S - THREE_HOURS_S)


@pytest.mark.campaign
@pytest.mark.timeout(3600)
def test_half_a_day_and_two_days_of_a_port_at_10_hz(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(port_reader, "MOST_ROWS", 1)
    for seconds in (HALF_A_DAY_S, TWO_DAYS_S):
        most, joints, cpu = memory(LongRun(seconds, 10.0))
        print(
            f"{seconds / 86400:g} days: {most / 1e6:.0f} MB, {joints} joints, {cpu:.1f} µs a row"
            " (traced)"
        )
        assert most - BYTES_A_JOINT * joints < MOST_BYTES_AT_10_HZ
