"""Fit the heat balance of a tip to the temperatures read while it touches nothing.

The fit explains the reading itself, by the heat that came and went since a piece of rest began. Its
noise is white, and the terms have hardly any, whereas rates of change have much (L. Ljung, System
Identification, 1999, section 3.2: output error). In K: T = begin + (power_sum - loss × above_sum +
lag × power - second × T') / capacity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.joints.heat_up_end import ReadyStretch
from jbclog.analysis.joints.mixture import USUAL_CAPACITY, USUAL_LOSS, Limits, bounded_solution
from jbclog.analysis.joints.series import Stretch
from jbclog.analysis.joints.thermal import AIR_C, Balance, balance_of
from jbclog.analysis.port_data import Flags, Floats

HOT_C: Final = 85.0  # a colder tip shows little of its losses
RISING_K_PER_S: Final = 5.0
# share of the highest power: a heat-up takes more before the regulator acts
FULL_SHARE: Final = 0.95
PIECE_S: Final = 2.0  # in longer pieces, what the balance neglects adds up
LEAST_PIECE: Final = 4
REWEIGHTED: Final = 6
# usual values; `second` divided by the capacity
LATE_SPREAD_S, SECOND_S, SECOND_SPREAD_S = 0.15, 0.03, 0.06
LAG_RANGE_S, SECOND_RANGE_S = (-0.15, 0.4), (0.0, 0.06)  # `second` divided by the capacity
INVERSE_RANGE: Final = (1 / 60, 1 / 2)  # range of 1 / capacity
# spread of the usual capacity; number of rows that share their errors
CAPACITY_SPREAD, ALIKE_ROWS = 0.8, 100.0
# times the noise of a piece's slope: a steeper one is contact that was not found
LEAVES_NOISES: Final = 1.5
KNOWN_COST: Final = 3.0  # rows at rest that outweigh one of a heat-up that the fit does not explain
# of 1 / capacity, lag / capacity and second / capacity
LIMITS: Final[Sequence[tuple[int, Limits]]] = (
    (0, lambda _: INVERSE_RANGE),
    (
        2,
        lambda fitted: (
            LAG_RANGE_S[0] * max(fitted[0], 1e-3),
            LAG_RANGE_S[1] * max(fitted[0], 1e-3),
        ),
    ),
    (3, lambda _: SECOND_RANGE_S),
)


@dataclass(frozen=True, slots=True)
class Fit:
    """The four parameters of the heat balance, their covariance, and the number of rows that they
    explain.
    """

    values: Floats
    covariance: Floats
    rows_explained: float


def fit_rest(
    parts: Sequence[BalancedStretch], rest: Flags, known: Flags, values: Floats, noise_c: float
) -> Fit:
    """Return the parameters with which the balance, summed over each piece of rest, gives the
    temperatures read.

    `rest` and `known` have a value for each row of all stretches: at rest, and certainly so. The
    fit starts from `values`; `noise_c` is the noise of a reading in °C.
    """
    terms, temperature, piece, known_rest = _rest_pieces(parts, rest, known)
    capacity = values[0]
    usual = np.array([1 / USUAL_CAPACITY, USUAL_LOSS / capacity, 0.0, SECOND_S])
    fitted = np.array([1.0, values[1], values[3], values[2]]) / capacity
    pieces, weight = _Pieces.of(piece), np.ones(len(temperature))
    total = pieces.total(weight)
    for _ in range(REWEIGHTED):
        residuals = pieces.centred(temperature - terms @ fitted, weight, total)
        weight = _weights(residuals, pieces, known_rest, noise_c)
        total = pieces.total(weight)
        centred_terms = np.stack(
            [pieces.centred(column, weight, total) for column in terms.T], axis=1
        )
        centred_temperature = pieces.centred(temperature, weight, total)
        weighted = centred_terms * weight[:, None]
        stiffness = _stiffness(capacity, fitted[0], noise_c)
        fitted = bounded_solution(
            weighted.T @ centred_terms + stiffness,
            weighted.T @ centred_temperature + stiffness @ usual,
            LIMITS,
        )
    residuals = centred_temperature - centred_terms @ fitted
    scores = np.add.reduceat(
        weighted * residuals[:, None], np.flatnonzero(np.diff(piece, prepend=-1)), axis=0
    )
    bread = np.linalg.inv(weighted.T @ centred_terms + stiffness)
    meat = scores.T @ scores + stiffness * noise_c**2
    rows_explained = np.where(
        known_rest, 1 - KNOWN_COST * (np.abs(residuals) > 3 * noise_c), weight
    )
    return _as_balance(fitted, bread @ meat @ bread, float(rows_explained.sum()))


def _stiffness(capacity: float, inverse: float, noise_c: float) -> Floats:
    """Return how strongly the fit is regularised towards usual values at 1 / capacity = `inverse`.

    The prior of the capacity is normal. In a record without a heat-up, everything that misleads the
    fit makes the capacity too large: contacts taken for rest, since work takes up heat as a heavier
    tip would, and a power that switches between two readings. So the larger the capacity, the
    stronger the regularisation.
    """
    spread = np.array(
        [
            CAPACITY_SPREAD * inverse,
            USUAL_LOSS / capacity,
            LATE_SPREAD_S / capacity,
            SECOND_SPREAD_S,
        ]
    )
    return np.diag(np.square(noise_c / spread) * [ALIKE_ROWS, 1.0, 1.0, 1.0])


@dataclass(frozen=True, slots=True)
class _Pieces:
    """Pieces of rest: for each row the number of its piece and its place, counted from the middle;
    for each piece the root of the sum of squares of these places.
    """

    number: NDArray[np.int64]
    row: Floats
    width: Floats

    @classmethod
    def of(cls, number: NDArray[np.int64]) -> _Pieces:
        count = np.bincount(number)
        row = (
            np.arange(len(number))
            - np.concatenate(([0], np.cumsum(count)[:-1]))[number]
            - 0.5 * (count[number] - 1)
        )
        return cls(number, row, np.sqrt(np.bincount(number, np.square(row))))

    def total(self, values: Floats) -> Floats:
        """Return the sum of the values in each piece."""
        return np.asarray(np.bincount(self.number, values), dtype=np.float64)

    def centred(self, values: Floats, weight: Floats, total: Floats) -> Floats:
        """Return the values minus their weighted mean in each piece; `total` is that of the
        weights.
        """
        return np.asarray(
            values - (self.total(weight * values) / total)[self.number], dtype=np.float64
        )


def _weights(residuals: Floats, pieces: _Pieces, known_rest: Flags, noise_c: float) -> Floats:
    """Return the weight of each row: less beyond the noise, and less in a piece in which heat
    leaves, which is a contact that was not found.

    A piece in which heat comes back keeps its full weight: this cannot happen, so the fit must not
    need it.
    """
    slopes = pieces.total(pieces.row * residuals) / (noise_c * pieces.width)
    leaves = np.maximum(-slopes - LEAVES_NOISES, 0.0) / LEAVES_NOISES
    closeness = 1 / (1 + np.square(residuals / (3 * noise_c)))
    return np.asarray(
        np.where(known_rest, 1.0, closeness / (1 + np.square(leaves))[pieces.number]),
        dtype=np.float64,
    )


def _as_balance(fitted: Floats, covariance: Floats, rows_explained: float) -> Fit:
    """Convert the parameters of the temperature to the four of the heat balance."""
    inverse, loss, late, second = fitted.tolist()
    inverse = max(inverse, 1e-3)
    turn = (
        np.array(
            [
                [-1, 0, 0, 0],
                [-loss, inverse, 0, 0],
                [-second, 0, 0, inverse],
                [-late, 0, inverse, 0],
            ]
        )
        / inverse**2
    )
    values = np.array([1.0, loss, max(second, 0.0), late]) / inverse
    return Fit(values, turn @ covariance @ turn.T, rows_explained)


def _rest_pieces(
    parts: Sequence[BalancedStretch], rest: Flags, known: Flags
) -> tuple[Floats, Floats, NDArray[np.int64], Flags]:
    """Return terms, temperature, piece number and known rest of each row at rest, in pieces of up
    to `PIECE_S`.
    """
    period = parts[0].stretch.period_s
    longest = max(round(PIECE_S / period), LEAST_PIECE)
    begins = np.cumsum([0, *(len(one.stretch) for one in parts)])
    new = np.zeros(begins[-1], dtype=np.bool_)
    new[begins[:-1]] = True
    new |= rest & ~np.concatenate(([False], rest[:-1]))
    since = np.arange(len(new)) - np.maximum.accumulate(np.where(new, np.arange(len(new)), 0))
    number = np.cumsum(new | (since % longest == 0))[rest]
    terms = np.concatenate(
        [
            np.stack(
                [one.power_sum, -one.above_sum, one.stretch.power, -one.balance.warming], axis=1
            )
            for one in parts
        ]
    )[rest]
    temperature = np.concatenate([one.stretch.temperature for one in parts])[rest]
    _, place, count = np.unique(number, return_inverse=True, return_counts=True)
    enough = count[place] >= LEAST_PIECE
    return (
        terms[enough],
        temperature[enough],
        np.unique(place[enough], return_inverse=True)[1],
        known[rest][enough],
    )


@dataclass(frozen=True, slots=True)
class BalancedStretch:
    """A stretch with its heat balance, and the integrals over time of its power and of its
    temperature above the air.
    """

    stretch: Stretch
    ready: Flags
    balance: Balance
    power_sum: Floats
    above_sum: Floats

    @property
    def hot(self) -> Flags:
        return np.asarray(self.balance.temperature > HOT_C, dtype=np.bool_)

    @property
    def heats(self) -> Flags:
        """Rows of a heat-up."""
        return np.asarray(
            self.hot & ~self.ready & (self.balance.warming > RISING_K_PER_S), dtype=np.bool_
        )

    @property
    def known(self) -> Flags:
        """Rows of a heat-up at full power, which are at rest; closer to the setpoint, soldering may
        have begun.
        """
        power = self.stretch.power
        return np.asarray(
            self.heats & (power >= FULL_SHARE * power[self.heats].max(initial=0.0)), dtype=np.bool_
        )

    @property
    def usable(self) -> Flags:
        """Rows that the model can use: hot, and ready or heating up."""
        return np.asarray(self.hot & (self.ready | self.heats), dtype=np.bool_)


def balanced_stretch(part: ReadyStretch) -> BalancedStretch:
    stretch = part.stretch
    sums = (
        _integral(stretch.power, stretch.period_s),
        _integral(stretch.temperature - AIR_C, stretch.period_s),
    )
    return BalancedStretch(stretch, part.ready, balance_of(stretch), *sums)


def _integral(values: Floats, period_s: float) -> Floats:
    """Return the integral up to each row (trapezoids)."""
    return np.asarray(period_s * (np.cumsum(values) - 0.5 * (values + values[0])), dtype=np.float64)
