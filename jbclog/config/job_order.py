"""When and in which order the jobs of a batch may start."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta
from enum import StrEnum
from typing import Final, Protocol

# Times of day are local. ``22:00`` is the next 22:00; one that has just passed counts as now, for a
# batch started a little late. Jobs in sequence form a timetable: a later job's time comes after
# those before it, so ``02:00`` behind ``22:00`` is the next morning's. Daylight saving: a skipped
# time is the moment of the skip, as in cron; of a repeated one the next counts.

JUST_PASSED_S: Final = 600.0
DAYS: Final = 3  # a day may have no such time, or have had it
AT_ALLOWED: Final = 'a time of day such as "22:00", or a date with it such as "2026-11-22 02:30"'
_AT: Final = re.compile(r"(?:(\d{4}-\d{2}-\d{2})[ T])?(\d{2}:\d{2}(?::\d{2})?)", re.ASCII)


class Zone(Protocol):
    """Local time. Its two ways are those of the system, or of a zone by name in a test."""

    def utc(self, wall: datetime) -> float:
        """Return seconds since 1970 UTC of a local time; `fold` selects one of two."""

    def wall(self, utc_s: float) -> datetime:
        """Return the local time, without a zone."""


class SystemZone:
    """Return this computer's local time."""

    @staticmethod
    def utc(wall: datetime) -> float:
        return wall.timestamp()

    @staticmethod
    def wall(utc_s: float) -> datetime:
        return datetime.fromtimestamp(utc_s)  # noqa: DTZ006  # what the clock on the wall shows is what is wanted


@dataclass(frozen=True, slots=True)
class At:
    """A time of day, on a date or on any."""

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
    """Return the first whole second between the two with a later local time."""
    low, high = int(before) - 1, int(behind) + 1
    while high - low > 1:
        middle = (low + high) // 2
        if zone.wall(middle).replace(fold=0) >= wall:
            high = middle
        else:
            low = middle
    return float(high)


class OnFailure(StrEnum):
    """What happens to jobs not yet begun if a job fails."""

    STOP = "stop"
    SKIP = "skip"
    CONTINUE = "continue"


@dataclass(frozen=True, slots=True)
class Turn:
    """A job in the queue. `places`: what it needs for itself: stations, its units' reader."""

    name: str
    places: frozenset[str]
    after: tuple[str, ...] = ()
    on_failure: OnFailure = OnFailure.STOP
    at: At | None = None


def in_turn(turns: Iterable[Turn]) -> list[Turn]:
    """The jobs in the order in which they take a place: that of the file, but behind those that
    they wait for.

    The first of them that has not ended can always begin, once what runs has ended and its time has
    come: no two wait for each other. `after` must not go in a circle (`circle`).
    """
    left, placed, found = list(turns), set[str](), list[Turn]()
    while left:
        turn = next(one for one in left if placed.issuperset(one.after))
        left.remove(turn)
        placed.add(turn.name)
        found.append(turn)
    return found


def circle(after: Mapping[str, Sequence[str]]) -> list[str]:
    """Return jobs that wait for each other in a circle, the first again at the end; else empty."""
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
    """When each of the jobs that wait for a time is due, seconds since 1970 UTC; None where its
    date is over.

    `turns` in the order of `in_turn`. A job's time is not before that of any that it comes after.
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
