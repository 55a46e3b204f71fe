"""Equivalence of two means within a margin: two one-sided tests (TOST).

No difference found proves nothing; this test asks the opposite question. Two means are *equivalent*
within a margin if the 90 % confidence interval of their difference lies within it on both sides,
which is both one-sided tests at 5 % (D. J. Schuirmann, A Comparison of the Two One-Sided Tests
Procedure, J. Pharmacokinetics and Biopharmaceutics 15 (1987)). Variances may differ (Welch). The
means are *different* if the interval lies beyond the margin; otherwise the result is "not known".

`equivalence` takes independent values. A run's readings are not independent: for them
`equivalence_of` takes means with their bounds at any confidence (`analysis/verdict/bounds.py`).
Half the width of the interval of their difference is the root of the sum of both squared
half-widths (the method of variance estimates recovery; G. Y. Zou and A. Donner, Construction of
Confidence Limits about Effect Measures, Statistics in Medicine 27 (2008)).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np
from numpy.typing import ArrayLike

from jbclog.analysis.spc import special
from jbclog.analysis.spc.refusal import Refused, too_few
from jbclog.core.errors import UsageError

LEAST = 8
ALPHA = 0.05
HALVINGS = 20


def equivalence(
    first: ArrayLike, second: ArrayLike, margin: float, *, step: float = 0.0
) -> Equivalence | Refused:
    """Test whether the means of two series of independent values are equivalent (TOST).

    `step`, the resolution of the values, widens the interval by what it may hide. Raises
    `UsageError` if the margin is not above zero.
    """
    _check_margin(margin)
    one, two = (np.asarray(values, dtype=np.float64) for values in (first, second))
    refused = too_few(min(len(one), len(two)), LEAST, "independent stretches in the shorter run")
    if refused is not None:
        return refused
    parts = float(one.var(ddof=1)) / len(one), float(two.var(ddof=1)) / len(two)
    error, difference = sqrt(sum(parts)), float(two.mean() - one.mean())
    if not error:
        return Equivalence(
            difference,
            difference - step,
            difference + step,
            margin,
            float(abs(difference) + step >= margin),
        )
    freedom = sum(parts) ** 2 / (parts[0] ** 2 / (len(one) - 1) + parts[1] ** 2 / (len(two) - 1))
    half = float(special.stdtrit(freedom, 1 - ALPHA)) * error + step
    chance = float(special.stdtr(freedom, -(margin - step - abs(difference)) / error))
    return Equivalence(difference, difference - half, difference + half, margin, chance)


@dataclass(frozen=True, slots=True)
class Equivalence:
    """Result of TOST: the difference (second mean minus first), its 90 % interval, the margin, and
    the greater p of the two tests.
    """

    difference: float
    low: float
    high: float
    margin: float
    p: float

    @property
    def verdict(self) -> str:
        """``equivalent``, ``different`` or ``not known``."""
        if -self.margin < self.low and self.high < self.margin:
            return "equivalent"
        return "different" if self.low > self.margin or self.high < -self.margin else "not known"


def equivalence_of(first: Mean, second: Mean, margin: float) -> Equivalence:
    """Test whether two means are equivalent (TOST), from their intervals.

    Raises `UsageError` if the margin is not above zero.
    """
    _check_margin(margin)
    difference = second.value - first.value

    def half(alpha: float) -> float:
        return hypot(first.half(1 - 2 * alpha), second.half(1 - 2 * alpha))

    slack = margin - abs(difference)
    chance = _chance(half, abs(slack))
    half_width = half(ALPHA)
    return Equivalence(
        difference,
        difference - half_width,
        difference + half_width,
        margin,
        chance if slack > 0 else 1 - chance,
    )


@dataclass(frozen=True, slots=True)
class Mean:
    """A mean, and the half-width of its two-sided interval as a function of the confidence."""

    value: float
    half: Callable[[float], float]


def _chance(half: Callable[[float], float], slack: float) -> float:
    """Return the one-sided probability at which the half-width equals `slack`."""
    low, high = 0.0, 0.5
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if half(middle) > slack else (low, middle)
    return high


def _check_margin(margin: float) -> None:
    if not (np.isfinite(margin) and margin > 0):
        raise UsageError(f"the margin must be above 0 (got {margin:g})")
