"""Heat draws: groups of contacts of the tip, with the heat that went into the work.

*Heat* is the integral of the flow to twice the smoothing beyond the edges, so that it includes what
the smoothing spread. *Confidence* is 1 - ½·exp(1 - m), with m the peak divided by the limit that
noise reaches once in 31 600 looks; halved with fewer than three readings. It is not a probability.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise, repeat
from typing import Final, NamedTuple

import numpy as np

from jbclog.analysis.joints.contacts import HIGH_NOISES, HIGH_PERMILLE, Contact, Flow, find_contacts
from jbclog.analysis.joints.parameters import JointSettings
from jbclog.analysis.joints.segments import segments
from jbclog.analysis.joints.thermal import ThermalModel
from jbclog.analysis.port_data import Floats

# ‰·s: less is within the error of the heat balance; the smallest pad takes 100
LEAST_HEAT: Final = 20.0
SURE_DWELL_S, SURE_HEAT, SURE_PEAK = 0.5, 65.0, 80.0
FEW_READINGS: Final = 3
CUT_CONFIDENCE: Final = 0.5  # factor on the confidence of a draw that is cut
FALLEN_SHARE: Final = 0.7  # a flow between two feeds below this share of the lower side has fallen
SHOWN_NOISES: Final = 6.0  # of noise: a fall from a lower flow would not stand out
SLOWEST_PERIOD_S: Final = 0.25  # longest period that shows the flow between two joints
JOINT, NOT_KNOWN = "joint", "not known"
ENDS = "The record, or the tool's work, ends in it."
BEGINS = "The record, or the tool's work, begins in it."


class Draw(NamedTuple):
    """A heat draw: seconds on the run's grid, dwell in s, heat in ‰·s, peak in ‰, and the number of
    its contacts.

    - `cut`: what cut it off, if anything
    - `fed`: whether wire was pushed in it; None if not known
    - `loss`: that of the tip's model in ‰/K
    - `is_unfed`: the feeder decides and pushed no wire
    - `late_s`: how much later than these edges the temperature shows it

    A feed without a draw has neither heat nor peak; its edges are those of the feed.
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
    is_unfed: bool = False
    late_s: float = 0.0

    @property
    def kind(self) -> str:
        """``joint``, or ``not known`` if it may also be a wipe, a touch without solder, or a feed
        without a joint.
        """
        return kind_of_draw(self.dwell_s, self.heat, self.peak, self.fed, self.is_unfed)


def kind_of_draw(
    dwell_s: float,
    heat: float | None,
    peak: float | None,
    fed: bool | None,  # fields of a draw
    is_unfed: bool,
) -> str:
    """Return the kind of a draw with these fields."""
    if is_unfed:
        return NOT_KNOWN
    is_fed = fed and heat is not None
    return JOINT if is_fed or is_large(dwell_s, heat, peak) else NOT_KNOWN


def is_large(dwell_s: float, heat: float | None, peak: float | None) -> bool:
    """Return whether a draw with these fields is as large as joints are."""
    return dwell_s >= SURE_DWELL_S and (heat or 0.0) >= SURE_HEAT and (peak or 0.0) >= SURE_PEAK


def is_joint(draw: Draw, settings: JointSettings) -> bool:
    """Return whether the draw counts as a joint: it is long enough, was cut off, or has a feed."""
    return draw.dwell_s >= settings.least_dwell_s or draw.cut is not None or bool(draw.fed)


def find_draws(parts: Sequence[Flow], model: ThermalModel, settings: JointSettings) -> list[Draw]:
    """Return the draws of all stretches in order of time: their contacts, merged if close."""
    groups: list[list[Contact]] = []
    for contact in find_contacts(parts, model.noise, settings.expected_every_s):
        before = groups[-1][-1] if groups else None
        if (
            before is not None
            and contact.begin == before.begin
            and contact.start_s - before.end_s < settings.merge_gap_s
        ):
            groups[-1].append(contact)
        else:
            groups.append([contact])
    return [draw for draw in _as_draws(parts, model, groups) if (draw.heat or 0.0) >= LEAST_HEAT]


def _as_draws(
    parts: Sequence[Flow], model: ThermalModel, groups: Sequence[Sequence[Contact]]
) -> list[Draw]:
    """Return a draw for each group of contacts, made column by column: a week has a hundred
    thousand.
    """
    if not groups:
        return []
    heats, peaks = _heats_and_peaks(parts, model, groups)
    starts = np.array([group[0].start_s for group in groups])
    ends = np.array([group[-1].end_s for group in groups])
    few = (ends - starts) / parts[0].stretch.period_s + 1 < FEW_READINGS
    over = np.maximum(peaks / max(HIGH_NOISES * model.noise.flow, HIGH_PERMILLE), 1.0)
    sure = (1 - 0.5 * np.exp(1 - over)) * np.where(few, 0.5, 1.0)
    columns = (
        starts.tolist(),
        ends.tolist(),
        map(_dwell_s, groups),
        heats.tolist(),
        peaks.tolist(),
        map(len, groups),
        [round(one, 3) for one in sure.tolist()],
        map(_cut, groups),
    )
    # `fed` to `late_s`
    same = [repeat(one) for one in (None, model.loss, False, model.delay.moved_s)]
    return [*map(Draw._make, zip(*columns, *same, strict=False))]


def _dwell_s(group: Sequence[Contact]) -> float:
    if len(group) == 1:  # the usual case
        return group[0].end_s - group[0].start_s
    return sum(contact.end_s - contact.start_s for contact in group)


def _cut(group: Sequence[Contact]) -> str | None:
    """Return what cuts off a draw of these contacts, or None."""
    if group[-1].last >= group[-1].end - 2:
        return ENDS
    return BEGINS if group[0].first <= group[0].begin + 1 else None


def _heats_and_peaks(
    parts: Sequence[Flow], model: ThermalModel, groups: Sequence[Sequence[Contact]]
) -> tuple[Floats, Floats]:
    """Return the heat and the highest flow of each group. The heat reaches beyond its edges, up to
    the next group and the ends of its stretch.
    """
    flow, period = np.concatenate([part.flow for part in parts]), parts[0].stretch.period_s
    margin = max(round(2 * model.noise.smooth_s / period), 1)
    first = np.array([group[0].first for group in groups], dtype=np.int64)
    last = np.array([group[-1].last for group in groups], dtype=np.int64)
    of_stretch = np.array([(group[0].begin, group[0].end) for group in groups], dtype=np.int64)
    begin = np.maximum(first - margin, np.maximum(np.append(0, last[:-1] + 1), of_stretch[:, 0]))
    until = np.minimum(
        last + margin + 1, np.minimum(np.append(first[1:], len(flow)), of_stretch[:, 1])
    )
    heats = segments(begin, np.maximum(until, begin)).total(flow) * period
    return heats, segments(first, last + 1).greatest(flow)


class FlowByTime:
    """The flow of a port by time."""

    def __init__(self, flows: Sequence[Flow]) -> None:
        self._flows = flows
        self._starts = [float(one.stretch.seconds[0]) for one in flows]

    def between(self, start_s: float, end_s: float) -> tuple[Floats, Floats]:
        """Return seconds and flow in ‰ between two moments, within one stretch."""
        place = bisect_right(self._starts, start_s + 1e-6) - 1
        if place < 0:
            return np.empty(0), np.empty(0)
        one = self._flows[place]
        first, last = np.searchsorted(one.stretch.seconds, [start_s - 1e-6, end_s + 1e-6])
        return one.stretch.seconds[first:last], one.flow[first:last]


def merged_draw(draws: Sequence[Draw]) -> Draw:
    first, last = draws[0], draws[-1]
    if first is last:
        return first
    heats = [one.heat for one in draws if one.heat is not None]
    peaks = [one.peak for one in draws if one.peak is not None]
    return first._replace(
        end_s=last.end_s,
        dwell_s=sum(one.dwell_s for one in draws),
        heat=sum(heats) if heats else None,
        peak=max(peaks, default=None),
        contacts=sum(one.contacts for one in draws),
        confidence=max(one.confidence for one in draws),
        cut=last.cut or first.cut,
    )


def lowest_between(by_time: FlowByTime, start_s: float, end_s: float, period_s: float) -> float:
    """Return the moment of the lowest flow between two moments, or their middle if no flow is
    known.
    """
    seconds, flow = by_time.between(start_s, max(end_s, start_s + period_s))
    return float(seconds[flow.argmin()]) if len(flow) else (start_s + end_s) / 2


def has_fallen(
    by_time: FlowByTime,
    before_s: float,
    valley_s: float,
    after_s: float,
    period_s: float,
    noise: float,
) -> bool:
    """Return whether the flow falls at a moment between two others; also True if the sampling rate
    or the `noise` of the flow, in ‰, cannot show it.
    """
    _, before = by_time.between(before_s, valley_s)
    _, after = by_time.between(valley_s, after_s)
    if period_s > SLOWEST_PERIOD_S or not len(before) or not len(after):
        return True
    lower = min(float(before.max()), float(after.max()))
    return float(after[0]) <= FALLEN_SHARE * lower or lower < SHOWN_NOISES * noise


def cut_draw(
    draw: Draw, moments: Sequence[float], by_time: FlowByTime, period_s: float
) -> list[Draw]:
    """Cut a draw at these moments."""
    edges = [draw.start_s, *moments, draw.end_s]
    parts = []
    for start, end in pairwise(edges):
        _, flow = by_time.between(start, end)
        parts.append(
            draw._replace(
                start_s=start,
                end_s=end,
                dwell_s=end - start,
                heat=float(flow.sum()) * period_s if len(flow) else draw.heat,
                peak=float(flow.max()) if len(flow) else draw.peak,
                contacts=1,
                confidence=round(CUT_CONFIDENCE * draw.confidence, 3),
                cut=None,
            )
        )
    parts[-1] = parts[-1]._replace(cut=draw.cut)
    return parts
