"""Draws of heat: when the tip touched something, from the heat flow into the work (`thermal`).

Finding. A *part* is a run of rows whose flow is above a low limit, cut where the flow comes near zero between a falling and a
rising edge that both are beyond the noise. Two parts are *apart* where one of three things shows that the flow was zero between
them: both stand `CLEAR_NOISES` above the valley; the flow is near zero also when smoothed to `COARSE_S`; or what follows is the
fresh onset of a contact. Else they are one contact, such as a long one whose flow has fallen to the noise. A contact is what
reaches the high limit.

An edge is an extreme of the flow's rate of change, which after the Gaussian smoothing is the matched detection of a step in
noise (J. Canny, A Computational Approach to Edge Detection, IEEE Trans. PAMI 8, 1986): its place does not depend on how high the
step is, nor on what comes before. An end is low, as the work has warmed up; it is placed where a fall from the last flow to zero
is most likely, which is where the sum of the flow beyond half of that is greatest (D. V. Hinkley, Biometrika 57, 1970).

Error rates. The limits are multiples of the standard deviation that the temperature's noise gives the flow and its rate of
change: noise alone passes `HIGH_NOISES` once in 31 600 independent looks, and `EDGE_NOISES` once in 4300. Floors keep the
model's own error out.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from jbclog.analysis.joints.series import Stretch
from jbclog.analysis.joints.thermal import COARSE_S, Noise, ThermalModel, flow_of, rate, smooth
from jbclog.analysis.verdict.idle import Flags, Floats

HIGH_NOISES, HIGH_PERMILLE = 4.0, 35.0
LOW_NOISES, LOW_PERMILLE = 2.0, 14.0
EDGE_NOISES: Final = 3.0
VALLEY_NOISES, VALLEY_SHARE = 2.0, 0.6
CLEAR_NOISES: Final = 6.0
FRESH_NOISES: Final = 5.0
FRESH_TIMES: Final = 2.5  # of the flow before: a contact that goes on does not rise so far
COARSE_NOISES, COARSE_SHARE = 2.0, 0.65
EXPECTED_SHARE, EXPECTED_VALLEY = 0.6, 0.6  # of the time expected between two joints, and of the lower neighbour
FAR_S: Final = 1.5  # two parts so far from each other are apart, which spares the look
BESIDE_S: Final = 0.8  # how far from a valley its neighbours are looked at
LOOK_S: Final = 0.3  # how far from the low limit's crossing a start is looked for
TAIL_S: Final = 0.6  # how far from the end of the run a contact's end is looked for
LEVEL_S, EDGE_S = 0.6, 0.15  # before the steepest fall: from when to when a contact's last flow is taken

Part = tuple[int, int]
"""First row, and one behind the last."""


@dataclass(frozen=True, slots=True)
class Span:
    """A contact: its first and last moment in grid seconds, and the rows of these."""

    start_s: float
    end_s: float
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Flow:
    """The heat flow into the work in ‰ in each row of a stretch; zero where the tip was not ready."""

    stretch: Stretch
    flow: Floats


def flows(stretch: Stretch, model: ThermalModel, ready: Flags) -> Flow:
    """The flow of a stretch; what flows before the tip is ready goes into the tip."""
    return Flow(stretch, np.where(ready, flow_of(stretch, model.values, model.noise.smooth_s), 0.0))


def find_spans(part: Flow, noise: Noise, expected_every_s: float | None = None) -> list[Span]:
    """The contacts of a stretch in their order; `expected_every_s` helps to tell two of them apart, and makes none."""
    if len(part.flow) < 3:
        return []
    period = part.stretch.period_s
    rises = rate(part.flow, period)
    more = float(np.sqrt(max(COARSE_S**2 - noise.smooth_s**2, 0.0))) / period
    coarse = smooth(part.flow, more) if more > 0.1 else part.flow
    looked = _Looked(part, rises, *_edges(rises, EDGE_NOISES * noise.rate), coarse, noise, expected_every_s)
    contacts = [one for one in _joined(looked, _parts(looked)) if looked.top(*one) >= looked.high]
    starts = [*(first for first, _ in contacts), len(part.flow)]
    return [_span(looked, one, starts[number + 1]) for number, one in enumerate(contacts)]


@dataclass(frozen=True, slots=True)
class _Looked:
    part: Flow
    rises: Floats
    upward: list[int]
    downward: list[int]
    coarse: Floats
    noise: Noise
    expected_every_s: float | None

    @property
    def flow(self) -> Floats:
        return self.part.flow

    @property
    def high(self) -> float:
        return max(HIGH_NOISES * self.noise.flow, self.noise.floors * HIGH_PERMILLE)

    @property
    def low(self) -> float:
        return max(LOW_NOISES * self.noise.flow, self.noise.floors * LOW_PERMILLE)

    def top(self, first: int, last: int) -> float:
        return float(self.part.flow[first:last].max())

    def rows(self, seconds: float) -> int:
        return max(round(seconds / self.part.stretch.period_s), 1)


def _edges(rises: Floats, least: float) -> tuple[list[int], list[int]]:
    """The rows of the rising and of the falling edges beyond the noise."""
    inner = rises[1:-1]
    top = (inner >= least) & (inner > rises[:-2]) & (inner >= rises[2:])
    bottom = (inner <= -least) & (inner < rises[:-2]) & (inner <= rises[2:])
    return (np.flatnonzero(top) + 1).tolist(), (np.flatnonzero(bottom) + 1).tolist()


def _parts(looked: _Looked) -> list[Part]:
    """The runs above the low limit, cut at their valleys."""
    above = looked.flow > looked.low
    sides = np.flatnonzero(np.diff(np.concatenate(([0], above.astype(np.int8), [0])))).tolist()
    parts: list[Part] = []
    for first, last in zip(sides[::2], sides[1::2], strict=True):
        cuts = [first, *_valleys(looked, first, last), last]
        parts += pairwise(cuts)
    return parts


def _valleys(looked: _Looked, first: int, last: int) -> list[int]:
    """Where a run is lowest between a falling and the next rising edge."""
    falls, rises = _within(looked.downward, first, last), _within(looked.upward, first, last)
    if not falls or not rises:
        return []
    edges = sorted([*((row, -1) for row in falls), *((row, 1) for row in rises)])
    pairs = [(fall, rise) for (fall, one), (rise, other) in pairwise(edges) if one < 0 < other]
    return sorted({valley for fall, rise in pairs if (valley := fall + int(looked.flow[fall : rise + 1].argmin())) > first})


def _within(rows: list[int], first: int, last: int) -> list[int]:
    return rows[bisect_right(rows, first) : bisect_left(rows, last)]


def _joined(looked: _Looked, parts: list[Part]) -> list[Part]:
    """Parts that are not apart as one."""
    together: list[Part] = []
    for first, last in parts:
        if together and not _apart(looked, together[-1], (first, last)):
            together[-1] = (together[-1][0], last)
        else:
            together.append((first, last))
    return together


def _apart(looked: _Looked, one: Part, other: Part) -> bool:
    """Whether the flow was zero between the two."""
    flow, coarse, noise = looked.flow, looked.coarse, looked.noise
    between = slice(one[1] - 1, other[0] + 1)
    lowest, lowest_coarse = float(flow[between].min()), float(coarse[between].min())
    near_zero = VALLEY_NOISES * noise.flow
    if other[0] - one[1] > looked.rows(FAR_S) or (lowest < near_zero and lowest_coarse <= COARSE_NOISES * noise.coarse):
        return True
    beside = looked.rows(BESIDE_S)
    left, right = slice(max(one[0], one[1] - beside), one[1]), slice(other[0], min(other[1], other[0] + beside))
    before, after = float(flow[left].max()), float(flow[right].max())
    lower, coarse_lower = min(before, after), min(float(coarse[left].max()), float(coarse[right].max()))
    if looked.expected_every_s and other[0] - one[0] >= looked.rows(EXPECTED_SHARE * looked.expected_every_s):
        return lowest < max(near_zero, EXPECTED_VALLEY * lower)
    if lowest_coarse <= max(noise.floors * LOW_PERMILLE, COARSE_SHARE * coarse_lower):
        return lowest < max(near_zero, VALLEY_SHARE * lower)
    if lower >= CLEAR_NOISES * noise.flow:
        return lowest < VALLEY_SHARE * lower
    is_fresh = after >= max(FRESH_NOISES * noise.flow, FRESH_TIMES * before)
    return is_fresh and lowest < max(near_zero, VALLEY_SHARE * after)


def _span(looked: _Looked, one: Part, next_first: int) -> Span:
    """Its edges: the steepest rise before the peak, and the likeliest end."""
    first, last = one
    peak = first + int(looked.flow[first:last].argmax())
    begin = max(first - looked.rows(LOOK_S), 0)
    start = begin + int(looked.rises[begin : peak + 1].argmax())
    end, end_s = _end(looked, start, last, next_first)
    return Span(_moment(looked.part, looked.rises, start), end_s, start, end)


def _end(looked: _Looked, start: int, last: int, next_first: int) -> tuple[int, float]:
    """The row of its end, and the moment: where a fall from its last flow to nothing is most likely, or the record's last row."""
    flow, seconds, period = looked.flow, looked.part.stretch.seconds, looked.part.stretch.period_s
    if last >= len(flow):
        return len(flow) - 1, float(seconds[-1])
    fall = _fall(looked, start, last, next_first)
    until = min(max(last + looked.rows(LOOK_S), fall + looked.rows(TAIL_S)), next_first, len(flow))
    begin = max(fall - looked.rows(TAIL_S), start + 1)
    if until - begin < 2:
        return fall, float(seconds[fall])
    before = max(fall - looked.rows(LEVEL_S), start)
    level = flow[before : max(fall - looked.rows(EDGE_S), before + 1)].mean()
    half = 0.5 * max(float(level), looked.noise.flow)
    end = begin + int(np.cumsum(flow[begin:until] - half).argmax())
    beyond = 0.5
    if end + 1 < len(flow) and flow[end] > flow[end + 1]:
        beyond = min(max(float((flow[end] - half) / (flow[end] - flow[end + 1])), 0.0), 1.0)
    return end, min(float(seconds[end]) + beyond * period, float(seconds[-1]))


def _fall(looked: _Looked, start: int, last: int, next_first: int) -> int:
    """The row of the steepest fall at its end."""
    until = min(last + looked.rows(LOOK_S), next_first, len(looked.flow))
    begin = max(last - 1 - looked.rows(TAIL_S), start + 1)
    return begin + int(looked.rises[begin:until].argmin()) if until > begin else last - 1


def _moment(part: Flow, steepness: Floats, row: int) -> float:
    """The moment of an extreme between the rows: the top of a parabola through it and its neighbours."""
    beside = 0.0
    if 0 < row < len(steepness) - 1:
        before, here, after = (float(one) for one in steepness[row - 1 : row + 2])
        bend = before - 2 * here + after
        beside = min(max(0.5 * (before - after) / bend, -0.5), 0.5) if bend < 0 else 0.0
    seconds = part.stretch.seconds
    return float(min(max(seconds[row] + beside * part.stretch.period_s, seconds[0]), seconds[-1]))
