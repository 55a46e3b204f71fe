"""An audit on a terminal, for those who go out with the tips: a line a station, below it what is to be done or looked at."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from jbclog.audit.due import State, TaskState
from jbclog.audit.fleet import FleetAudit, Meter, StationAudit
from jbclog.audit.interval import Interval
from jbclog.audit.observed import Standing

WORDS: Final = {State.FINE: "fine", State.UNKNOWN: "unknown", State.SOON: "soon", State.DUE: "DUE", State.OVERDUE: "OVERDUE"}
UNSEEN: Final = "NOT SEEN"
ABSENT: Final = "nak4"  # the station does not have it, which is nothing to be told each day
NO_ERROR: Final = frozenset({"ok", "normal", "normal, ready"})
SHOWN: Final = "work_h"


def lines(audit: FleetAudit) -> Iterator[str]:
    """The whole table."""
    width = max((len(one.station) for one in audit.stations), default=0)
    several = len({one.line for one in audit.stations}) > 1
    for one in audit.stations:
        yield _station(one, width, several=several)
        yield from (f"{'':8}  {text}" for text in _below(one))


def _station(one: StationAudit, width: int, *, several: bool) -> str:
    word = WORDS[one.state] if one.seen else UNSEEN
    line = f"{one.line}/" if several else ""
    told = _told(one) if one.seen else _unseen(one)
    return f"{word:8}  {line}{one.station:{width}}  {told}".rstrip()


def _told(one: StationAudit) -> str:
    who = one.identity
    model = "" if who is None else " ".join(filter(None, (who.model or who.family, who.software)))
    worked = ", ".join(f"port {meter.port} {_read(meter)}" for meter in one.meters if meter.counter == SHOWN)
    source = f"from {one.source.replace('run:', 'the run ', 1)}" if one.source.startswith("run:") else ""
    return "  ".join(filter(None, (model, worked and f"working hours {worked}", source)))


def _read(meter: Meter) -> str:
    return "?" if meter.read is None or meter.read.value is None else f"{meter.read.value:g}"


def _unseen(one: StationAudit) -> str:
    last = f"last seen {one.last_seen[:16].replace('T', ' ')}" if one.last_seen else "never seen"
    return f"{one.why} ({last})"


def _below(one: StationAudit) -> Iterator[str]:
    """What is to be done, then what is to be looked at."""
    order = list(State)
    for task in sorted(one.tasks, key=lambda task: -order.index(task.state)):
        if task.state is not State.FINE:
            yield f"{WORDS[task.state]:8}{_task(task)}"
    yield from (f"suspect {_place(doubt.port)}{doubt.counter}: {doubt.text}" for doubt in one.doubts)
    yield from filter(None, map(_unread, one.meters))
    yield from _errors(one)
    yield from (f"drift   {drift.name}: {drift.text}" for drift in one.drifts)
    yield from (f"note    {note}" for note in one.notes)
    if one.seen and one.why:
        yield f"note    {one.why}"


def _task(task: TaskState) -> str:
    part = f" ({task.part})" if task.part else ""
    used = "" if task.percent is None else f", {_percent(task.percent)} of {task.life:g} {task.unit} used"
    return f"{_place(task.port)}{task.title or task.task}{part}{used}{_due(task)}"


def _percent(found: Interval) -> str:
    low, high = math.floor(found.low), math.ceil(found.high) if math.isfinite(found.high) else None
    if high is None:
        return f"{low} % or more"
    return f"{low} %" if low == high else f"{low} to {high} %"


def _due(task: TaskState) -> str:
    due = task.due
    if due is None:
        return f"; {task.why}" if task.why else ""
    return f"; due between {due.p10 or 'later'} and {due.p90 or 'later'}, likely {due.p50 or 'later'}"


def _unread(meter: Meter) -> str:
    read = meter.read
    if read is None or read.standing is Standing.OK or read.why == ABSENT:
        return ""
    values = ", ".join(f"{value:g}" for value in read.values)
    if read.standing is Standing.MOVING:
        return f"moving  {_place(meter.port)}{meter.counter}: {values}; no two reads were the same"
    return f"unread  {_place(meter.port)}{meter.counter}: {read.why}"


def _errors(one: StationAudit) -> Iterator[str]:
    if one.errors is None:
        return
    if one.errors.station is not None and one.errors.station not in NO_ERROR:
        yield f"error   station: {one.errors.station}"
    yield from (f"error   port {port}: {text}" for port, text in one.errors.ports.items() if text not in NO_ERROR)


def _place(port: int | None) -> str:
    return "" if port is None else f"port {port} "
