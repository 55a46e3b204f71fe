"""Compare heat draws with the feeder: which draws had wire, which feeds had no draw, and which
joints follow from both.

A seen feed (`feed_events`) belongs to the draw that it overlaps most, or that begins or ends within
`NEAR_S` of it. Draws bridged by one push of the motor are one draw. Feeds that were only counted
belong to draws between the two readings that have no feed yet, the largest draw first; the rest are
placed in the longest free interval between the other feeds.

Wire is pushed while the tip is on the work. So if draws begin later than their feeds in the median,
the heat is shown late, and all draws are moved earlier by that much.

The feeder decides if a recipe says so and, by default, unless more draws lack a feed than there are
feeds. Then a draw with a feed is a joint, and lasts at least as long as wire was pushed. A draw
without one counts if it is as large as joints are, with its kind not known. But near the feed of
another draw, at less than `ONE_JOINT_SHARE` of the usual time between feeds, it is not a joint of
its own: it is a piece of that draw if no more than `PIECE_S` lie between them. And each feed is a
joint:

- A feed without a draw, while the tool works, is a joint of low confidence: where it was seen or,
  if it was only counted, somewhere between the two readings, which may be at most `MOST_INTERVAL_S`
  apart. It has neither heat nor edges.
- Several feeds in one draw are several joints, cut where the flow is lowest between them, with half
  of the draw's confidence. They stay one joint if the next feed comes in less than
  `ONE_JOINT_SHARE` of the usual time between feeds, or if the flow does not fall between them
  although the sampling rate and the noise would show it.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from jbclog.analysis.joints.contacts import Flow
from jbclog.analysis.joints.draws import (
    Draw,
    FlowByTime,
    cut_draw,
    has_fallen,
    is_large,
    lowest_between,
    merged_draw,
)
from jbclog.analysis.joints.feed_events import CountedFeeds, Feed, FeedEvents, feed_events
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.track import track_of

NEAR_S: Final = 0.3  # largest distance of a feed from its draw
FEED_ALONE_CONFIDENCE: Final = 0.3
PIECE_S: Final = 1.0
ONE_JOINT_SHARE: Final = 0.5
MOST_INTERVAL_S: Final = 6.0
LEAST_INTERVAL_S: Final = 0.2
LEAST_FEEDS: Final = 10


@dataclass(frozen=True, slots=True)
class FeederEvidence:
    """Draws with what the feeder shows about them, feeds without a draw included, and both counts.

    `others` are draws that are not joints of their own. `counted` is the growth of the feeder's
    counter, None if it was not read.
    """

    draws: list[Draw]
    others: list[Draw]
    feeds: int
    counted: int | None
    feeds_without_draw: int
    draws_without_feed: int
    decides: bool


def feeder_evidence(
    series: Series,
    draws: Sequence[Draw],
    flows: Sequence[Flow],
    wire_decides: bool | None,
    noise: float = 0.0,
) -> FeederEvidence | None:
    """Compare the draws of a port with its feeds; None without a feeder.

    `flows` are the flows in which the draws were found, and `noise` theirs in ‰. `wire_decides` is
    the recipe's choice, None if it has none.
    """
    events = feed_events(series) if len(series.seconds) else None
    if events is None:
        return None
    interval_s, late_s = _usual_interval_s(events), _behind_feeds_s(draws, events, series.period_s)
    earlier = [_moved(draw, late_s) for draw in draws] if late_s else draws
    flows = [replace(one, stretch=one.stretch.earlier(late_s)) for one in flows]
    merged, draw_feeds = _with_feeds(
        series, _joined_by_feeds(earlier, events.seen, series.period_s), events
    )
    merged, draw_feeds, nearby = _merge_pieces(merged, draw_feeds, interval_s)
    with_wire = sum(
        bool(feeds) and draw.heat is not None
        for draw, feeds in zip(merged, draw_feeds, strict=True)
    )
    seen = sum(draw.heat is not None for draw in merged)
    decides = bool(events.number) and (
        events.number >= seen - with_wire if wire_decides is None else wire_decides
    )
    if not decides:
        return _without_decision(series, draws, events)
    fed = [
        one._replace(fed=_fed(series, one, feeds, events, True))
        for one, feeds in zip(merged, draw_feeds, strict=True)
    ]
    fed = [one._replace(is_unfed=True) if one.fed is False else one for one in fed]
    cut = _cut(fed, draw_feeds, FlowByTime(flows), series.period_s, interval_s, noise)
    found = [one for one in cut if not _is_weak(one)]
    others = [
        *(one._replace(fed=_fed(series, one, [], events, True)) for one in nearby),
        *(one for one in cut if _is_weak(one)),
    ]
    without = len(nearby) + seen - with_wire
    alone = events.number - sum(
        len(feeds) for draw, feeds in zip(merged, draw_feeds, strict=True) if draw.heat is not None
    )
    return FeederEvidence(found, others, events.number, events.counted, alone, without, True)


def _is_weak(draw: Draw) -> bool:
    """Return whether neither feeder nor heat shows a joint."""
    return draw.is_unfed and draw.cut is None and not is_large(draw.dwell_s, draw.heat, draw.peak)


def _without_decision(series: Series, draws: Sequence[Draw], events: FeedEvents) -> FeederEvidence:
    """Return the same draws, each with whether wire was pushed in it."""
    draw_feeds, alone = _feeds_of_draws(draws, events, series.period_s)
    with_feeds = [
        one._replace(fed=_fed(series, one, feeds, events, False))
        for one, feeds in zip(draws, draw_feeds, strict=True)
    ]
    without = sum(not feeds for feeds in draw_feeds)
    return FeederEvidence(with_feeds, [], events.number, events.counted, len(alone), without, False)


def _usual_interval_s(events: FeedEvents) -> float:
    """Return the median time in s from one feed to the next, 0 with fewer than three feeds."""
    moments = sorted(
        [*(one.middle_s for one in events.seen), *_counted_moments(events.counted_only)]
    )
    return float(np.median(np.diff(moments))) if len(moments) > 2 else 0.0


def _behind_feeds_s(draws: Sequence[Draw], events: FeedEvents, period_s: float) -> float:
    """Return by how much draws begin later than their feeds in the median, in s; 0 if they do not,
    or for fewer than `LEAST_FEEDS`. A feed began half a period before it was seen, on average.
    """
    draw_feeds, _ = _feeds_of_draws(draws, events, period_s)
    behind = [
        draw.start_s - (feeds[0].start_s - period_s / 2)
        for draw, feeds in zip(draws, draw_feeds, strict=True)
        if feeds and feeds[0].is_seen
    ]
    return max(float(np.median(behind)), 0.0) if len(behind) >= LEAST_FEEDS else 0.0


def _moved(draw: Draw, late_s: float) -> Draw:
    return draw._replace(
        start_s=draw.start_s - late_s, end_s=draw.end_s - late_s, late_s=draw.late_s + late_s
    )


def _counted_moments(counted: Sequence[CountedFeeds]) -> list[float]:
    """Return a moment for each counted feed, evenly spread between the two readings of the
    counter.
    """
    return [
        one.start_s + (place + 0.5) * (one.end_s - one.start_s) / one.feeds
        for one in counted
        for place in range(one.feeds)
    ]


def _joined_by_feeds(draws: Sequence[Draw], seen: Sequence[Feed], period_s: float) -> list[Draw]:
    """Merge draws that one feed bridges."""
    joined = np.arange(len(draws))
    for feed in seen:
        under = [
            place for place in _places_near(draws, feed) if _overlap(draws[place], feed) >= period_s
        ]
        for place in under[1:]:
            joined[place] = joined[under[0]]
    groups: list[list[Draw]] = []
    for place, draw in enumerate(draws):
        if joined[place] < place:
            groups[-1].append(draw)
        else:
            groups.append([draw])
    return [merged_draw(group) for group in groups]


def _with_feeds(
    series: Series, draws: Sequence[Draw], events: FeedEvents
) -> tuple[list[Draw], list[list[Feed]]]:
    """Return the draws, each at least as long as its feeds, and the feeds of each; a feed without a
    draw becomes a draw.
    """
    draw_feeds, alone = _feeds_of_draws(draws, events, series.period_s)
    every = [
        (_extended_to_feeds(draw, feeds), feeds)
        for draw, feeds in zip(draws, draw_feeds, strict=True)
    ]
    every += [
        (Draw(one.start_s, one.end_s, 0.0, None, None, 0, FEED_ALONE_CONFIDENCE, None, True), [one])
        for one in _while_working(series, alone)
    ]
    every.sort(key=lambda one: one[0].start_s)
    return _without_overlap([draw for draw, _ in every]), [feeds for _, feeds in every]


def _without_overlap(draws: Sequence[Draw]) -> list[Draw]:
    """Shorten draws to end no later than the next begins."""
    following = [draw.start_s for draw in draws[1:]]
    shorter = [
        one._replace(end_s=end) if one.end_s > end else one
        for one, end in zip(draws, following, strict=False)
    ]
    return [*shorter, *draws[-1:]]


def _extended_to_feeds(draw: Draw, feeds: Sequence[Feed]) -> Draw:
    """Extend a draw to its feeds: wire is pushed while the tip is on the work."""
    seen = [one for one in feeds if one.is_seen]
    start = min([draw.start_s, *(one.start_s for one in seen)])
    end = max([draw.end_s, *(one.end_s for one in seen)])
    longer = draw.start_s - start + end - draw.end_s
    return (
        draw._replace(start_s=start, end_s=end, dwell_s=draw.dwell_s + longer) if longer else draw
    )


def _while_working(series: Series, feeds: Sequence[Feed]) -> list[Feed]:
    """Return the feeds during which the tool works and whose time is known well enough."""
    working = track_of(
        series, np.where(series.known, series.rows.working, np.nan).astype(np.float64)
    )
    places = working.last(np.array([feed.middle_s for feed in feeds])) - 1
    return [
        feed
        for feed, place in zip(feeds, places.tolist(), strict=True)
        if place >= 0 and working.values[place] > 0 and feed.end_s - feed.start_s <= MOST_INTERVAL_S
    ]


def _merge_pieces(
    draws: Sequence[Draw], draw_feeds: Sequence[list[Feed]], interval_s: float
) -> tuple[list[Draw], list[list[Feed]], list[Draw]]:
    """Merge the pieces of draws. Returns the draws, the feeds of each, and the draws near another's
    feed that are not joints.
    """
    owner_of, nearby = _owners(draws, draw_feeds, interval_s)
    groups: dict[int, list[int]] = {}
    for place in range(len(draws)):
        if place not in nearby:
            groups.setdefault(owner_of.get(place, place), []).append(place)
    in_order = sorted(groups.values())
    merged = [merged_draw([draws[place] for place in group]) for group in in_order]
    feeds_of_merged = [
        [feed for place in group for feed in draw_feeds[place]] for group in in_order
    ]
    return merged, feeds_of_merged, [draws[place] for place in sorted(nearby)]


def _owners(
    draws: Sequence[Draw], draw_feeds: Sequence[list[Feed]], interval_s: float
) -> tuple[dict[int, int], set[int]]:
    """Return piece -> draw that it belongs to, and the draws near another's feed that are not
    joints.

    A feed without a draw makes one joint of the draws before and after it; a draw on one side only
    may as well be a wipe.
    """
    owner_of: dict[int, int] = {}
    nearby: set[int] = set()
    for place, feeds in enumerate(draw_feeds):
        is_placed = bool(feeds) and (feeds[0].is_seen or draws[place].heat is not None)
        sides = (
            [
                _neighbours_without_feed(draws, draw_feeds, place, step, interval_s)
                for step in (-1, 1)
            ]
            if is_placed
            else []
        )
        is_one = draws[place].heat is not None or all(pieces for pieces, _ in sides)
        for pieces, others in sides:
            owner_of.update((piece, place) for piece in pieces if is_one and piece not in owner_of)
            nearby.update(others if is_one else [*pieces, *others])
    return owner_of, nearby - set(owner_of)


def _neighbours_without_feed(
    draws: Sequence[Draw],
    draw_feeds: Sequence[list[Feed]],
    place: int,
    step: int,
    interval_s: float,
) -> tuple[list[int], list[int]]:
    """Return the draws without a feed on one side of a draw with one: its pieces, and others near
    its feed.
    """
    feed, last = draw_feeds[place][0 if step < 0 else -1], place
    pieces: list[int] = []
    others: list[int] = []
    near = place + step
    while 0 <= near < len(draws) and not draw_feeds[near]:
        middle = (draws[near].start_s + draws[near].end_s) / 2
        if abs(middle - feed.middle_s) >= ONE_JOINT_SHARE * interval_s:
            break
        one, other = sorted((last, near))
        is_piece = not others and draws[other].start_s - draws[one].end_s <= PIECE_S
        (pieces if is_piece else others).append(near)
        last, near = near, near + step
    return pieces, others


def _feeds_of_draws(
    draws: Sequence[Draw], events: FeedEvents, period_s: float
) -> tuple[list[list[Feed]], list[Feed]]:
    """Return the feeds of each draw, and the feeds without a draw."""
    draw_feeds: list[list[Feed]] = [[] for _ in draws]
    alone: list[Feed] = []
    for feed in events.seen:
        owner = _owner(feed, draws, period_s)
        (alone if owner is None else draw_feeds[owner]).append(feed)
    known = sorted([(one.start_s, one.end_s) for one in events.seen])
    for counted in events.counted_only:
        _assign_counted(draws, draw_feeds, alone, counted, known)
    for feeds in draw_feeds:
        feeds.sort(key=lambda feed: feed.start_s)
    return draw_feeds, alone


def _places_near(draws: Sequence[Draw], feed: Feed | CountedFeeds) -> range:
    """Return the indices of the draws that can touch the feed."""
    begin = max(bisect_left(draws, feed.start_s, key=lambda draw: draw.start_s) - 2, 0)
    end = bisect_left(draws, feed.end_s, key=lambda draw: draw.start_s) + 2
    return range(begin, min(max(end, begin), len(draws)))


def _overlap(draw: Draw, feed: Feed | CountedFeeds) -> float:
    return min(draw.end_s, feed.end_s) - max(draw.start_s, feed.start_s)


def _owner(feed: Feed, draws: Sequence[Draw], period_s: float) -> int | None:
    """Return the index of the draw that the feed overlaps most, else of the nearest within
    `NEAR_S`; else None.
    """
    best = max(
        ((_overlap(draws[place], feed), place) for place in _places_near(draws, feed)), default=None
    )
    return best[1] if best is not None and best[0] > -max(NEAR_S, period_s) else None


def _assign_counted(
    draws: Sequence[Draw],
    draw_feeds: list[list[Feed]],
    alone: list[Feed],
    counted: CountedFeeds,
    known: list[tuple[float, float]],
) -> None:
    """Assign feeds that were only counted to draws without a feed, and the rest to free intervals.

    Changes `draw_feeds` and `alone`; `known` has the intervals of known feeds and stays sorted.
    """
    assigned = _assign_to_draws(draws, draw_feeds, counted, known)
    for _ in range(counted.feeds - assigned):
        free = _free_interval(counted, known)
        if free is None:
            return
        insort(known, (free.start_s, free.end_s))
        inside = max(
            ((_overlap(draws[place], free), place) for place in _places_near(draws, free)),
            default=(0.0, 0),
        )
        if inside[0] > (free.end_s - free.start_s) / 2:
            draw_feeds[inside[1]].append(free)
        elif (nearby := _outside_draws(draws, free)) is not None:
            alone.append(nearby)


def _assign_to_draws(
    draws: Sequence[Draw],
    draw_feeds: list[list[Feed]],
    counted: CountedFeeds,
    known: list[tuple[float, float]],
) -> int:
    """Assign a feed to each draw in the interval that has none, the largest first; return the
    number assigned.
    """

    def priority(place: int) -> tuple[bool, float]:
        draw = draws[place]
        return 2 * _overlap(draw, counted) >= draw.end_s - draw.start_s, draw.heat or 0.0

    places = [
        place
        for place in _places_near(draws, counted)
        if not draw_feeds[place] and _overlap(draws[place], counted) > 0
    ]
    chosen = sorted(places, key=priority, reverse=True)[: counted.feeds]
    for place in chosen:
        draw = draws[place]
        draw_feeds[place].append(
            Feed(max(draw.start_s, counted.start_s), min(draw.end_s, counted.end_s), False)
        )
        insort(known, (draw.start_s, draw.end_s))
    return len(chosen)


def _free_interval(counted: CountedFeeds, known: Sequence[tuple[float, float]]) -> Feed | None:
    """Return the longest interval without a known feed between two readings of the counter; None if
    none is long enough.
    """
    begin = bisect_left(known, (counted.start_s, counted.start_s))
    end = bisect_left(known, (counted.end_s, counted.end_s))
    return _longest_free(counted, known[max(begin - 1, 0) : end])


def _outside_draws(draws: Sequence[Draw], feed: Feed) -> Feed | None:
    """Return the longest part of the interval outside any draw; None if none is long enough."""
    under = [
        draws[place] for place in _places_near(draws, feed) if _overlap(draws[place], feed) > 0
    ]
    return _longest_free(feed, [(draw.start_s, draw.end_s) for draw in under])


def _longest_free(place: Feed | CountedFeeds, taken: Sequence[tuple[float, float]]) -> Feed | None:
    """Return the longest part of the interval that is not in `taken` (sorted); None if too
    short.
    """
    edges = [
        place.start_s,
        *(min(max(moment, place.start_s), place.end_s) for span in taken for moment in span),
        place.end_s,
    ]
    start, end = max(zip(edges[::2], edges[1::2], strict=True), key=lambda span: span[1] - span[0])
    return Feed(start, end, False) if end - start >= LEAST_INTERVAL_S else None


def _fed(
    series: Series, draw: Draw, feeds: Sequence[Feed], events: FeedEvents, decides: bool
) -> bool | None:
    """Return whether wire was pushed in the draw; None if not read, or if it may have been
    missed.
    """
    if feeds:
        return True
    if events.is_counted(draw.start_s, draw.end_s):
        return False
    assert series.feeding is not None
    read = series.window(
        series.feeding, draw.start_s - series.period_s, draw.end_s + series.period_s
    )
    return False if read.n and (events.sees_all or not decides) else None


def _cut(
    draws: Sequence[Draw],
    draw_feeds: Sequence[Sequence[Feed]],
    by_time: FlowByTime,
    period_s: float,
    interval_s: float,
    noise: float,
) -> list[Draw]:
    """Cut the draws that have the feeds of several joints, between the feeds."""
    parts: list[Draw] = []
    for draw, feeds in zip(draws, draw_feeds, strict=True):
        moments = [
            moment
            for feed, after in pairwise(feeds)
            if after.start_s - feed.start_s >= ONE_JOINT_SHARE * interval_s
            and draw.start_s
            < (moment := lowest_between(by_time, feed.end_s, after.start_s, period_s))
            < draw.end_s
            and (
                not (feed.is_seen and after.is_seen)
                or has_fallen(by_time, feed.start_s, moment, after.end_s, period_s, noise)
            )
        ]
        parts += cut_draw(draw, moments, by_time, period_s) if moments else [draw]
    return parts
