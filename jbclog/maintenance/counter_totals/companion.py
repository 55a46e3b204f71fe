"""Two counters that go together: millimetres for each feed. One that rolls over often is told by the one that does not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from jbclog.maintenance.counter_totals.interval import Interval
from jbclog.maintenance.counter_totals.judgement import Judged, turned
from jbclog.maintenance.counter_totals.totals import Kind

Ratios = Mapping[tuple[int, str], Interval]
"""By port and counter: how much a counter grew for each count of its companion, at the least and at the most, with a margin."""

COMPANION: Final = {"dispensed_mm": "dispensed_cycles"}
OPEN: Final = ("can_have_rolled_over", "rolled_over_unknown_times")
LEAST_COUNTS: Final = 100.0
LEAST_SEEN: Final = 3
MARGIN: Final = 2.5  # another product may take that much more or less


def ratios_of(looks: Iterable[Iterable[Judged]]) -> dict[tuple[int, str], Interval]:
    """What was seen, of differences that are known, at every look."""
    seen: dict[tuple[int, str], list[float]] = {}
    for judged in map(list, looks):
        for one in judged:
            beside = _beside(one, judged)
            if beside is not None and one.is_known:
                seen.setdefault((one.span.port, one.span.counter), []).append(one.delta.middle / beside.delta.middle)
    return {key: Interval(min(all_) / MARGIN, max(all_) * MARGIN) for key, all_ in seen.items() if len(all_) >= LEAST_SEEN}


def by_companion(judged: Judged, others: Iterable[Judged], ratios: Ratios) -> Judged:
    """How often it rolled over, where only one number of times fits what its companion counted."""
    span = judged.span
    ratio = ratios.get((span.port, span.counter)) if judged.rule in OPEN else None
    beside = _beside(judged, others) if ratio is not None else None
    if ratio is None or beside is None:
        return judged
    possible = ([] if span.fell else [0]) + list(span.turns(span.most))
    fitting = [turns for turns in possible if _fits(turned(span, turns), beside.delta, ratio)]
    if len(fitting) != 1:
        return judged
    return Judged(span, Kind.ROLL_OVER if fitting[0] else Kind.NORMAL, "fits_its_companion", turns=fitting[0])


def _beside(judged: Judged, others: Iterable[Judged]) -> Judged | None:
    """Its companion over the same time, where that is known and counted enough."""
    name, begin = COMPANION.get(judged.span.counter), judged.span.before.look
    for one in others if name else ():
        if (one.span.counter, one.span.port, one.span.before.look) == (name, judged.span.port, begin):
            return one if one.is_known and one.delta.low >= LEAST_COUNTS else None
    return None


def _fits(worked: Interval, counted: Interval, ratio: Interval) -> bool:
    return worked.high >= ratio.low * counted.low and worked.low <= ratio.high * counted.high
