"""Series of a feature, one value a joint: healthy ones of many shapes, and ones that no index
describes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Draw = Callable[[np.random.Generator, int], Floats]

SHAPES: dict[str, Draw] = {
    "normal": lambda rng, n: rng.normal(350, 2, n),
    "lognormal": lambda rng, n: rng.lognormal(0.4, 0.35, n),
    "Weibull": lambda rng, n: 2.5 * rng.weibull(2.2, n),
    "skewed": lambda rng, n: 1.2 + rng.gamma(3, 0.25, n),
}
SIZES = (60, 200)
STEPS = (0.0, 0.1)  # of six standard deviations: what practice asks of a gauge


def in_steps(values: Floats, share: float) -> tuple[Floats, float | None]:
    """The values as read in steps of that share of six standard deviations, and the step."""
    step = share * 6 * float(values.std())
    return (np.round(values / step) * step, step) if step else (values, None)


def healthy(seed: int) -> list[tuple[str, Floats, float | None]]:
    """Sixteen stable series: four shapes, two lengths, as they are and in steps."""
    rng = np.random.default_rng(seed)
    return [
        (f"{name}, {n}, {'steps' if share else 'exact'}", *in_steps(draw(rng, n), share))
        for name, draw in SHAPES.items()
        for n in SIZES
        for share in STEPS
    ]


def _scored(rng: np.random.Generator, n: int, scores: Floats, shape: int) -> Floats:
    """Scores as values of a normal or of a lognormal feature."""
    return 350 + 2 * scores if shape == 0 else np.exp(0.4 + 0.35 * scores)


def _step(rng: np.random.Generator, n: int) -> Floats:
    return rng.normal(size=n) + 2.0 * (np.arange(n) >= n * rng.uniform(0.3, 0.7))


def _drift(rng: np.random.Generator, n: int) -> Floats:
    return rng.normal(size=n) + np.linspace(-1.5, 1.5, n)


def _two(rng: np.random.Generator, n: int) -> Floats:
    return rng.normal(size=n) + 5.0 * (rng.uniform(size=n) < 0.4)


def _alike(rng: np.random.Generator, n: int) -> Floats:
    noise, values = rng.normal(size=n), np.zeros(n)
    for place in range(1, n):
        values[place] = 0.7 * values[place - 1] + noise[place]
    return values


UNSTABLE: dict[str, Draw] = {
    "step": _step,
    "drift": _drift,
    "two populations": _two,
    "autocorrelated": _alike,
}


def unstable(seed: int, share: float = 0.0) -> list[tuple[str, Floats, float | None]]:
    """Sixteen series that are not: a step of 2 sigma, a drift of 3, two populations 5 apart,
    neighbours alike (0.7).

    With `share` as they are read in steps of that share of six standard deviations.
    """
    rng = np.random.default_rng(seed)
    return [
        (
            f"{name}, {n}, {'lognormal' if shape else 'normal'}",
            *in_steps(_scored(rng, n, draw(rng, n), shape), share),
        )
        for name, draw in UNSTABLE.items()
        for n in SIZES
        for shape in (0, 1)
    ]
