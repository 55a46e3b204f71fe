"""The feeder as a second witness of joints: which draws had wire, and which feeds had no draw.

Where it is read, each run of readings in which the motor pushes is a *feed*. A feed belongs to the draw that it overlaps, or
that begins or ends within `BESIDE_S` of it. Feeds less than `ONE_FEED_S` apart are one.

Wire decides where a recipe asks for it and, by default, where at least half of the draws have a feed: then a draw with a feed
is a joint, a feed without a draw is a joint of low confidence, and a draw without a feed is none, and both counts are given.
Where the feeder pushes for less than two readings, feeds can be missed, and draws without one stay joints.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jbclog.features.drawn import Draw
from jbclog.features.series import Series

BESIDE_S: Final = 0.3
ONE_FEED_S: Final = 0.3
FED_ALONE: Final = 0.3  # the confidence of a feed without a draw
LEAST_READINGS: Final = 2.0


@dataclass(frozen=True, slots=True)
class Witnessed:
    """Draws with what the feeder tells of them, feeds without a draw among them; and both counts."""

    draws: list[Draw]
    feeds: int
    feeds_without_draw: int
    draws_without_feed: int
    decides: bool
    sees_all: bool


Feed = tuple[float, float]


def witnessed(series: Series, draws: Sequence[Draw], asked: bool | None) -> Witnessed | None:
    """The draws of a port beside its feeds; None without a feeder."""
    if series.feeding is None:
        return None
    feeds = feeds_in(series)
    owners = [_owner(feed, draws, series.period_s) for feed in feeds]
    with_wire = {owner for owner in owners if owner is not None}
    decides = bool(feeds) and 2 * len(with_wire) >= len(draws) if asked is None else asked and bool(feeds)
    sees_all = bool(feeds) and float(np.median([end - start for start, end in feeds])) >= (LEAST_READINGS - 1) * series.period_s
    told = [replace(draw, fed=_fed(series, draw, number in with_wire, decides, sees_all)) for number, draw in enumerate(draws)]
    alone = [_alone(feed) for feed, owner in zip(feeds, owners, strict=True) if owner is None]
    both = sorted([*told, *(alone if decides else [])], key=lambda draw: draw.start_s)
    return Witnessed(both, len(feeds), len(alone), len(draws) - len(with_wire), decides, sees_all)


def feeds_in(series: Series) -> list[Feed]:
    """When the motor was seen pushing, in grid seconds: from the first to the last of these readings."""
    if series.feeding is None:
        return []
    read = ~np.isnan(series.feeding)
    seconds, pushing = series.seconds[read], (series.feeding[read] > 0).astype(np.int8)
    sides = np.flatnonzero(np.diff(np.concatenate(([0], pushing, [0]))))
    half = series.period_s / 2
    feeds: list[Feed] = []
    for first, last in zip(sides[::2].tolist(), sides[1::2].tolist(), strict=True):
        start, end = (
            float(seconds[first]),
            max(float(seconds[last - 1]), min(float(seconds[first]) + half, float(series.seconds[-1]))),
        )
        if feeds and start - feeds[-1][1] < ONE_FEED_S:
            feeds[-1] = (feeds[-1][0], end)
        else:
            feeds.append((start, end))
    return feeds


def _owner(feed: Feed, draws: Sequence[Draw], period_s: float) -> int | None:
    """The draw that the feed belongs to: the one it overlaps most, or the nearest that is near."""
    slack = max(BESIDE_S, period_s)
    begin = max(bisect_left(draws, feed[0], key=lambda draw: draw.start_s) - 2, 0)
    near = range(begin, min(begin + 5, len(draws)))
    overlaps = [(min(draws[place].end_s, feed[1]) - max(draws[place].start_s, feed[0]), place) for place in near]
    best = max(overlaps, default=None)
    return best[1] if best is not None and best[0] > -slack else None


def _fed(series: Series, draw: Draw, has_wire: bool, decides: bool, sees_all: bool) -> bool | None:
    """Whether wire was pushed in it; None where that was not read, or can have been missed."""
    if has_wire:
        return True
    assert series.feeding is not None
    read = series.window(series.feeding, draw.start_s - series.period_s, draw.end_s + series.period_s)
    return False if read.n and (sees_all or not decides) else None


def _alone(feed: Feed) -> Draw:
    return Draw(feed[0], feed[1], feed[1] - feed[0], None, None, 0, FED_ALONE, None, True)
