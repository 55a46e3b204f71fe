"""At which temperature a tip rests at each setpoint.

A reading is at rest where no draw was for `CALM_S` before it and the tip has moved no more than `CALM_K` in that time. The
level is the median of these readings at a setpoint. Where there are less than `LEAST_S` of them the tip was never seen at
rest there, and there is no level. How far a level lies from its setpoint is the idle error's business.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Final

import numpy as np

from jbclog.features.drawn import Draw
from jbclog.features.draws import Flow
from jbclog.judge.idle import Flags, Floats

CALM_S, CALM_K = 2.0, 2.0
LEAST_S: Final = 1.0


def resting_levels(parts: Sequence[Flow], draws: Sequence[Draw]) -> dict[float, float]:
    """Setpoint -> level, °C; only the setpoints at which the tip was seen at rest."""
    starts, ends = (np.array([getattr(draw, name) for draw in draws]) for name in ("start_s", "end_s"))
    resting: dict[float, list[Floats]] = defaultdict(list)
    for part in parts:
        stretch = part.stretch
        rest = _rest(part, starts, ends) & ~np.isnan(stretch.setting)
        for setpoint in np.unique(stretch.setting[rest]).tolist():
            resting[setpoint].append(stretch.temperature[rest & (stretch.setting == setpoint)])
    period = parts[0].stretch.period_s if parts else 0.0
    together = {setpoint: np.concatenate(some) for setpoint, some in resting.items()}
    return {setpoint: float(np.median(some)) for setpoint, some in together.items() if len(some) * period >= LEAST_S}


def _rest(part: Flow, starts: Floats, ends: Floats) -> Flags:
    stretch, back = part.stretch, max(round(CALM_S / part.stretch.period_s), 1)
    rest = np.zeros(len(stretch), dtype=np.bool_)
    if len(stretch) <= back:
        return rest
    seconds, temperature = stretch.seconds, stretch.temperature
    same = stretch.setting[back:] == stretch.setting[:-back]
    rest[back:] = (np.abs(temperature[back:] - temperature[:-back]) <= CALM_K) & same
    begun = np.searchsorted(starts, seconds, side="right")
    last_end = np.concatenate(([-np.inf], ends))[begun]
    return np.asarray(rest & (seconds - last_end >= CALM_S), dtype=np.bool_)
