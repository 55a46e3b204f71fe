"""Feeds of wire: seen at each tick in the motor's state, and counted between two readings of the
feeder's counter.

A run of readings in which the motor pushes forward (R-PSx, on every tick) is a *push*; pushes less
than `ONE_FEED_S` apart are one *seen feed*. The counter (R-DCx) counts every feed but does not show
when. Growth between two readings beyond the seen feeds is *feeds that were only counted*, somewhere
between these readings, unless it may be further pushes of the feeds that were seen. No manual
states whether a feed counts at its begin or its end; the one that fits the run better is used.

If the counter grew by less than the pushes, one feed is several pushes: the pushes closest to each
other are merged. A counter that decreased was reset, and shows nothing about that time.
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
from jbclog.analysis.port_data import Flags, Floats

ONE_FEED_S: Final = 0.3
ONE_CYCLE_S: Final = 3.0  # pushes further apart are never one cycle of the feeder
READ_BEFORE_S: Final = 0.3  # a count may be this much older than its time, because it is read twice
# share of the feeds: more surplus pushes are not an accident of a reading at an edge
MORE_THAN_COUNTED: Final = 0.1
LEAST_READINGS: Final = 2.0


@dataclass(frozen=True, slots=True)
class Feed:
    """A feed of wire between two moments in seconds of the run's grid; `is_seen`: these are its
    first and last reading. `pushes` is how many the motor made.
    """

    start_s: float
    end_s: float
    is_seen: bool = True
    pushes: int = 1

    @property
    def middle_s(self) -> float:
        return (self.start_s + self.end_s) / 2


@dataclass(frozen=True, slots=True)
class CountedFeeds:
    """A number of feeds that were not seen, somewhere between two readings of the counter."""

    start_s: float
    end_s: float
    feeds: int


@dataclass(frozen=True, slots=True)
class FeedEvents:
    """Everything known about a port's feeds.

    - `known_s`: intervals in which the counter was read and not reset
    - `counted`: its growth in them; None if it was not read twice
    - `sees_all`: pushes last longer than a sampling period, so that none is missed
    """

    seen: list[Feed]
    counted_only: list[CountedFeeds]
    known_s: list[tuple[float, float]]
    counted: int | None
    sees_all: bool

    @property
    def number(self) -> int:
        """Number of feeds, seen or only counted."""
        return len(self.seen) + sum(one.feeds for one in self.counted_only)

    def is_counted(self, start_s: float, end_s: float) -> bool:
        """Return whether the counter covers all feeds in this time."""
        place = bisect_right(self.known_s, start_s, key=lambda one: one[0]) - 1
        return place >= 0 and end_s <= self.known_s[place][1]


def feed_events(series: Series) -> FeedEvents | None:
    """Return the feeds of a port; None for a tool without a feeder."""
    if series.feeding is None:
        return None
    pushes = pushes_in(series)
    sees_all = bool(pushes) and float(np.median([one.end_s - one.start_s for one in pushes])) >= (
        (LEAST_READINGS - 1) * series.period_s
    )
    if series.cycles is None or len(series.cycles) < 2:
        return FeedEvents(pushes, [], [], None, sees_all)
    known, grown = _growth(series.cycles)
    excess = _excess(pushes, series.cycles, known, grown)
    too_many = -int(excess[excess < 0].sum())
    if too_many > max(MORE_THAN_COUNTED * grown[known].sum(), 1):
        pushes = _merge_nearest(pushes, too_many)
        excess = _excess(pushes, series.cycles, known, grown)
    excess -= np.clip(excess, 0.0, _as_pushes(series, pushes, series.cycles.seconds, sees_all))
    at, begin, end = series.cycles.seconds, float(series.moments[0]), float(series.moments[-1])
    counted_only = [
        CountedFeeds(
            max(float(at[place]) - READ_BEFORE_S, begin),
            min(float(at[place + 1]), end),
            int(excess[place]),
        )
        for place in np.flatnonzero(excess > 0).tolist()
    ]
    return FeedEvents(
        pushes, counted_only, _intervals(at, known), int(grown[known].sum()), sees_all
    )


def pushes_in(series: Series) -> list[Feed]:
    """Return the pushes of the motor, each from its first to its last reading."""
    if series.feeding is None:
        return []
    read = ~np.isnan(series.feeding)
    seconds, half = series.moments[read], series.period_s / 2
    feeds: list[Feed] = []
    for first, last in zip(
        *(rows.tolist() for rows in runs(series.feeding[read] > 0)), strict=True
    ):
        start = float(seconds[first])
        end = max(float(seconds[last - 1]), min(start + half, float(series.moments[-1])))
        if feeds and start - feeds[-1].end_s < ONE_FEED_S:
            feeds[-1] = Feed(feeds[-1].start_s, end, pushes=feeds[-1].pushes + 1)
        else:
            feeds.append(Feed(start, end))
    return feeds


def _as_pushes(series: Series, feeds: Sequence[Feed], at: Floats, sees_all: bool) -> Floats:
    """Return for each interval between readings of the counter how many of its counts may be
    further pushes of the feeds seen in it; any number if no other push can have been missed.
    """
    begun, again = np.zeros(len(at) - 1), np.zeros(len(at) - 1)
    first = np.searchsorted(at, [one.start_s for one in feeds], side="right") - 1
    last = np.searchsorted(at, [one.end_s + READ_BEFORE_S for one in feeds], side="right")
    for one, start, end in zip(feeds, first.tolist(), last.tolist(), strict=True):
        begun[max(start, 0) : end] += 1
        again[max(start, 0) : end] += one.pushes - 1
    assert series.feeding is not None
    lost = np.searchsorted(series.moments[np.isnan(series.feeding)], at)
    is_complete = sees_all & (np.diff(lost) == 0) & (begun > 0)
    return np.where(is_complete, np.inf, again)


def _growth(cycles: Cycles) -> tuple[Flags, Floats]:
    """Return for each interval between readings whether the counter was not reset, and its
    growth.
    """
    grown = np.diff(cycles.counted)
    return grown >= 0, np.where(grown >= 0, grown, 0.0)


def _intervals(at: Floats, known: Flags) -> list[tuple[float, float]]:
    """Return the intervals in which the counter is known."""
    return [(float(at[first]), float(at[last])) for first, last in zip(*runs(known), strict=True)]


def _excess(pushes: Sequence[Feed], cycles: Cycles, known: Flags, grown: Floats) -> Floats:
    """Return for each interval between readings the growth of the counter beyond the pushes seen;
    negative if it grew by less.
    """
    as_begun = _excess_at(np.array([one.start_s for one in pushes]), cycles.seconds, known, grown)
    as_ended = _excess_at(np.array([one.end_s for one in pushes]), cycles.seconds, known, grown)
    return min((as_begun, as_ended), key=lambda excess: float(np.abs(excess).sum()))


def _excess_at(moments: Floats, at: Floats, known: Flags, grown: Floats) -> Floats:
    """Return the excess if feeds count at these moments. A feed seen on one side of a reading and
    counted on the other cancels.
    """
    seen = np.diff(np.searchsorted(moments, at, side="right"))
    excess = np.where(known, grown - seen, 0.0)
    for place in np.flatnonzero(excess[:-1] * excess[1:] < 0).tolist():
        shared = (
            float(min(abs(excess[place]), abs(excess[place + 1])))
            if excess[place] * excess[place + 1] < 0
            else 0.0
        )
        excess[place] -= np.sign(excess[place]) * shared
        excess[place + 1] -= np.sign(excess[place + 1]) * shared
    return excess


def _merge_nearest(pushes: Sequence[Feed], times: int) -> list[Feed]:
    """Merge the closest neighbours among the pushes, this many times."""
    apart = np.array([after.start_s - before.end_s for before, after in pairwise(pushes)])
    nearest = {
        place
        for place in np.argsort(apart, kind="stable")[:times].tolist()
        if apart[place] < ONE_CYCLE_S
    }
    merged: list[Feed] = []
    for place, push in enumerate(pushes):
        if place - 1 in nearest:
            merged[-1] = Feed(merged[-1].start_s, push.end_s)
        else:
            merged.append(push)
    return merged
