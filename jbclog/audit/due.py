"""How a maintenance task stands, and when its life will have been used."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from jbclog.audit.interval import Interval


class State(StrEnum):
    """How a task stands; the worst of a station's is the station's."""

    FINE = "fine"
    UNKNOWN = "unknown"  # what was used since it was done cannot be told
    SOON = "soon"  # from 80 % on
    DUE = "due"  # from 100 %
    OVERDUE = "overdue"  # from 120 %


@dataclass(frozen=True, slots=True)
class Due:
    """When the task's life will have been used, as UTC dates: with a chance of 10, 50 and 90 % by then. Null: after the horizon."""

    p10: str | None
    p50: str | None
    p90: str | None


@dataclass(frozen=True, slots=True)
class TaskState:
    """One task of one station; `port` null where it is of the whole station.

    `used` and `percent` are intervals; null where nothing is known. `since` is when it was done last, or else since when it is
    counted (`is_told` false). `due` null says why in `why`: ``not enough data: 2 of 4 audits``.
    """

    task: str
    title: str
    port: int | None
    counter: str
    unit: str
    life: float
    used: Interval | None
    percent: Interval | None
    state: State
    since: str | None
    is_told: bool
    part: str = ""
    due: Due | None = None
    why: str = ""
