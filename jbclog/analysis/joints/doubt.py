"""Whether the number of joints is reliable: it must not change under other assumptions.

A wrong number leaves no trace: a draw that depends on a limit, two draws that depend on a valley,
or a tip whose heat capacity the fit missed. What these have in common is that the joints change
with the assumptions. So the joints are found again under each of `ASSUMPTIONS`: other limits, other
smoothing, another heat capacity, another lag (stability selection: N. Meinshausen, P. Bühlmann,
Journal of the Royal Statistical Society B 72, 2010). *Doubt* is the share of joints that appear or
disappear, averaged over the assumptions. What a low limit finds in the inverted flow is noise,
because no heat comes back from work, and does not count as appeared.

If doubt is above its limit, the number is not known, and the least and the most joints found are
reported instead. The limits were chosen on simulated plants; docs/explanation/joints.md has the
figures. No assumption reveals a joint between two readings, or two joints without a reading between
them. So at periods above `SLOW_S` a contact longer than `LONG_S` is in doubt, and no joints found
is "not known", not none. Nor does any reveal joints that all stay below the noise: no joints found
is "not known" where a draw of `SURE_PEAK` would not stand out.

In a long record, doubt is measured in the windows that the model comes from (`identify`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jbclog.analysis.joints.contacts import Flow, flow_into_work, least_peak
from jbclog.analysis.joints.draws import SURE_PEAK, Draw, find_draws, is_joint
from jbclog.analysis.joints.heat_up_end import ReadyStretch
from jbclog.analysis.joints.identify import model_windows
from jbclog.analysis.joints.parameters import JointSettings
from jbclog.analysis.joints.thermal import ThermalModel, noise_at, power_noise
from jbclog.analysis.joints.tools import Tool

SLOW_S: Final = 0.25  # slower readings show fewer of the gaps between joints
MOST_DOUBT, MOST_DOUBT_SLOW = 0.03, 0.02
LONG_S: Final = 8.0  # at such a rate, a longer contact may be several with no reading between them
SAME_SHARE: Final = 0.5  # overlap, as a share of the shorter of two draws


@dataclass(frozen=True, slots=True)
class Assumption:
    """Factors on limits, smoothing and heat capacity, and by how many s power or temperature comes
    later.
    """

    limits: float = 1.0
    smoothing: float = 1.0
    capacity: float = 1.0
    later_s: float = 0.0


AS_FOUND: Final = Assumption()
ASSUMPTIONS: Final = (
    Assumption(limits=0.5),
    Assumption(limits=1.4),
    Assumption(smoothing=1.4),
    Assumption(smoothing=1.4, limits=1.4),
    Assumption(smoothing=2.0),
    Assumption(capacity=0.7),
    Assumption(capacity=1.4),
    Assumption(later_s=-0.1),
    Assumption(later_s=0.1),
)


@dataclass(frozen=True, slots=True)
class Doubt:
    """Share of joints that appear or disappear, and the least and most joints found under any
    assumption.

    `looked_at` is the number of joints without an assumption, in the windows examined.
    `seen_from` is the flow in ‰ from which a draw is found, at the tool with the most noise.
    """

    share: float
    least: int
    most: int
    looked_at: int
    seen_from: float

    def range_of(self, joints: int) -> tuple[int, int]:
        """Return the least and the most joints of a record in which `joints` were found: the
        windows examined may be a part of it.
        """
        share = joints / self.looked_at if self.looked_at else 1.0
        return round(share * self.least), round(share * self.most)


def doubt_of(tools: Sequence[Tool], settings: JointSettings) -> Doubt:
    """Return the doubt about the joints of all tools together."""
    changed, counts, total = np.zeros(len(ASSUMPTIONS)), np.zeros(len(ASSUMPTIONS)), 0
    for tool in tools:
        variants = _Variants(model_windows(tool.parts), tool.model, settings)
        as_found = variants.joints(AS_FOUND)
        total += len(as_found)
        for number, assumed in enumerate(ASSUMPTIONS):
            others = variants.joints(assumed)
            same = _count_same(as_found, others)
            noise = len(variants.joints(assumed, upside_down=True)) if assumed.limits < 1 else 0
            appeared = max(len(others) - same - noise, 0)
            changed[number] += (
                appeared + len(as_found) - same + (_count_long(as_found) if variants.is_slow else 0)
            )
            counts[number] += same + appeared
    every = [total, *counts.tolist()]
    return Doubt(
        float(changed.mean()) / max(total, 1),
        round(min(every)),
        round(max(every)),
        total,
        max(least_peak(tool.model.noise) for tool in tools),
    )


def why_not_known(doubt: Doubt, joints: int, period_s: float) -> str | None:
    """Return why the number of joints is not known, with the range found; None if it is known."""
    allowed = MOST_DOUBT_SLOW if period_s > SLOW_S else MOST_DOUBT
    if period_s > SLOW_S and not joints:
        return f"None were found, but readings {period_s:g} s apart do not show short joints."
    if doubt.seen_from > SURE_PEAK and not joints:
        return (
            f"None were found, but only a draw of {doubt.seen_from:.0f} ‰ or more stands out from"
            f" the noise of these readings, and a joint may have {SURE_PEAK:.0f} ‰."
        )
    if doubt.share <= allowed:
        return None
    least, most = doubt.range_of(joints)
    found = f"{least} were" if least == most else f"Between {least} and {most} were"
    return (
        f"{found} found as limits, smoothing, heat capacity and lag were"
        f" varied; {100 * doubt.share:.0f} % of them come or go, {100 * allowed:g} % are allowed."
    )


class _Variants:
    """The joints of a tool under any assumption."""

    def __init__(
        self, parts: Sequence[ReadyStretch], model: ThermalModel, settings: JointSettings
    ) -> None:
        self._parts, self._model, self._settings = parts, model, settings
        self._power_noise = power_noise([part.stretch for part in parts])
        self._flows: dict[Assumption, tuple[ThermalModel, list[Flow]]] = {}

    @property
    def is_slow(self) -> bool:
        """Whether readings are too far apart to show a short gap."""
        return self._parts[0].stretch.period_s > SLOW_S

    def joints(self, assumed: Assumption, upside_down: bool = False) -> list[Draw]:
        """Return the joints in order of time; `upside_down`: in the inverted flow, as if heat came
        back from the work.
        """
        model, flows = self._flows_under(replace(assumed, limits=1.0))
        model = replace(
            model, noise=replace(model.noise.times(assumed.limits), floors=assumed.limits)
        )
        flows = [Flow(one.stretch, -one.flow) for one in flows] if upside_down else flows
        found = find_draws(flows, model, self._settings)
        return [draw for draw in found if is_joint(draw, self._settings)]

    def _flows_under(self, assumed: Assumption) -> tuple[ThermalModel, list[Flow]]:
        """Return the model under an assumption, and the flows with it."""
        if assumed not in self._flows:
            model = self._model_under(assumed)
            self._flows[assumed] = (
                model,
                [flow_into_work(part.stretch, model, part.ready) for part in self._parts],
            )
        return self._flows[assumed]

    def _model_under(self, assumed: Assumption) -> ThermalModel:
        """Return the model under an assumption, with the same ratio of its noise to that of the
        readings.
        """
        model, period = self._model, self._parts[0].stretch.period_s
        other = replace(
            model, capacity=assumed.capacity * model.capacity, lag_s=model.lag_s + assumed.later_s
        )
        noises = (model.temperature_noise, self._power_noise)
        before = noise_at(period, model.values, *noises, model.noise.smooth_s)
        after = noise_at(period, other.values, *noises, assumed.smoothing * model.noise.smooth_s)
        return replace(other, noise=after.times(model.noise.flow / before.flow))


def _count_long(draws: Sequence[Draw]) -> int:
    return sum(one.dwell_s > LONG_S for one in draws)


def _count_same(draws: Sequence[Draw], others: Sequence[Draw]) -> int:
    """Return how many draws two sorted lists share: they overlap for half of the shorter one, and
    each counts once.
    """
    same, place = 0, 0
    for one in draws:
        while place < len(others) and others[place].end_s <= one.start_s:
            place += 1
        for near in range(place, len(others)):
            other = others[near]
            if other.start_s >= one.end_s:
                break
            shorter = min(one.end_s - one.start_s, other.end_s - other.start_s)
            if (
                min(one.end_s, other.end_s) - max(one.start_s, other.start_s)
                >= SAME_SHARE * shorter
            ):
                same, place = same + 1, near + 1
                break
    return same
