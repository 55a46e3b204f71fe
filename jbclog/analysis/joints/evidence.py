"""The joints of a sealed run as evidence for its verdict, from its Parquet files, without pandas.

Called by the recorder at the end of a run and by `report` when it judges again, so that both get
the same result. Needs scipy and some time; runs only for stations whose recipe has a limit on
joints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from math import ceil
from pathlib import Path
from typing import Final, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.clock_steps import steps_in
from jbclog.analysis.joints.draws import Draw
from jbclog.analysis.joints.joints import FoundJoints, find_joints
from jbclog.analysis.joints.parameters import JointOptions, options_of
from jbclog.analysis.joints.port_reader import (
    PortReader,
    floats,
    micros,
)
from jbclog.analysis.joints.port_rows import COLUMNS, CYCLES, cycles_of
from jbclog.analysis.joints.recovery import Joint
from jbclog.analysis.joints.series import Cycles, Series
from jbclog.analysis.joints.solder_wire import counter_span, feeds_counted
from jbclog.analysis.joints.sweeps import Identified, PortSweeps
from jbclog.analysis.port_data import Counts, Floats, has_tip
from jbclog.analysis.verdict import Feeds, PortJoints, Recovery
from jbclog.analysis.verdict.rules import has_feeder
from jbclog.core.rows import PortKey, StationFacts
from jbclog.record.clock_steps import COLUMNS as COLUMNS_OF_STEPS
from jbclog.record.folder import joints_asked
from jbclog.record.parts import row_groups
from jbclog.record.samples_by_port import SamplesByPort, samples_by_port
from jbclog.record.schema import SCHEMAS

EDGE_S: Final = 1.0
NOTHING_RECORDED: Final = "Nothing was recorded at all."
COUNTERS: Final = ["time", "station", "port", "counter", "value"]
Evidence = dict[PortKey, PortJoints]
Read = Callable[[str, list[str]], Iterable[pa.Table]]
"""Reads these columns of a table of a run, in order, in pieces."""


class PortFound(NamedTuple):
    """The joints of a port, its number of rows, their period, and the time of the last row.
    `series` is set with a feeder, `identified` without one.
    """

    found: FoundJoints
    rows: int
    period_s: float
    last_s: float
    series: Series | None = None
    identified: Identified | None = None


def joint_evidence(
    folder: Path, stations: Sequence[StationFacts], t0_utc: float | None
) -> Evidence:
    """Return the joints of each port of these stations that has a tip; `t0_utc` is that of the
    manifest.
    """

    read = partial(row_groups, folder)
    stepped_s = sum(abs(step.size_s) for step in steps_in(read("events", COLUMNS_OF_STEPS)))
    samples = samples_by_port(folder, COLUMNS)
    found = ports_found(folder, read, samples, stations, t0_utc)
    return {key: _port_joints(port, stepped_s) for key, port in found.items()}


def ports_found(
    folder: Path,
    read: Read,
    samples: SamplesByPort,
    stations: Sequence[StationFacts],
    t0_utc: float | None,
) -> dict[PortKey, PortFound]:
    """Return the joints of each port of these stations that has a tip.

    `read` returns the rows of the other tables; `folder` has the recipes. Ports without a feeder
    are read in windows (`sweeps`), the others as a whole.
    """
    steps = steps_in(read("events", COLUMNS_OF_STEPS))
    t0_us = round((t0_utc or 0.0) * 1e6)
    found: dict[PortKey, PortFound] = {}
    for facts in stations:
        if not has_tip(facts):
            continue
        options = options_of(joints_asked(folder, facts))
        counters = _counters(read, facts.name) if has_feeder(facts) else None
        for port in facts.ports:
            reader = PortReader(facts, port, samples, steps, t0_us)
            if counters is None:
                found[facts.name, port] = _in_windows(reader, options)
            else:
                of_port = counters.filter(pc.equal(counters["port"], port))
                found[facts.name, port] = _whole(reader, of_port, options)
    return found


def _in_windows(reader: PortReader, options: JointOptions) -> PortFound:
    port = PortSweeps(options)
    reader.sweep(port)
    return PortFound(
        port.found, reader.rows, reader.period_s, reader.last_s, identified=port.identified
    )


def _whole(reader: PortReader, counters: pa.Table, options: JointOptions) -> PortFound:
    plain, utc_us = reader.whole()
    series = replace(plain, cycles=_cycles(counters, utc_us, plain.moments))
    last_s = float(series.seconds[-1]) if len(series.seconds) else 0.0
    joints = find_joints(series, options)
    return PortFound(joints, len(series.seconds), series.period_s, last_s, series)


def _port_joints(port: PortFound, stepped_s: float) -> PortJoints:
    found = port.found
    if not port.rows:
        return PortJoints(why=NOTHING_RECORDED)
    feeds = None
    if port.series is not None and found.heat_why is None:
        why = found.number_why
        feeds = (
            feeds_of(port.series, found.by_heat, stepped_s)
            if why is None
            else Feeds(0, 0, 0, None, why=why)
        )
    recoveries = [_recovery(joint) for joint in found.joints]
    unseen_joints = _possibly_unseen(port.rows * port.period_s, found)
    return PortJoints(recoveries, feeds, found.heat_why or found.why, unseen_joints, found.unseen_s)


def _counters(read: Read, station: str) -> pa.Table:
    pieces = [
        group.filter(pc.equal(group["station"], station)) for group in read("counters", COUNTERS)
    ]
    return pa.concat_tables([SCHEMAS["counters"].empty_table().select(COUNTERS), *pieces])


def _possibly_unseen(seconds: float, found: FoundJoints) -> int:
    """Return how many joints may be hidden where nothing was read: one in each piece, or as many as
    elsewhere in that time.
    """
    seen_s = seconds - found.unseen_s
    rate = len(found.joints) / seen_s if seen_s > 0 else 0.0
    return max(found.unseen, ceil(rate * found.unseen_s))


def _recovery(joint: Joint) -> Recovery | None:
    """Return a joint's recovery for the verdict; None if nothing is known of it."""
    if joint.recovery_s is not None:
        return Recovery(round(joint.recovery_s, 6), True)
    return None if joint.had_s is None else Recovery(round(joint.had_s, 6), joint.recovered)


def _cycles(counters: pa.Table, rows_us: Counts, moments: Floats) -> Cycles:
    read = counters.filter(
        pc.and_(pc.equal(counters["counter"], CYCLES), pc.is_valid(counters["value"]))
    )
    return cycles_of(micros(read), floats(read["value"]), rows_us, moments)


def feeds_of(series: Series, draws: Sequence[Draw], stepped_s: float = 0.0) -> Feeds:
    """Return joints found and feeds counted between the first and the last reading of the feeder's
    counter.

    The counter has its time in UTC and the joints are on the run's grid, so the two agree to
    `EDGE_S` and to `stepped_s`, the steps of the wall clock; a joint closer to the first or last
    reading is not known to be inside. If the rows end with the last reading, one more joint may
    have begun that shows no heat yet. `draws` are the joints by heat alone: joints found with the
    help of the feeder must not be compared with the feeder.
    """
    counted = feeds_counted(series)
    if counted.value is None or series.cycles is None:
        return Feeds(0, 0, 0, None, why=counted.why or "")
    start, end = counter_span(series, series.cycles.seconds)
    slack_s = EDGE_S + stepped_s
    near_start, near_end = (
        [draw for draw in draws if _is_near(draw, edge, slack_s)] for edge in (start, end)
    )
    sides = [start <= draw.start_s < end for draw in {*near_start, *near_end}]
    found = sum(start <= draw.start_s < end for draw in draws)
    not_yet_seen = int(not near_end and end >= series.moments[-1] - slack_s)
    beyond = len(sides) - sum(sides) + not_yet_seen
    return Feeds(found, sum(sides), beyond, round(counted.value), _unread_s(series, start, end))


def _is_near(draw: Draw, edge: float, slack_s: float) -> bool:
    return draw.start_s - slack_s <= edge <= draw.end_s + slack_s


def _unread_s(series: Series, start: float, end: float) -> float:
    """Return for how long temperature or power was not read, if there is a gap; single lost rows
    hide no joint.
    """
    windows = [
        series.window(column, start, end) for column in (series.rows.temperature, series.rows.power)
    ]
    return max(
        (window.due - window.n) * series.period_s if window.gap else 0.0 for window in windows
    )
