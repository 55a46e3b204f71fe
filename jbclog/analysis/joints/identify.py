"""Identify a tip's thermal model on the run itself, or give the reason why the record does not show it.

A mixture gives first estimates (`mixture`); usual tips are tried as well. From each of these: find the contacts, fit the four
parameters to the temperatures read in the rows at least `MARGIN_S` away from any contact, the heat-up among them (`_refined`), and
repeat. The best `FINALISTS` are repeated to `ROUNDS` in all, and the best of them is taken (`_score`): the one that explains most
rows as rest, with hardly any heat coming back from the work, and that is not an unusual tip. No quantile of a line that may never
rest is used. The uncertainties are those of the last fit, with the rows of each piece of rest taken together because neighbours are
alike (the sandwich estimate of Huber and White with clusters).

The noise is what the noise of the readings explains, or what the flow below zero shows if that is more: heat that comes back is
noise or an error of the model (a regulator that switches in bursts, a reported power that is a mean), whatever the line does.

A long record is sampled: `MOST_S` in windows of `WINDOW_S`, spread evenly over it, the first at its beginning. This bounds the
work, and a week shows no more of a tip than an hour.

There is no model if a parameter lies beyond what a soldering tip can have, if less than `LEAST_REST_S` without contact remain, or
if more heat comes back from the work than noise explains. If hardly anything warmed or cooled the tip without contact, its capacity
is not known, and there is a model only if all usual capacities give as many contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.joints.contacts import Flow, find_contacts
from jbclog.analysis.joints.delay import delay_of
from jbclog.analysis.joints.heat_up_end import ReadyStretch
from jbclog.analysis.joints.mixture import (
    FLAT_PERMILLE,
    REFERENCE_NOISE,
    USUAL_CAPACITY,
    USUAL_LOSS,
    Limits,
    Rows,
    bounded_solution,
    first_estimates,
)
from jbclog.analysis.joints.series import Stretch
from jbclog.analysis.joints.thermal import (
    AIR_C,
    COARSE_S,
    QUIET_PERMILLE,
    Balance,
    Noise,
    ThermalModel,
    balance_of,
    least_smoothed_noise,
    noise_levels,
    power_noise,
    smooth,
    smoothing_s,
    temperature_noise,
    term_noise,
)
from jbclog.analysis.verdict.idle import Flags, Floats

NEVER_READ: Final = "Temperature and power of a working tool were never read together."
ROUNDS, FINALISTS = 3, 2
MARGIN_S: Final = 0.2
HOT_C: Final = 85.0  # a colder tip shows little of its losses
RISING_K_PER_S: Final = 5.0
FULL_SHARE: Final = 0.95  # of its highest power: a heat-up takes more while nothing is regulated yet
PIECE_S: Final = 2.0  # in longer pieces what the balance neglects adds up
LEAST_PIECE: Final = 4
REWEIGHTED: Final = 6
LATE_SPREAD_S, SECOND_S, SECOND_SPREAD_S = 0.15, 0.03, 0.06  # usual values; `second` divided by the capacity
LAG_RANGE_S, SECOND_RANGE_S = (-0.15, 0.4), (0.0, 0.06)  # `second` divided by the capacity
INVERSE_SPREAD, INVERSE_RANGE, ALIKE_ROWS = 0.7, (1 / 60, 1 / 2), 20.0  # of 1 / capacity; so many rows share their errors
LEAVES_NOISES: Final = 1.5  # of the slope of a piece: a steeper one is contact that was not found
MOST_UNSURE: Final = 0.3  # of the capacity: beyond, the record does not show it
CAPACITY_RANGE, LOSS_RANGE = (2.0, 80.0), (0.02, 3.0)
USUAL_CAPACITIES: Final = (5.0, 10.0, 20.0)  # ‰·s/K
APART: Final = 0.25  # of the logarithm: starts closer together are one
AGREE_SHARE: Final = 0.1  # of the draws
MOST_S, WINDOW_S = 1200.0, 60.0
LEAST_REST_S, LEAST_REST_ROWS = 3.0, 30
BACKWARD_NOISES, MOST_BACKWARD = 5.0, 0.15
BACKWARD_COST: Final = 10.0  # rows at rest that outweigh one in which heat comes back
KNOWN_COST: Final = 3.0  # and one of a heat-up that the fit does not explain
CAPACITY_SPREAD, LOSS_SPREAD, PRIOR_SHARE = 0.6, 0.6, 0.04  # of logarithms; of all rows
MEDIAN_TO_SD: Final = 1.4826
LIMITS: Final[Sequence[tuple[int, Limits]]] = (  # of 1 / capacity, lag / capacity and second / capacity
    (0, lambda _: INVERSE_RANGE),
    (2, lambda fitted: (LAG_RANGE_S[0] * max(fitted[0], 1e-3), LAG_RANGE_S[1] * max(fitted[0], 1e-3))),
    (3, lambda _: SECOND_RANGE_S),
)
MOST_NOISE_FACTOR: Final = 6.0  # times the noise of readings: more is not noise


@dataclass(frozen=True, slots=True)
class Identification:
    """The model of a tool, or the reason why it is not known. With both, the model is not plausible."""

    model: ThermalModel | None
    why: str | None = None


def identify(parts: Sequence[ReadyStretch]) -> Identification:
    """Return the thermal model of the tip in these stretches of one tool."""
    parts = model_windows(parts)
    if not parts:
        return Identification(None, NEVER_READ)
    delay = delay_of(parts)
    parts = [ReadyStretch(part.stretch.power_later(delay.rows), part.ready) for part in parts]
    balanced = [_balanced(part) for part in parts]
    stretches = [part.stretch for part in parts]
    reading = _ReadingNoise(temperature_noise(stretches), power_noise(stretches))
    usable = np.concatenate([one.usable for one in balanced])
    if usable.sum() < LEAST_REST_ROWS:
        return Identification(None, f"The tip was hot in {int(usable.sum())} readings; its heat balance takes {LEAST_REST_ROWS}.")
    every = _rows(balanced, stretches[0].period_s, reading)
    known = np.concatenate([one.known for one in balanced])
    starts = _starts(first_estimates(every.take(usable)))
    started = [_refined_candidate(balanced, usable, known, start, reading, 1) for start in starts]
    started.sort(key=lambda one: -one.score)
    candidates = [_refined_candidate(balanced, usable, known, one.fit.values, reading, ROUNDS - 1) for one in started[:FINALISTS]]
    best = max(candidates, key=lambda one: one.score)
    found = _plausible_model(balanced, best.rest, best.fit, best.noise, reading)
    return found if found.model is None else replace(found, model=replace(found.model, delay=delay))


def identify_each(tools: Sequence[Sequence[ReadyStretch]]) -> tuple[list[ThermalModel | None], str | None]:
    """Return the model of each tool, None where it is not known, and the first reason why one is not."""
    found = [identify(parts) for parts in tools]
    why = next((one.why for one in found if one.why is not None), None)
    return [one.model if one.why is None else None for one in found], why


def _starts(estimates: list[Floats]) -> list[Floats]:
    """Return the estimates, and the capacities of a small, a medium and a large tip with the loss of the most likely estimate."""
    loss = min(max(float(estimates[0][1]), LOSS_RANGE[0]), LOSS_RANGE[1])
    usual = [np.array([capacity, loss, 0.0, 0.0]) for capacity in USUAL_CAPACITIES]
    near = [one for one in estimates if one[0] > CAPACITY_RANGE[0] and one[1] > LOSS_RANGE[0]]
    return near + [one for one in usual if all(abs(np.log(one[0] / other[0])) > APART for other in near)]


def _refined_candidate(
    balanced: Sequence[_BalancedStretch], usable: Flags, known: Flags, start: Floats, reading: _ReadingNoise, rounds: int
) -> _Candidate:
    """Find contacts and refine the parameters in turn, `rounds` times, and return the result with its score."""
    fit, rest, score = _Fit(start, np.full((4, 4), np.nan), 0.0), usable, -np.inf
    noise = _observed_noise(balanced, usable, start, reading)
    for _ in range(rounds):
        rest = usable & np.concatenate([_rows_at_rest(one, fit.values, noise) for one in balanced])
        if rest.sum() < LEAST_REST_ROWS:
            break
        fit = _refined(balanced, rest, known, fit.values, reading.celsius)
        noise = _observed_noise(balanced, usable, fit.values, reading)
        score = _score(fit, noise, _backward_rows(balanced, usable, fit.values, reading), int(usable.sum()))
    return _Candidate(fit, noise, rest, score)


def _score(fit: _Fit, noise: Noise, backward: int, rows: int) -> float:
    """Return how much more likely the rows at rest are than contact with any flow; heat that comes back counts against it."""
    capacity, loss = np.maximum(fit.values[:2], 1e-3)
    unusual = (np.log(capacity / USUAL_CAPACITY) / CAPACITY_SPREAD) ** 2 + (np.log(loss / USUAL_LOSS) / LOSS_SPREAD) ** 2
    gain = np.log(FLAT_PERMILLE / np.sqrt(noise.flow * REFERENCE_NOISE))
    return float(gain * (fit.rows_explained - BACKWARD_COST * backward - PRIOR_SHARE * rows * unusual))


def _noise(period_s: float, values: Floats, reading: _ReadingNoise) -> Noise:
    return least_smoothed_noise(period_s, values, reading.celsius, reading.permille)


def _backward_rows(parts: Sequence[_BalancedStretch], usable: Flags, values: Floats, reading: _ReadingNoise) -> int:
    """Return the number of rows in which heat comes back from the work for longer than the noise of readings explains."""
    noise = _noise(parts[0].stretch.period_s, values, reading)
    flow = np.concatenate([_flow(one, values, max(COARSE_S, noise.smooth_s)) for one in parts])
    return int((usable & (flow < -BACKWARD_NOISES * noise.coarse)).sum())


def model_windows(parts: Sequence[ReadyStretch]) -> list[ReadyStretch]:
    """Return the stretches, or windows of a long record."""
    taken = pieces_for_model([len(part.stretch) for part in parts], parts[0].stretch.period_s) if parts else []
    return [ReadyStretch(parts[place].stretch.take(rows), parts[place].ready[rows]) for place, rows in taken]


def pieces_for_model(lengths: Sequence[int], period_s: float) -> list[tuple[int, slice]]:
    """Return which rows of stretches of these `lengths` in rows the model comes from, as pairs of stretch and rows."""
    if sum(length * period_s for length in lengths) <= MOST_S:
        return [(place, slice(0, length)) for place, length in enumerate(lengths)]
    pieces = [(place, rows) for place, length in enumerate(lengths) for rows in _windows_of(length, period_s)]
    taken = np.unique(np.linspace(0, len(pieces) - 1, round(MOST_S / WINDOW_S)).astype(np.int64))
    return [pieces[number] for number in taken.tolist()]


def _windows_of(length: int, period_s: float) -> list[slice]:
    rows = max(round(WINDOW_S / period_s), 1)
    return [slice(cut, min(cut + rows, length)) for cut in range(0, max(length - rows // 2, 1), rows)]


@dataclass(frozen=True, slots=True)
class _ReadingNoise:
    """The noise of readings: of the temperature in °C and of the power in ‰."""

    celsius: float
    permille: float


@dataclass(frozen=True, slots=True)
class _BalancedStretch:
    """A stretch with its heat balance, and the integrals over time of its power and of its temperature above the air."""

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
        return np.asarray(self.hot & ~self.ready & (self.balance.warming > RISING_K_PER_S), dtype=np.bool_)

    @property
    def known(self) -> Flags:
        """Rows of a heat-up at full power, which are at rest; closer to the setpoint, soldering may have begun."""
        power = self.stretch.power
        return np.asarray(self.heats & (power >= FULL_SHARE * power[self.heats].max(initial=0.0)), dtype=np.bool_)

    @property
    def usable(self) -> Flags:
        """Rows that the model can use: hot, and ready or heating up."""
        return np.asarray(self.hot & (self.ready | self.heats), dtype=np.bool_)


def _balanced(part: ReadyStretch) -> _BalancedStretch:
    stretch = part.stretch
    sums = (_integral(stretch.power, stretch.period_s), _integral(stretch.temperature - AIR_C, stretch.period_s))
    return _BalancedStretch(stretch, part.ready, balance_of(stretch), *sums)


def _integral(values: Floats, period_s: float) -> Floats:
    """Return the integral up to each row (trapezoids)."""
    return np.asarray(period_s * (np.cumsum(values) - 0.5 * (values + values[0])), dtype=np.float64)


def _rows(parts: Sequence[_BalancedStretch], period_s: float, reading: _ReadingNoise) -> Rows:
    """Return the rows for the first estimates."""
    return Rows(
        np.concatenate([one.balance.power for one in parts]),
        np.concatenate([one.balance.terms for one in parts]),
        np.concatenate([one.known for one in parts]),
        term_noise(period_s, reading.celsius),
    )


def _rows_at_rest(one: _BalancedStretch, values: Floats, noise: Noise) -> Flags:
    """Return the rows of a stretch that are far enough from any contact."""
    stretch = one.stretch
    flow = _flow(one, values, noise.smooth_s)
    rest = np.ones(len(stretch), dtype=np.bool_)
    margin = max(round(MARGIN_S / stretch.period_s), 1)
    for contact in find_contacts(Flow(stretch, flow), noise):
        rest[max(contact.first - margin, 0) : contact.last + margin + 1] = False
    return rest


def _flow(one: _BalancedStretch, values: Floats, smooth_s: float) -> Floats:
    """Return the flow of a stretch, smoothed as for finding contacts."""
    period = one.stretch.period_s
    flow = one.balance.power - one.balance.terms @ values
    more = float(np.sqrt(max(smooth_s**2 - smoothing_s(period) ** 2, 0.0))) / period
    smoothed = smooth(flow, more) if more > 0.1 else flow
    return np.asarray(np.where(one.ready, smoothed, 0.0), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class _Fit:
    """The four parameters of the heat balance, their covariance, and the number of rows that they explain."""

    values: Floats
    covariance: Floats
    rows_explained: float


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A fit with its noise, the rows at rest that it comes from, and its score."""

    fit: _Fit
    noise: Noise
    rest: Flags
    score: float


def _refined(parts: Sequence[_BalancedStretch], rest: Flags, known: Flags, values: Floats, noise_c: float) -> _Fit:
    """Return the parameters with which the balance, summed over each piece of rest, gives the temperatures that were read.

    The reading itself is explained, by the heat that came and went since the piece began. Its noise is white, and the terms have
    hardly any, whereas rates of change have much (L. Ljung, System Identification, 1999, section 3.2: output error). In K: T =
    begin + (power_sum - loss × above_sum + lag × power - second × T') / capacity.
    """
    terms, temperature, piece, known_rest = _rest_pieces(parts, rest, known)
    capacity = values[0]
    usual = np.array([1 / USUAL_CAPACITY, USUAL_LOSS / capacity, 0.0, SECOND_S])
    spread = np.array([INVERSE_SPREAD / USUAL_CAPACITY, USUAL_LOSS / capacity, LATE_SPREAD_S / capacity, SECOND_SPREAD_S])
    stiffness = np.diag(np.square(noise_c / spread) * [ALIKE_ROWS, 1.0, 1.0, 1.0])
    fitted, weight = np.array([1.0, values[1], values[3], values[2]]) / capacity, np.ones(len(temperature))
    for _ in range(REWEIGHTED):
        residuals = _centred(temperature - terms @ fitted, piece, weight)
        weight = _weights(residuals, piece, known_rest, noise_c)
        centred_terms, centred_temperature = _centred(terms, piece, weight), _centred(temperature, piece, weight)
        weighted = centred_terms * weight[:, None]
        fitted = bounded_solution(
            weighted.T @ centred_terms + stiffness, weighted.T @ centred_temperature + stiffness @ usual, LIMITS
        )
    residuals = centred_temperature - centred_terms @ fitted
    scores = np.add.reduceat(weighted * residuals[:, None], np.flatnonzero(np.diff(piece, prepend=-1)), axis=0)
    bread = np.linalg.inv(weighted.T @ centred_terms + stiffness)
    meat = scores.T @ scores + stiffness * noise_c**2
    rows_explained = np.where(known_rest, 1 - KNOWN_COST * (np.abs(residuals) > 3 * noise_c), weight)
    return _as_balance(fitted, bread @ meat @ bread, float(rows_explained.sum()))


def _weights(residuals: Floats, piece: NDArray[np.int64], known_rest: Flags, noise_c: float) -> Floats:
    """Return the weight of each row: less beyond the noise, and less in a piece in which heat leaves, which is contact not found.

    A piece in which heat comes back keeps its full weight: it does not exist, so the fit must not need it.
    """
    count = np.bincount(piece)
    row = np.arange(len(residuals)) - np.concatenate(([0], np.cumsum(count)[:-1]))[piece] - 0.5 * (count[piece] - 1)
    slopes = np.bincount(piece, row * residuals) / (noise_c * np.sqrt(np.bincount(piece, np.square(row))))
    leaves = np.maximum(-slopes - LEAVES_NOISES, 0.0) / LEAVES_NOISES
    closeness = 1 / (1 + np.square(residuals / (3 * noise_c)))
    return np.asarray(np.where(known_rest, 1.0, closeness / (1 + np.square(leaves))[piece]), dtype=np.float64)


def _as_balance(fitted: Floats, covariance: Floats, rows_explained: float) -> _Fit:
    """Return the four parameters of the heat balance from those that explain the temperature."""
    inverse, loss, late, second = fitted.tolist()
    inverse = max(inverse, 1e-3)
    turn = np.array([[-1, 0, 0, 0], [-loss, inverse, 0, 0], [-second, 0, 0, inverse], [-late, 0, inverse, 0]]) / inverse**2
    values = np.array([1.0, loss, max(second, 0.0), late]) / inverse
    return _Fit(values, turn @ covariance @ turn.T, rows_explained)


def _rest_pieces(parts: Sequence[_BalancedStretch], rest: Flags, known: Flags) -> tuple[Floats, Floats, NDArray[np.int64], Flags]:
    """Return terms, temperature, piece number and known rest of each row at rest, in pieces of up to `PIECE_S`."""
    period = parts[0].stretch.period_s
    longest = max(round(PIECE_S / period), LEAST_PIECE)
    begins = np.cumsum([0, *(len(one.stretch) for one in parts)])
    new = np.zeros(begins[-1], dtype=np.bool_)
    new[begins[:-1]] = True
    new |= rest & ~np.concatenate(([False], rest[:-1]))
    since = np.arange(len(new)) - np.maximum.accumulate(np.where(new, np.arange(len(new)), 0))
    number = np.cumsum(new | (since % longest == 0))[rest]
    terms = np.concatenate(
        [np.stack([one.power_sum, -one.above_sum, one.stretch.power, -one.balance.warming], axis=1) for one in parts]
    )[rest]
    temperature = np.concatenate([one.stretch.temperature for one in parts])[rest]
    _, place, count = np.unique(number, return_inverse=True, return_counts=True)
    enough = count[place] >= LEAST_PIECE
    return terms[enough], temperature[enough], np.unique(place[enough], return_inverse=True)[1], known[rest][enough]


def _centred(values: Floats, piece: NDArray[np.int64], weight: Floats) -> Floats:
    """Return the values less their weighted mean in each piece."""
    total = np.bincount(piece, weight)
    if values.ndim == 1:
        return np.asarray(values - (np.bincount(piece, weight * values) / total)[piece], dtype=np.float64)
    return np.stack([_centred(column, piece, weight) for column in values.T], axis=1)


def _observed_noise(parts: Sequence[_BalancedStretch], usable: Flags, values: Floats, reading: _ReadingNoise) -> Noise:
    """Return the noise that the readings explain, or that the flow below zero shows if that is more; contact only adds to the flow.

    The flow is smoothed as little as keeps its noise below `QUIET_PERMILLE`.
    """
    period = parts[0].stretch.period_s
    noise = None
    for level in noise_levels(period, values, reading.celsius, reading.permille):
        flow = np.concatenate([_flow(one, values, level.smooth_s) for one in parts])[usable]
        below = -flow[flow < 0]
        times = MEDIAN_TO_SD * float(np.median(below)) / level.flow if len(below) >= LEAST_REST_ROWS else 1.0
        times = min(max(times, 1.0), MOST_NOISE_FACTOR)
        noise = level.times(times)
        if noise.flow <= QUIET_PERMILLE:
            break
    assert noise is not None
    return noise


def _model_without_capacity(parts: Sequence[_BalancedStretch], rest: Flags, reading: _ReadingNoise) -> Identification:
    """Return a model of unknown capacity if all usual capacities find as many contacts."""
    period = parts[0].stretch.period_s
    power = np.concatenate([one.balance.power for one in parts])[rest]
    above_air = np.concatenate([one.balance.terms[:, 1] for one in parts])[rest]
    loss = float(np.median(power / np.maximum(above_air, 1.0)))
    candidates = [np.array([capacity, loss, 0.0, 0.0]) for capacity in USUAL_CAPACITIES]
    counts = [_count_contacts(parts, values, _noise(period, values, reading)) for values in candidates]
    if max(counts) - min(counts) > AGREE_SHARE * max(counts):
        return Identification(None, "The tip was never seen warming or cooling without contact: its heat capacity is not known.")
    noise = _noise(period, candidates[1], reading)
    unsure = (USUAL_CAPACITY, 0.1 * loss, 0.0, 0.0)
    return Identification(ThermalModel(USUAL_CAPACITY, loss, 0.0, 0.0, unsure, noise, reading.celsius, float(rest.sum()) * period))


def _count_contacts(parts: Sequence[_BalancedStretch], values: Floats, noise: Noise) -> int:
    return sum(len(find_contacts(Flow(one.stretch, _flow(one, values, noise.smooth_s)), noise)) for one in parts)


def _plausible_model(
    parts: Sequence[_BalancedStretch], rest: Flags, fit: _Fit, noise: Noise, reading: _ReadingNoise
) -> Identification:
    """Return the model with its uncertainties, if it is plausible."""
    rest_s = float(rest.sum()) * parts[0].stretch.period_s
    if rest.sum() < LEAST_REST_ROWS or rest_s < LEAST_REST_S:
        took = f"{LEAST_REST_S:g} s and {LEAST_REST_ROWS} readings"
        why = f"Only {rest_s:.1f} s ({rest.sum()} readings) are without contact; the tip's heat balance takes {took}."
        return Identification(None, why)
    capacity, loss, second, lag = fit.values.tolist()
    unsure = np.sqrt(np.diag(fit.covariance)).tolist()
    if unsure[0] > MOST_UNSURE * capacity:
        return _model_without_capacity(parts, rest, reading)
    model = ThermalModel(capacity, loss, second, lag, (unsure[0], unsure[1], unsure[2], unsure[3]), noise, reading.celsius, rest_s)
    flow = np.concatenate([_flow(one, fit.values, noise.smooth_s)[one.ready] for one in parts])
    return Identification(model, _implausible(model, flow))


def _implausible(model: ThermalModel, flow: Floats) -> str | None:
    """Return why the fit is not plausible, or None."""
    for name, value, unit, (low, high) in (
        ("heat capacity", model.capacity, "‰·s/K", CAPACITY_RANGE),
        ("heat loss", model.loss, "‰/K", LOSS_RANGE),
    ):
        if not low <= value <= high:
            return f"The tip's {name} comes out as {value:.2g} {unit}; a soldering tip has {low:g} to {high:g}."
    backward = float((flow < -BACKWARD_NOISES * model.noise.flow).mean()) if len(flow) else 0.0
    if backward > MOST_BACKWARD:
        share = f"{100 * backward:.0f} %"
        return f"Heat seems to come back from the work in {share} of the readings: one heat balance does not fit them."
    return None
