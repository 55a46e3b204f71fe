"""A tip's thermal model, identified on the run itself; or the reason why the record does not carry one.

A mixture gives first estimates (`mixture`); usual tips are tried beside them. From each of these: find the contacts (`draws`), and
fit the four parameters to the temperatures read in the rows at least `MARGIN_S` away from any, the heat-up among them
(`_refined`). The best `FINALISTS` go on, `ROUNDS` in all; the best of them is taken (`_score`): the one that explains most rows as
rest, while hardly any heat comes back from the work, and which is no unusual tip. No quantile of a line that may never rest is
used. The uncertainties are those of the last fit, with the rows of each piece of rest taken together, since neighbours are alike
(the sandwich estimate of Huber and White with clusters).

Noise. What the noise of the readings explains, or what the flow below zero shows where that is more: heat that comes back is
noise, or an error of the model (a regulator that fires in bursts, a told power that is a mean), whatever the line does.

Of a long record `MOST_S` are looked at, in windows of `WINDOW_S` that are spread evenly over it, the first of them its
beginning: the work is bounded, and a week says nothing of a tip that an hour does not.

No model where a parameter lies beyond what a soldering tip can have, where less than `LEAST_REST_S` without contact are left, or
where more heat comes back from the work than noise explains. Where hardly anything warmed or cooled the tip without contact, so
that its capacity is not known, there is a model only if all capacities that a tip can have show as many draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.joints.contacts import Flow, find_spans
from jbclog.analysis.joints.delay import delay_of
from jbclog.analysis.joints.heat_up_end import Readied
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
from jbclog.analysis.joints.thermal import (
    AIR_C,
    COARSE_S,
    QUIET_PERMILLE,
    Balance,
    Noise,
    ThermalModel,
    balance_of,
    noise_of,
    noises,
    power_noise,
    smooth,
    smoothing_s,
    temperature_noise,
    term_noise,
)
from jbclog.analysis.verdict.idle import Flags, Floats

ROUNDS, FINALISTS = 3, 2
MARGIN_S: Final = 0.2
HOT_C: Final = 85.0  # a colder tip tells little of its losses
RISING_K_PER_S: Final = 5.0
FULL_SHARE: Final = 0.95  # of the most power in it: what a heat-up takes while nothing is regulated yet
PIECE_S: Final = 2.0  # over longer ones what the balance leaves out adds up
LEAST_PIECE: Final = 4
REWEIGHTED: Final = 6
LATE_SPREAD_S, SECOND_S, SECOND_SPREAD_S = 0.15, 0.03, 0.06  # what is usual; the second over the capacity
LAG_RANGE_S, SECOND_RANGE_S = (-0.15, 0.4), (0.0, 0.06)  # the second over the capacity
INVERSE_SPREAD, INVERSE_RANGE, ALIKE_ROWS = 0.7, (1 / 60, 1 / 2), 20.0  # of 1 / capacity; errors of so many rows are alike
LEAVES_NOISES: Final = 1.5  # of the slope of a piece: more is contact that was not found
MOST_UNSURE: Final = 0.3  # of the capacity: then the record does not show it
CAPACITY_RANGE, LOSS_RANGE = (2.0, 80.0), (0.02, 3.0)
TRIED: Final = (5.0, 10.0, 20.0)  # ‰·s/K, where it is not known
APART: Final = 0.25  # of the logarithm: nearer starts are one
AGREE_SHARE: Final = 0.1  # of the draws
MOST_S, WINDOW_S = 1200.0, 60.0
LEAST_REST_S, LEAST_REST_ROWS = 3.0, 30
BACKWARD_NOISES, MOST_BACKWARD = 5.0, 0.15
BACKWARD_COST: Final = 10.0  # rows at rest that one in which heat comes back takes away
KNOWN_COST: Final = 3.0  # and one of a heat-up that is not explained
CAPACITY_SPREAD, LOSS_SPREAD, PRIOR_SHARE = 0.6, 0.6, 0.04  # of logarithms; of all rows
MEDIAN_TO_SD: Final = 1.4826
LIMITS: Final[Sequence[tuple[int, Limits]]] = (  # of 1 / capacity, lag / capacity and second / capacity
    (0, lambda _: INVERSE_RANGE),
    (2, lambda fitted: (LAG_RANGE_S[0] * max(fitted[0], 1e-3), LAG_RANGE_S[1] * max(fitted[0], 1e-3))),
    (3, lambda _: SECOND_RANGE_S),
)
MOST_TIMES: Final = 6.0  # more noise than this is no noise


@dataclass(frozen=True, slots=True)
class Identified:
    """The model of a tool, or why there is none."""

    model: ThermalModel | None
    why: str | None = None


def identify(parts: Sequence[Readied]) -> Identified:
    """The thermal model of the tip in these stretches."""
    parts = windows(parts)
    if not parts:
        return Identified(None, "Temperature and power of a working tool were never read together.")
    delay = delay_of(parts)
    parts = [Readied(part.stretch.power_later(delay.rows), part.ready) for part in parts]
    rows = [_part(part) for part in parts]
    stretches = [part.stretch for part in parts]
    read = _Reading(temperature_noise(stretches), power_noise(stretches))
    usable = np.concatenate([one.usable for one in rows])
    if usable.sum() < LEAST_REST_ROWS:
        return Identified(None, f"The tip was hot in {int(usable.sum())} readings; its heat balance takes {LEAST_REST_ROWS}.")
    every = _rows(rows, stretches[0].period_s, read)
    known = np.concatenate([one.known for one in rows])
    begun = [_tried(rows, usable, known, start, read, 1) for start in _starts(first_estimates(every.take(usable)))]
    begun.sort(key=lambda one: -one.score)
    tried = [_tried(rows, usable, known, one.fit.values, read, ROUNDS - 1) for one in begun[:FINALISTS]]
    best = max(tried, key=lambda one: one.score)
    found = _judged(rows, best.rest, best.fit, best.noise, read)
    return found if found.model is None else replace(found, model=replace(found.model, delay=delay))


def identify_each(tools: Sequence[Sequence[Readied]]) -> tuple[list[ThermalModel | None], str | None]:
    """Return the model of each tool, None where it is not known, and the first reason why one is not."""
    found = [identify(parts) for parts in tools]
    why = next((one.why for one in found if one.why is not None), None)
    return [one.model if one.why is None else None for one in found], why


def _starts(estimates: list[Floats]) -> list[Floats]:
    """The estimates, and capacities of a small, a medium and a large tip with the loss of the likeliest."""
    loss = min(max(float(estimates[0][1]), LOSS_RANGE[0]), LOSS_RANGE[1])
    usual = [np.array([capacity, loss, 0.0, 0.0]) for capacity in TRIED]
    near = [one for one in estimates if one[0] > CAPACITY_RANGE[0] and one[1] > LOSS_RANGE[0]]
    return near + [one for one in usual if all(abs(np.log(one[0] / other[0])) > APART for other in near)]


def _tried(rows: Sequence[_Part], usable: Flags, known: Flags, start: Floats, read: _Reading, rounds: int) -> _Tried:
    """Contacts found and parameters refined in turn."""
    fit, rest, score = _Fit(start, np.full((4, 4), np.nan), 0.0), usable, -np.inf
    noise = _seen_noise(rows, usable, start, read)
    for _ in range(rounds):
        rest = usable & np.concatenate([_rest(one, fit.values, noise) for one in rows])
        if rest.sum() < LEAST_REST_ROWS:
            break
        fit = _refined(rows, rest, known, fit.values, read.celsius)
        noise = _seen_noise(rows, usable, fit.values, read)
        score = _score(fit, noise, _backward(rows, usable, fit.values, read), int(usable.sum()))
    return _Tried(fit, noise, rest, score)


def _score(fit: _Fit, noise: Noise, backward: int, rows: int) -> float:
    """How much likelier the rows at rest are than contact with any flow; what comes back counts against it."""
    capacity, loss = np.maximum(fit.values[:2], 1e-3)
    unusual = (np.log(capacity / USUAL_CAPACITY) / CAPACITY_SPREAD) ** 2 + (np.log(loss / USUAL_LOSS) / LOSS_SPREAD) ** 2
    gain = np.log(FLAT_PERMILLE / np.sqrt(noise.flow * REFERENCE_NOISE))
    return float(gain * (fit.fits - BACKWARD_COST * backward - PRIOR_SHARE * rows * unusual))


def _noise(period_s: float, values: Floats, read: _Reading) -> Noise:
    return noise_of(period_s, values, read.celsius, read.permille)


def _backward(parts: Sequence[_Part], usable: Flags, values: Floats, read: _Reading) -> int:
    """The rows in which heat seems to come back from the work for a while, beyond what the readings' noise explains."""
    noise = _noise(parts[0].readied.stretch.period_s, values, read)
    flow = np.concatenate([_flow(one, values, max(COARSE_S, noise.smooth_s)) for one in parts])
    return int((usable & (flow < -BACKWARD_NOISES * noise.coarse)).sum())


def windows(parts: Sequence[Readied]) -> list[Readied]:
    """The stretches, or of a long record windows of them."""
    taken = pieces_taken([len(part.stretch) for part in parts], parts[0].stretch.period_s) if parts else []
    return [Readied(parts[place].stretch.take(rows), parts[place].ready[rows]) for place, rows in taken]


def pieces_taken(lengths: Sequence[int], period_s: float) -> list[tuple[int, slice]]:
    """Of stretches with so many rows: which rows of which are looked at."""
    if sum(length * period_s for length in lengths) <= MOST_S:
        return [(place, slice(0, length)) for place, length in enumerate(lengths)]
    pieces = [(place, rows) for place, length in enumerate(lengths) for rows in _pieces(length, period_s)]
    taken = np.unique(np.linspace(0, len(pieces) - 1, round(MOST_S / WINDOW_S)).astype(np.int64))
    return [pieces[number] for number in taken.tolist()]


def _pieces(length: int, period_s: float) -> list[slice]:
    rows = max(round(WINDOW_S / period_s), 1)
    return [slice(cut, min(cut + rows, length)) for cut in range(0, max(length - rows // 2, 1), rows)]


@dataclass(frozen=True, slots=True)
class _Reading:
    """The noise of readings: of the temperature in °C and of the power in ‰."""

    celsius: float
    permille: float


@dataclass(frozen=True, slots=True)
class _Part:
    """A stretch with its heat balance, and the integrals over time of its power and of its height above the air."""

    readied: Readied
    balance: Balance
    power_sum: Floats
    above_sum: Floats

    @property
    def hot(self) -> Flags:
        return np.asarray(self.balance.temperature > HOT_C, dtype=np.bool_)

    @property
    def heats(self) -> Flags:
        """Rows of a heat-up."""
        return np.asarray(self.hot & ~self.readied.ready & (self.balance.warming > RISING_K_PER_S), dtype=np.bool_)

    @property
    def known(self) -> Flags:
        """Those at full power, in which hardly anybody solders; nearer to its setpoint somebody may have begun."""
        power = self.readied.stretch.power
        return np.asarray(self.heats & (power >= FULL_SHARE * power[self.heats].max(initial=0.0)), dtype=np.bool_)

    @property
    def usable(self) -> Flags:
        return np.asarray(self.hot & (self.readied.ready | self.heats), dtype=np.bool_)


def _part(readied: Readied) -> _Part:
    stretch = readied.stretch
    sums = (_integral(stretch.power, stretch.period_s), _integral(stretch.temperature - AIR_C, stretch.period_s))
    return _Part(readied, balance_of(stretch), *sums)


def _integral(values: Floats, period_s: float) -> Floats:
    return np.asarray(period_s * (np.cumsum(values) - 0.5 * (values + values[0])), dtype=np.float64)


def _rows(parts: Sequence[_Part], period_s: float, read: _Reading) -> Rows:
    """What the first estimate looks at."""
    return Rows(
        np.concatenate([one.balance.power for one in parts]),
        np.concatenate([one.balance.terms for one in parts]),
        np.concatenate([one.known for one in parts]),
        term_noise(period_s, read.celsius),
    )


def _rest(one: _Part, values: Floats, noise: Noise) -> Flags:
    """The rows of a stretch that are far enough from any contact."""
    stretch = one.readied.stretch
    flow = _flow(one, values, noise.smooth_s)
    rest = np.ones(len(stretch), dtype=np.bool_)
    margin = max(round(MARGIN_S / stretch.period_s), 1)
    for span in find_spans(Flow(stretch, flow), noise):
        rest[max(span.first - margin, 0) : span.last + margin + 1] = False
    return rest


def _flow(one: _Part, values: Floats, smooth_s: float) -> Floats:
    """The flow of a stretch, smoothed as draws are found in it."""
    period = one.readied.stretch.period_s
    flow = one.balance.power - one.balance.terms @ values
    more = float(np.sqrt(max(smooth_s**2 - smoothing_s(period) ** 2, 0.0))) / period
    smoothed = smooth(flow, more) if more > 0.1 else flow
    return np.asarray(np.where(one.readied.ready, smoothed, 0.0), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class _Fit:
    """The four parameters of the heat balance and their covariance."""

    values: Floats
    covariance: Floats
    fits: float  # rows that it explains


@dataclass(frozen=True, slots=True)
class _Tried:
    fit: _Fit
    noise: Noise
    rest: Flags
    score: float


def _refined(parts: Sequence[_Part], rest: Flags, known: Flags, values: Floats, noise_c: float) -> _Fit:
    """The parameters with which the balance, summed up over each piece of rest, gives the temperatures that were read.

    What is explained is the reading itself, by the heat that came and went since the piece began: its noise is white, and what
    explains it has hardly any, where rates of change would have much (L. Ljung, System Identification, 1999, section 3.2:
    output error). In K: T = begin + (power_sum - loss × above_sum + lag × power - second × T') / capacity.
    """
    terms, read, piece, sure = _pieces_of(parts, rest, known)
    capacity = values[0]
    usual = np.array([1 / USUAL_CAPACITY, USUAL_LOSS / capacity, 0.0, SECOND_S])
    spread = np.array([INVERSE_SPREAD / USUAL_CAPACITY, USUAL_LOSS / capacity, LATE_SPREAD_S / capacity, SECOND_SPREAD_S])
    stiff = np.diag(np.square(noise_c / spread) * [ALIKE_ROWS, 1.0, 1.0, 1.0])
    fitted, weight = np.array([1.0, values[1], values[3], values[2]]) / capacity, np.ones(len(read))
    for _ in range(REWEIGHTED):
        left = _centred(read - terms @ fitted, piece, weight)
        weight = _weights(left, piece, sure, noise_c)
        near, aim = _centred(terms, piece, weight), _centred(read, piece, weight)
        weighted = near * weight[:, None]
        fitted = bounded_solution(weighted.T @ near + stiff, weighted.T @ aim + stiff @ usual, LIMITS)
    left = aim - near @ fitted
    scores = np.add.reduceat(weighted * left[:, None], np.flatnonzero(np.diff(piece, prepend=-1)), axis=0)
    bread = np.linalg.inv(weighted.T @ near + stiff)
    meat = scores.T @ scores + stiff * noise_c**2
    fits = np.where(sure, 1 - KNOWN_COST * (np.abs(left) > 3 * noise_c), weight)
    return _as_balance(fitted, bread @ meat @ bread, float(fits.sum()))


def _weights(left: Floats, piece: NDArray[np.int64], sure: Flags, noise_c: float) -> Floats:
    """What a row counts: less beyond noise, and less in a piece in which heat leaves, which is contact that was not found.

    A piece in which heat comes back counts whole: there is no such thing, so that the fit must do without it.
    """
    count = np.bincount(piece)
    row = np.arange(len(left)) - np.concatenate(([0], np.cumsum(count)[:-1]))[piece] - 0.5 * (count[piece] - 1)
    turns = np.bincount(piece, row * left) / (noise_c * np.sqrt(np.bincount(piece, np.square(row))))
    leaves = np.maximum(-turns - LEAVES_NOISES, 0.0) / LEAVES_NOISES
    near = 1 / (1 + np.square(left / (3 * noise_c)))
    return np.asarray(np.where(sure, 1.0, near / (1 + np.square(leaves))[piece]), dtype=np.float64)


def _as_balance(fitted: Floats, covariance: Floats, fits: float) -> _Fit:
    """Of what explains the temperature, the four of the heat balance: capacity, loss, second and lag."""
    inverse, loss, late, second = fitted.tolist()
    inverse = max(inverse, 1e-3)
    turn = np.array([[-1, 0, 0, 0], [-loss, inverse, 0, 0], [-second, 0, 0, inverse], [-late, 0, inverse, 0]]) / inverse**2
    values = np.array([1.0, loss, max(second, 0.0), late]) / inverse
    return _Fit(values, turn @ covariance @ turn.T, fits)


def _pieces_of(parts: Sequence[_Part], rest: Flags, known: Flags) -> tuple[Floats, Floats, NDArray[np.int64], Flags]:
    """Terms, reading and number of the piece of each row at rest, in pieces of at most `PIECE_S`."""
    period = parts[0].readied.stretch.period_s
    longest = max(round(PIECE_S / period), LEAST_PIECE)
    begins = np.cumsum([0, *(len(one.readied.stretch) for one in parts)])
    new = np.zeros(begins[-1], dtype=np.bool_)
    new[begins[:-1]] = True
    new |= rest & ~np.concatenate(([False], rest[:-1]))
    since = np.arange(len(new)) - np.maximum.accumulate(np.where(new, np.arange(len(new)), 0))
    number = np.cumsum(new | (since % longest == 0))[rest]
    terms = np.concatenate(
        [np.stack([one.power_sum, -one.above_sum, one.readied.stretch.power, -one.balance.warming], axis=1) for one in parts]
    )[rest]
    read = np.concatenate([one.readied.stretch.temperature for one in parts])[rest]
    _, place, count = np.unique(number, return_inverse=True, return_counts=True)
    enough = count[place] >= LEAST_PIECE
    return terms[enough], read[enough], np.unique(place[enough], return_inverse=True)[1], known[rest][enough]


def _centred(values: Floats, piece: NDArray[np.int64], weight: Floats) -> Floats:
    """Less their weighted mean in each piece."""
    total = np.bincount(piece, weight)
    if values.ndim == 1:
        return np.asarray(values - (np.bincount(piece, weight * values) / total)[piece], dtype=np.float64)
    return np.stack([_centred(column, piece, weight) for column in values.T], axis=1)


def _seen_noise(parts: Sequence[_Part], usable: Flags, values: Floats, read: _Reading) -> Noise:
    """The noise as that of the readings explains it, or as the flow below zero shows it where that is more.

    Contact only ever adds to the flow. It is smoothed as little as keeps the noise below `QUIET_PERMILLE`.
    """
    period = parts[0].readied.stretch.period_s
    seen = None
    for expected in noises(period, values, read.celsius, read.permille):
        flow = np.concatenate([_flow(one, values, expected.smooth_s) for one in parts])[usable]
        below = -flow[flow < 0]
        times = MEDIAN_TO_SD * float(np.median(below)) / expected.flow if len(below) >= LEAST_REST_ROWS else 1.0
        times = min(max(times, 1.0), MOST_TIMES)
        seen = expected.times(times)
        if seen.flow <= QUIET_PERMILLE:
            break
    assert seen is not None
    return seen


def _without_capacity(parts: Sequence[_Part], rest: Flags, values: Floats, read: _Reading) -> Identified:
    """Of a tip that hardly warmed or cooled without contact: a model only if all usual capacities find as many draws."""
    period = parts[0].readied.stretch.period_s
    power, above = (
        np.concatenate(some)[rest] for some in zip(*((one.balance.power, one.balance.terms[:, 1]) for one in parts), strict=True)
    )
    loss = float(np.median(power / np.maximum(above, 1.0)))
    several = [np.array([capacity, loss, 0.0, 0.0]) for capacity in TRIED]
    found = [
        sum(len(find_spans(Flow(one.readied.stretch, _flow(one, tried, noise.smooth_s)), noise)) for one in parts)
        for tried, noise in ((tried, _noise(period, tried, read)) for tried in several)
    ]
    if max(found) - min(found) > AGREE_SHARE * max(found):
        return Identified(None, "The tip was never seen warming or cooling without contact: its heat capacity is not known.")
    noise = _noise(period, several[1], read)
    unsure = (USUAL_CAPACITY, 0.1 * loss, 0.0, 0.0)
    return Identified(ThermalModel(USUAL_CAPACITY, loss, 0.0, 0.0, unsure, noise, read.celsius, float(rest.sum()) * period))


def _judged(parts: Sequence[_Part], rest: Flags, fit: _Fit, noise: Noise, read: _Reading) -> Identified:
    """The model with its uncertainties, where it is plausible."""
    rest_s = float(rest.sum()) * parts[0].readied.stretch.period_s
    if rest.sum() < LEAST_REST_ROWS or rest_s < LEAST_REST_S:
        took = f"{LEAST_REST_S:g} s and {LEAST_REST_ROWS} readings"
        why = f"Only {rest_s:.1f} s ({rest.sum()} readings) are without contact; the tip's heat balance takes {took}."
        return Identified(None, why)
    capacity, loss, second, lag = fit.values.tolist()
    unsure = np.sqrt(np.diag(fit.covariance)).tolist()
    if unsure[0] > MOST_UNSURE * capacity:
        return _without_capacity(parts, rest, fit.values, read)
    model = ThermalModel(capacity, loss, second, lag, (unsure[0], unsure[1], unsure[2], unsure[3]), noise, read.celsius, rest_s)
    flow = np.concatenate([_flow(one, fit.values, noise.smooth_s)[one.readied.ready] for one in parts])
    return Identified(model, _implausible(model, flow))


def _implausible(model: ThermalModel, flow: Floats) -> str | None:
    """Why the fit cannot be believed; None where it can."""
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
