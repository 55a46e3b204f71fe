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

from dataclasses import dataclass
from typing import Final

import numpy as np

from jbclog.analysis.joints.segments import Places, highest_running_sum, runs, segments
from jbclog.analysis.joints.series import Stretch
from jbclog.analysis.joints.thermal import COARSE_S, Noise, ThermalModel, flow_of, rate, smooth
from jbclog.analysis.verdict.idle import Flags, Floats

HIGH_NOISES, HIGH_PERMILLE = 4.0, 35.0
LOW_NOISES, LOW_PERMILLE = 2.0, 14.0
EDGE_NOISES: Final = 3.0
VALLEY_NOISES, VALLEY_SHARE = 2.0, 0.6
CLEAR_NOISES: Final = 6.0
FRESH_NOISES: Final = 5.0
FRESH_TIMES: Final = 2.5  # of the flow before: a contact that continues does not rise so far
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
    """The flow of a stretch; what flows before the tip is ready goes into the tip.

    A temperature that is shown late belongs to the power of then; the stretch of the flow is as early as that power.
    """
    flow = flow_of(stretch.power_later(model.delay.rows), model.values, model.noise.smooth_s)
    return Flow(stretch.earlier(model.delay.moved_s), np.where(ready, flow, 0.0))


def find_spans(part: Flow, noise: Noise, expected_every_s: float | None = None) -> list[Span]:
    """The contacts of a stretch in their order; `expected_every_s` helps to tell two of them apart, and makes none."""
    if len(part.flow) < 3:
        return []
    period = part.stretch.period_s
    rises = rate(part.flow, period)
    more = float(np.sqrt(max(COARSE_S**2 - noise.smooth_s**2, 0.0))) / period
    coarse = smooth(part.flow, more) if more > 0.1 else part.flow
    looked = _Looked(part, rises, *_edges(rises, EDGE_NOISES * noise.rate), coarse, noise, expected_every_s)
    first, last = _joined(looked, *_parts(looked))
    high = segments(first, last).greatest(looked.flow) >= looked.high
    return _spans(looked, first[high], last[high])


@dataclass(frozen=True, slots=True)
class _Looked:
    part: Flow
    rises: Floats
    edges: Places
    upward: Flags
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

    def rows(self, seconds: float) -> int:
        return max(round(seconds / self.part.stretch.period_s), 1)


def _edges(rises: Floats, least: float) -> tuple[Places, Flags]:
    """The rows of the edges beyond the noise, and which of them rise; the others fall."""
    inner = rises[1:-1]
    top = (inner >= least) & (inner > rises[:-2]) & (inner >= rises[2:])
    bottom = (inner <= -least) & (inner < rises[:-2]) & (inner <= rises[2:])
    rows = np.flatnonzero(top | bottom)
    return rows + 1, top[rows]


def _parts(looked: _Looked) -> tuple[Places, Places]:
    """The runs above the low limit, cut at their valleys: first rows, and those behind the last."""
    first, last = runs(looked.flow > looked.low)
    valleys = _valleys(looked, first, last)
    return np.sort(np.concatenate([first, valleys])), np.sort(np.concatenate([valleys, last]))


def _valleys(looked: _Looked, first: Places, last: Places) -> Places:
    """Where a run is lowest between a falling and the next rising edge."""
    run = np.searchsorted(first, looked.edges) - 1  # an edge in the first row of a run is outside
    within = (run >= 0) & (looked.edges < np.append(last, 0)[run])
    pairs = within[:-1] & within[1:] & (run[:-1] == run[1:]) & ~looked.upward[:-1] & looked.upward[1:]
    return segments(looked.edges[:-1][pairs], looked.edges[1:][pairs] + 1).where_least(looked.flow)


def _joined(looked: _Looked, first: Places, last: Places) -> tuple[Places, Places]:
    """Parts that are not apart as one. Most are seen to be apart at once; the others are looked at one after the other."""
    if len(first) < 2:
        return first, last
    apart = first[1:] - last[:-1] > looked.rows(FAR_S)
    near = np.flatnonzero(~apart)
    between = segments(last[near] - 1, first[near + 1] + 1)
    lowest, lowest_coarse = between.least(looked.flow), between.least(looked.coarse)
    zero = (lowest < VALLEY_NOISES * looked.noise.flow) & (lowest_coarse <= COARSE_NOISES * looked.noise.coarse)
    begin, until = first.tolist(), last.tolist()
    for place in np.flatnonzero(~zero).tolist():
        one, valley = int(near[place]), (float(lowest[place]), float(lowest_coarse[place]))
        zero[place] = _apart(looked, (begin[one], until[one]), (begin[one + 1], until[one + 1]), valley)
        if not zero[place]:
            begin[one + 1] = begin[one]
    apart[near] = zero
    return first[np.append(True, apart)], last[np.append(apart, True)]


def _apart(looked: _Looked, one: Part, other: Part, valley: tuple[float, float]) -> bool:
    """Whether the flow was zero between two parts whose valley is not near zero; `valley` is its lowest, and so when smoothed."""
    flow, coarse, noise = looked.flow, looked.coarse, looked.noise
    lowest, lowest_coarse = valley
    near_zero = VALLEY_NOISES * noise.flow
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


def _spans(looked: _Looked, first: Places, last: Places) -> list[Span]:
    """The edges of these contacts: the steepest rise before the peak, and the likeliest end."""
    peak = segments(first, last).where_greatest(looked.flow)
    start = segments(np.maximum(first - looked.rows(LOOK_S), 0), peak + 1).where_greatest(looked.rises)
    end, end_s = _ends(looked, start, last, np.append(first[1:], len(looked.flow)))
    starts_s = _moments(looked.part, looked.rises, start)
    return [Span(*one) for one in zip(starts_s.tolist(), end_s.tolist(), start.tolist(), end.tolist(), strict=True)]


def _ends(looked: _Looked, start: Places, last: Places, next_first: Places) -> tuple[Places, Floats]:
    """The rows and moments of their ends: where a fall from the last flow to nothing is likeliest, or the record's last row."""
    flow, seconds, period = looked.flow, looked.part.stretch.seconds, looked.part.stretch.period_s
    fall = _falls(looked, start, last, next_first)
    until = np.minimum(np.maximum(last + looked.rows(LOOK_S), fall + looked.rows(TAIL_S)), np.minimum(next_first, len(flow)))
    begin = np.maximum(fall - looked.rows(TAIL_S), start + 1)
    before = np.maximum(fall - looked.rows(LEVEL_S), start)
    levels = segments(before, np.maximum(fall - looked.rows(EDGE_S), before + 1))
    half = 0.5 * np.maximum(levels.total(flow) / levels.lengths, looked.noise.flow)
    end, beyond = fall.copy(), np.zeros(len(fall))
    seen = until - begin >= 2
    end[seen] = highest_running_sum(flow, begin[seen], until[seen], half[seen])
    here, after = flow[end], flow[np.minimum(end + 1, len(flow) - 1)]
    falls = here > after
    share = np.clip((here - half) / np.where(falls, here - after, 1.0), 0.0, 1.0)
    beyond[seen] = np.where(falls, share, 0.5)[seen]
    cut = last >= len(flow)
    end[cut], beyond[cut] = len(flow) - 1, 0.0
    return end, np.minimum(seconds[end] + beyond * period, seconds[-1])


def _falls(looked: _Looked, start: Places, last: Places, next_first: Places) -> Places:
    """The rows of the steepest falls at their ends."""
    until = np.minimum(np.minimum(last + looked.rows(LOOK_S), next_first), len(looked.flow))
    begin = np.maximum(last - 1 - looked.rows(TAIL_S), start + 1)
    fall, seen = last - 1, until > begin
    fall[seen] = segments(begin[seen], until[seen]).where_least(looked.rises)
    return fall


def _moments(part: Flow, steepness: Floats, rows: Places) -> Floats:
    """The moments of extremes between the rows: the top of a parabola through each and its neighbours."""
    seconds, inner = part.stretch.seconds, (rows > 0) & (rows < len(steepness) - 1)
    near = np.clip(rows, 1, len(steepness) - 2)
    before, here, after = steepness[near - 1], steepness[near], steepness[near + 1]
    bend = before - 2 * here + after
    bent = inner & (bend < 0)
    beside = np.where(bent, np.clip(0.5 * (before - after) / np.where(bent, bend, -1.0), -0.5, 0.5), 0.0)
    return np.clip(seconds[rows] + beside * part.stretch.period_s, seconds[0], seconds[-1])
