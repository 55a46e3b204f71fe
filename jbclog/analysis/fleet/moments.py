"""Partial statistics of groups of values that merge exactly: the same result, to the last digit, in
any order and any division.

Every finite double is an integer multiple of 2^-1074. So a sum is kept as an integer of these, and
a sum of squares as one of 2^-2148: Python's integers are unbounded, and their sums exact. Mean and
variance are rounded once, at the end. All squares are about zero; with exact sums no other origin
is better.

Quantiles come from counts of values in bins. A bin has the values of one sign and exponent whose
first ten bits behind the point are the same. A quantile is the middle of the bin that contains the
value of that rank, and differs from it by at most `QUANTILE_ERROR` of it. Bins are fixed, so that
counts add up.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MANTISSA_BITS: Final = 52
BIN_BITS: Final = 10
QUANTILE_ERROR: Final = 2.0 ** -(BIN_BITS + 1)
"""Half the largest width of a bin as a share of the value: 0.05 %."""
SHIFT: Final = MANTISSA_BITS - BIN_BITS
UNIT_BITS: Final = 1074  # the smallest double above zero is 2^-1074
# three limbs are a mantissa; 2^16 times twice a product of two is 2^53 at most, exact as a double
LIMB_BITS: Final = 18
MOST_COUNTED: Final = 1 << 16  # values at once
MASK: Final = (1 << LIMB_BITS) - 1
BINS: Final = 1 << (63 - SHIFT + 1)


@dataclass(slots=True)
class Moments:
    """Statistics of a set of values. `unknown` counts null and non-finite values, `n` the others.

    `total` is their sum × 2^1074 and `squares` the sum of their squares × 2^2148. `bins` counts
    values by the first bits of their doubles.
    """

    n: int = 0
    unknown: int = 0
    total: int = 0
    squares: int = 0
    least: float | None = None
    greatest: float | None = None
    bins: Counter[int] = field(default_factory=Counter)

    def add(self, other: Moments) -> None:
        """Merge other statistics into these."""
        self.n += other.n
        self.unknown += other.unknown
        self.total += other.total
        self.squares += other.squares
        self.least = min(
            (one for one in (self.least, other.least) if one is not None), default=None
        )
        self.greatest = max(
            (one for one in (self.greatest, other.greatest) if one is not None), default=None
        )
        self.bins.update(other.bins)

    @property
    def mean(self) -> float | None:
        """The mean, rounded once; None without values."""
        return self.total / (self.n << UNIT_BITS) if self.n else None

    @property
    def sd(self) -> float | None:
        """The standard deviation (n − 1), from a variance rounded once; None below two values, or
        if too large for a double.
        """
        if self.n < 2:
            return None
        try:
            return sqrt(
                (self.n * self.squares - self.total**2)
                / ((self.n * (self.n - 1)) << (2 * UNIT_BITS))
            )
        except OverflowError:
            return None

    def quantiles(self, percents: Sequence[int]) -> list[float | None]:
        """Return for each percentage the value of rank ⌈n × percent / 100⌉ within `QUANTILE_ERROR`
        of it; None without values.
        """
        if self.least is None or self.greatest is None:
            return [None for _ in percents]
        ordered = sorted((_middle(one), count) for one, count in self.bins.items())
        ends = np.cumsum([count for _, count in ordered])
        ranks = [max(1, -(-self.n * percent // 100)) for percent in percents]
        found = [ordered[int(np.searchsorted(ends, rank))][0] for rank in ranks]
        return [min(max(one, self.least), self.greatest) for one in found]


def moments_of(values: Floats, counts: Ints, groups: Ints, count: int) -> list[Moments]:
    """Return the statistics of each group of values; `counts` is how often each value occurs, 65
    536 values in all at most.

    `groups` has the number of each value's group, from 0 to below `count`.
    """
    if counts.sum() > MOST_COUNTED:
        raise ValueError(f"{counts.sum()} values; at most {MOST_COUNTED} at once")
    found = [Moments() for _ in range(count)]
    is_known = np.isfinite(values)
    for group, unknown in zip(groups[~is_known].tolist(), counts[~is_known].tolist(), strict=True):
        found[group].unknown += unknown
    if is_known.any():
        # + 0.0 turns -0.0 into 0.0
        _add(found, values[is_known] + 0.0, counts[is_known], groups[is_known])
    return found


def _add(found: list[Moments], values: Floats, counts: Ints, groups: Ints) -> None:
    bits = values.view(np.int64)
    keys, slots = np.unique(groups * BINS + (bits >> SHIFT) + BINS // 2, return_inverse=True)
    owners, bins = keys // BINS, keys % BINS - BINS // 2
    in_bins = np.bincount(slots, weights=counts).astype(np.int64)
    for group, one, n in zip(owners.tolist(), bins.tolist(), in_bins.tolist(), strict=True):
        found[group].n += n
        found[group].bins[one] += n
    _add_sums(found, bits, counts, groups)
    _add_extremes(found, values, groups)


def _add_extremes(found: list[Moments], values: Floats, groups: Ints) -> None:
    least, greatest = np.full(len(found), np.inf), np.full(len(found), -np.inf)
    np.minimum.at(least, groups, values)
    np.maximum.at(greatest, groups, values)
    for group in np.unique(groups).tolist():
        found[group].add(Moments(least=float(least[group]), greatest=float(greatest[group])))


def _add_sums(found: list[Moments], bits: Ints, counts: Ints, groups: Ints) -> None:
    exponents = (bits >> MANTISSA_BITS) & 0x7FF
    keys, slots = np.unique(groups * 0x800 + exponents, return_inverse=True)
    mantissa = (bits & ((1 << MANTISSA_BITS) - 1)) | np.where(exponents > 0, 1 << MANTISSA_BITS, 0)
    limbs = [(mantissa >> (LIMB_BITS * place)) & MASK for place in range(3)]
    signed = np.where(bits < 0, -counts, counts)
    pairs = [(low, high) for low in range(3) for high in range(low, 3)]
    products = [
        limbs[low] * limbs[high] * counts * (1 if low == high else 2) for low, high in pairs
    ]
    sums = _summed([limb * signed for limb in limbs], slots, len(keys), [0, 1, 2])
    squares = _summed(products, slots, len(keys), [low + high for low, high in pairs])
    for key, total, square in zip(keys.tolist(), sums, squares, strict=True):
        group, shift = key // 0x800, max(key % 0x800, 1) - 1
        found[group].total += total << shift
        found[group].squares += square << (2 * shift)


def _summed(limbs: Sequence[Ints], slots: Ints, count: int, places: Sequence[int]) -> list[int]:
    """Return for each slot the sum of its limbs, each times 2^(18 × its place), as integers."""
    totals = [0] * count
    for limb, place in zip(limbs, places, strict=True):
        sums = np.bincount(slots, weights=limb, minlength=count)  # exact: see `LIMB_BITS`
        for slot, one in enumerate(sums.tolist()):
            totals[slot] += int(one) << (LIMB_BITS * place)
    return totals


def _middle(number: int) -> float:
    """Return the middle of a bin; zero for the bin of zero and values below 2^-1022."""
    if (number >> BIN_BITS) & 0x7FF == 0:
        return 0.0
    sides = np.array([number << SHIFT, (number << SHIFT) | ((1 << SHIFT) - 1)], np.int64).view(
        np.float64
    )
    return float(sides[0] / 2 + sides[1] / 2)
