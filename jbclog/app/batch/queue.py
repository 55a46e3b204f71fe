"""What may begin now. In turn on one place, side by side on different ones, in the file's order.

A job that waits, for its time or for others, keeps its place in the queue: what stands behind it and needs the same station waits
as well. So the file is what happens, whatever takes how long.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from jbclog.app.batch.entry import State
from jbclog.app.batch.state import BatchState
from jbclog.config.job_order import OnFailure, Turn

DONE_FOR = frozenset({State.FAILED, State.HALF, State.NOT_FINE})


@dataclass(frozen=True, slots=True)
class Waits:
    """A job that cannot begin yet. `why` is for people; `until` the moment that it waits for, if that is all."""

    name: str
    why: str
    until: float | None = None


@dataclass(frozen=True, slots=True)
class Next:
    """What comes next: jobs that can begin now, those that are not done and why, those that wait."""

    begin: tuple[str, ...] = ()
    skip: tuple[tuple[str, str], ...] = ()
    wait: tuple[Waits, ...] = ()


def whats_next(turns: Sequence[Turn], standing: BatchState, now: float) -> Next:
    """What comes next at `now` (seconds since 1970 UTC). `turns` in the order of `in_turn`.

    A line that was stopped begins and skips nothing more. Skipping comes alone: what it means for others is asked next.
    """
    if standing.stopped_by is not None or standing.ended_by is not None:
        return Next()
    skipped = tuple(_skipped(turns, standing))
    if skipped:
        return Next(skip=skipped)
    taken = {place: name for name in _running(standing) for place in _places(turns, name)}
    begin: list[str] = []
    wait: list[Waits] = []
    for turn in turns:
        if standing.jobs[turn.name].state is not State.WAITING:
            continue
        waits = _why_waits(turn, standing, taken, now)
        if waits is None:
            begin.append(turn.name)
        else:
            wait.append(waits)
        for place in turn.places:
            taken.setdefault(place, turn.name)
    return Next(tuple(begin), wait=tuple(wait))


def _running(standing: BatchState) -> list[str]:
    return [job.name for job in standing.running()]


def _places(turns: Sequence[Turn], name: str) -> frozenset[str]:
    return next(turn.places for turn in turns if turn.name == name)


def _skipped(turns: Sequence[Turn], standing: BatchState) -> Iterator[tuple[str, str]]:
    policies = {turn.name: turn.on_failure for turn in turns}
    for turn in turns:
        if standing.jobs[turn.name].state is State.WAITING:
            for other in turn.after:
                state = standing.jobs[other].state
                if state is State.SKIPPED or (state in DONE_FOR and policies[other] is OnFailure.SKIP):
                    yield turn.name, f"it waits for {other}, which is {state.value}"
                    break


def _why_waits(turn: Turn, standing: BatchState, taken: dict[str, str], now: float) -> Waits | None:
    others = [name for name in turn.after if not standing.jobs[name].is_over]
    if others:
        return Waits(turn.name, f"after {', '.join(others)}")
    before = sorted({taken[place] for place in turn.places if place in taken})
    if before:
        places = sorted(place for place in turn.places if place in taken)
        return Waits(turn.name, f"{', '.join(places)}: behind {', '.join(before)}")
    due = standing.jobs[turn.name].due
    return Waits(turn.name, "its time", due) if due is not None and now < due else None
