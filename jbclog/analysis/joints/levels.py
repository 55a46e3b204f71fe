"""The temperature at which a tip rests at each setpoint.

A reading is *at rest* if no draw was in the `CALM_S` before it and the tip has moved no more than
`CALM_K` in that time. The level is the median of these readings at a setpoint. With less than
`LEAST_S` of them there is no level. The idle error (`analysis/metrics/idling.py`) is the distance
of a level from its setpoint.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Sequence
from itertools import accumulate
from typing import Final

import numpy as np

from jbclog.analysis.joints.contacts import Flow
from jbclog.analysis.joints.draws import Draw
from jbclog.analysis.port_data import Flags, Floats

CALM_S, CALM_K = 2.0, 2.0
LEAST_S: Final = 1.0
DECIMALS: Final = 3
MOST_STEPS: Final = 10**6  # steps of a temperature: 1000 °C


class Levels:
    """Counts of the readings at rest by setpoint and temperature; memory does not grow with the
    record.
    """

    def __init__(self) -> None:
        self._counts: dict[float, Counter[float]] = defaultdict(Counter)

    def add(self, part: Flow, rest: Flags) -> None:
        """Count the readings of a stretch that are at rest."""
        stretch = part.stretch
        rest = rest & ~np.isnan(stretch.setting)
        for setpoint in np.unique(stretch.setting[rest]).tolist():
            here = stretch.temperature[rest & (stretch.setting == setpoint)]
            self._counts[setpoint].update(_counted(here))

    def levels(self, period_s: float) -> dict[float, float]:
        """Return setpoint -> level in °C, where the tip was at rest."""
        return {
            setpoint: _median(some)
            for setpoint, some in sorted(self._counts.items())
            if some.total() * period_s >= LEAST_S
        }


def _counted(temperatures: Floats) -> dict[float, int]:
    """Return how often each temperature occurs, rounded."""
    steps = np.rint(temperatures * 10**DECIMALS)
    if np.ptp(steps) > MOST_STEPS:
        distinct, counts = np.unique(steps, return_counts=True)
    else:  # without sorting
        least = steps.min()
        every = np.bincount((steps - least).astype(np.int64))
        places = np.flatnonzero(every)
        distinct, counts = places + least, every[places]
    return dict(zip((distinct / 10**DECIMALS).tolist(), counts.tolist(), strict=True))


def _median(counts: Counter[float]) -> float:
    values = sorted(counts)
    behind = list(accumulate(counts[value] for value in values))
    below, above = (
        bisect_right(behind, place) for place in ((behind[-1] - 1) // 2, behind[-1] // 2)
    )
    return (values[below] + values[above]) / 2


def resting_levels(parts: Sequence[Flow], draws: Sequence[Draw]) -> dict[float, float]:
    """Return the levels of a port whose rows are all in memory."""
    levels = Levels()
    for part in parts:
        levels.add(part, resting(part, draws))
    return levels.levels(parts[0].stretch.period_s if parts else 0.0)


def resting(part: Flow, draws: Sequence[Draw]) -> Flags:
    """Return which readings of a stretch are at rest; `draws` are in order of time."""
    starts, ends = (
        np.array([getattr(draw, name) for draw in draws]) for name in ("start_s", "end_s")
    )
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
