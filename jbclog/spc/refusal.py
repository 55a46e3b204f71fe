"""Why a chart or an index is not given: each a check that names what it saw, and its limit.

What is refused misleads in a way that was measured: an individuals chart of values whose neighbours are alike (lag-1
correlation 0.9) calls a third of them out of control, and its sigma is three times too small; a spread below the
resolution makes Cpk as large as one likes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri, pdtrc

from jbclog.spc.charts import Chart, Floats
from jbclog.spc.nelson import TESTS

LEAST_POINTS = 20  # for limits of a chart; fewer are guesses (Montgomery: 20 to 25)
LEAST_FOR_CAPABILITY = 30  # at which the lower bound of a Cpk of 1.33 is 1.03
MOST_LAG_1 = 0.3
ALIKE = 0.01  # chance of a correlation as high in values that have nothing to do with each other
LEAST_STEPS = 5  # different values, below which the resolution and not the process makes the spread
BY_CHANCE = 0.01  # chance that a stable process gives so many signals
NOT_NORMAL = 0.01


@dataclass(frozen=True, slots=True)
class Refused:
    """Why there is no figure: `kind` for programs, `text` for people."""

    kind: str
    text: str


Check = Callable[[], Refused | None]


def first_refusal(checks: Iterable[Check]) -> Refused | None:
    """The first that refuses, in the order in which they are worth telling."""
    return next((refused for check in checks if (refused := check()) is not None), None)


def too_few(count: int, least: int, what: str) -> Refused | None:
    """Limits and indices of a handful of values say more about the handful than about the process."""
    if count >= least:
        return None
    return Refused("too_few", f"There are {count} {what}; it takes at least {least}.")


def lag_1(points: Floats) -> float:
    """How far neighbours are alike: the correlation of each value with the next."""
    away = points - points.mean()
    total = float(away @ away)
    return float(away[:-1] @ away[1:]) / total if total else 0.0


def autocorrelated(points: Floats) -> Refused | None:
    """Values whose neighbours are alike have limits that are far too narrow."""
    found, chance = lag_1(points), float(-ndtri(ALIKE)) / sqrt(len(points))
    if found <= max(MOST_LAG_1, chance):
        return None
    text = f"Neighbouring values are alike (lag-1 correlation {found:.2f}, at most {max(MOST_LAG_1, chance):.2f} allowed), "
    return Refused("autocorrelated", text + "so limits from their differences would be far too narrow.")


def unresolved(points: Floats, sigma: float, resolution: float | None) -> Refused | None:
    """A spread that the resolution made, or hid."""
    if not resolution:
        if sigma > 0:
            return None
        return Refused("unresolved", "All values are the same; their spread is not known.")
    steps = len(np.unique(np.round(points / resolution)))
    if sigma >= resolution / sqrt(12) and steps >= LEAST_STEPS:
        return None
    text = f"The values come in steps of {resolution:g} and take {steps} of them (standard deviation {sigma:.2g}); "
    return Refused("unresolved", text + "their spread is that of the resolution, not of the process.")


def unstable(chart: Chart) -> Refused | None:
    """A point further out, or more signals, than a stable process gives by chance; of long series some are expected."""
    away = np.abs(chart.points - chart.centre) / chart.sigma
    if ndtr(-away.max()) * 2 * len(away) < BY_CHANCE:
        text = f"The process is not stable: a point of {len(away)} is {away.max():.1f} sigma from the centre"
        return Refused("unstable", f"{text}; an index would describe no process that exists.")
    for number, test in enumerate(TESTS, 1):
        if test.rate is None:
            continue
        seen = _occasions([one.last for one in chart.signals if one.test == number])
        if seen and pdtrc(seen - 1, test.rate * len(chart.points)) < BY_CHANCE:
            text = f"The process is not stable: {test.text}, {seen} time{'s' * (seen > 1)} in {len(chart.points)} points"
            return Refused("unstable", f"{text}; an index would describe no process that exists.")
    return None


def _occasions(places: list[int]) -> int:
    """How often a pattern began; one that goes on from point to point is one."""
    return sum(before is None or place > before + 1 for before, place in zip([None, *places], places, strict=False))


def not_normal(points: Floats) -> Refused | None:
    """Indices are shares of a normal distribution (Anderson-Darling, D'Agostino and Stephens 1986)."""
    chance = anderson_darling_chance(points)
    if chance >= NOT_NORMAL:
        return None
    text = f"The values are not normally distributed (Anderson-Darling, p = {chance:.2g}), "
    return Refused("not_normal", text + "so the index would not mean the share that it is read as.")


def anderson_darling_chance(points: Floats) -> float:
    """The chance of values as far from normal, mean and spread estimated from them (Stephens' approximation)."""
    n = len(points)
    ordered = np.sort((points - points.mean()) / points.std(ddof=1))
    low, high = log_ndtr(ordered), log_ndtr(-ordered[::-1])
    squared = -n - float(((2 * np.arange(1, n + 1) - 1) * (low + high)).sum()) / n
    a = squared * (1 + 0.75 / n + 2.25 / n**2)
    if a >= 0.6:
        chance = np.exp(1.2937 - 5.709 * a + 0.0186 * a**2) if a < 13 else 0.0
    elif a > 0.34:
        chance = np.exp(0.9177 - 4.279 * a - 1.38 * a**2)
    elif a > 0.2:
        chance = 1 - np.exp(-8.318 + 42.796 * a - 59.938 * a**2)
    else:
        chance = 1 - np.exp(-13.436 + 101.14 * a - 223.73 * a**2)
    return float(chance)
