"""Whether the bounds of the odometer hold over exchanges that nobody told of, and which of these
any reading could reveal.

An exchange can be revealed unless the readings on its two sides are what one unit could have shown
that just went on. That is so where every counter that was read on both sides

- of hours: grew by no more hours than went by (a clock may differ by 1 %, whole hours by one), over
  its last number if need be;
- of events: grew by no more than its fastest plausible pace, in the hours that its own counter of
  hours grew (`FASTEST`: what the odometer supposes and says), over its last number as often as that
  allows,

and neither another model nor a person tells. A counter that was not read at every look between
tells of an exchange only where the others tell of nothing at those looks that explains it.

Where it is not so, the exchange is revealed, and every bound over it must hold. These are hidden,
too: a loan that comes and goes between two looks, of which there is no reading; a unit on loan of
which one counter alone does not fit at the one look that saw it, which is like a wrong digit, which
the odometer leaves out and tells; an exchange between two looks between which the counters were
reset as well, as somebody told, where that explains what is read.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

from jbclog.config.task_names import REPLACED, RESET
from jbclog.maintenance.counter_totals.history import History
from jbclog.maintenance.counter_totals.observed import Count, Standing
from jbclog.maintenance.counter_totals.span import seconds
from jbclog.maintenance.counter_totals.totals import Trace
from jbclog.maintenance.counter_totals.tracing import traces_of
from support.fleets.exchange_fleet import LAST, STEP, Key, Place, Places

NEAR = 1e-6
LAST_HOUR = 99_999.0
DRIFT = 1.01
FASTEST = {
    "sleep_cycles": (60, "plugged_h"),
    "desolder_cycles": (600, "work_h"),
    "dispensed_cycles": (2000, "work_h"),
    "dispensed_mm": (4000, "work_h"),
    "tool_cycles": (60, "on_h"),
    "suction_cycles": (600, "on_h"),
}

Shown = tuple[float, float]


@dataclass
class ExchangeScore:
    """`exchanges` by what can be known of them; `bounds` by what they lie over; `wrong` are those
    that must hold and do not.
    """

    exchanges: Counter[str] = field(default_factory=Counter)
    bounds: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        told, bounds = self.exchanges, self.bounds
        known = 100 * bounds["known"] / max(1, bounds["plain"])
        return (
            f"{told.total()} exchanges: {told['announced']} announced, {told['revealed']} revealed"
            f" by readings, {told['hidden']} that no reading reveals, {told['unseen']} before the"
            f" first look or after the last; {bounds['exchange']} bounds over revealed ones,"
            f" {bounds['hidden']} over hidden ones, of which and of their sums"
            f" {bounds['hidden wrong']} do not hold, {bounds['plain']} over none, of which"
            f" {known:.1f} % known; {bounds['sums']} sums over none that is hidden;"
            f" {len(self.wrong)} wrong, {bounds['too high']} of them too high from below"
        )


def exchange_score(places: Places, seed: int, count: int) -> ExchangeScore:
    """All bounds of all places."""
    score = ExchangeScore()
    for number in range(count):
        place = places.place(seed, number)
        revealed = {hour: standing(place, hour) for hour in place.exchanges}
        score.exchanges.update(revealed.values())
        revealed |= _half_told(place)
        traces = traces_of(History("line", place.name, place.seen, place.facts))
        for trace in [*traces.now.values(), *traces.earlier]:
            _score(score, place, trace, revealed)
    return score


# -- what readings tell of an exchange -------------------------------------------------------------


def standing(place: Place, hour: float) -> str:
    """``announced``, ``revealed``, ``hidden`` or ``unseen``."""
    after = bisect_left(place.moments, hour)
    if not 0 < after < len(place.moments):
        return "unseen"
    begin, end = place.moments[after - 1], place.moments[after]
    said = any(
        fact.task == REPLACED and begin < _hour(place, fact.time) <= end for fact in place.facts
    )
    if said or place.stands(begin).model != place.stands(end).model:
        return "announced"
    odd = [key for key in place.grown if _contradicts(place, key, after)]
    if place.stands(begin).unit == place.stands(end).unit or _was_told_reset(place, after):
        return "hidden"
    if not odd or (len(odd) == 1 and _is_for_once(place, odd[0], hour)):
        return "hidden"
    return "revealed"


def _was_told_reset(place: Place, after: int) -> bool:
    """Whether somebody told of a reset before the look `after`, since which all that is shown can
    have been counted.
    """
    begin, end = place.moments[after - 1], place.moments[after]
    told = any(
        fact.task == RESET and begin < _hour(place, fact.time) <= end for fact in place.facts
    )
    return told and all(
        _can_be_since(key, shown[0], end - begin)
        for key in place.grown
        if (shown := _read(place, key, after))
    )


def _can_be_since(key: Key, shown: float, hours: float) -> bool:
    return shown <= hours * DRIFT * (FASTEST[key[1]][0] if key[1] in FASTEST else 1.0)


def _contradicts(place: Place, key: Key, after: int) -> bool:
    """Whether the last reading before the look `after`, and the first from it on, are not of one
    unit that went on.
    """
    found = _around(place, key, after)
    if found is None:
        return False
    begin, end, (low, high), (new_low, new_high) = found
    if end - begin > 1 and any(
        _is_odd(place, look) for look in range(begin + 1, end + 1) if look != after
    ):
        return False
    lasted = (place.moments[end] - place.moments[begin]) * DRIFT
    step, modulus = STEP.get(key[1], 1.0), LAST.get(key[1], 99_999.0) + STEP.get(key[1], 1.0)
    if key[1].endswith("_h"):
        most = lasted + step
    else:
        rate, hours = FASTEST[key[1]]
        most = rate * min(lasted, _hours_grown(place, (key[0], hours), begin, end, lasted)) + (
            STEP.get(key[1], 0.0)
        )
    least, greatest = new_low - high, new_high - low
    turns = max(0, math.ceil(-greatest / modulus - 1e-9))
    return least + turns * modulus > most


def _is_odd(place: Place, after: int) -> bool:
    """Whether a counter that was read at a look and at the one before it did not just go on."""
    read = [key for key in place.grown if _read(place, key, after - 1) and _read(place, key, after)]
    return any(_contradicts(place, key, after) for key in read)


def _hours_grown(place: Place, key: Key, begin: int, end: int, lasted: float) -> float:
    before, after = _read(place, key, begin), _read(place, key, end)
    # where it may stand still, it tells nothing
    if before is None or after is None or not before[0] <= after[1] < LAST_HOUR:
        return lasted
    return after[1] - before[0] + 1.0


def _around(place: Place, key: Key, after: int) -> tuple[int, int, Shown, Shown] | None:
    before = next(
        (
            (look, one)
            for look in range(after - 1, -1, -1)
            if (one := _read(place, key, look)) is not None
        ),
        None,
    )
    behind = next(
        (
            (look, one)
            for look in range(after, len(place.seen))
            if (one := _read(place, key, look)) is not None
        ),
        None,
    )
    return (
        None if before is None or behind is None else (before[0], behind[0], before[1], behind[1])
    )


def _read(place: Place, key: Key, look: int) -> Shown | None:
    count = _counts(place, look)[key]
    if count.standing is Standing.UNREAD:
        return None
    return min(count.values), max(count.values)


def _counts(place: Place, look: int) -> dict[Key, Count]:
    return {(one.port, one.counter): one for one in place.seen[look].counts}


def _is_for_once(place: Place, key: Key, hour: float) -> bool:
    """Whether a unit was read once only, and the one before it stood there again at the next look
    that read this counter.
    """
    looks = [look for look in range(len(place.seen)) if _read(place, key, look) is not None]
    units = [place.stands(place.moments[look]).unit for look in looks]
    at = next(
        (number for number, look in enumerate(looks) if place.moments[look] >= hour), len(looks)
    )
    return any(
        0 < one < len(units) - 1 and units[one - 1] == units[one + 1] != units[one]
        for one in (at, at - 1)
    )


def _hour(place: Place, time: str) -> float:
    return (seconds(time) - seconds(place.seen[0].time)) / 3600 + place.moments[0]


# -- bounds ----------------------------------------------------------------------------------------


def _score(score: ExchangeScore, place: Place, trace: Trace, revealed: dict[float, str]) -> None:
    hours = [place.moments[point.look] for point in trace.points]
    for number, one in enumerate(trace.differences):
        over = _over(revealed, hours[number], hours[number + 1])
        score.bounds[over] += 1
        score.bounds["known"] += over == "plain" and one.is_known
        _hold(score, place, trace, (number, number + 1), over, str(one))
    for begin, end in _sums(len(hours)):
        over = _over(revealed, hours[begin], hours[end])
        score.bounds["sums"] += over != "hidden"
        _hold(score, place, trace, (begin, end), over, f"the sum from look {begin} to {end}")


def _over(revealed: dict[float, str], begin: float, end: float) -> str:
    found = {standing for hour, standing in revealed.items() if begin < hour <= end}
    return "hidden" if "hidden" in found else "exchange" if found else "plain"


def _half_told(place: Place) -> dict[float, str]:
    """Of two resets between two looks of which one was told and the other was not, the other is
    hidden.
    """
    found = {}
    for begin, end in pairwise(place.moments):
        resets = [(hour, told) for hour, told in place.resets if begin < hour <= end]
        if {told for _, told in resets} == {True, False}:
            found |= {hour: "hidden" for hour, told in resets if not told}
    return found


def _sums(count: int) -> Iterator[tuple[int, int]]:
    """From the first reading, and from one in the middle, to the last."""
    if count > 3:
        yield from ((0, count - 1), (count // 2, count - 1))


def _hold(
    score: ExchangeScore, place: Place, trace: Trace, at: tuple[int, int], over: str, what: str
) -> None:
    begin, end = (trace.points[number] for number in at)
    key = trace.port, trace.counter
    # of a counter that moved while it was read, what was worked from one of its readings to another
    late = 0.008 if begin.shown.width or end.shown.width else 0.0
    hours = place.moments[begin.look], place.moments[end.look]
    least = place.true(key, hours[0]) * -1 + place.true(key, hours[1])
    most = least + (place.true(key, hours[1] + late) - place.true(key, hours[1]))
    worked = trace.between(*at) if at[1] - at[0] > 1 else trace.differences[at[0]].delta
    if worked.low - NEAR <= most and least <= worked.high + NEAR:
        return
    if over == "hidden":
        score.bounds["hidden wrong"] += 1
        return
    score.bounds["too high"] += worked.low > most
    score.wrong.append(f"{place.name} {key} {over}: {least:.1f} worked, {worked}: {what}")
