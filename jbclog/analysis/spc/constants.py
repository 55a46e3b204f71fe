"""What ranges and standard deviations of small normal samples are on average, worked out rather than copied.

The tables of the textbooks (Montgomery, appendix VI) print the same to three or four digits; a test holds them side by side.
"""

from __future__ import annotations

from functools import cache
from math import exp, lgamma, sqrt

import numpy as np
from scipy.special import ndtr

REACH = 8.5  # standard deviations; beyond, nothing is left that the digits would show
STEPS = 1701


@cache
def c4(n: int) -> float:
    """The mean of the standard deviation of `n` normal values, in units of sigma."""
    return sqrt(2 / (n - 1)) * exp(lgamma(n / 2) - lgamma((n - 1) / 2))


@cache
def d2(n: int) -> float:
    """The mean range of `n` normal values, in units of sigma: the integral of 1 - F**n - (1 - F)**n."""
    x = np.linspace(-REACH, REACH, STEPS)
    below = ndtr(x)
    return float(np.trapezoid(1 - below**n - (1 - below) ** n, x))


@cache
def d3(n: int) -> float:
    """The standard deviation of the range of `n` normal values, in units of sigma."""
    x = np.linspace(-REACH, REACH, STEPS)
    below = ndtr(x)
    high, low = below[np.newaxis, :], below[:, np.newaxis]
    inner = np.triu(1 - high**n - (1 - low) ** n + (high - low).clip(0) ** n)
    inner[np.diag_indices(STEPS)] /= 2  # the edge of the triangle in which the greatest lies above the least
    square = 2 * float(np.trapezoid(np.trapezoid(inner, x, axis=1), x))
    return sqrt(square - d2(n) ** 2)
