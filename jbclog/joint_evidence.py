"""The joints of a sealed run as evidence for its verdict: from its Parquet files, without pandas.

The recorder calls it when the run has ended, `report` when it judges again; both so come to the same. It takes scipy and some
time, and is asked only for stations whose recipe has a limit about joints.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import ceil
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.features import Asked, Cycles, Joint, Series, find_joints
from jbclog.features.asked import asked_of
from jbclog.features.feeds import feeds_of
from jbclog.features.joints import Found as JointsFound
from jbclog.features.port_rows import COLUMNS, CYCLES, PUSHING, WORKING, Clock, PortRows, cycles_of, series_of
from jbclog.judge import PortJoints, Recovery
from jbclog.judge.idle import Flags, Floats
from jbclog.judge.rules import has_feeder, has_tip
from jbclog.judge.samples import Counts
from jbclog.judge.stepped import steps_of
from jbclog.record.joints_asked import joints_asked
from jbclog.record.parts import row_groups
from jbclog.record.schema import SCHEMAS
from jbclog.rows import StationFacts

MOST_ROWS: Final = 1_000_000  # at once in memory, some 100 MB
COUNTERS: Final = ["time", "station", "port", "counter", "value"]
Found = dict[tuple[str, int], PortJoints]


def joint_evidence(folder: Path, stations: Sequence[StationFacts], t0_utc: float | None) -> Found:
    """The joints of each port of these stations that has a tip; `t0_utc` is the manifest's."""
    steps, t0_us, found = steps_of(folder), round((t0_utc or 0.0) * 1e6), Found()
    for some in _at_once([facts for facts in stations if has_tip(facts)]):
        samples = _of_stations(folder, "samples", COLUMNS, [facts.name for facts in some])
        for facts in some:
            clock, rows = Clock(facts.period_s, steps, t0_us), samples.filter(pc.equal(samples["station"], facts.name))
            asked = asked_of(joints_asked(folder, facts))
            counters = _of_stations(folder, "counters", COUNTERS, [facts.name]) if has_feeder(facts) else None
            for port in facts.ports:
                found[facts.name, port] = _port(
                    facts,
                    _of_port(rows, port),
                    None if counters is None else _of_port(counters, port),
                    clock,
                    asked,
                )
    return found


def _at_once(stations: Sequence[StationFacts]) -> Iterator[list[StationFacts]]:
    """As many stations together as fit into memory."""
    held: list[StationFacts] = []
    for facts in stations:
        if held and sum(map(_rows, [*held, facts])) > MOST_ROWS:
            yield held
            held = []
        held.append(facts)
    if held:
        yield held


def _rows(facts: StationFacts) -> int:
    return len(facts.ports) * ((facts.last_tick or 0) - (facts.first_tick or 0) + 1)


def _of_stations(folder: Path, table: str, columns: list[str], names: list[str]) -> pa.Table:
    wanted = pa.array(names, pa.string())
    pieces = [group.filter(pc.is_in(group["station"], wanted)) for group in row_groups(folder, table, columns)]
    return pa.concat_tables(pieces) if pieces else SCHEMAS[table].empty_table().select(columns)


def _of_port(rows: pa.Table, port: int) -> pa.Table:
    return rows.filter(pc.equal(rows["port"], port))


def _port(facts: StationFacts, rows: pa.Table, counters: pa.Table | None, clock: Clock, asked: Asked) -> PortJoints:
    if not rows.num_rows:
        return PortJoints(why="Nothing was recorded at all.")
    port_rows = _port_rows(rows, clock)
    cycles = None if counters is None else _cycles(counters, _micros(rows), port_rows.seconds)
    series = series_of(facts, port_rows, cycles=cycles)
    found = find_joints(series, asked)
    recoveries = [_recovery(joint) for joint in found.joints]
    feeds = None
    if counters is not None and found.heat_why is None:
        stepped_s = sum(abs(step.size_s) for step in clock.steps)
        feeds = feeds_of(series, found.by_heat, stepped_s)
    return PortJoints(recoveries, feeds, found.heat_why, _hidden(series, found), found.unseen_s)


def _hidden(series: Series, found: JointsFound) -> int:
    """How many joints there may be where nothing was read: one in each piece, or as many as elsewhere in that time."""
    seen_s = len(series.seconds) * series.period_s - found.unseen_s
    rate = len(found.joints) / seen_s if seen_s > 0 else 0.0
    return max(found.unseen, ceil(rate * found.unseen_s))


def _recovery(joint: Joint) -> Recovery | None:
    """What the judge has to know of a joint; None where nothing is known of its recovery."""
    if joint.recovery_s is not None:
        return Recovery(round(joint.recovery_s, 6), True)
    return None if joint.had_s is None else Recovery(round(joint.had_s, 6), joint.recovered)


def _port_rows(rows: pa.Table, clock: Clock) -> PortRows:
    status, motor = rows["status"], rows["motor"]
    return PortRows(
        clock.seconds(_floats(rows["tick"]), _micros(rows)),
        _floats(rows["temperature_c"]),
        _floats(rows["power_permille"]),
        _floats(rows["set_c"]),
        _flags(pc.fill_null(pc.is_in(status, pa.array(WORKING)), False)),
        _flags(pc.is_valid(status)),
        _floats(pc.equal(motor, PUSHING).cast(pa.int8())),
        _floats(rows["tool"]),
        _floats(rows["port_error"]),
    )


def _cycles(counters: pa.Table, rows_us: Counts, seconds: Floats) -> Cycles:
    read = counters.filter(pc.and_(pc.equal(counters["counter"], CYCLES), pc.is_valid(counters["value"])))
    return cycles_of(_micros(read), _floats(read["value"]), rows_us, seconds)


def _micros(rows: pa.Table) -> Counts:
    return np.asarray(rows["time"].cast(pa.int64()).to_numpy(), dtype=np.int64)


def _floats(column: pa.ChunkedArray) -> Floats:
    """With NaN for what was not read."""
    return np.asarray(column.cast(pa.float64()).to_numpy(), dtype=np.float64)


def _flags(column: pa.ChunkedArray) -> Flags:
    return np.asarray(column.to_numpy(), dtype=np.bool_)
