"""Jobs as the queue sees them, the order of their turns, and when those that wait for a time are due."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from jbclog.config.job_time import JUST_PASSED_S, At, Zone, due


class OnFailure(StrEnum):
    """What a job that fails means for those that have not begun."""

    STOP = "stop"
    SKIP = "skip"
    CONTINUE = "continue"


@dataclass(frozen=True, slots=True)
class Turn:
    """A job as the queue sees it. `places` are what it needs for itself: its stations, and the reader of its units."""

    name: str
    places: frozenset[str]
    after: tuple[str, ...] = ()
    on_failure: OnFailure = OnFailure.STOP
    at: At | None = None


def in_turn(turns: Iterable[Turn]) -> list[Turn]:
    """The jobs in the order in which they take a place: that of the file, but behind those that they wait for.

    The first of them that has not ended can always begin, once what runs has ended and its time has come: no two wait for each
    other. `after` must not go in a circle (`circle`).
    """
    left, placed, found = list(turns), set[str](), list[Turn]()
    while left:
        turn = next(one for one in left if placed.issuperset(one.after))
        left.remove(turn)
        placed.add(turn.name)
        found.append(turn)
    return found


def circle(after: Mapping[str, Sequence[str]]) -> list[str]:
    """Jobs that wait for each other in a circle, the first one again at the end; nothing where there are none."""
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
    """When each of the jobs that wait for a time is due, seconds since 1970 UTC; None where its date is over.

    `turns` in the order of `in_turn`. A job's time is not before that of any that it comes after.
    """
    found: dict[str, float | None] = {}
    earliest: dict[str, float] = {}
    for number, turn in enumerate(turns):
        before = [one for one in turns[:number] if one.name in turn.after or one.places & turn.places]
        earliest[turn.name] = max((earliest[one.name] for one in before), default=begin_s - JUST_PASSED_S)
        if turn.at is not None:
            moment = found[turn.name] = due(turn.at, earliest[turn.name], zone)
            earliest[turn.name] = earliest[turn.name] if moment is None else moment
    return found
