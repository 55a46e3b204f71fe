"""Rows are read in narrow columns, in pieces: text, figures and numbers of a report are those from
whole rows.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from jbclog.analysis.figures import curves
from jbclog.analysis.figures import port as port_figure
from jbclog.analysis.figures.curves import GridSeconds
from jbclog.analysis.figures.from_samples import (
    GrowingColumn,
    JoinedTrace,
    columns_of,
    has_air,
    trace,
)
from jbclog.analysis.figures.trace import Grid, Trace
from jbclog.analysis.run import open_run
from jbclog.analysis.run_tables import RunTables
from jbclog.analysis.verdict import judged_signals
from jbclog.core.rows import PortKey, StationFacts
from jbclog.record.samples_by_port import SamplesByPort
from jbclog.report import gather, joints, ports
from jbclog.report.facts import FigureFacts, JointFacts
from jbclog.report.joints import COLUMNS, SHOWN, joints_of
from jbclog.report.ports import PortSamples, samples_of
from jbclog.report.write import as_document, figures_of, report_files
from support import once
from support.records import small_run
from support.records.sealed_run import lose, samples, seal, station, table
from support.virtual.lines import AIR
from support.virtual.recorded_run import run_in
from support.virtual.virtual_run import line_text


def small(home: Path) -> Path:
    return small_run.make_run(home, 20.0)


def hot_air(home: Path) -> Path:
    sim = "tool = 1\n[[station.sim.fault]]\nkind = 'silence'\nat_s = 4\nfor_s = 2\n"
    return run_in(home, line_text(sim).replace("dde", "jtse"), AIR, 10.0)


def free(home: Path) -> Path:
    """With ``--rate max`` the rows have no grid, only times."""
    return run_in(home, line_text(), duration_s=5.0, rate="max")


@pytest.mark.parametrize("made", [small, hot_air, free])
def test_a_report_is_the_same_however_its_rows_are_read(
    made: Callable[[Path], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(made(tmp_path))
    joints = joints_of(run, run.alarm_findings())
    whole = gather.gather(run, joints, run.alarm_findings())
    monkeypatch.setattr(curves, "BLOCK_ROWS", 7)
    monkeypatch.setattr(SamplesByPort, "rows", in_small_tables)
    pieces = gather.gather(run, joints, run.alarm_findings())
    assert as_document(pieces) == as_document(whole)
    assert figures_of(pieces) == figures_of(whole)


ROWS_OF_PORT = SamplesByPort.rows


def in_small_tables(
    samples: SamplesByPort, key: PortKey, columns: Sequence[str] | None = None
) -> Iterator[pa.Table]:
    for rows in ROWS_OF_PORT(samples, key, columns):
        yield from (rows.slice(first, 61) for first in range(0, len(rows), 61))


def test_the_scale_of_a_figure_is_found_once_for_its_two_sizes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def again(*_: object, **__: object) -> None:
        raise AssertionError("the drawing looks at all readings again")

    run = small(tmp_path)
    monkeypatch.setattr(port_figure, "scale_of", again)
    once.forget()  # or a figure that another test has drawn is not drawn again
    assert "figures/dde-1-1.svg" in report_files(run)


def test_of_the_joints_what_is_shown_is_in_memory_and_the_table_has_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(seal(tmp_path, [station(rows=2400)], table(samples(2400))))
    found = joints_of(run, run.alarm_findings())
    assert found.table.column_names == SHOWN
    assert len(SHOWN) == 9
    whole = found.csv()
    header, *lines = whole.decode("utf-8-sig").splitlines()
    assert header.split(",") == [*COLUMNS]
    assert len(lines) == found.table.num_rows > 10
    monkeypatch.setattr(joints, "ROWS_AT_ONCE", 7)
    assert found.csv() == whole


def each_port(run: RunTables) -> Iterator[tuple[StationFacts, int, PortSamples]]:
    for facts in run.stations:
        samples = run.samples_by_port(["late_us", *columns_of(facts)])
        grid = Grid(run.manifest.t0_utc_us, facts.period_s, ())
        for port in facts.ports:
            yield facts, port, samples_of(samples, facts, port, grid)


@pytest.mark.parametrize("made", [small, hot_air, free])
@pytest.mark.parametrize("at_once", [1, 7, 50])
def test_a_trace_made_in_pieces_is_that_of_the_whole_table(
    made: Callable[[Path], Path], at_once: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(made(tmp_path))
    monkeypatch.setattr(ports, "ROWS_A_GROUP", at_once)
    monkeypatch.setattr(SamplesByPort, "rows", in_small_tables)
    for facts, port, rows in each_port(run):
        states = "temperature_c" not in judged_signals(facts)
        whole = run.samples(facts.name, port)
        of_air, grid = has_air(facts), Grid(run.manifest.t0_utc_us, facts.period_s)
        expected = trace(whole, grid, of_states=states, of_air=of_air)
        found = rows.trace()
        assert rows.rows == len(whole) > 0
        assert rows.last_status == whole["status"].dropna().iloc[-1]
        late_us = whole["late_us"].dropna()
        assert rows.late_us(0.99) == (np.quantile(late_us, 0.99) if len(late_us) else None)
        assert np.array_equal(found.seconds[:], expected.seconds[:])
        for name in ("temperature", "power", "setting"):
            assert np.array_equal(getattr(found, name), getattr(expected, name), equal_nan=True)
        assert found.status == expected.status
        assert (found.states, found.period_s) == (expected.states, expected.period_s)
        assert [*found.reasons] == [*expected.reasons]


@pytest.mark.parametrize(("latest", "size"), [(65_535, 2), (65_536, 4), (3_000_000_000, 8)])
def test_how_late_rows_were_takes_as_few_bytes_as_hold_it(
    latest: int, size: int, tmp_path: Path
) -> None:
    columns = samples(100)
    columns["late_us"][50] = latest
    run = open_run(seal(tmp_path, [station(rows=100)], table(columns)))
    ((_, _, rows),) = each_port(run)
    assert rows._late_us.array().dtype.itemsize == size
    assert rows.late_us(1.0) == latest


def test_spans_that_continue_in_the_next_piece_are_one(tmp_path: Path) -> None:
    columns = samples(600)
    lose(columns, slice(95, 160))
    lose(columns, slice(300, 301), "timeout")
    columns["status"][210:230] = "stand"
    kept = np.ones(600, dtype=np.bool_)
    kept[[40, 41, 42, 200, 400, 450, 451]] = False  # the host stood still
    frame = table(columns).to_pandas()[kept]
    grid = Grid(0, 0.1)
    whole = trace(frame, grid)
    for size in (1, 2, 40, 41, 199, 599):
        pieces = JoinedTrace()
        for first in range(0, len(frame), size):
            pieces.add(trace(frame[first : first + size], grid))
        found = pieces.trace()
        assert found.status == whole.status, size
        assert [*found.reasons] == [*whole.reasons]
        assert np.array_equal(found.temperature, whole.temperature, equal_nan=True)


def test_a_column_takes_the_type_of_its_widest_values() -> None:
    pieces = [
        np.array(some, kind) for some, kind in (([], "f4"), ([1, np.nan], "f2"), ([7e4], "f4"))
    ]
    column, known = GrowingColumn(), np.array([1, np.nan, 7e4])
    assert not len(column.array())
    for piece in pieces:
        column.add(piece)
    assert np.array_equal(column.array(), known, equal_nan=True)
    column.add(np.arange(9.0, dtype="f2"))
    assert column.array().dtype == np.float32


@pytest.mark.parametrize(("celsius", "size"), [(350, 2), (2048, 2), (2049, 4)])
def test_readings_take_two_bytes_where_these_hold_them(
    celsius: int, size: int, tmp_path: Path
) -> None:
    columns = samples(100)
    columns["temperature_c"][50] = celsius
    run = open_run(seal(tmp_path, [station(rows=100)], table(columns)))
    ((_, _, rows),) = each_port(run)
    found = rows.trace()
    assert found.temperature.dtype.itemsize == size
    assert found.temperature[50] == celsius


def test_the_rows_of_a_port_are_small_and_freed_before_its_joints_are_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(small(tmp_path))
    alive: list[weakref.ref[PortSamples]] = []
    traced: list[weakref.ref[Any]] = []
    of_port, figures, chart = ports.samples_of, ports._figures, ports.joint_facts

    def noted(*given: Any) -> PortSamples:
        rows = of_port(*given)
        alive.append(weakref.ref(rows))
        return rows

    def charted(*given: Any, **more: Any) -> JointFacts | None:
        left_for_chart.append(sum(one() is not None for one in [*alive, *traced]))
        return chart(*given, **more)

    def drawn(file: str, place: str, one: Trace, context: ports.Context) -> list[FigureFacts]:
        assert isinstance(one.seconds, GridSeconds)
        columns = (one.seconds.ticks, one.temperature, one.power, one.setting, one.reasons.codes)
        assert sum(column.nbytes for column in columns) <= 11 * len(one.seconds)
        left.append(sum(one() is not None for one in alive))
        traced.append(weakref.ref(one.temperature))
        return figures(file, place, one, context)

    left, left_for_chart = list[int](), list[int]()
    monkeypatch.setattr(ports, "samples_of", noted)
    monkeypatch.setattr(ports, "_figures", drawn)
    monkeypatch.setattr(ports, "joint_facts", charted)
    alarms = run.alarm_findings()
    gather.gather(run, joints_of(run, alarms), alarms)
    assert len(alive) > 1
    assert left == left_for_chart == [0] * len(alive)
