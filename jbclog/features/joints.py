"""Joints, found without labels from the heat that leaves the tip (`heat`).

Definition. A *touch* is a time in which the flow into the work is above its noise (`NOISES` standard deviations, `FLOOR_PERMILLE`
at least, at its highest). Where it falls between two peaks to less than `VALLEY` of the lower one, two touches meet. A touch's
*dwell* is the time from the first to the last moment at which its flow is above `SHARE` of its peak, less what the smoothing adds.
Touches less than `MERGE_S` apart belong together. *A joint* is one touch, or several that belong together, of which one at least

- dwells `LEAST_DWELL_S`: what is shorter is a wipe over a sponge, a poke into brass wool, a slip;
- takes `LEAST_HEAT` ‰·s of heat at a peak of `LEAST_PEAK` ‰: what takes less is a touch without solder, through which a dry
  contact hardly lets heat.

So a joint here is *a draw of heat as long and as large as a joint's*. Whether there was solder cannot be known from power and
temperature: a tip that rests in a wet sponge for as long as a joint is counted as one, and a joint that is shorter or smaller
than this is not. Where a feeder's state is read (ale) it decides: if wire was pushed at half of the joints found or more, each
touch with wire is a joint and none without. Nothing here says that a joint is good.

Start and end are those of the dwell, to the sampling period. *Heat* is the flow into the work, above what holds the tip, over the
time of the joint. *Confidence* is 1 - ½·exp(1 - m) with m the least of dwell, heat and peak over their limits: 0.5 at the limit,
0.82 at twice, 0.93 at three times as much, where wire decided the greater of this and 0.9; it is halved where the joint has fewer
than three readings. It is no probability.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from jbclog.features.heat import Flow, Flows, find_flows, find_tip
from jbclog.features.series import Series, stretches
from jbclog.judge.idle import Floats

NOISES, FLOOR_PERMILLE = 3.5, 40.0
EDGE = 0.4  # of that: where a touch begins and ends at the latest
VALLEY, VALLEY_NOISES = 0.65, 1.0
SHARE, SHARE_NOISES = 0.35, 1.5
GAUSS_EDGES = 0.77  # a rectangle smoothed with s grows by 2 × 0.385 s at 0.35 of its height
MERGE_S, LEAST_PART = 0.7, 15.0
LEAST_DWELL_S, LEAST_HEAT, LEAST_PEAK = 0.60, 65.0, 80.0
FEW_READINGS, BY_WIRE = 3, 0.9


@dataclass(frozen=True, slots=True)
class Touch:
    """One touch: its first and last moment in grid seconds, dwell in s, heat in ‰·s, peak in ‰."""

    start_s: float
    end_s: float
    dwell_s: float
    heat: float
    peak: float

    @property
    def is_long(self) -> bool:
        """Whether a joint can be made of it."""
        return self.margin >= 1.0

    @property
    def margin(self) -> float:
        """The least of dwell, heat and peak over their limits."""
        return min(self.dwell_s / LEAST_DWELL_S, self.heat / LEAST_HEAT, self.peak / LEAST_PEAK)


@dataclass(frozen=True, slots=True)
class Draw:
    """Touches that belong together, in one stretch of the record."""

    touches: tuple[Touch, ...]
    flow: Flow
    fed: bool | None = None

    @property
    def start_s(self) -> float:
        return self.touches[0].start_s

    @property
    def end_s(self) -> float:
        return self.touches[-1].end_s

    @property
    def main(self) -> Touch:
        """The touch that is most like a joint."""
        return max(self.touches, key=lambda touch: touch.margin)

    @property
    def confidence(self) -> float:
        """From 0 to 1; definition in the module's docstring."""
        sure = max(1 - 0.5 * np.exp(1 - max(self.main.margin, 0.3)), BY_WIRE if self.fed else 0.0)
        readings = (self.end_s - self.start_s) / self.flow.stretch.period_s + 1
        return round(float(sure) * (0.5 if readings < FEW_READINGS else 1.0), 3)


@dataclass(frozen=True, slots=True)
class Found:
    """What came of looking for joints in a port: the joints, the touches that are none, and what they rest on."""

    joints: list[Draw]
    others: list[Draw]
    noise: float
    smooth_s: float
    by_wire: bool = False


def find_joints(series: Series) -> Found:
    """The joints of a port, in order. None in a series without temperature or power."""
    parts = stretches(series)
    tip = find_tip(parts)
    if not tip.found:
        return Found([], [], 0.0, 0.0)
    found = find_flows(parts, tip)
    draws = [draw for part in found.parts for draw in _draws(part, found)]
    return _judged(draws, series, found)


def _judged(draws: Sequence[Draw], series: Series, found: Flows) -> Found:
    """Which draws are joints; by wire, where a feeder tells."""
    by_heat = [any(touch.is_long for touch in draw.touches) for draw in draws]
    fed = [_fed(draw, series) for draw in draws]
    told = [bool(wire) for wire, long in zip(fed, by_heat, strict=True) if long]
    by_wire = bool(told) and 2 * sum(told) >= len(told)
    joints: list[Draw] = []
    others: list[Draw] = []
    for draw, wire, long in zip(draws, fed, by_heat, strict=True):
        (joints if (bool(wire) if by_wire else long) else others).append(Draw(draw.touches, draw.flow, wire))
    return Found(joints, others, found.noise, found.smooth_s, by_wire)


def _fed(draw: Draw, series: Series) -> bool | None:
    """Whether wire was pushed during the draw; None without a feeder or where it was not read."""
    if series.feeding is None:
        return None
    read = series.window(series.feeding, draw.start_s - series.period_s, draw.end_s + series.period_s).values
    return bool(read.any()) if len(read) else None


def _draws(part: Flow, found: Flows) -> Iterator[Draw]:
    """The touches of a stretch, those put together that belong together."""
    together: list[Touch] = []
    for touch in _touches(part, found):
        if together and not (touch.start_s - together[-1].end_s < MERGE_S and min(touch.heat, together[-1].heat) >= LEAST_PART):
            yield Draw(tuple(together), part)
            together = []
        together.append(touch)
    if together:
        yield Draw(tuple(together), part)


def _touches(part: Flow, found: Flows) -> Iterator[Touch]:
    flow, highest = part.flow, max(FLOOR_PERMILLE, NOISES * found.noise)
    for first, last in _runs(flow, EDGE * highest):
        if flow[first:last].max() > highest:
            for start, end in _split(flow, first, last, found.noise):
                if flow[start:end].max() > highest:
                    yield _touch(part, start, end, found)


def _runs(flow: Floats, above: float) -> Iterator[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], (flow > above).astype(np.int8), [0]))))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        yield int(first), int(last)


def _split(flow: Floats, first: int, last: int, noise: float) -> list[tuple[int, int]]:
    """Cut at each valley between two peaks."""
    cuts, open_ = [first], [(first, last)]
    while open_:
        start, end = open_.pop()
        lowest = _valley(flow[start:end], noise)
        if lowest is not None:
            cuts.append(start + lowest)
            open_ += [(start, start + lowest), (start + lowest, end)]
    return list(pairwise([*sorted(cuts), last]))


def _valley(flow: Floats, noise: float) -> int | None:
    """Where the flow falls deepest between two peaks, in proportion to the lower of them; None where it does not fall."""
    if len(flow) < 4:
        return None
    lower = np.minimum(np.maximum.accumulate(flow), np.maximum.accumulate(flow[::-1])[::-1])
    share = np.where(lower - flow > VALLEY_NOISES * noise, flow / lower, 1.0)
    lowest = int(np.argmin(share))
    return lowest if share[lowest] < VALLEY and 0 < lowest < len(flow) - 1 else None


def _touch(part: Flow, first: int, last: int, found: Flows) -> Touch:
    flow, period = part.flow, part.stretch.period_s
    peak = float(flow[first:last].max())
    edge = max(SHARE * peak, min(SHARE_NOISES * found.noise, 0.5 * peak))
    above = first + np.flatnonzero(flow[first:last] > edge)
    start, end = int(above[0]), int(above[-1])
    before, after = _beyond(flow, start, start - 1, edge), _beyond(flow, end, end + 1, edge)
    seconds = part.stretch.seconds
    width = (end - start + before + after) * period
    return Touch(
        float(seconds[start]),
        float(seconds[end]),
        max(width - GAUSS_EDGES * found.smooth_s, 0.0),
        float(flow[first:last].sum() * period),
        peak,
    )


def _beyond(flow: Floats, inside: int, outside: int, edge: float) -> float:
    """How far beyond its last row inside the flow crosses the edge, in rows; half a row where it does not."""
    if not 0 <= outside < len(flow) or flow[outside] > edge:
        return 0.5
    return float((flow[inside] - edge) / (flow[inside] - flow[outside]))
