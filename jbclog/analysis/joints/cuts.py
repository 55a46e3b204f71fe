"""Draws put together, or cut, because the feeder shows that they are one joint or several."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from jbclog.analysis.joints.draw import Draw
from jbclog.analysis.joints.draws import Flow
from jbclog.analysis.verdict.idle import Floats

CUT_CONFIDENCE: Final = 0.5  # of the draw's
SEEN_TO_FALL: Final = 0.7  # of the lower of both sides: a flow that falls to less between two feeds has fallen
SHOWN_PERIOD_S: Final = 0.25  # rates that are slower do not show what lies between two joints


class Flows:
    """The flow of a port by its seconds."""

    def __init__(self, looked: Sequence[Flow]) -> None:
        self._looked = looked
        self._starts = [float(one.stretch.seconds[0]) for one in looked]

    def between(self, start_s: float, end_s: float) -> tuple[Floats, Floats]:
        """Seconds and flow in ‰ from one moment to the other, as far as they lie in one stretch."""
        place = bisect_right(self._starts, start_s + 1e-6) - 1
        if place < 0:
            return np.empty(0), np.empty(0)
        one = self._looked[place]
        first, last = np.searchsorted(one.stretch.seconds, [start_s - 1e-6, end_s + 1e-6])
        return one.stretch.seconds[first:last], one.flow[first:last]


def put_together(draws: Sequence[Draw]) -> Draw:
    """Neighbours as one draw."""
    first, last = draws[0], draws[-1]
    if first is last:
        return first
    heats, peaks = [one.heat for one in draws if one.heat is not None], [one.peak for one in draws if one.peak is not None]
    return replace(
        first,
        end_s=last.end_s,
        dwell_s=sum(one.dwell_s for one in draws),
        heat=sum(heats) if heats else None,
        peak=max(peaks, default=None),
        contacts=sum(one.contacts for one in draws),
        confidence=max(one.confidence for one in draws),
        cut=last.cut or first.cut,
    )


def lowest_between(flows: Flows, start_s: float, end_s: float, period_s: float) -> float:
    """The moment of the lowest flow between two; their middle where no flow is known."""
    seconds, flow = flows.between(start_s, max(end_s, start_s + period_s))
    return float(seconds[flow.argmin()]) if len(flow) else (start_s + end_s) / 2


def has_fallen(flows: Flows, before_s: float, valley_s: float, after_s: float, period_s: float) -> bool:
    """Whether the flow is seen to fall at a moment between two others, or the rate cannot show it."""
    _, before = flows.between(before_s, valley_s)
    _, after = flows.between(valley_s, after_s)
    if period_s > SHOWN_PERIOD_S or not len(before) or not len(after):
        return True
    return float(after[0]) <= SEEN_TO_FALL * min(float(before.max()), float(after.max()))


def cut(draw: Draw, moments: Sequence[float], flows: Flows, period_s: float) -> list[Draw]:
    """The parts of a draw between these moments."""
    edges = [draw.start_s, *moments, draw.end_s]
    parts = []
    for start, end in pairwise(edges):
        _, flow = flows.between(start, end)
        parts.append(
            replace(
                draw,
                start_s=start,
                end_s=end,
                dwell_s=end - start,
                heat=float(flow.sum()) * period_s if len(flow) else draw.heat,
                peak=float(flow.max()) if len(flow) else draw.peak,
                contacts=1,
                confidence=round(CUT_CONFIDENCE * draw.confidence, 3),
                cut=None,
                cut_by_feeds=True,
            )
        )
    parts[-1] = replace(parts[-1], cut=draw.cut)
    return parts
