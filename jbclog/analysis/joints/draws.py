"""A draw of heat: contacts of the tip (`draws`) that belong together, and how much heat went into the work.

*Heat* is the integral of the flow, to twice the smoothing beyond its edges, so that what the smoothing spread is in it.
*Confidence* is 1 - ½·exp(1 - m) with m the peak over the limit that noise reaches once in 31 600 looks; halved with fewer
than three readings. It is no probability.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from jbclog.analysis.joints.contacts import HIGH_NOISES, HIGH_PERMILLE, Flow, Span, find_spans
from jbclog.analysis.joints.parameters import Taken
from jbclog.analysis.joints.segments import segments
from jbclog.analysis.joints.thermal import ThermalModel
from jbclog.analysis.verdict.idle import Floats

LEAST_HEAT: Final = 20.0  # ‰·s: less is within what the heat balance leaves; the smallest pad takes 100
SURE_DWELL_S, SURE_HEAT, SURE_PEAK = 0.5, 65.0, 80.0
FEW_READINGS: Final = 3
CUT_CONFIDENCE: Final = 0.5  # of the draw's
SEEN_TO_FALL: Final = 0.7  # of the lower of both sides: a flow that falls to less between two feeds has fallen
SHOWN_PERIOD_S: Final = 0.25  # rates that are slower do not show what lies between two joints
JOINT, NOT_KNOWN = "joint", "not known"
ENDS, BEGINS = "The record, or the tool's work, ends in it.", "The record, or the tool's work, begins in it."


@dataclass(frozen=True, slots=True)
class Draw:
    """A draw of heat: seconds on the grid, s, ‰·s, ‰. `contacts` were put together in it; `fed` is None where that is not known.

    `cut` says what cut it off, where something did; `loss` is that of its tip's model in ‰/K. A feed of which no draw was found
    has neither heat nor peak, and its edges are those of the time in which it was. `cut_by_feeds`: it is a part of a draw in which
    there were feeds of several joints. `is_unfed`: wire decides, and none was pushed in it. `late_s`: how much later than its edges
    the temperature shows it.
    """

    start_s: float
    end_s: float
    dwell_s: float
    heat: float | None
    peak: float | None
    contacts: int
    confidence: float
    cut: str | None = None
    fed: bool | None = None
    loss: float | None = None
    cut_by_feeds: bool = False
    is_unfed: bool = False
    late_s: float = 0.0

    @property
    def kind(self) -> str:
        """``joint``, or ``not known`` where it may as well be a wipe or a touch without solder, or a feed without a joint."""
        if self.is_unfed:
            return NOT_KNOWN
        sure = self.dwell_s >= SURE_DWELL_S and (self.heat or 0.0) >= SURE_HEAT and (self.peak or 0.0) >= SURE_PEAK
        return JOINT if (self.fed and self.heat is not None) or sure else NOT_KNOWN


def is_joint(draw: Draw, settings: Taken) -> bool:
    """Whether it lasts long enough; one that was cut off may have."""
    return draw.dwell_s >= settings.least_dwell_s or draw.cut is not None or bool(draw.fed)


def draws_of(part: Flow, model: ThermalModel, settings: Taken) -> list[Draw]:
    """The draws of a stretch: contacts, put together where they are close."""
    spans = find_spans(part, model.noise, settings.expected_every_s)
    together: list[list[Span]] = []
    for span in spans:
        if together and span.start_s - together[-1][-1].end_s < settings.merge_gap_s:
            together[-1].append(span)
        else:
            together.append([span])
    return [draw for draw in _draws(part, model, together) if (draw.heat or 0.0) >= LEAST_HEAT]


def _draws(part: Flow, model: ThermalModel, together: Sequence[Sequence[Span]]) -> list[Draw]:
    """Each of these contacts as a draw."""
    flow, period, noise, late_s = part.flow, part.stretch.period_s, model.noise, model.delay.moved_s
    beside = max(round(2 * noise.smooth_s / period), 1)
    first = np.array([some[0].first for some in together], dtype=np.int64)
    last = np.array([some[-1].last for some in together], dtype=np.int64)
    begin = np.maximum(first - beside, np.append(0, last[:-1] + 1))
    until = np.minimum(last + beside + 1, np.append(first[1:], len(flow)))
    heats = segments(begin, np.maximum(until, begin)).total(flow) * period
    peaks = segments(first, last + 1).greatest(flow)
    over = np.maximum(peaks / max(HIGH_NOISES * noise.flow, HIGH_PERMILLE), 1.0)
    sure = 1 - 0.5 * np.exp(1 - over)
    found: list[Draw] = []
    for some, heat, peak, confidence in zip(together, heats.tolist(), peaks.tolist(), sure.tolist(), strict=True):
        start_s, end_s = some[0].start_s, some[-1].end_s
        few = (end_s - start_s) / period + 1 < FEW_READINGS
        cut = ENDS if some[-1].last >= len(flow) - 2 else BEGINS if some[0].first <= 1 else None
        dwell = sum(span.end_s - span.start_s for span in some)
        confidence = round(confidence * (0.5 if few else 1.0), 3)
        found.append(Draw(start_s, end_s, dwell, heat, peak, len(some), confidence, cut, None, model.loss, late_s=late_s))
    return found


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
