"""Start times and order of the jobs of a batch."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta, tzinfo
from enum import StrEnum
from graphlib import CycleError, TopologicalSorter
from typing import Final

# Times of day are local. ``22:00`` is the next 22:00; a time that has just passed counts as now,
# for a batch started a little late. Jobs in sequence form a timetable: a later job's time is never
# before an earlier job's, so ``02:00`` after ``22:00`` means the next morning. Daylight saving: a
# skipped time means the moment of the skip, as in cron; a repeated time means its next occurrence.

JUST_PASSED_S: Final = 600.0
DAYS: Final = 3  # a day may lack the time, or be past it
AT_ALLOWED: Final = 'a time of day such as "22:00", or a date with it such as "2026-11-22 02:30"'
_AT: Final = re.compile(r"(?:(\d{4}-\d{2}-\d{2})[ T])?(\d{2}:\d{2}(?::\d{2})?)", re.ASCII)


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


def due(at: At, after_s: float, zone: tzinfo | None = None) -> float | None:
    """Return the first due time from `after_s`, in s since 1970 UTC; None if its date is over.
    `zone` None: the local time of this computer.
    """
    if at.date is not None:
        days = [at.date]
    else:
        first = datetime.fromtimestamp(after_s, zone).date() - timedelta(days=1)
        days = [first + timedelta(days=number) for number in range(DAYS + 1)]
    moments = sorted(
        moment for day in days for moment in _moments(datetime.combine(day, at.time), zone)
    )
    return next((moment for moment in moments if moment >= after_s), None)


def _moments(wall: datetime, zone: tzinfo | None) -> list[float]:
    """Return the moments of a local time: one, two, or the moment of the skip."""

    def wall_at(utc_s: float) -> datetime:
        return datetime.fromtimestamp(utc_s, zone).replace(tzinfo=None, fold=0)

    both = {wall.replace(tzinfo=zone, fold=fold).timestamp() for fold in (0, 1)}
    shown = sorted(moment for moment in both if wall_at(moment) == wall)
    if shown:
        return shown
    around = range(int(min(both)), int(max(both)) + 1)
    return [float(around[bisect_left(around, wall, key=wall_at)])]


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
    try:
        TopologicalSorter(after).prepare()
    except CycleError as error:
        way: list[str] = error.args[1]
        return way[::-1]
    return []


def due_times(
    turns: Sequence[Turn], begin_s: float, zone: tzinfo | None = None
) -> dict[str, float | None]:
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
