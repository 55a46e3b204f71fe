"""Gauge repeatability and reproducibility (GR&R): the share of the variation that comes from
measuring, by analysis of variance.

The crossed study of AIAG's Measurement Systems Analysis: every operator measures every part several
times. An interaction that is not significant is pooled with repeatability, and a variance below
zero counts as zero; `notes` reports both.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, sqrt

import numpy as np
from numpy.typing import ArrayLike

from jbclog.analysis.spc import special
from jbclog.analysis.spc.distribution import Floats
from jbclog.core.errors import UsageError

POOLED_ABOVE = 0.25  # p of the interaction's F (AIAG MSA, 4th edition)
GOOD, TOLERABLE = 10.0, 30.0  # per cent of the total variation (AIAG MSA)
LEAST_CATEGORIES = 5


@dataclass(frozen=True, slots=True)
class Source:
    """A row of the table of variance."""

    name: str
    squares: float
    freedom: int
    mean_square: float
    f: float | None = None
    chance: float | None = None


@dataclass(frozen=True, slots=True)
class GaugeStudy:
    """Standard deviations by source, in the unit of the measurements, and the table of variance."""

    repeatability: float
    reproducibility: float
    gauge: float
    parts: float
    total: float
    categories: int
    table: tuple[Source, ...]
    notes: tuple[str, ...]

    def percent(self, sigma: float) -> float:
        """Return `sigma` as a percentage of the total variation."""
        return 100 * sigma / self.total

    @property
    def verdict(self) -> str:
        """One of AIAG's three classes; with fewer than five distinct categories a gauge is not fit
        for process control.
        """
        percent = self.percent(self.gauge)
        if percent > TOLERABLE or self.categories < 2:
            return "unacceptable"
        return (
            "acceptable" if percent < GOOD and self.categories >= LEAST_CATEGORIES else "marginal"
        )


def gauge_study(measurements: ArrayLike) -> GaugeStudy:
    """Return the GR&R study of `measurements`, of shape (parts, operators, trials).

    Raises `UsageError` if it is not crossed.
    """
    data = np.asarray(measurements, dtype=np.float64)
    if data.ndim != 3 or min(data.shape) < 2:
        raise UsageError(
            f"a gauge study needs at least two parts, operators and trials (got shape {data.shape})"
        )
    if not np.isfinite(data).all():
        raise UsageError(
            "a gauge study needs a finite measurement of every part by every operator in every"
            " trial"
        )
    parts, operators, interaction, rest = _table(data)
    table: tuple[Source, ...] = (parts, operators, interaction, rest)
    pooled = interaction.chance is not None and interaction.chance > POOLED_ABOVE
    if pooled:
        rest = _pooled(interaction, rest)
        table = (_against(parts, rest), _against(operators, rest), rest)
    return _study(data, table, interaction, rest, pooled=pooled)


def _table(data: Floats) -> tuple[Source, Source, Source, Source]:
    p, o, t = data.shape
    middle = float(data.mean())
    by_part, by_operator, cells = data.mean(axis=(1, 2)), data.mean(axis=(0, 2)), data.mean(axis=2)
    parts = _source("parts", o * t * float(((by_part - middle) ** 2).sum()), p - 1)
    operators = _source("operators", p * t * float(((by_operator - middle) ** 2).sum()), o - 1)
    crossed = cells - by_part[:, np.newaxis] - by_operator[np.newaxis, :] + middle
    interaction = _source("operators × parts", t * float((crossed**2).sum()), (p - 1) * (o - 1))
    rest = _source(
        "repeatability", float(((data - cells[:, :, np.newaxis]) ** 2).sum()), p * o * (t - 1)
    )
    return (
        _against(parts, interaction),
        _against(operators, interaction),
        _against(interaction, rest),
        rest,
    )


def _source(name: str, squares: float, freedom: int) -> Source:
    return Source(name, squares, freedom, squares / freedom)


def _pooled(interaction: Source, rest: Source) -> Source:
    return _source(
        "repeatability", interaction.squares + rest.squares, interaction.freedom + rest.freedom
    )


def _against(source: Source, other: Source) -> Source:
    """Return the source with its F against another source."""
    if not other.mean_square:
        return source
    f = source.mean_square / other.mean_square
    chance = float(special.fdtrc(source.freedom, other.freedom, f))
    return Source(source.name, source.squares, source.freedom, source.mean_square, f, chance)


def _study(
    data: Floats, table: tuple[Source, ...], interaction: Source, rest: Source, *, pooled: bool
) -> GaugeStudy:
    p, o, t = data.shape
    parts, operators = table[0], table[1]
    held = rest if pooled else interaction
    notes = (
        ["The interaction is not significant and is pooled with repeatability."] if pooled else []
    )
    crossed = (
        0.0
        if pooled
        else _variance("interaction", interaction.mean_square - rest.mean_square, t, notes)
    )
    between = _variance("operators", operators.mean_square - held.mean_square, p * t, notes)
    real = _variance("parts", parts.mean_square - held.mean_square, o * t, notes)
    repeatability, reproducibility = sqrt(rest.mean_square), sqrt(between + crossed)
    gauge = sqrt(rest.mean_square + between + crossed)
    categories = floor(sqrt(2) * sqrt(real) / gauge) if gauge else 0
    return GaugeStudy(
        repeatability,
        reproducibility,
        gauge,
        sqrt(real),
        sqrt(gauge**2 + real),
        categories,
        table,
        tuple(notes),
    )


def _variance(name: str, difference: float, times: int, notes: list[str]) -> float:
    if difference < 0:
        notes.append(f"The variance of the {name} came out below zero and counts as zero.")
    return max(difference, 0.0) / times
