"""When wire was pushed: seen at each tick in the motor's state, and counted by the feeder between two readings of its counter.

A run of readings in which the motor pushes forward (R-PSx, on every tick) is a *push*; pushes less than `ONE_FEED_S` apart are
one, which is a *feed that was seen*. The counter (R-DCx) sees every feed, but not when: between two readings it grew by as many
as there were. What it grew by more than was seen are *feeds that were counted only*, each somewhere between these two readings.
Whether a feed counts as it begins or as it ends is told by no manual; what fits the run better is taken.

Where the counter grew by less than was pushed, one feed is several pushes: those nearest to each other are put together. A
counter that went down was reset, and tells nothing of that time.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from jbclog.analysis.joints.segments import runs
from jbclog.analysis.joints.series import Cycles, Series
from jbclog.analysis.verdict.idle import Flags, Floats

ONE_FEED_S: Final = 0.3
ONE_CYCLE_S: Final = 3.0  # pushes further apart than this are never one cycle of the feeder
HEARD_BEFORE_S: Final = 0.3  # a count can have been heard so long before its time, as it is asked for twice
MORE_THAN_COUNTED: Final = 0.1  # of the feeds: so many pushes that are no cycles are no accident of a reading at an edge
LEAST_READINGS: Final = 2.0


@dataclass(frozen=True, slots=True)
class Feed:
    """Wire was pushed once between these two grid seconds. `is_seen`: they are those of the first and last reading of it."""

    start_s: float
    end_s: float
    is_seen: bool = True

    @property
    def middle_s(self) -> float:
        return (self.start_s + self.end_s) / 2


@dataclass(frozen=True, slots=True)
class Counted:
    """So many feeds that were not seen, somewhere between two readings of the counter."""

    start_s: float
    end_s: float
    feeds: int


@dataclass(frozen=True, slots=True)
class FeedEvents:
    """All that is known of a port's feeds.

    `known_s` are the times in which the counter was read and not reset, each its begin and end; `counted` is by how much it grew
    in them, None where it was not read twice. `sees_all`: pushes are longer than two readings are apart.
    """

    seen: list[Feed]
    counted_only: list[Counted]
    known_s: list[tuple[float, float]]
    counted: int | None
    sees_all: bool

    @property
    def number(self) -> int:
        """How many feeds there were, as far as either tells."""
        return len(self.seen) + sum(one.feeds for one in self.counted_only)

    def is_counted(self, start_s: float, end_s: float) -> bool:
        """Whether the counter tells of all feeds in this time."""
        place = bisect_right(self.known_s, start_s, key=lambda one: one[0]) - 1
        return place >= 0 and end_s <= self.known_s[place][1]


def feed_events(series: Series) -> FeedEvents | None:
    """The feeds of a port; None for a tool without a feeder."""
    if series.feeding is None:
        return None
    pushes = pushes_in(series)
    sees_all = bool(pushes) and float(np.median([one.end_s - one.start_s for one in pushes])) >= (
        (LEAST_READINGS - 1) * series.period_s
    )
    if series.cycles is None or len(series.cycles) < 2:
        return FeedEvents(pushes, [], [], None, sees_all)
    known, grown = _grown(series.cycles)
    beyond = _beyond(pushes, series.cycles, known, grown)
    too_many = -int(beyond[beyond < 0].sum())
    if too_many > max(MORE_THAN_COUNTED * grown[known].sum(), 1):
        pushes = _put_together(pushes, too_many)
        beyond = _beyond(pushes, series.cycles, known, grown)
    at, begin, end = series.cycles.seconds, float(series.seconds[0]), float(series.seconds[-1])
    counted_only = [
        Counted(max(float(at[place]) - HEARD_BEFORE_S, begin), min(float(at[place + 1]), end), int(beyond[place]))
        for place in np.flatnonzero(beyond > 0).tolist()
    ]
    return FeedEvents(pushes, counted_only, _spans(at, known), int(grown[known].sum()), sees_all)


def pushes_in(series: Series) -> list[Feed]:
    """When the motor was seen pushing, from the first to the last of these readings."""
    if series.feeding is None:
        return []
    read = ~np.isnan(series.feeding)
    seconds, half = series.seconds[read], series.period_s / 2
    feeds: list[Feed] = []
    for first, last in zip(*(rows.tolist() for rows in runs(series.feeding[read] > 0)), strict=True):
        start = float(seconds[first])
        end = max(float(seconds[last - 1]), min(start + half, float(series.seconds[-1])))
        if feeds and start - feeds[-1].end_s < ONE_FEED_S:
            feeds[-1] = Feed(feeds[-1].start_s, end)
        else:
            feeds.append(Feed(start, end))
    return feeds


def _grown(cycles: Cycles) -> tuple[Flags, Floats]:
    """From each reading to the next: whether the counter was not reset, and by how much it grew."""
    grown = np.diff(cycles.counted)
    return grown >= 0, np.where(grown >= 0, grown, 0.0)


def _spans(at: Floats, known: Flags) -> list[tuple[float, float]]:
    return [(float(at[first]), float(at[last])) for first, last in zip(*runs(known), strict=True)]


def _beyond(pushes: Sequence[Feed], cycles: Cycles, known: Flags, grown: Floats) -> Floats:
    """From each reading to the next: by how much more the counter grew than was seen, below zero where it grew by less."""
    as_begun = _left(np.array([one.start_s for one in pushes]), cycles.seconds, known, grown)
    as_ended = _left(np.array([one.end_s for one in pushes]), cycles.seconds, known, grown)
    return min((as_begun, as_ended), key=lambda left: float(np.abs(left).sum()))


def _left(moments: Floats, at: Floats, known: Flags, grown: Floats) -> Floats:
    """The same, where feeds count at these moments. One that was seen on one side of a reading and counted on the other is none."""
    seen = np.diff(np.searchsorted(moments, at, side="right"))
    left = np.where(known, grown - seen, 0.0)
    for place in np.flatnonzero(left[:-1] * left[1:] < 0).tolist():
        both = float(min(abs(left[place]), abs(left[place + 1]))) if left[place] * left[place + 1] < 0 else 0.0
        left[place] -= np.sign(left[place]) * both
        left[place + 1] -= np.sign(left[place + 1]) * both
    return left


def _put_together(pushes: Sequence[Feed], times: int) -> list[Feed]:
    """The nearest neighbours as one feed, so often."""
    apart = np.array([after.start_s - before.end_s for before, after in pairwise(pushes)])
    nearest = {place for place in np.argsort(apart, kind="stable")[:times].tolist() if apart[place] < ONE_CYCLE_S}
    together: list[Feed] = []
    for place, push in enumerate(pushes):
        if place - 1 in nearest:
            together[-1] = Feed(together[-1].start_s, push.end_s)
        else:
            together.append(push)
    return together
