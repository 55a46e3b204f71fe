"""Whether the number of joints can be trusted: they are found again under other assumptions, and have to be the same.

A number has no error that could be read off it: a draw that hangs on a limit, two that hang on a valley, or a tip whose heat
capacity the fit missed make it wrong and leave no trace. What they all do is that the joints change as soon as the assumptions do.
So the joints are found again under each of `ASSUMPTIONS`: other limits, other smoothing, another heat capacity, another lag
(stability selection: N. Meinshausen, P. Bühlmann, Journal of the Royal Statistical Society B 72, 2010). *Doubt* is how many
joints come or go, as a share of all, as a mean over the assumptions. What a low limit finds in the flow turned upside down is
noise, since no heat comes back from work, and is not counted as having come.

Where doubt is more than `most_doubt`, the number is not known, and the least and the most joints found are given instead. Doubt
and error were compared on plants for tuning; docs/explanation/joints.md has the figures. What no assumption shows stays
hidden: a joint that lies between two readings, or two without a reading between them. So at rates slower than `SLOW_S` a contact
longer than `LONG_S` is in doubt, and no joints found is never known to be none.

Of a long record the windows are looked at that its model came from (`identify`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jbclog.analysis.joints.contacts import Flow, flows
from jbclog.analysis.joints.draws import Draw, draws_of, is_joint
from jbclog.analysis.joints.heat_up_end import Readied
from jbclog.analysis.joints.identify import windows
from jbclog.analysis.joints.parameters import Taken
from jbclog.analysis.joints.thermal import ThermalModel, noise_at, power_noise
from jbclog.analysis.joints.tools import Tool

SLOW_S: Final = 0.25  # readings further apart show less of a gap
MOST_DOUBT, MOST_DOUBT_SLOW = 0.03, 0.02
LONG_S: Final = 8.0  # at such a rate: a longer contact may be several with no reading between them
SAME_SHARE: Final = 0.5  # of the shorter of two draws that overlap


@dataclass(frozen=True, slots=True)
class Assumption:
    """Factors of the limits, of the smoothing and of the heat capacity, and by how much later power or temperature comes, s."""

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
    """`share`: of the joints that come or go; `least` and `most` were found in all, `looked_at` of them as they stand."""

    share: float
    least: int
    most: int
    looked_at: int


def doubt_of(tools: Sequence[Tool], settings: Taken) -> Doubt:
    """Of the joints of all tools together."""
    changed, counts, found = np.zeros(len(ASSUMPTIONS)), np.zeros(len(ASSUMPTIONS)), 0
    for tool in tools:
        looked = _Looked(windows(tool.parts), tool.model, settings)
        stand = looked.joints(AS_FOUND)
        found += len(stand)
        for number, assumed in enumerate(ASSUMPTIONS):
            others = looked.joints(assumed)
            same = _same(stand, others)
            noise = len(looked.joints(assumed, upside_down=True)) if assumed.limits < 1 else 0
            come = max(len(others) - same - noise, 0)
            changed[number] += come + len(stand) - same + (_long(stand) if looked.is_slow else 0)
            counts[number] += same + come
    every = [found, *counts.tolist()]
    return Doubt(float(changed.mean()) / max(found, 1), round(min(every)), round(max(every)), found)


def why_not_known(doubt: Doubt, joints: int, period_s: float) -> str | None:
    """The reason why their number is not known, with the range in which it lies; None where it is known."""
    allowed = MOST_DOUBT_SLOW if period_s > SLOW_S else MOST_DOUBT
    if period_s > SLOW_S and not joints:
        return f"None were found, but readings {period_s:g} s apart do not show short joints."
    if doubt.share <= allowed:
        return None
    share = joints / doubt.looked_at if doubt.looked_at else 1.0
    least, most = (round(share * number) for number in (doubt.least, doubt.most))
    return (
        f"Between {least} and {most} were found as limits, smoothing, heat capacity and lag were varied; "
        f"{100 * doubt.share:.0f} % of them come or go, {100 * allowed:g} % are allowed."
    )


class _Looked:
    """The joints of a tool under any assumption."""

    def __init__(self, parts: Sequence[Readied], model: ThermalModel, settings: Taken) -> None:
        self._parts, self._model, self._settings = parts, model, settings
        self._power_noise = power_noise([part.stretch for part in parts])
        self._flows: dict[Assumption, tuple[ThermalModel, list[Flow]]] = {}

    @property
    def is_slow(self) -> bool:
        return self._parts[0].stretch.period_s > SLOW_S

    def joints(self, assumed: Assumption, upside_down: bool = False) -> list[Draw]:
        """In their order; `upside_down`: as if heat came back from the work."""
        model, looked = self._flowing(replace(assumed, limits=1.0))
        model = replace(model, noise=replace(model.noise.times(assumed.limits), floors=assumed.limits))
        looked = [Flow(one.stretch, -one.flow) for one in looked] if upside_down else looked
        found = [draw for one in looked for draw in draws_of(one, model, self._settings)]
        return [draw for draw in found if is_joint(draw, self._settings)]

    def _flowing(self, assumed: Assumption) -> tuple[ThermalModel, list[Flow]]:
        """The model under an assumption, and the flow with it."""
        if assumed not in self._flows:
            model = self._assumed(assumed)
            self._flows[assumed] = model, [flows(part.stretch, model, part.ready) for part in self._parts]
        return self._flows[assumed]

    def _assumed(self, assumed: Assumption) -> ThermalModel:
        """Its noise is as many times what the readings explain as that of the model is."""
        model, period = self._model, self._parts[0].stretch.period_s
        other = replace(model, capacity=assumed.capacity * model.capacity, lag_s=model.lag_s + assumed.later_s)
        noises = (model.temperature_noise, self._power_noise)
        before = noise_at(period, model.values, *noises, model.noise.smooth_s)
        after = noise_at(period, other.values, *noises, assumed.smoothing * model.noise.smooth_s)
        return replace(other, noise=after.times(model.noise.flow / before.flow))


def _long(draws: Sequence[Draw]) -> int:
    return sum(one.dwell_s > LONG_S for one in draws)


def _same(some: Sequence[Draw], others: Sequence[Draw]) -> int:
    """How many of two lists in order are the same draw: they overlap for half of the shorter one; each counts once."""
    same, place = 0, 0
    for one in some:
        while place < len(others) and others[place].end_s <= one.start_s:
            place += 1
        for near in range(place, len(others)):
            other = others[near]
            if other.start_s >= one.end_s:
                break
            shorter = min(one.end_s - one.start_s, other.end_s - other.start_s)
            if min(one.end_s, other.end_s) - max(one.start_s, other.start_s) >= SAME_SHARE * shorter:
                same, place = same + 1, near + 1
                break
    return same
