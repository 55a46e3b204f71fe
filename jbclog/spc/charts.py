"""Control charts: points, centre line, limits and signals. Plain arithmetic; `study.py` says whether it means anything."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jbclog.spc.constants import d2, d3
from jbclog.spc.nelson import Signal, signals

Floats = NDArray[np.float64]

LIMIT_ONLY = (1,)
"""Tests of a chart whose neighbouring points have something in common: ranges that share a value, weighted means."""


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """One chart. `sigma` is that of a plotted point (of the last, on an EWMA chart); `lower` and `upper` have a limit a point."""

    name: str
    points: Floats
    centre: float
    sigma: float
    lower: Floats
    upper: Floats
    signals: tuple[Signal, ...]


def individuals(values: ArrayLike) -> Chart:
    """Individual values, sigma from the mean moving range of two (NIST 6.3.2.2). All eight tests."""
    points = _floats(values)
    return _three_sigma("individuals", points, float(points.mean()), sigma_of_moving_ranges(points))


def moving_ranges(values: ArrayLike) -> Chart:
    """Moving ranges of two; they overlap, so only the limit is a test."""
    spans = np.abs(np.diff(_floats(values)))
    return _of_ranges("moving ranges", spans, 2, LIMIT_ONLY)


def means(subgroups: ArrayLike) -> Chart:
    """Means of subgroups (a row each), sigma from the mean range within them (NIST 6.3.2.1)."""
    rows = _rows(subgroups)
    return _three_sigma("subgroup means", rows.mean(axis=1), float(rows.mean()), sigma_of_ranges(rows) / sqrt(rows.shape[1]))


def ranges(subgroups: ArrayLike) -> Chart:
    """Ranges within subgroups (a row each)."""
    rows = _rows(subgroups)
    return _of_ranges("subgroup ranges", np.ptp(rows, axis=1), rows.shape[1], LIMIT_ONLY)


def ewma(
    values: ArrayLike, weight: float = 0.2, width: float = 3.0, centre: float | None = None, sigma: float | None = None
) -> Chart:
    """Exponentially weighted moving averages (NIST 6.3.2.4), limits of each point by its own variance.

    `centre` and `sigma` (of a single value) are taken from the values where they are not known beforehand.
    """
    points = _floats(values)
    if not 0 < weight <= 1:
        raise ValueError(f"the weight of an EWMA chart is above 0 and at most 1, not {weight}")
    middle = float(points.mean()) if centre is None else centre
    spread = sigma_of_moving_ranges(points) if sigma is None else sigma
    averages, last = np.empty_like(points), middle
    for place, value in enumerate(points):
        last = averages[place] = weight * value + (1 - weight) * last
    share = weight / (2 - weight) * (1 - (1 - weight) ** (2 * np.arange(1, len(points) + 1)))
    reach = width * spread * np.sqrt(share)
    return _chart("EWMA", averages, middle, spread * sqrt(share[-1]), middle - reach, middle + reach, LIMIT_ONLY)


def sigma_of_moving_ranges(points: Floats) -> float:
    """Sigma of single values, by the mean moving range of two."""
    return float(np.abs(np.diff(points)).mean()) / d2(2)


def sigma_of_ranges(rows: Floats) -> float:
    """Sigma of single values, by the mean range within subgroups."""
    return float(np.ptp(rows, axis=1).mean()) / d2(rows.shape[1])


def _three_sigma(name: str, points: Floats, centre: float, sigma: float) -> Chart:
    limit = np.full(len(points), 3 * sigma)
    return _chart(name, points, centre, sigma, centre - limit, centre + limit, tuple(range(1, 9)))


def _of_ranges(name: str, spans: Floats, size: int, tests: tuple[int, ...]) -> Chart:
    centre = float(spans.mean())
    sigma = d3(size) / d2(size) * centre
    lower, upper = max(centre - 3 * sigma, 0.0), centre + 3 * sigma
    return _chart(name, spans, centre, sigma, np.full(len(spans), lower), np.full(len(spans), upper), tests)


def _chart(name: str, points: Floats, centre: float, sigma: float, lower: Floats, upper: Floats, tests: tuple[int, ...]) -> Chart:
    """Distances are counted in thirds of the way to the limit on their side, which is a sigma where limits are even."""
    away = points - centre
    third = np.where(away >= 0, upper - centre, centre - lower) / 3
    if not away.any():
        return Chart(name, points, centre, sigma, lower, upper, ())  # all alike: nothing stands out
    zones = np.divide(away, third, out=np.where(away == 0, 0.0, np.copysign(np.inf, away)), where=third > 0)
    return Chart(name, points, centre, sigma, lower, upper, signals(zones, tests))


def _floats(values: ArrayLike) -> Floats:
    points = np.asarray(values, dtype=np.float64)
    if points.ndim != 1 or len(points) < 2:
        raise ValueError(f"a chart takes a row of at least two values, not an array of shape {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError("a chart takes values that are all known; leave out what was not read, and say so")
    return points


def _rows(subgroups: ArrayLike) -> Floats:
    rows = np.asarray(subgroups, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] < 2 or not rows.shape[0]:
        raise ValueError(f"subgroups are rows of at least two values, not an array of shape {rows.shape}")
    if not np.isfinite(rows).all():
        raise ValueError("a chart takes values that are all known; leave out what was not read, and say so")
    return rows
