"""The one value of an audit, from which CSV, JSON, page and terminal are all made: a row per station, and per task of it."""

from __future__ import annotations

from dataclasses import dataclass

from jbclog.maintenance.counter_totals.interval import Interval
from jbclog.maintenance.counter_totals.observed import Count, Errors, Fact, Identity
from jbclog.maintenance.counter_totals.totals import CounterTotal, Difference
from jbclog.maintenance.due import State, TaskState

BEFORE, FLEET = "before", "fleet"


@dataclass(frozen=True, slots=True)
class Meter:
    """A counter of a port: what was read now, the odometer behind it, the last difference, the pace (per day, where known)."""

    port: int
    counter: str
    unit: str
    read: Count | None
    odometer: CounterTotal
    last: Difference | None
    per_day: Interval | None


@dataclass(frozen=True, slots=True)
class UseFigure:
    """A figure of a station's use (`use.py`): its range where it has one, null with a reason (`why`) where it is not known.

    `name` is a stable word (``use_percent``, ``idle_hot_h``, ``mm_per_joint``, ...), `title` what people read, `by` the
    definition where there could be another. It rests on `n` differences between readings, over `days`.
    `port` null: all ports together.
    """

    name: str
    title: str
    unit: str
    value: float | None
    range: Interval | None = None
    port: int | None = None
    why: str = ""
    n: int = 0
    days: float | None = None
    by: str = ""


@dataclass(frozen=True, slots=True)
class Week:
    """Seven days from `begin` (UTC date): port hours that were worked a day, null where no two readings tell.

    `is_spread` where readings were further apart than a week, so that a longer time's hours are spread evenly.
    """

    begin: str
    per_day: Interval | None
    is_spread: bool = False


@dataclass(frozen=True, slots=True)
class Drift:
    """Software or a parameter that is not what it was, or not what the fleet has: `than` is ``before`` or ``fleet``.

    From the fleet: `held_by` stations (or ports) of the `of` others alike have what is `expected`.
    """

    name: str
    value: str
    expected: str
    than: str
    held_by: int = 0
    of: int = 0

    @property
    def text(self) -> str:
        """``350, 7 of 8 others have 330``; ``350, was 330 at the last audit``."""
        if self.than == BEFORE:
            return f"{self.value}, was {self.expected} at the last audit"
        return f"{self.value}, {self.held_by} of {self.of} others have {self.expected}"


@dataclass(frozen=True, slots=True)
class StationAudit:
    """A row: a station of the line, as it was seen now (`seen`) or last (`last_seen`), with all that follows from the ledger."""

    line: str
    station: str
    url: str
    seen: bool
    why: str
    source: str
    last_seen: str | None
    audits: int
    identity: Identity | None
    meters: tuple[Meter, ...] = ()
    tasks: tuple[TaskState, ...] = ()
    use: tuple[UseFigure, ...] = ()
    errors: Errors | None = None
    drifts: tuple[Drift, ...] = ()
    weeks: tuple[Week, ...] = ()  # the last 53, oldest first
    notes: tuple[str, ...] = ()  # a sentence for everything that is not as it should be

    @property
    def state(self) -> State:
        """That of the worst task."""
        order = list(State)
        return max((task.state for task in self.tasks), key=order.index, default=State.FINE)

    @property
    def doubts(self) -> tuple[Difference, ...]:
        """Differences since last time that nobody can be sure of."""
        return tuple(meter.last for meter in self.meters if meter.last is not None and meter.last.is_doubtful)


@dataclass(frozen=True, slots=True)
class FleetAudit:
    """All of it. `wrong` are sentences about damaged lines of the ledger; `ledger_head` is the hash of its last line."""

    line: str
    audit: str
    ledger: str
    ledger_head: str
    stations: tuple[StationAudit, ...]
    wrong: tuple[str, ...] = ()
    facts: tuple[Fact, ...] = ()  # what people told, oldest first

    @property
    def is_whole(self) -> bool:
        return all(station.seen for station in self.stations)
