"""Start times and order of the jobs of a batch."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta
from enum import StrEnum
from typing import Final, Protocol

# Times of day are local. ``22:00`` is the next 22:00; a time that has just passed counts as now,
# for a batch started a little late. Jobs in sequence form a timetable: a later job's time is never
# before an earlier job's, so ``02:00`` after ``22:00`` means the next morning. Daylight saving: a
# skipped time means the moment of the skip, as in cron; a repeated time means its next occurrence.

JUST_PASSED_S: Final = 600.0
DAYS: Final = 3  # a day may lack the time, or be past it
AT_ALLOWED: Final = 'a time of day such as "22:00", or a date with it such as "2026-11-22 02:30"'
_AT: Final = re.compile(r"(?:(\d{4}-\d{2}-\d{2})[ T])?(\d{2}:\d{2}(?::\d{2})?)", re.ASCII)


class Zone(Protocol):
    """Local time: the system's, or that of a named zone in tests."""

    def utc(self, wall: datetime) -> float:
        """Convert a local time to seconds since 1970 UTC; `fold` selects one of two."""

    def wall(self, utc_s: float) -> datetime:
        """Convert to local time, without a zone."""


class SystemZone:
    """The local time of this computer."""

    @staticmethod
    def utc(wall: datetime) -> float:
        return wall.timestamp()

    @staticmethod
    def wall(utc_s: float) -> datetime:
        return datetime.fromtimestamp(utc_s)  # noqa: DTZ006  # local time is intended


@dataclass(frozen=True, slots=True)
class At:
    """A time of day, on a given date or on any."""

    time: time
    date: date | None = None

    def __str__(self) -> str:
        shown = self.time.strftime("%H:%M:%S" if self.time.second else "%H:%M")
        return shown if self.date is None else f"{self.date} {shown}"


def read_at(text: str) -> At | None:
    """Parse a time of day; None for other text."""
    found = _AT.fullmatch(text.strip())
    if found is None:
        return None
    try:
        return At(
            time.fromisoformat(found[2]), None if found[1] is None else date.fromisoformat(found[1])
        )
    except ValueError:
        return None


def due(at: At, after_s: float, zone: Zone) -> float | None:
    """Return the first due time from `after_s`, in s since 1970 UTC; None if its date is over."""
    if at.date is not None:
        days = [at.date]
    else:
        first = zone.wall(after_s).date() - timedelta(days=1)
        days = [first + timedelta(days=number) for number in range(DAYS + 1)]
    moments = sorted(
        moment for day in days for moment in _moments(datetime.combine(day, at.time), zone)
    )
    return next((moment for moment in moments if moment >= after_s), None)


def _moments(wall: datetime, zone: Zone) -> list[float]:
    """Return the moments of a local time: one, two, or the moment of the skip."""
    both = sorted({zone.utc(wall.replace(fold=0)), zone.utc(wall.replace(fold=1))})
    shown = [moment for moment in both if zone.wall(moment).replace(fold=0) == wall]
    return shown or [_skip(wall, both[0], both[-1], zone)]


def _skip(wall: datetime, before: float, behind: float, zone: Zone) -> float:
    """Return the first whole second from `before` to `behind` whose local time is not before
    `wall`.
    """
    low, high = int(before) - 1, int(behind) + 1
    while high - low > 1:
        middle = (low + high) // 2
        if zone.wall(middle).replace(fold=0) >= wall:
            high = middle
        else:
            low = middle
    return float(high)


class OnFailure(StrEnum):
    """What a failed job does to jobs not yet started."""

    STOP = "stop"
    SKIP = "skip"
    CONTINUE = "continue"


@dataclass(frozen=True, slots=True)
class Turn:
    """A job in the queue. `places`: resources that it needs exclusively (stations, its units'
    reader).
    """

    name: str
    places: frozenset[str]
    after: tuple[str, ...] = ()
    on_failure: OnFailure = OnFailure.STOP
    at: At | None = None


def in_turn(turns: Iterable[Turn]) -> list[Turn]:
    """Return the jobs in the order in which they take places: file order, but after the jobs they
    wait for.

    So the first unfinished job can always start once running jobs have ended and its time has come;
    no two wait for each other. `after` must have no cycle (`circle`).
    """
    left, placed, found = list(turns), set[str](), list[Turn]()
    while left:
        turn = next(one for one in left if placed.issuperset(one.after))
        left.remove(turn)
        placed.add(turn.name)
        found.append(turn)
    return found


def circle(after: Mapping[str, Sequence[str]]) -> list[str]:
    """Return a cycle of jobs that wait for each other, with the first repeated at the end; empty if
    there is none.
    """
    left = dict(after)
    while True:
        free = [name for name, others in left.items() if not any(one in left for one in others)]
        if not free:
            break
        for name in free:
            del left[name]
    return _around(left) if left else []


def _around(left: Mapping[str, Sequence[str]]) -> list[str]:
    way = [next(iter(left))]
    while way[-1] not in way[:-1]:
        way.append(next(one for one in left[way[-1]] if one in left))
    return way[way.index(way[-1]) :]


def due_times(turns: Sequence[Turn], begin_s: float, zone: Zone) -> dict[str, float | None]:
    """Return the due time of each job that waits for a time, in seconds since 1970 UTC; None if its
    date is over.

    `turns` in the order of `in_turn`. A job is never due before the jobs it comes after.
    """
    found: dict[str, float | None] = {}
    earliest: dict[str, float] = {}
    for number, turn in enumerate(turns):
        before = [
            one for one in turns[:number] if one.name in turn.after or one.places & turn.places
        ]
        earliest[turn.name] = max(
            (earliest[one.name] for one in before), default=begin_s - JUST_PASSED_S
        )
        if turn.at is not None:
            moment = found[turn.name] = due(turn.at, earliest[turn.name], zone)
            earliest[turn.name] = earliest[turn.name] if moment is None else moment
    return found
