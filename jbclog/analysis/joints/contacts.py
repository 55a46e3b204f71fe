"""Find contacts, the times in which the tip touched something, from the heat flow into the work
(`thermal`).

A *part* is a run of rows whose flow is above a low limit, cut where the flow comes near zero
between a falling and a rising edge that are both beyond the noise. Two parts are *apart* if the
flow was zero between them. One of three conditions shows this: both are `CLEAR_NOISES` above the
valley; the flow smoothed to `COARSE_S` is near zero too; or the second part has the fresh onset of
a contact. Otherwise they are one contact, such as a long one whose flow has fallen to the noise. A
contact reaches the high limit.

An edge is an extreme of the flow's rate of change. After Gaussian smoothing this is the matched
detection of a step in noise (J. Canny, A Computational Approach to Edge Detection, IEEE Trans. PAMI
8, 1986): its place depends neither on the height of the step nor on what comes before. An end is
low, because the work has warmed up. It is placed where a fall from the last flow to zero is most
likely, which is where the sum of the flow beyond half of that is greatest (D. V. Hinkley,
Biometrika 57, 1970).

The limits are multiples of the standard deviations of the flow and of its rate of change that
follow from the noise of the temperature: noise alone exceeds `HIGH_NOISES` once in 31 600
independent looks, and `EDGE_NOISES` once in 4300. Minimum values in ‰ keep out the model's own
error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from jbclog.analysis.joints.segments import Places, rows_of_highest_sum, runs, segments
from jbclog.analysis.joints.series import Stretch
from jbclog.analysis.joints.thermal import COARSE_S, Noise, ThermalModel, flow_of, rate, smooth
from jbclog.analysis.port_data import Flags, Floats

HIGH_NOISES, HIGH_PERMILLE = 4.0, 35.0
LOW_NOISES, LOW_PERMILLE = 2.0, 14.0
EDGE_NOISES: Final = 3.0
VALLEY_NOISES, VALLEY_SHARE = 2.0, 0.6
CLEAR_NOISES: Final = 6.0
FRESH_NOISES: Final = 5.0
# ratio to the flow before: a contact that continues does not rise this much
FRESH_FACTOR: Final = 2.5
COARSE_NOISES, COARSE_SHARE = 2.0, 0.65
# shares of the expected time between two joints, and of the lower neighbour
EXPECTED_SHARE, EXPECTED_VALLEY = 0.6, 0.6
FAR_S: Final = 1.5  # parts further apart than this are not compared
BESIDE_S: Final = 0.8  # on each side of a valley: window of its neighbours' flow
LOOK_S: Final = 0.3  # around the crossing of the low limit: window of a start
TAIL_S: Final = 0.6  # around the end of a run of rows: window of a contact's end
# before the steepest fall: window of a contact's last flow
LEVEL_S, EDGE_S = 0.6, 0.15

Part = tuple[int, int]
"""First row, and the row after the last."""


class Contact(NamedTuple):  # there are thousands, and a tuple is made in a fifth of the time
    """A contact: its first and last moment in seconds of the run's grid, and their rows.

    Rows are numbered through all stretches of the search; those of its own stretch are from `begin`
    to before `end`.
    """

    start_s: float
    end_s: float
    first: int
    last: int
    begin: int
    end: int


@dataclass(frozen=True, slots=True)
class Flow:
    """The heat flow into the work in ‰ for each row of a stretch; zero while the tip is not
    ready.
    """

    stretch: Stretch
    flow: Floats


def flow_into_work(stretch: Stretch, model: ThermalModel, ready: Flags) -> Flow:
    """Return the flow of a stretch; zero until the tip is `ready`, while heat goes into the tip.

    A temperature that is reported late belongs to earlier power, so the flow has the time of the
    power.
    """
    flow = flow_of(stretch.power_later(model.delay.rows), model.values, model.noise.smooth_s)
    return Flow(stretch.earlier(model.delay.moved_s), np.where(ready, flow, 0.0))


def find_contacts(
    parts: Sequence[Flow], noise: Noise, expected_every_s: float | None = None
) -> list[Contact]:
    """Return the contacts of all stretches, in order of time.

    All stretches are searched at once, because in the one-minute stretches of identification most
    steps cost more to start than to run. `expected_every_s` helps to separate two contacts and
    never makes one.
    """
    parts = [part for part in parts if len(part.flow)]
    if not parts:
        return []
    signals = _signals(parts, noise, expected_every_s)
    first, last = _merged(signals, *_parts(signals))
    high = segments(first, last).greatest(signals.flow) >= signals.high
    return _contacts(signals, first[high], last[high])


def least_peak(noise: Noise) -> float:
    """Return the flow in ‰ that a contact reaches; what stays below is not found."""
    return max(HIGH_NOISES * noise.flow, noise.floors * HIGH_PERMILLE)


@dataclass(frozen=True, slots=True)
class _Signals:
    """The flow of stretches and what is derived from it: rate of change, coarse flow, limits.

    The rows of a stretch are those from one of `begins` to before one of `ends`.
    """

    period_s: float
    seconds: Floats
    flow: Floats
    rises: Floats
    coarse: Floats
    begins: Places
    ends: Places
    noise: Noise
    expected_every_s: float | None

    @property
    def high(self) -> float:
        return least_peak(self.noise)

    @property
    def low(self) -> float:
        """Limit in ‰ above which a part of a contact lies."""
        return max(LOW_NOISES * self.noise.flow, self.noise.floors * LOW_PERMILLE)

    def rows(self, seconds: float) -> int:
        """Return the number of rows in this time, at least one."""
        return max(round(seconds / self.period_s), 1)

    def stretch_of(self, rows: Places) -> tuple[Places, Places]:
        """Return the begin and the end of the stretch of each row."""
        place = np.searchsorted(self.begins, rows, side="right") - 1
        return self.begins[place], self.ends[place]


def _signals(parts: Sequence[Flow], noise: Noise, expected_every_s: float | None) -> _Signals:
    period = parts[0].stretch.period_s
    # fewer rows show nothing
    flows = [part.flow if len(part.flow) >= 3 else np.zeros(len(part.flow)) for part in parts]
    more = float(np.sqrt(max(COARSE_S**2 - noise.smooth_s**2, 0.0))) / period
    flow = np.concatenate(flows)
    ends = np.cumsum([len(one) for one in flows])
    return _Signals(
        period,
        np.concatenate([part.stretch.seconds for part in parts]),
        flow,
        np.concatenate([rate(one, period) for one in flows]),
        np.concatenate([smooth(one, more) for one in flows]) if more > 0.1 else flow,
        np.append(0, ends[:-1]),
        ends,
        noise,
        expected_every_s,
    )


def _edges(signals: _Signals) -> tuple[Places, Flags]:
    """Return the rows of the edges beyond the noise, and whether each of them rises."""
    rises, least = signals.rises, EDGE_NOISES * signals.noise.rate
    inner = rises[1:-1]
    top = (inner >= least) & (inner > rises[:-2]) & (inner >= rises[2:])
    bottom = (inner <= -least) & (inner < rises[:-2]) & (inner <= rises[2:])
    has_neighbours = np.ones(len(rises), dtype=np.bool_)
    has_neighbours[signals.begins] = has_neighbours[signals.ends - 1] = False
    rows = np.flatnonzero((top | bottom) & has_neighbours[1:-1])
    return rows + 1, top[rows]


def _parts(signals: _Signals) -> tuple[Places, Places]:
    """Return the runs above the low limit, cut at their valleys: first rows, and rows after the
    last.
    """
    above, begins = signals.flow > signals.low, signals.begins[1:]
    first, last = _cut(*runs(above), begins[above[begins - 1] & above[begins]])
    return _cut(first, last, _valleys(signals, first, last))


def _cut(first: Places, last: Places, rows: Places) -> tuple[Places, Places]:
    """Cut the runs before these of their rows."""
    return np.sort(np.concatenate([first, rows])), np.sort(np.concatenate([rows, last]))


def _valleys(signals: _Signals, first: Places, last: Places) -> Places:
    """Return the lowest row of each run between a falling and the next rising edge."""
    edges, upward = _edges(signals)
    run = np.searchsorted(first, edges) - 1  # an edge in the first row of a run is outside
    within = (run >= 0) & (edges < np.append(last, 0)[run])
    pairs = within[:-1] & within[1:] & (run[:-1] == run[1:]) & ~upward[:-1] & upward[1:]
    return segments(edges[:-1][pairs], edges[1:][pairs] + 1).where_least(signals.flow)


def _merged(signals: _Signals, first: Places, last: Places) -> tuple[Places, Places]:
    """Merge parts that are not apart. Zero flow between them separates most; the others are
    compared one by one.
    """
    if len(first) < 2:
        return first, last
    begins, _ = signals.stretch_of(first)
    apart = (first[1:] - last[:-1] > signals.rows(FAR_S)) | (begins[1:] != begins[:-1])
    near = np.flatnonzero(~apart)
    between = segments(last[near] - 1, first[near + 1] + 1)
    lowest, lowest_coarse = between.least(signals.flow), between.least(signals.coarse)
    zero = (lowest < VALLEY_NOISES * signals.noise.flow) & (
        lowest_coarse <= COARSE_NOISES * signals.noise.coarse
    )
    begin, until = first.tolist(), last.tolist()
    for place in np.flatnonzero(~zero).tolist():
        one, valley = int(near[place]), (float(lowest[place]), float(lowest_coarse[place]))
        zero[place] = _are_apart(
            signals, (begin[one], until[one]), (begin[one + 1], until[one + 1]), valley
        )
        if not zero[place]:
            begin[one + 1] = begin[one]
    apart[near] = zero
    return first[np.append(True, apart)], last[np.append(apart, True)]


def _are_apart(signals: _Signals, one: Part, other: Part, valley: tuple[float, float]) -> bool:
    """Return whether the flow was zero between two parts whose lowest flow, `valley` (as it is,
    coarse), is not near zero.
    """
    flow, coarse, noise = signals.flow, signals.coarse, signals.noise
    lowest, lowest_coarse = valley
    near_zero = VALLEY_NOISES * noise.flow
    beside = signals.rows(BESIDE_S)
    left = slice(max(one[0], one[1] - beside), one[1])
    right = slice(other[0], min(other[1], other[0] + beside))
    before, after = float(flow[left].max()), float(flow[right].max())
    lower = min(before, after)
    coarse_lower = min(float(coarse[left].max()), float(coarse[right].max()))
    if signals.expected_every_s and other[0] - one[0] >= signals.rows(
        EXPECTED_SHARE * signals.expected_every_s
    ):
        return lowest < max(near_zero, EXPECTED_VALLEY * lower)
    if lowest_coarse <= max(noise.floors * LOW_PERMILLE, COARSE_SHARE * coarse_lower):
        return lowest < max(near_zero, VALLEY_SHARE * lower)
    if lower >= CLEAR_NOISES * noise.flow:
        return lowest < VALLEY_SHARE * lower
    is_fresh = after >= max(FRESH_NOISES * noise.flow, FRESH_FACTOR * before)
    return is_fresh and lowest < max(near_zero, VALLEY_SHARE * after)


def _contacts(signals: _Signals, first: Places, last: Places) -> list[Contact]:
    """Return the contacts, from the steepest rise before the peak to the most likely end."""
    begin, end = signals.stretch_of(first)
    peak = segments(first, last).where_greatest(signals.flow)
    start = segments(np.maximum(first - signals.rows(LOOK_S), begin), peak + 1).where_greatest(
        signals.rises
    )
    until, until_s = _ends(signals, start, last, np.minimum(np.append(first[1:], end[-1:]), end))
    starts_s = _refined_moments(signals, start)
    columns = (starts_s, until_s, start, until, begin, end)
    return [*map(Contact._make, zip(*(column.tolist() for column in columns), strict=True))]


def _ends(
    signals: _Signals, start: Places, last: Places, next_first: Places
) -> tuple[Places, Floats]:
    """Return rows and moments of the ends: where a fall from the last flow to zero is most likely,
    or the last row of the stretch.

    `next_first` is where the next part begins, or where the stretch ends.
    """
    flow, seconds, period = signals.flow, signals.seconds, signals.period_s
    final = signals.stretch_of(start)[1] - 1
    fall = _steepest_falls(signals, start, last, next_first)
    until = np.minimum(
        np.maximum(last + signals.rows(LOOK_S), fall + signals.rows(TAIL_S)), next_first
    )
    begin = np.maximum(fall - signals.rows(TAIL_S), start + 1)
    before = np.maximum(fall - signals.rows(LEVEL_S), start)
    levels = segments(before, np.maximum(fall - signals.rows(EDGE_S), before + 1))
    # half of the last flow before the fall: the sum of the flow above it is greatest at the most
    # likely end
    half = 0.5 * np.maximum(levels.total(flow) / levels.lengths, signals.noise.flow)
    end, fraction = fall.copy(), np.zeros(len(fall))
    is_long = until - begin >= 2
    end[is_long] = rows_of_highest_sum(flow, begin[is_long], until[is_long], half[is_long])
    # to a fraction of a row: where the flow crosses that half
    here, after = flow[end], flow[np.minimum(end + 1, final)]
    falls = here > after
    share = np.clip((here - half) / np.where(falls, here - after, 1.0), 0.0, 1.0)
    fraction[is_long] = np.where(falls, share, 0.5)[is_long]
    cut = last > final
    end[cut], fraction[cut] = final[cut], 0.0
    return end, np.minimum(seconds[end] + fraction * period, seconds[final])


def _steepest_falls(signals: _Signals, start: Places, last: Places, next_first: Places) -> Places:
    """Return the rows of the steepest falls at the ends of the parts."""
    until = np.minimum(last + signals.rows(LOOK_S), next_first)
    begin = np.maximum(last - 1 - signals.rows(TAIL_S), start + 1)
    fall, seen = last - 1, until > begin
    fall[seen] = segments(begin[seen], until[seen]).where_least(signals.rises)
    return fall


def _refined_moments(signals: _Signals, rows: Places) -> Floats:
    """Return the moments of the steepest rises to a fraction of a row: the vertex of a parabola
    through each and its neighbours.
    """
    begin, end = signals.stretch_of(rows)
    seconds, inner = signals.seconds, (rows > begin) & (rows < end - 1)
    near = np.clip(rows, 1, len(signals.rises) - 2)
    before, here, after = (signals.rises[near + away] for away in (-1, 0, 1))
    bend = before - 2 * here + after
    bent = inner & (bend < 0)
    beside = np.where(
        bent, np.clip(0.5 * (before - after) / np.where(bent, bend, -1.0), -0.5, 0.5), 0.0
    )
    return np.clip(seconds[rows] + beside * signals.period_s, seconds[begin], seconds[end - 1])
