"""Joints and metrics of a run: from its samples to `features`, and back into tables.

A table has a row for each joint (`joint_table`) or for each metric of each port (`METRICS`). Works also for a run that is still
open or was cut off, as far as its record goes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from math import inf
from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.alarm_rows import stations_of
from jbclog.analysis.joint_table import FILE as JOINTS_FILE
from jbclog.analysis.joint_table import JOINTS_SCHEMA, read_joints
from jbclog.analysis.joints.joints import find_joints
from jbclog.analysis.joints.parameters import asked_of
from jbclog.analysis.joints.port_rows import COLUMNS, CYCLES, PUSHING, WORKING, Clock, PortRows, cycles_of, kind_of, series_of
from jbclog.analysis.joints.recovery import Joint
from jbclog.analysis.joints.series import Cycles, Series
from jbclog.analysis.joints.solder_wire import Wire
from jbclog.analysis.metrics.definitions import DEFINITIONS
from jbclog.analysis.metrics.measures import Measured, measure_port
from jbclog.analysis.stored_metrics import is_as_written, left_metrics, metric_table
from jbclog.analysis.verdict.idle import Floats
from jbclog.analysis.verdict.rules import has_feeder
from jbclog.analysis.verdict.samples import Counts
from jbclog.analysis.verdict.stepped_clock import Step
from jbclog.core.errors import RecordError
from jbclog.core.rows import StationFacts
from jbclog.record.folder import joints_asked
from jbclog.record.manifest import manifest_sha256

if TYPE_CHECKING:
    from jbclog.analysis.run import Run

ORDER_TO_WORK: Final = {"tip": "00000", "air": "00001"}  # status words of W-PS (manuals 000, 001, 002)


def metrics_of(run: Run, station: str | None = None) -> pd.DataFrame:
    """A row for each metric of each port: value or the reason why there is none, unit, n, coverage in per cent, resolution.

    As the report left them, or computed anew.
    """
    try:
        left = left_metrics(run.folder, manifest_sha256(run.folder)) if run.manifest.state == "sealed" else None
    except RecordError:
        left = None
    if left is not None:
        return left if station is None else left[left["station"] == station].reset_index(drop=True)
    rows = [
        {"station": facts.name, "port": port, **_named(asdict(figure))}
        for facts, port, measured, _ in _measured(run, station)
        for figure in measured.figures
    ]
    return metric_table(rows)


def joints_and_metrics(run: Run) -> tuple[pa.Table, list[dict[str, object]], list[dict[str, object]]]:
    """The joints of a run as `joints_table` has them, and the rows of `metrics_of`, from one pass over the samples.

    Then what the joints of each port were found with: its `[joints]`, with the values that the run told.
    """
    joints: list[dict[str, object]] = []
    metrics: list[dict[str, object]] = []
    taken: list[dict[str, object]] = []
    for facts, port, measured, moments in _measured(run, None):
        joints += [_row(facts, port, number, joint, moments) for number, joint in enumerate(measured.joints, 1)]
        metrics += [{"station": facts.name, "port": port, **_named(asdict(figure))} for figure in measured.figures]
        taken += [] if measured.found is None else [{"station": facts.name, "port": port, **asdict(measured.found.asked)}]
    return pa.Table.from_pylist(joints, schema=JOINTS_SCHEMA), metrics, taken


def definitions() -> pd.DataFrame:
    """What each metric means: `metric`, `unit`, `definition`, `applies_to`."""
    rows = [(one.name, one.unit, one.text, ", ".join(one.of)) for one in DEFINITIONS]
    return pd.DataFrame(rows, columns=["metric", "unit", "definition", "applies_to"])


def joints_table(run: Run, station: str | None = None) -> pa.Table:
    """The joints of a run in the order of stations, ports and times."""
    rows: list[dict[str, object]] = []
    for facts, port, measured, moments in _measured(run, station):
        rows += [_row(facts, port, number, joint, moments) for number, joint in enumerate(measured.joints, 1)]
    return pa.Table.from_pylist(rows, schema=JOINTS_SCHEMA)


def joints_of(run: Run, station: str | None = None) -> pa.Table:
    """The joints as the report left them, or found anew."""
    try:
        is_left = run.manifest.state == "sealed" and is_as_written(run.folder, JOINTS_FILE)
        left = read_joints(run.folder, manifest_sha256(run.folder)) if is_left else None
    except RecordError:
        left = None
    if left is None:
        return joints_table(run, station)
    return left if station is None else left.filter(pc.equal(left["station"], station))


def _named(figure: dict[str, object]) -> dict[str, object]:
    """A figure's name is the metric's."""
    return {"metric" if key == "name" else key: value for key, value in figure.items()}


class _Moments:
    """The UTC of a port's rows, in microseconds, for any grid second."""

    def __init__(self, seconds: Floats, utc_us: Counts) -> None:
        self.seconds, self.utc_us = seconds, utc_us

    def at(self, second: float) -> int:
        """The time of the row nearest to it."""
        place = int(np.clip(np.searchsorted(self.seconds, second - 1e-6), 0, len(self.seconds) - 1))
        return int(self.utc_us[place])


def joint_count(run: Run, ended_s: float | None = None) -> int:
    """How many joints there are, as many as in `joints_table`; only those that ended so long before their port's last row."""
    count = 0
    for facts, _, series, _, _ in _ports(run, None):
        if kind_of(facts) == "tip" and len(series.seconds):
            latest = inf if ended_s is None else float(series.seconds[-1]) - ended_s
            count += sum(joint.end_s <= latest for joint in find_joints(series, asked_of(joints_asked(run.folder, facts))).joints)
    return count


def _measured(run: Run, station: str | None) -> Iterator[tuple[StationFacts, int, Measured, _Moments]]:
    """Each port of each station, measured."""
    for facts, port, series, wire, moments in _ports(run, station):
        asked = asked_of(joints_asked(run.folder, facts))
        yield facts, port, measure_port(series, kind_of(facts), wire, asked), moments


def _ports(run: Run, station: str | None) -> Iterator[tuple[StationFacts, int, Series, Wire | None, _Moments]]:
    """Each port of each station, one station's samples in memory at a time."""
    manifest, stations = run.manifest, stations_of(run)
    steps = _steps(run) if any(not facts.period_s for facts in stations) else []
    t0_us = round((manifest.t0_utc or 0.0) * 1e6)
    for facts in stations:
        if station not in (None, facts.name):
            continue
        samples, counters, settings = run.samples(facts.name, columns=COLUMNS), run.counters(facts.name), run.settings(facts.name)
        for port in facts.ports:
            rows = samples[samples["port"] == port]
            utc_us = _micros(rows)
            clock = Clock(facts.period_s, steps, t0_us)
            seconds = clock.seconds(rows["tick"].to_numpy(dtype=np.float64), utc_us)
            counted = counters[counters["port"] == port]
            cycles = _cycles(counted, utc_us, seconds) if has_feeder(facts) else None
            series = _series(facts, rows, seconds, _ordered_s(facts, settings, port, clock), cycles)
            wire = _wire(facts, counted, settings, clock)
            yield facts, port, series, wire, _Moments(seconds, utc_us)


def _ordered_s(facts: StationFacts, settings: pd.DataFrame, port: int, clock: Clock) -> float | None:
    """When the run ordered the tool to work."""
    mine = settings[(settings["port"] == port) & (settings["setting"] == "status") & (settings["outcome"] == "confirmed")]
    mine = mine[mine["requested"] == ORDER_TO_WORK.get(kind_of(facts))]
    return float(clock.of(_micros(mine))[-1]) if len(mine) else None


def _steps(run: Run) -> list[Step]:
    """The steps of the wall clock, also of a run that is open."""
    events = run.events()
    steps = events[(events["kind"] == "clock.step") & events["value"].notna()]
    return [Step(time / 1e6, value) for time, value in zip(steps["time"].astype("int64"), steps["value"], strict=True)]


def _series(facts: StationFacts, rows: pd.DataFrame, seconds: Floats, ordered_s: float | None, cycles: Cycles | None) -> Series:
    temperature, power, setting, tool, error = (
        rows[name].to_numpy(dtype=np.float64, na_value=np.nan)
        for name in ("temperature_c", "power_permille", "set_c", "tool", "port_error")
    )
    working = rows["status"].isin(WORKING).to_numpy(dtype=np.bool_)
    known = rows["status"].notna().to_numpy(dtype=np.bool_)
    motor = rows["motor"]
    feeding = np.where(motor.isna(), np.nan, (motor == PUSHING).to_numpy(dtype=np.float64, na_value=np.nan))
    port_rows = PortRows(seconds, temperature, power, setting, working, known, feeding, tool, error)
    return series_of(facts, port_rows, ordered_s, cycles)


def _wire(facts: StationFacts, counters: pd.DataFrame, settings: pd.DataFrame, clock: Clock) -> Wire | None:
    """The feeder's counter of lengths, and the length that is set where it was read."""
    if not has_feeder(facts):
        return None
    length = _counter(counters, "dispensed_mm")
    told = settings[(settings["setting"] == "feeder_length") & settings["readback"].notna()]["readback"]
    try:
        set_mm = float(told.iloc[-1]) if len(told) else None
    except ValueError:
        set_mm = None
    return Wire(clock.of(_micros(length)), length["value"].to_numpy(dtype=np.float64), set_mm)


def _cycles(counters: pd.DataFrame, rows_us: Counts, seconds: Floats) -> Cycles:
    read = _counter(counters, CYCLES)
    return cycles_of(_micros(read), read["value"].to_numpy(dtype=np.float64), rows_us, seconds)


def _counter(counters: pd.DataFrame, name: str) -> pd.DataFrame:
    return counters[(counters["counter"] == name) & counters["value"].notna()]


def _micros(rows: pd.DataFrame) -> Counts:
    """The times of these rows in UTC microseconds since 1970."""
    return np.asarray(rows["time"].astype("int64"), dtype=np.int64)


def _row(facts: StationFacts, port: int, number: int, joint: Joint, moments: _Moments) -> dict[str, object]:
    draw, energy, rated_w = joint.draw, joint.energy, facts.rated_power_w
    return {
        "station": facts.name,
        "port": port,
        "joint": number,
        "start": moments.at(draw.start_s),
        "end": moments.at(draw.end_s),
        "start_s": round(draw.start_s, 6),
        "end_s": round(draw.end_s, 6),
        "touches": draw.contacts,
        "dwell_s": _tidy(joint.dwell_s),
        "depth_c": _tidy(joint.depth_c),
        "recovery_s": _tidy(joint.recovery_s),
        "peak_permille": _tidy(draw.peak),
        "heat_permille_s": _tidy(draw.heat),
        "energy_permille_s": _tidy(energy),
        "energy_j": None if energy is None or rated_w is None else _tidy(energy * rated_w / 1000),
        "fed": draw.fed,
        "confidence": draw.confidence,
        "why": joint.why,
        "kind": draw.kind,
        "heat_j": _tidy(joint.heat_j),
        "setpoint_c": _tidy(joint.setpoint_c),
        "deficit_c": _tidy(joint.deficit_c),
        "resting_below_c": _tidy(joint.resting_below_c),
        "lowest_c": _tidy(joint.lowest_c),
        "end_c": _tidy(joint.end_c),
        "recovered": joint.recovered,
        "had_s": _tidy(joint.had_s),
    }


def _tidy(value: float | None) -> float | None:
    """To a thousandth, which is below every resolution."""
    return None if value is None or abs(value) == inf else round(value, 3)
