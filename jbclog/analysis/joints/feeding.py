"""The feeder as a second witness of joints: which draws had wire, which feeds had no draw, and what that makes of them.

A feed that was seen (`feed_events`) belongs to the draw that it overlaps most, or that begins or ends within `BESIDE_S` of it.
Draws that one push of the motor bridges are one. Feeds that were only counted belong to draws between the two readings that
have none yet, the largest first; what is left of them stands where there is most room between the other feeds.

Wire decides where a recipe asks for it and, by default, where at least half of the draws have a feed. Then a draw with a feed is
a joint, and lasts at least as long as wire was seen pushed. A draw without one is counted with its kind not known; but near the
feed of another draw, less than `ONE_JOINT_SHARE` of the usual time between feeds, it is none of its own: a piece of that one
where no more than `PIECE_S` lie between them. And each feed is a joint:

- A feed without a draw, while the tool works, is a joint of low confidence: where it was seen, or, where it was only counted,
  somewhere between the two readings, no more than `MOST_PLACE_S` apart. It has neither heat nor edges.
- Several feeds in one draw are several joints, cut where the flow is lowest between them: their confidence is half of the
  draw's. They stay one joint where the next feed comes in less than `ONE_JOINT_SHARE` of the usual time between feeds, or where
  the flow is not seen to fall between them although the rate would show it.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from jbclog.analysis.joints.contacts import Flow
from jbclog.analysis.joints.draws import Draw, Flows, cut, has_fallen, lowest_between, put_together
from jbclog.analysis.joints.feed_events import Counted, Feed, FeedEvents, feed_events
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.track import track_of

BESIDE_S: Final = 0.3
FED_ALONE: Final = 0.3  # the confidence of a feed without a draw
PIECE_S: Final = 1.0
ONE_JOINT_SHARE: Final = 0.5
MOST_PLACE_S: Final = 6.0
LEAST_PLACE_S: Final = 0.2


@dataclass(frozen=True, slots=True)
class Witnessed:
    """Draws with what the feeder tells of them, feeds without a draw among them; and both counts.

    `draws_seen` are those of heat alone, before any was cut or put together; `counted` is what the feeder's counter grew by.
    """

    draws: list[Draw]
    others: list[Draw]
    feeds: int
    counted: int | None
    draws_seen: int
    feeds_without_draw: int
    draws_without_feed: int
    decides: bool


def witnessed(series: Series, draws: Sequence[Draw], looked: Sequence[Flow], asked: bool | None) -> Witnessed | None:
    """The draws of a port beside its feeds; None without a feeder. `looked` are the flows in which the draws were found."""
    events = feed_events(series) if len(series.seconds) else None
    if events is None:
        return None
    usual_s = _usual_s(events)
    whole, own = _with_feeds(series, _bridged(draws, events.seen, series.period_s), events)
    whole, own, beside = _with_pieces(whole, own, usual_s)
    with_wire = sum(bool(feeds) and draw.heat is not None for draw, feeds in zip(whole, own, strict=True))
    seen = sum(draw.heat is not None for draw in whole)
    decides = bool(events.number) and (2 * with_wire >= seen if asked is None else asked)
    if not decides:
        return _told(series, draws, events)
    fed = [replace(one, fed=_fed(series, one, feeds, events, True)) for one, feeds in zip(whole, own, strict=True)]
    fed = [replace(one, is_unfed=True) if one.fed is False else one for one in fed]
    found = _cut(fed, own, Flows(looked), series.period_s, usual_s)
    others = [replace(one, fed=_fed(series, one, [], events, True)) for one in beside]
    without = len(beside) + seen - with_wire
    alone = events.number - sum(len(feeds) for draw, feeds in zip(whole, own, strict=True) if draw.heat is not None)
    return Witnessed(found, others, events.number, events.counted, len(draws), alone, without, True)


def _told(series: Series, draws: Sequence[Draw], events: FeedEvents) -> Witnessed:
    """The draws as they are, each with what the feeder tells of it."""
    own, alone = _owned(draws, events, series.period_s)
    told = [replace(one, fed=_fed(series, one, feeds, events, False)) for one, feeds in zip(draws, own, strict=True)]
    without = sum(not feeds for feeds in own)
    return Witnessed(told, [], events.number, events.counted, len(draws), len(alone), without, False)


def _usual_s(events: FeedEvents) -> float:
    """The median time from one feed to the next."""
    moments = sorted([*(one.middle_s for one in events.seen), *_counted_moments(events.counted_only)])
    return float(np.median(np.diff(moments))) if len(moments) > 2 else 0.0


def _counted_moments(counted: Sequence[Counted]) -> list[float]:
    return [one.start_s + (place + 0.5) * (one.end_s - one.start_s) / one.feeds for one in counted for place in range(one.feeds)]


def _bridged(draws: Sequence[Draw], seen: Sequence[Feed], period_s: float) -> list[Draw]:
    """The draws, those that one feed runs across as one."""
    joined = np.arange(len(draws))
    for feed in seen:
        under = [place for place in _near(draws, feed) if _overlap(draws[place], feed) >= period_s]
        for place in under[1:]:
            joined[place] = joined[under[0]]
    together: list[list[Draw]] = []
    for place, draw in enumerate(draws):
        if joined[place] < place:
            together[-1].append(draw)
        else:
            together.append([draw])
    return [put_together(some) for some in together]


def _with_feeds(series: Series, draws: Sequence[Draw], events: FeedEvents) -> tuple[list[Draw], list[list[Feed]]]:
    """The draws with their feeds, each as long as its feeds were seen at the least; feeds without a draw among them."""
    own, alone = _owned(draws, events, series.period_s)
    every = [(_as_long(draw, feeds), feeds) for draw, feeds in zip(draws, own, strict=True)]
    every += [(Draw(one.start_s, one.end_s, 0.0, None, None, 0, FED_ALONE, None, True), [one]) for one in _at_work(series, alone)]
    every.sort(key=lambda one: one[0].start_s)
    return _apart([draw for draw, _ in every]), [feeds for _, feeds in every]


def _apart(draws: Sequence[Draw]) -> list[Draw]:
    """The same, none longer than until the next begins."""
    following = [draw.start_s for draw in draws[1:]]
    shorter = [replace(one, end_s=end) if one.end_s > end else one for one, end in zip(draws, following, strict=False)]
    return [*shorter, *draws[-1:]]


def _as_long(draw: Draw, feeds: Sequence[Feed]) -> Draw:
    """Wire is pushed while the tip is on the work."""
    seen = [one for one in feeds if one.is_seen]
    start, end = min([draw.start_s, *(one.start_s for one in seen)]), max([draw.end_s, *(one.end_s for one in seen)])
    longer = draw.start_s - start + end - draw.end_s
    return replace(draw, start_s=start, end_s=end, dwell_s=draw.dwell_s + longer) if longer else draw


def _at_work(series: Series, feeds: Sequence[Feed]) -> list[Feed]:
    """Those in which the tool works, and of which the place is known well enough."""
    working = track_of(series, np.where(series.known, series.rows.working, np.nan).astype(np.float64))
    places = working.last(np.array([feed.middle_s for feed in feeds])) - 1
    return [
        feed
        for feed, place in zip(feeds, places.tolist(), strict=True)
        if place >= 0 and working.values[place] > 0 and feed.end_s - feed.start_s <= MOST_PLACE_S
    ]


def _with_pieces(
    draws: Sequence[Draw], own: Sequence[list[Feed]], usual_s: float
) -> tuple[list[Draw], list[list[Feed]], list[Draw]]:
    """The draws with their feeds, pieces put together; and those near a feed of another that are no joints of their own.

    A feed without a draw makes one joint of the draws before and behind it; one beside it may as well be a wipe.
    """
    to: dict[int, int] = {}
    beside: set[int] = set()
    for place, feeds in enumerate(own):
        is_placed = bool(feeds) and (feeds[0].is_seen or draws[place].heat is not None)
        sides = [_around(draws, own, place, step, usual_s) for step in (-1, 1)] if is_placed else []
        is_one = draws[place].heat is not None or all(pieces for pieces, _ in sides)
        for pieces, others in sides:
            to.update((piece, place) for piece in pieces if is_one and piece not in to)
            beside.update(others if is_one else [*pieces, *others])
    beside -= set(to)
    groups: dict[int, list[int]] = {}
    for place in range(len(draws)):
        if place not in beside:
            groups.setdefault(to.get(place, place), []).append(place)
    together = sorted(groups.values())
    whole = [put_together([draws[place] for place in some]) for some in together]
    return whole, [[feed for place in some for feed in own[place]] for some in together], [draws[place] for place in sorted(beside)]


def _around(draws: Sequence[Draw], own: Sequence[list[Feed]], place: int, step: int, usual_s: float) -> tuple[list[int], list[int]]:
    """The draws without a feed on one side of one with: those that are pieces of it, and others near its feed."""
    feed, last = own[place][0 if step < 0 else -1], place
    pieces: list[int] = []
    others: list[int] = []
    near = place + step
    while 0 <= near < len(draws) and not own[near]:
        middle = (draws[near].start_s + draws[near].end_s) / 2
        if abs(middle - feed.middle_s) >= ONE_JOINT_SHARE * usual_s:
            break
        one, other = sorted((last, near))
        is_piece = not others and draws[other].start_s - draws[one].end_s <= PIECE_S
        (pieces if is_piece else others).append(near)
        last, near = near, near + step
    return pieces, others


def _owned(draws: Sequence[Draw], events: FeedEvents, period_s: float) -> tuple[list[list[Feed]], list[Feed]]:
    """The feeds of each draw, and those of none."""
    own: list[list[Feed]] = [[] for _ in draws]
    alone: list[Feed] = []
    for feed in events.seen:
        owner = _owner(feed, draws, period_s)
        (alone if owner is None else own[owner]).append(feed)
    known = sorted([(one.start_s, one.end_s) for one in events.seen])
    for counted in events.counted_only:
        _give(draws, own, alone, counted, known)
    for feeds in own:
        feeds.sort(key=lambda feed: feed.start_s)
    return own, alone


def _near(draws: Sequence[Draw], feed: Feed | Counted) -> range:
    """The places of the draws that can touch it."""
    begin = max(bisect_left(draws, feed.start_s, key=lambda draw: draw.start_s) - 2, 0)
    end = bisect_left(draws, feed.end_s, key=lambda draw: draw.start_s) + 2
    return range(begin, min(max(end, begin), len(draws)))


def _overlap(draw: Draw, feed: Feed | Counted) -> float:
    return min(draw.end_s, feed.end_s) - max(draw.start_s, feed.start_s)


def _owner(feed: Feed, draws: Sequence[Draw], period_s: float) -> int | None:
    """The draw that the feed belongs to: the one it overlaps most, or the nearest that is near."""
    best = max(((_overlap(draws[place], feed), place) for place in _near(draws, feed)), default=None)
    return best[1] if best is not None and best[0] > -max(BESIDE_S, period_s) else None


def _give(
    draws: Sequence[Draw], own: list[list[Feed]], alone: list[Feed], counted: Counted, known: list[tuple[float, float]]
) -> None:
    """Feeds that were only counted, to the draws without any; what is left, to where there is room. `known` is kept in order."""
    places = [place for place in _near(draws, counted) if not own[place] and _overlap(draws[place], counted) > 0]

    def worth(place: int) -> tuple[bool, float]:
        draw = draws[place]
        return 2 * _overlap(draw, counted) >= draw.end_s - draw.start_s, draw.heat or 0.0

    for place in sorted(places, key=worth, reverse=True)[: counted.feeds]:
        draw = draws[place]
        feed = Feed(max(draw.start_s, counted.start_s), min(draw.end_s, counted.end_s), False)
        own[place].append(feed)
        insort(known, (draw.start_s, draw.end_s))
    for _ in range(counted.feeds - min(len(places), counted.feeds)):
        room = _room(counted, known)
        if room is None:
            return
        insort(known, (room.start_s, room.end_s))
        inside = max(((_overlap(draws[place], room), place) for place in _near(draws, room)), default=(0.0, 0))
        if inside[0] > (room.end_s - room.start_s) / 2:
            own[inside[1]].append(room)
        elif (beside := _beside_draws(draws, room)) is not None:
            alone.append(beside)


def _room(counted: Counted, known: Sequence[tuple[float, float]]) -> Feed | None:
    """The longest time between two readings of the counter in which no other feed is known; None where there is no room."""
    begin = bisect_left(known, (counted.start_s, counted.start_s))
    end = bisect_left(known, (counted.end_s, counted.end_s))
    return _longest(counted, known[max(begin - 1, 0) : end])


def _beside_draws(draws: Sequence[Draw], feed: Feed) -> Feed | None:
    """The longest part of it in which no draw is; None where there is no room."""
    under = [draws[place] for place in _near(draws, feed) if _overlap(draws[place], feed) > 0]
    return _longest(feed, [(draw.start_s, draw.end_s) for draw in under])


def _longest(place: Feed | Counted, taken: Sequence[tuple[float, float]]) -> Feed | None:
    """The longest part of a time that is not taken; `taken` is in order."""
    edges = [place.start_s, *(min(max(moment, place.start_s), place.end_s) for span in taken for moment in span), place.end_s]
    start, end = max(zip(edges[::2], edges[1::2], strict=True), key=lambda room: room[1] - room[0])
    return Feed(start, end, False) if end - start >= LEAST_PLACE_S else None


def _fed(series: Series, draw: Draw, feeds: Sequence[Feed], events: FeedEvents, decides: bool) -> bool | None:
    """Whether wire was pushed in it; None where that was not read, or can have been missed."""
    if feeds:
        return True
    if events.is_counted(draw.start_s, draw.end_s):
        return False
    assert series.feeding is not None
    read = series.window(series.feeding, draw.start_s - series.period_s, draw.end_s + series.period_s)
    return False if read.n and (events.sees_all or not decides) else None


def _cut(draws: Sequence[Draw], own: Sequence[Sequence[Feed]], flows: Flows, period_s: float, usual_s: float) -> list[Draw]:
    """The draws, those with the feeds of several joints cut between them."""
    parts: list[Draw] = []
    for draw, feeds in zip(draws, own, strict=True):
        moments = [
            moment
            for feed, after in pairwise(feeds)
            if after.start_s - feed.start_s >= ONE_JOINT_SHARE * usual_s
            and draw.start_s < (moment := lowest_between(flows, feed.end_s, after.start_s, period_s)) < draw.end_s
            and (not (feed.is_seen and after.is_seen) or has_fallen(flows, feed.start_s, moment, after.end_s, period_s))
        ]
        parts += cut(draw, moments, flows, period_s) if moments else [draw]
    return parts
