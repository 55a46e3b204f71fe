"""Joints and metrics of a run, from its samples or as its report stored them.

A table has a row for each joint (`joint_table`) or for each metric of each port (`METRICS`). Works also for a run that is still
open or was cut off, as far as its record goes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from hashlib import file_digest, sha256
from itertools import groupby
from math import inf
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog import __version__
from jbclog.analysis.joint_table import FILE as JOINTS_FILE
from jbclog.analysis.joint_table import JOINTS_SCHEMA, read_joints
from jbclog.analysis.joints.joints import find_joints
from jbclog.analysis.joints.parameters import JointOptions, options_of
from jbclog.analysis.joints.port_reader import MOST_PORTS, MOST_ROWS, Key, PortReader, at_once
from jbclog.analysis.joints.port_rows import CYCLES, Clock, cycles_of, kind_of
from jbclog.analysis.joints.recovery import Joint
from jbclog.analysis.joints.series import Cycles, Series
from jbclog.analysis.joints.solder_wire import Wire
from jbclog.analysis.joints.sweeps import PortSweeps
from jbclog.analysis.metrics.definitions import DEFINITIONS
from jbclog.analysis.metrics.measures import Measured, PortMeasuring, measure_port
from jbclog.analysis.run_tables import RunTables, stations_of
from jbclog.analysis.verdict import RULES
from jbclog.analysis.verdict.idle import Floats
from jbclog.analysis.verdict.rules import has_feeder
from jbclog.analysis.verdict.samples import Counts, Step
from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind, open_foreign, read_foreign
from jbclog.core.foreign.json_reader import json_of
from jbclog.core.rows import StationFacts
from jbclog.record.annotations import read
from jbclog.record.folder import joints_asked
from jbclog.record.manifest import manifest_sha256

# -- stored metrics -----------------------------------------------------------------------------------------------------------
# The metrics as `report` left them in `report.json`: so that many runs are looked at without going through their samples again.
#
# They are taken where that file was made from this very manifest, by this very version and its rules, in which the definitions are
# the same, and where a line of the annotations vouches for its bytes; else they are computed anew.

FILE: Final = "report.json"
METRICS: Final = {
    "station": "str",
    "port": "int64",
    "metric": "str",
    "value": "Float64",
    "unit": "str",
    "n": "int64",
    "coverage": "Float64",
    "resolution": "Float64",
    "why": "str",
}
"""The columns of a table of metrics and their kinds."""


def is_as_written(folder: Path, name: str) -> bool:
    """Whether a file of the report has the bytes that `report.json` says, and a line of the annotations vouches for that one's."""
    try:
        data = read_foreign(folder / FILE, Kind.REPORT)
        if read(folder).report != sha256(data).hexdigest():
            return False
        with open_foreign(folder / name, Kind.OF_REPORT) as file:
            return bool(json_of(data)["written"][name] == file_digest(file, "sha256").hexdigest())
    except (RecordError, OSError, ValueError, TypeError, KeyError, RecursionError):
        return False


def left_metrics(folder: Path, manifest_sha256: str) -> pd.DataFrame | None:
    """The table of all metrics of the run; None where the report does not have it, or is not this run's or this version's."""
    try:
        data = read_foreign(folder / FILE, Kind.REPORT)
        document = json_of(data)
        made_by = document["manifest_sha256"], document["jbclog"], document["rules"]
        if made_by != (manifest_sha256, __version__, RULES) or read(folder).report != sha256(data).hexdigest():
            return None
        rows = document["metrics"]
        return metric_table(rows) if isinstance(rows, list) else None
    except (RecordError, OSError, ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return None


def metric_table(rows: list[dict[str, object]]) -> pd.DataFrame:
    """Rows of metrics as a table. Raises ValueError, TypeError or KeyError where they are none."""
    return pd.DataFrame(rows, columns=list(METRICS)).astype(METRICS)


# -- run metrics --------------------------------------------------------------------------------------------------------------

Moments = Mapping[float, int]
"""The UTC in microseconds of some of a port's grid seconds."""
ORDER_TO_WORK: Final = {"tip": "00000", "air": "00001"}  # status words of W-PS (manuals 000, 001, 002)


def metrics_of(run: RunTables, station: str | None = None) -> pd.DataFrame:
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


def joints_and_metrics(run: RunTables) -> tuple[pa.Table, list[dict[str, object]], list[dict[str, object]]]:
    """The joints of a run as `joints_table` has them, and the rows of `metrics_of`, from one pass over the samples.

    Then what the joints of each port were found with: its `[joints]`, with the values that the run told.
    """
    joints: list[pa.Table] = []
    metrics: list[dict[str, object]] = []
    taken: list[dict[str, object]] = []
    for facts, port, measured, moments in _measured(run, None):
        joints.append(_table(facts, port, measured.joints, moments))
        metrics += [{"station": facts.name, "port": port, **_named(asdict(figure))} for figure in measured.figures]
        taken += [] if measured.found is None else [{"station": facts.name, "port": port, **asdict(measured.found.settings)}]
    return _together(joints), metrics, taken


def definitions() -> pd.DataFrame:
    """What each metric means: `metric`, `unit`, `definition`, `applies_to`."""
    rows = [(one.name, one.unit, one.text, ", ".join(one.of)) for one in DEFINITIONS]
    return pd.DataFrame(rows, columns=["metric", "unit", "definition", "applies_to"])


def joints_table(run: RunTables, station: str | None = None) -> pa.Table:
    """The joints of a run in the order of stations, ports and times."""
    return _together([_table(facts, port, measured.joints, moments) for facts, port, measured, moments in _measured(run, station)])


def _table(facts: StationFacts, port: int, joints: Sequence[Joint], moments: Moments) -> pa.Table:
    """The joints of one port."""
    rows = [_row(facts, port, number, joint, moments) for number, joint in enumerate(joints, 1)]
    return pa.Table.from_pylist(rows, schema=JOINTS_SCHEMA)


def _together(ports: Sequence[pa.Table]) -> pa.Table:
    return pa.concat_tables([JOINTS_SCHEMA.empty_table(), *ports]).combine_chunks()


def joints_of(run: RunTables, station: str | None = None) -> pa.Table:
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


def joint_count(run: RunTables, ended_s: float | None = None) -> int:
    """How many joints there are, as many as in `joints_table`; only those that ended so long before their port's last row."""
    count = 0
    stations = [facts for facts in stations_of(run) if kind_of(facts) == "tip"]
    for some in at_once([facts for facts in stations if not has_feeder(facts)], lambda facts: len(facts.ports), MOST_PORTS):
        reader = _reader(run, some)
        ports = {(facts.name, port): PortSweeps(_asked(run, facts)) for facts in some for port in facts.ports}
        reader.sweep(ports)
        count += sum(_ended(one.found.joints, reader.last_s(key), ended_s) for key, one in ports.items())
    for facts in filter(has_feeder, stations):
        for _, series, _, _ in _ports(run, facts):
            last_s = float(series.seconds[-1]) if len(series.seconds) else 0.0
            count += _ended(find_joints(series, _asked(run, facts)).joints, last_s, ended_s)
    return count


def _ended(joints: Sequence[Joint], last_s: float, ended_s: float | None) -> int:
    latest = inf if ended_s is None else last_s - ended_s
    return sum(joint.end_s <= latest for joint in joints)


def _asked(run: RunTables, facts: StationFacts) -> JointOptions:
    return options_of(joints_asked(run.folder, facts))


def _measured(run: RunTables, station: str | None) -> Iterator[tuple[StationFacts, int, Measured, Moments]]:
    """Each port of each station, measured: those without a feeder in windows, the others as a whole."""
    wanted = [facts for facts in stations_of(run) if station in (None, facts.name)]
    for fed, stations in groupby(wanted, has_feeder):
        if not fed:
            for some in at_once(list(stations), lambda facts: len(facts.ports), MOST_PORTS):
                yield from _in_windows(run, some)
            continue
        for facts in stations:
            for port, series, wire, utc_us in _ports(run, facts):
                measured = measure_port(series, kind_of(facts), wire, _asked(run, facts))
                yield facts, port, measured, _moments(series.seconds, utc_us, measured.joints)


def _in_windows(run: RunTables, stations: Sequence[StationFacts]) -> Iterator[tuple[StationFacts, int, Measured, Moments]]:
    """The ports of these stations, none with a feeder; no more than a window of each is in memory."""
    reader = _reader(run, stations)
    ports: dict[Key, PortMeasuring] = {}
    every_setting = run.settings()
    for facts in stations:
        settings, asked = every_setting[every_setting["station"] == facts.name], _asked(run, facts)
        for port in facts.ports:
            ordered_s = _ordered_s(facts, settings, port, reader.clock((facts.name, port)))
            like = replace(reader.like((facts.name, port)), ordered_s=ordered_s)
            ports[facts.name, port] = PortMeasuring(kind_of(facts), like, asked)
    reader.sweep(ports)
    every = {key: port.measured for key, port in ports.items()}
    moments = reader.utc_us({key: _edges(measured.joints) for key, measured in every.items()})
    for facts in stations:
        for port in facts.ports:
            yield facts, port, every[facts.name, port], moments[facts.name, port]


def _reader(run: RunTables, stations: Sequence[StationFacts]) -> PortReader:
    steps = _steps(run) if any(not facts.period_s for facts in stations) else []
    t0_us = round((run.manifest.t0_utc or 0.0) * 1e6)
    return PortReader(stations, lambda columns: run.groups("samples", columns), steps, t0_us, MOST_ROWS)


def _edges(joints: Sequence[Joint]) -> list[float]:
    """The moments of which a table of joints has the times."""
    return [moment for joint in joints for moment in (joint.start_s, joint.end_s)]


def _moments(seconds: Floats, utc_us: Counts, joints: Sequence[Joint]) -> Moments:
    """The times of the rows at the edges of joints, or next behind them."""
    edges = _edges(joints)
    places = np.clip(np.searchsorted(seconds, np.array(edges) - 1e-6), 0, len(seconds) - 1)
    return dict(zip(edges, utc_us[places].tolist(), strict=True)) if edges else {}


def _ports(run: RunTables, facts: StationFacts) -> Iterator[tuple[int, Series, Wire, Counts]]:
    """The ports of a station with a feeder, all its samples in memory: their rows, the feeder's counter, and the rows' UTC."""
    reader, counters, settings = _reader(run, [facts]), run.counters(facts.name), run.settings(facts.name)
    for key, (series, utc_us) in reader.whole().items():
        port, clock, counted = key[1], reader.clock(key), counters[counters["port"] == key[1]]
        cycles, ordered_s = _cycles(counted, utc_us, series.seconds), _ordered_s(facts, settings, port, clock)
        yield port, replace(series, ordered_s=ordered_s, cycles=cycles), _wire(counted, settings, clock), utc_us


def _ordered_s(facts: StationFacts, settings: pd.DataFrame, port: int, clock: Clock) -> float | None:
    """When the run ordered the tool to work."""
    mine = settings[(settings["port"] == port) & (settings["setting"] == "status") & (settings["outcome"] == "confirmed")]
    mine = mine[mine["requested"] == ORDER_TO_WORK.get(kind_of(facts))]
    return float(clock.of(_micros(mine))[-1]) if len(mine) else None


def _steps(run: RunTables) -> list[Step]:
    """The steps of the wall clock, also of a run that is open."""
    events = run.events()
    steps = events[(events["kind"] == "clock.step") & events["value"].notna()]
    return [Step(time / 1e6, value) for time, value in zip(steps["time"].astype("int64"), steps["value"], strict=True)]


def _wire(counters: pd.DataFrame, settings: pd.DataFrame, clock: Clock) -> Wire:
    """The feeder's counter of lengths, and the length that is set where it was read."""
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


def _row(facts: StationFacts, port: int, number: int, joint: Joint, moments: Moments) -> dict[str, object]:
    draw, energy, rated_w = joint.draw, joint.energy, facts.rated_power_w
    return {
        "station": facts.name,
        "port": port,
        "joint": number,
        "start": moments[draw.start_s],
        "end": moments[draw.end_s],
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
