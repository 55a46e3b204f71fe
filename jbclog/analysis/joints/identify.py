"""Identify a tip's thermal model from the run itself, or say why the record does not show it.

A mixture gives first estimates (`mixture`); usual tips are tried as well. For each of them: find
the contacts, fit the four parameters to the temperatures read in the rows at least `MARGIN_S` away
from any contact, the heat-up included (`rest_fit`), and repeat. The best `FINALISTS` get `ROUNDS`
in all, and the best of them is taken (`_score`): the one that explains most rows as rest, with
hardly any heat coming back from the work, and that is not an unusual tip. No quantile of a line
that may never rest is used. The uncertainties are those of the last fit, with the rows of each
piece of rest as a cluster because neighbours are correlated (sandwich estimator of Huber and White
with clusters).

The noise is what the noise of the readings explains, or what the flow below zero shows if that is
more: heat that comes back is noise or an error of the model (a regulator that switches in bursts, a
reported power that is a mean), whatever the line does.

A long record is sampled: `MOST_S` in windows of `WINDOW_S`, spread evenly over it, the first at its
beginning. This bounds the work, and a week shows no more of a tip than an hour.

There is no model if a parameter lies beyond what a soldering tip can have, if less than
`LEAST_REST_S` without contact remain, or if more heat comes back from the work than noise explains.
If hardly anything warmed or cooled the tip without contact, its capacity is not known, and there is
a model only if all usual capacities give as many contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jbclog.analysis.joints.contacts import Contact, Flow, find_contacts
from jbclog.analysis.joints.delay import SLOWEST_S, delay_of
from jbclog.analysis.joints.heat_up_end import ReadyStretch
from jbclog.analysis.joints.mixture import (
    FLAT_PERMILLE,
    REFERENCE_NOISE,
    USUAL_CAPACITY,
    USUAL_LOSS,
    Rows,
    first_estimates,
)
from jbclog.analysis.joints.rest_fit import BalancedStretch, Fit, balanced_stretch, fit_rest
from jbclog.analysis.joints.thermal import (
    COARSE_S,
    QUIET_PERMILLE,
    Delay,
    Noise,
    ThermalModel,
    least_smoothed_noise,
    noise_levels,
    power_noise,
    smooth,
    smoothing_s,
    temperature_noise,
    term_noise,
)
from jbclog.analysis.port_data import Flags, Floats

NEVER_READ: Final = "Temperature and power of a working tool were never read together."
ROUNDS, FINALISTS = 3, 2
MARGIN_S: Final = 0.2
CERTAIN: Final = 2.0  # standard uncertainties of the lag; a greater lag moves the joints
MOST_UNSURE: Final = 0.3  # uncertainty of the capacity, above which the record does not show it
CAPACITY_RANGE, LOSS_RANGE = (2.0, 80.0), (0.02, 3.0)
USUAL_CAPACITIES: Final = (5.0, 10.0, 20.0)  # ‰·s/K
APART: Final = 0.25  # difference of the logarithm: starts closer together are one
AGREE_SHARE: Final = 0.1  # share of the draws
MOST_S, WINDOW_S = 1200.0, 60.0
LEAST_REST_S, LEAST_REST_ROWS = 3.0, 30
BACKWARD_NOISES, MOST_BACKWARD = 5.0, 0.15
BACKWARD_COST: Final = 10.0  # rows at rest that outweigh one in which heat comes back
# spreads of the logarithms; share of all rows
CAPACITY_SPREAD, LOSS_SPREAD, PRIOR_SHARE = 0.6, 0.6, 0.12
MEDIAN_TO_SD: Final = 1.4826
MOST_NOISE_FACTOR: Final = 6.0  # times the noise of readings: more is not noise


@dataclass(frozen=True, slots=True)
class Identification:
    """The model of a tool, or why it is not known. With both, the model is not plausible."""

    model: ThermalModel | None
    why: str | None = None


def identify(parts: Sequence[ReadyStretch]) -> Identification:
    """Return the thermal model of the tip in these stretches of one tool."""
    parts = model_windows(parts)
    if not parts:
        return Identification(None, NEVER_READ)
    delay = delay_of(parts)
    parts = [ReadyStretch(part.stretch.power_later(delay.rows), part.ready) for part in parts]
    balanced = [balanced_stretch(part) for part in parts]
    stretches = [part.stretch for part in parts]
    reading = _ReadingNoise(temperature_noise(stretches), power_noise(stretches))
    usable = np.concatenate([one.usable for one in balanced])
    if usable.sum() < LEAST_REST_ROWS:
        return Identification(
            None,
            f"The tip was hot in {int(usable.sum())} readings; its heat balance takes"
            f" {LEAST_REST_ROWS}.",
        )
    every = _rows(balanced, stretches[0].period_s, reading)
    known = np.concatenate([one.known for one in balanced])
    starts = _starts(first_estimates(every.take(usable)))
    started = [_refined_candidate(balanced, usable, known, start, reading, 1) for start in starts]
    started.sort(key=lambda one: -one.score)
    candidates = [
        _refined_candidate(balanced, usable, known, one.fit.values, reading, ROUNDS - 1)
        for one in started[:FINALISTS]
    ]
    best = max(candidates, key=lambda one: one.score)
    found = _plausible_model(balanced, best.rest, best.fit, best.noise, reading)
    if found.model is None:
        return found
    if known.any():
        # without a heat-up, contacts that were not found also change the lag
        delay = _moved_by_fit(delay, found.model, stretches[0].period_s)
    return replace(found, model=replace(found.model, delay=delay))


def _moved_by_fit(delay: Delay, model: ThermalModel, period_s: float) -> Delay:
    """Return the delay, with joints moved earlier by the lag of the fit as well.

    A lag below zero means that the power was reported earlier than its temperature, so the flow is
    that of the earlier moment. A lag above zero means that the power is reported late; the flow is
    then that of the temperature's moment, and nothing is moved.
    """
    late_s = -model.lag_s
    if period_s > SLOWEST_S or late_s <= CERTAIN * model.uncertainties[3]:
        return delay
    return replace(delay, moved_s=delay.moved_s + late_s)


def identify_each(
    tools: Sequence[Sequence[ReadyStretch]],
) -> tuple[list[ThermalModel | None], str | None]:
    """Return the model of each tool, None if not known, and the first reason why one is not."""
    found = [identify(parts) for parts in tools]
    why = next((one.why for one in found if one.why is not None), None)
    return [one.model if one.why is None else None for one in found], why


def _starts(estimates: list[Floats]) -> list[Floats]:
    """Return the estimates, and a small, a medium and a large capacity with the loss of the most
    likely estimate.
    """
    loss = min(max(float(estimates[0][1]), LOSS_RANGE[0]), LOSS_RANGE[1])
    usual = [np.array([capacity, loss, 0.0, 0.0]) for capacity in USUAL_CAPACITIES]
    near = [one for one in estimates if one[0] > CAPACITY_RANGE[0] and one[1] > LOSS_RANGE[0]]
    return near + [
        one for one in usual if all(abs(np.log(one[0] / other[0])) > APART for other in near)
    ]


def _refined_candidate(
    balanced: Sequence[BalancedStretch],
    usable: Flags,
    known: Flags,
    start: Floats,
    reading: _ReadingNoise,
    rounds: int,
) -> _Candidate:
    """Find contacts and refine the parameters in turn, `rounds` times; return the result and its
    score.
    """
    fit, rest, score = Fit(start, np.full((4, 4), np.nan), 0.0), usable, -np.inf
    noise = _observed_noise(balanced, usable, start, reading)
    for _ in range(rounds):
        rest = usable & _rows_at_rest(balanced, fit.values, noise)
        if rest.sum() < LEAST_REST_ROWS:
            break
        fit = fit_rest(balanced, rest, known, fit.values, reading.celsius)
        noise = _observed_noise(balanced, usable, fit.values, reading)
        score = _score(
            fit, noise, _backward_rows(balanced, usable, fit.values, reading), int(usable.sum())
        )
    return _Candidate(fit, noise, rest, score)


def _score(fit: Fit, noise: Noise, backward: int, rows: int) -> float:
    """Return how much more likely the rows at rest are than contact with any flow; heat that comes
    back counts against it.
    """
    capacity, loss = np.maximum(fit.values[:2], 1e-3)
    unusual = (np.log(capacity / USUAL_CAPACITY) / CAPACITY_SPREAD) ** 2 + (
        np.log(loss / USUAL_LOSS) / LOSS_SPREAD
    ) ** 2
    gain = np.log(FLAT_PERMILLE / np.sqrt(noise.flow * REFERENCE_NOISE))
    return float(
        gain * (fit.rows_explained - BACKWARD_COST * backward - PRIOR_SHARE * rows * unusual)
    )


def _noise(period_s: float, values: Floats, reading: _ReadingNoise) -> Noise:
    return least_smoothed_noise(period_s, values, reading.celsius, reading.permille)


def _backward_rows(
    parts: Sequence[BalancedStretch], usable: Flags, values: Floats, reading: _ReadingNoise
) -> int:
    """Return the number of rows in which heat comes back from the work for longer than the noise of
    readings explains.
    """
    noise = _noise(parts[0].stretch.period_s, values, reading)
    flow = np.concatenate([_flow(one, values, max(COARSE_S, noise.smooth_s)) for one in parts])
    return int((usable & (flow < -BACKWARD_NOISES * noise.coarse)).sum())


def model_windows(parts: Sequence[ReadyStretch]) -> list[ReadyStretch]:
    """Return the stretches, or windows of a long record."""
    taken = (
        pieces_for_model([len(part.stretch) for part in parts], parts[0].stretch.period_s)
        if parts
        else []
    )
    return [
        ReadyStretch(parts[place].stretch.take(rows), parts[place].ready[rows])
        for place, rows in taken
    ]


def pieces_for_model(lengths: Sequence[int], period_s: float) -> list[tuple[int, slice]]:
    """Return the rows that the model comes from, as pairs of stretch and rows; `lengths` are those
    of the stretches in rows.
    """
    if sum(length * period_s for length in lengths) <= MOST_S:
        return [(place, slice(0, length)) for place, length in enumerate(lengths)]
    pieces = [
        (place, rows)
        for place, length in enumerate(lengths)
        for rows in _windows_of(length, period_s)
    ]
    taken = np.unique(np.linspace(0, len(pieces) - 1, round(MOST_S / WINDOW_S)).astype(np.int64))
    return [pieces[number] for number in taken.tolist()]


def _windows_of(length: int, period_s: float) -> list[slice]:
    rows = max(round(WINDOW_S / period_s), 1)
    return [
        slice(cut, min(cut + rows, length)) for cut in range(0, max(length - rows // 2, 1), rows)
    ]


@dataclass(frozen=True, slots=True)
class _ReadingNoise:
    """The noise of readings: of the temperature in °C and of the power in ‰."""

    celsius: float
    permille: float


def _rows(parts: Sequence[BalancedStretch], period_s: float, reading: _ReadingNoise) -> Rows:
    """Return the rows for the first estimates."""
    return Rows(
        np.concatenate([one.balance.power for one in parts]),
        np.concatenate([one.balance.terms for one in parts]),
        np.concatenate([one.known for one in parts]),
        term_noise(period_s, reading.celsius),
    )


def _rows_at_rest(parts: Sequence[BalancedStretch], values: Floats, noise: Noise) -> Flags:
    """Return the rows of all stretches that are far enough from any contact."""
    rest = np.ones(sum(len(one.stretch) for one in parts), dtype=np.bool_)
    margin = max(round(MARGIN_S / parts[0].stretch.period_s), 1)
    for contact in _contacts(parts, values, noise):
        first = max(contact.first - margin, contact.begin)
        rest[first : min(contact.last + margin + 1, contact.end)] = False
    return rest


def _contacts(parts: Sequence[BalancedStretch], values: Floats, noise: Noise) -> list[Contact]:
    flows = [Flow(one.stretch, _flow(one, values, noise.smooth_s)) for one in parts]
    return find_contacts(flows, noise)


def _flow(one: BalancedStretch, values: Floats, smooth_s: float) -> Floats:
    """Return the flow of a stretch, smoothed as for finding contacts."""
    period = one.stretch.period_s
    flow = one.balance.power - one.balance.terms @ values
    more = float(np.sqrt(max(smooth_s**2 - smoothing_s(period) ** 2, 0.0))) / period
    smoothed = smooth(flow, more) if more > 0.1 else flow
    return np.asarray(np.where(one.ready, smoothed, 0.0), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A fit with its noise, its rows at rest, and its score."""

    fit: Fit
    noise: Noise
    rest: Flags
    score: float


def _observed_noise(
    parts: Sequence[BalancedStretch], usable: Flags, values: Floats, reading: _ReadingNoise
) -> Noise:
    """Return the noise that the readings explain, or that the flow below zero shows if that is
    more; contact only adds to the flow.

    The flow is smoothed just enough to keep its noise below `QUIET_PERMILLE`.
    """
    period = parts[0].stretch.period_s
    noise = None
    for level in noise_levels(period, values, reading.celsius, reading.permille):
        flow = np.concatenate([_flow(one, values, level.smooth_s) for one in parts])[usable]
        below = -flow[flow < 0]
        times = (
            MEDIAN_TO_SD * float(np.median(below)) / level.flow
            if len(below) >= LEAST_REST_ROWS
            else 1.0
        )
        times = min(max(times, 1.0), MOST_NOISE_FACTOR)
        noise = level.times(times)
        if noise.flow <= QUIET_PERMILLE:
            break
    assert noise is not None
    return noise


def _model_without_capacity(
    parts: Sequence[BalancedStretch], rest: Flags, reading: _ReadingNoise
) -> Identification:
    """Return a model of unknown capacity if all usual capacities find as many contacts."""
    period = parts[0].stretch.period_s
    power = np.concatenate([one.balance.power for one in parts])[rest]
    above_air = np.concatenate([one.balance.terms[:, 1] for one in parts])[rest]
    loss = float(np.median(power / np.maximum(above_air, 1.0)))
    candidates = [np.array([capacity, loss, 0.0, 0.0]) for capacity in USUAL_CAPACITIES]
    counts = [
        len(_contacts(parts, values, _noise(period, values, reading))) for values in candidates
    ]
    if max(counts) - min(counts) > AGREE_SHARE * max(counts):
        return Identification(
            None,
            "The tip was never seen warming or cooling without contact: its heat capacity is not"
            " known.",
        )
    noise = _noise(period, candidates[1], reading)
    unsure = (USUAL_CAPACITY, 0.1 * loss, 0.0, 0.0)
    return Identification(
        ThermalModel(
            USUAL_CAPACITY,
            loss,
            0.0,
            0.0,
            unsure,
            noise,
            reading.celsius,
        )
    )


def _plausible_model(
    parts: Sequence[BalancedStretch], rest: Flags, fit: Fit, noise: Noise, reading: _ReadingNoise
) -> Identification:
    rest_s = float(rest.sum()) * parts[0].stretch.period_s
    if rest.sum() < LEAST_REST_ROWS or rest_s < LEAST_REST_S:
        took = f"{LEAST_REST_S:g} s and {LEAST_REST_ROWS} readings"
        why = (
            f"Only {rest_s:.1f} s ({rest.sum()} readings) are without contact; the tip's heat"
            f" balance takes {took}."
        )
        return Identification(None, why)
    capacity, loss, second, lag = fit.values.tolist()
    unsure = np.sqrt(np.diag(fit.covariance)).tolist()
    if unsure[0] > MOST_UNSURE * capacity:
        return _model_without_capacity(parts, rest, reading)
    model = ThermalModel(
        capacity,
        loss,
        second,
        lag,
        (unsure[0], unsure[1], unsure[2], unsure[3]),
        noise,
        reading.celsius,
    )
    flow = np.concatenate([_flow(one, fit.values, noise.smooth_s)[one.ready] for one in parts])
    return Identification(model, _implausible(model, flow))


def _implausible(model: ThermalModel, flow: Floats) -> str | None:
    """Return why the fit is not plausible, or None."""
    for name, value, unit, (low, high) in (
        ("heat capacity", model.capacity, "‰·s/K", CAPACITY_RANGE),
        ("heat loss", model.loss, "‰/K", LOSS_RANGE),
    ):
        if not low <= value <= high:
            return (
                f"The tip's {name} comes out as {value:.2g} {unit}; a soldering tip has {low:g} to"
                f" {high:g}."
            )
    backward = float((flow < -BACKWARD_NOISES * model.noise.flow).mean()) if len(flow) else 0.0
    if backward > MOST_BACKWARD:
        share = f"{100 * backward:.0f} %"
        return (
            f"Heat seems to come back from the work in {share} of the readings: one heat balance"
            " does not fit them."
        )
    return None
