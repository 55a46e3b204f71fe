"""First estimates of a tip's thermal model, from a record without labelled contacts.

Each row is either rest, where the heat balance leaves only noise, or contact, where any amount of
heat may leave and none comes back: a mixture of a regression and a flat distribution (DeSarbo and
Cron, Journal of Classification 5, 1988), found by expectation maximisation from a grid of starts.
Estimates that are nearly as likely are returned too, because `identify` does not always take the
most likely one. The noise of rest is limited to what the noise of the temperature explains;
otherwise dense contacts pass for noise. Rows of a heat-up, in which nothing is soldered, are known
rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.joints.thermal import POWER_NOISE_PERMILLE
from jbclog.analysis.port_data import Flags, Floats

CAPACITIES: Final = np.geomspace(4.0, 45.0, 14)  # ‰·s/K; a tip of 1.2 J/K at 130 W has 9
LOSSES: Final = np.geomspace(0.06, 1.6, 10)  # ‰/K; 100 ‰ at 350 °C are 0.3
USUAL: Final = np.array([0.0, 0.35, 0.0, 0.02])
# keeps second and lag near zero; left free they explain contacts
STIFF: Final = np.diag([1e-4, 1e4, 2e8, 2e8])
FLAT_PERMILLE: Final = 1500.0  # width of the flat distribution of heat that leaves
BACKWARD_PERMILLE: Final = 40_000.0  # the same for heat that comes back, which is almost impossible
DOUBT: Final = 0.02  # probability that a row of a heat-up is not rest
NOISE_MARGIN: Final = 1.3  # factor on what the noise of the temperature explains
MOST_ROWS: Final = 4000
STARTS, FINALISTS = 8, 4
LEAST_SIGNAL: Final = 0.1  # share of the moments that remains, whatever the noise
USUAL_CAPACITY, USUAL_LOSS = 10.0, 0.35  # ‰·s/K, ‰/K
LAG_RANGE: Final = (-0.1, 1.5)  # s
# second ≤ capacity × (lag + this): of two masses it is lag × the heater's, a sensor adds its own
SENSOR_LAG_S: Final = 0.3
Limits = Callable[[Floats], tuple[float, float]]
"""Returns the lower and upper limit of a parameter, given the parameters solved so far."""
LIMITS: Final[Sequence[tuple[int, Limits]]] = (
    (3, lambda _: LAG_RANGE),
    (2, lambda values: (0.0, values[0] * (max(values[3], 0.0) + SENSOR_LAG_S))),
)
REFERENCE_NOISE: Final = 20.0
REST_WIDTH: Final = float(REFERENCE_NOISE * np.sqrt(2 * np.pi))


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of the heat balance: power, terms, whether each is known rest, and the covariance of the
    terms' noise.
    """

    power: Floats
    terms: Floats
    is_rest: Flags
    term_noise: Floats

    @property
    def warming_noise(self) -> float:
        """Variance of the noise of the warming rate, (K/s)²."""
        return float(self.term_noise[0, 0])

    def take(self, rows: NDArray[np.int64] | Flags) -> Rows:
        return Rows(self.power[rows], self.terms[rows], self.is_rest[rows], self.term_noise)


@dataclass(frozen=True, slots=True)
class _Densities:
    """Density of each row: as rest, times the share of rest, and in all."""

    of_rest: Floats
    both: Floats

    @property
    def rest(self) -> Floats:
        """Probability of each row to be rest."""
        return np.asarray(self.of_rest / self.both, dtype=np.float64)

    @property
    def likelihood(self) -> float:
        """Mean log-likelihood of the rows."""
        return float(np.log(self.both).mean())


@dataclass(frozen=True, slots=True)
class _State:
    """Parameters, the share of rest, and the mean log-likelihood."""

    values: Floats
    share: float
    likelihood: float


def first_estimates(rows: Rows) -> list[Floats]:
    """Return the most likely parameters, and others that are nearly as likely; the most likely
    first.
    """
    sample = _sampled(rows)
    started = [_maximise(sample, _State(start, 0.4, 0.0), 6, 1.5) for start in _starts(sample)]
    started.sort(key=lambda state: -state.likelihood)
    ended = [_maximise(sample, state, 25, 1.0) for state in started[:FINALISTS]]
    ended.sort(key=lambda state: -state.likelihood)
    chosen: list[Floats] = []
    for state in ended:
        if all(_is_apart(state.values, one) for one in chosen):
            chosen.append(state.values)
    return chosen


def _sampled(rows: Rows) -> Rows:
    """Return at most `MOST_ROWS` rows, evenly spread."""
    if len(rows.power) <= MOST_ROWS:
        return rows
    return rows.take(np.linspace(0, len(rows.power) - 1, MOST_ROWS).astype(np.int64))


def _starts(rows: Rows) -> list[Floats]:
    """Return the most likely points of the grid that are not neighbours."""
    every = [np.array([capacity, loss, 0.0, 0.0]) for capacity in CAPACITIES for loss in LOSSES]
    every.sort(key=lambda values: -_densities(rows, values, 0.4, 2.0).likelihood)
    chosen: list[Floats] = []
    for values in every:
        if len(chosen) < STARTS and all(_is_apart(values, one) for one in chosen):
            chosen.append(values)
    return chosen


def _is_apart(one: Floats, other: Floats) -> bool:
    """Return whether two estimates differ clearly in capacity or loss."""
    one, other = np.maximum(one, 1e-3), np.maximum(other, 1e-3)
    return bool(abs(np.log(one[0] / other[0])) > 0.25 or abs(np.log(one[1] / other[1])) > 0.4)


def _densities(rows: Rows, values: Floats, share: float, wider: float) -> _Densities:
    """Return the densities of the rows with these parameters, `share` of them rest.

    The density of rest has the same height for all values; otherwise a capacity of zero, which
    leaves no noise, would be the most likely.
    """
    left = rows.power - rows.terms @ values
    noise = (
        wider
        * NOISE_MARGIN
        * float(np.hypot(np.sqrt(values @ rows.term_noise @ values), POWER_NOISE_PERMILLE))
    )
    rest = np.exp(-0.5 * np.square(left / noise)) / REST_WIDTH
    known, open_share = np.flatnonzero(rows.is_rest), 1 - share
    of_rest = share * rest
    of_rest[known] = (1 - DOUBT) * rest[known]
    of_contact = np.where(
        left > 0, open_share * (1 / FLAT_PERMILLE), open_share * (1 / BACKWARD_PERMILLE)
    )
    of_contact[known] = DOUBT / 5000.0
    return _Densities(of_rest, of_rest + of_contact)


def _maximise(rows: Rows, state: _State, rounds: int, wider: float) -> _State:
    values, share = state.values, state.share
    open_rows = np.flatnonzero(~rows.is_rest)
    for _ in range(rounds):
        weight = _densities(rows, values, share, wider).rest
        values = weighted_fit(rows.terms, rows.power, weight, STIFF, rows.warming_noise)
        share = min(max(float(weight[open_rows].mean()) if len(open_rows) else 0.9, 0.1), 0.98)
    return _State(values, share, _densities(rows, values, share, wider).likelihood)


def weighted_fit(
    terms: Floats, power: Floats, weight: Floats, stiffness: Floats, noise: float
) -> Floats:
    """Return the weighted least squares solution, regularised towards usual values and corrected
    for the noise of the warming rate.

    Noise in a term biases an ordinary fit towards zero, the more the less happens: at rest the
    capacity becomes zero. Its variance is subtracted from the moment (W. A. Fuller, Measurement
    Error Models, 1987), but at least `LEAST_SIGNAL` of it remains. Second mass and lag come out too
    small: they absorb an error of the flow and are not results.
    """
    weighted = terms * weight[:, None]
    moments = weighted.T @ terms + stiffness
    moments[0, 0] -= min(weight.sum() * noise, (1 - LEAST_SIGNAL) * moments[0, 0])
    return bounded_solution(moments, weighted.T @ power + stiffness @ USUAL, LIMITS)


def bounded_solution(
    moments: Floats, right: Floats, limits: Sequence[tuple[int, Limits]]
) -> Floats:
    """Return the least squares solution of the normal equations, with some parameters kept within
    limits.

    The parameters in `limits` are checked in that order; one beyond its limits is set to the nearer
    of them, and the others are solved for again.
    """
    values: Floats = np.asarray(np.linalg.solve(moments, right), dtype=np.float64)
    held: list[int] = []
    for place, limits_of in limits:
        low, high = limits_of(values)
        bound = min(max(values[place], low), high)
        if bound != values[place]:
            held.append(place)
            values[place] = bound
            free = [one for one in range(4) if one not in held]
            values[free] = np.linalg.solve(
                moments[np.ix_(free, free)],
                right[free] - moments[np.ix_(free, held)] @ values[held],
            )
    return values
