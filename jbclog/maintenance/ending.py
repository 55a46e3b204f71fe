"""What an audit comes to: the findings that it may end with, and the exit code (docs/reference/exit-codes.md)."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from enum import StrEnum
from typing import Final

from jbclog.maintenance.counter_totals.observed import Standing
from jbclog.maintenance.due import State
from jbclog.maintenance.fleet import FleetAudit, StationAudit

ABSENT: Final = "nak4"  # the station does not have that counter


class Finding(StrEnum):
    """What `--fail-on` can name."""

    OVERDUE = "overdue"
    DUE = "due"
    SOON = "soon"
    SUSPECT = "suspect"  # a difference that nobody can be sure of, or a counter on which no two reads agreed
    DRIFT = "drift"
    UNSEEN = "unseen"  # a station that did not answer, or did not tell all of its counters


USUAL: Final = (Finding.OVERDUE, Finding.DUE, Finding.SUSPECT, Finding.UNSEEN)
_TASKS: Final = {State.OVERDUE: Finding.OVERDUE, State.DUE: Finding.DUE, State.SOON: Finding.SOON}


def findings(station: StationAudit) -> set[Finding]:
    """Everything that there is to find at this station."""
    return set(_found(station))


def _found(station: StationAudit) -> Iterator[Finding]:
    yield from (_TASKS[task.state] for task in station.tasks if task.state in _TASKS)
    if station.doubts:
        yield Finding.SUSPECT
    if station.drifts:
        yield Finding.DRIFT
    if not station.seen:
        yield Finding.UNSEEN
        return
    for meter in station.meters:
        if meter.read is not None and meter.read.standing is Standing.MOVING:
            yield Finding.SUSPECT
        if meter.read is not None and meter.read.standing is Standing.UNREAD and meter.read.why != ABSENT:
            yield Finding.UNSEEN


def exit_code(audit: FleetAudit, fail_on: Collection[Finding] = USUAL) -> int:
    """3 where a station was not seen, else 1 where something is due or suspect; 0 where all is fine. The ledger is not in it."""
    found = {one for station in audit.stations for one in findings(station)} & set(fail_on)
    if Finding.UNSEEN in found:
        return 3
    return 1 if found else 0
