"""A tip's thermal model, identified on the run itself; or the reason why the record does not carry one.

A mixture gives a first estimate (`mixture`); then, `ROUNDS` times: find the contacts (`draws`), and fit the four parameters
by robust least squares to the rows at least `MARGIN_S` away from any, the heat-up among them. No quantile of a line that may
never rest is used. The uncertainties are those of the last fit, with the rows of each second taken together, since neighbours
are alike (the sandwich estimate of Huber and White with clusters).

Of a long record `MOST_S` are looked at, in windows of `WINDOW_S` that are spread evenly over it, the first of them its
beginning: the work is bounded, and a week says nothing of a tip that an hour does not.

No model where a parameter lies at the edge of what a soldering tip can have, where less than `LEAST_REST_S` without contact
are left, or where more heat comes back from the work than noise explains. Where nothing ever warmed or cooled the tip, so
that its capacity cannot be known, there is a model only if no capacity that a tip can have would show a draw: then there was
none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jbclog.features.draws import Flow, find_spans
from jbclog.features.mixture import Rows, first_estimate, weighted_fit
from jbclog.features.ready import Readied
from jbclog.features.thermal import (
    Balance,
    Noise,
    ThermalModel,
    balance_of,
    noise_of,
    smooth,
    smoothing_s,
    temperature_noise,
    term_noise,
)
from jbclog.judge.idle import Flags, Floats

ROUNDS: Final = 3
MARGIN_S: Final = 0.2
HOT_C: Final = 85.0  # a colder tip tells little of its losses
RISING_K_PER_S: Final = 5.0
WEAK: Final = np.diag([1e-4, 1e4, 4e3, 6e5])
REWEIGHTED: Final = 6
CAPACITY_RANGE, LOSS_RANGE = (2.0, 60.0), (0.02, 3.0)
LEAST_SIGNAL: Final = 0.3  # of the variance of the warming, beyond its noise, in rows at rest: what a capacity is known by
TRIED: Final = (4.0, 10.0, 30.0)  # ‰·s/K, where it is not known
USUAL_CAPACITY: Final = 10.0
MOST_S, WINDOW_S = 1200.0, 60.0
LEAST_REST_S, LEAST_REST_ROWS = 3.0, 30
BACKWARD_NOISES, MOST_BACKWARD = 5.0, 0.15
CLUSTER_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Identified:
    """The model of a tool, or why there is none."""

    model: ThermalModel | None
    why: str | None = None


def identify(parts: Sequence[Readied]) -> Identified:
    """The thermal model of the tip in these stretches."""
    parts = windows(parts)
    rows = [_Part(part, balance_of(part.stretch)) for part in parts]
    if not rows:
        return Identified(None, "Temperature and power of a working tool were never read together.")
    period, noise_c = parts[0].stretch.period_s, temperature_noise([part.stretch for part in parts])
    every = Rows(
        np.concatenate([one.balance.power for one in rows]),
        np.concatenate([one.balance.terms for one in rows]),
        np.concatenate([one.heats for one in rows]),
        term_noise(period, noise_c),
    )
    usable = np.concatenate([one.usable for one in rows])
    if usable.sum() < LEAST_REST_ROWS:
        return Identified(None, f"The tip was hot in {int(usable.sum())} readings; its heat balance takes {LEAST_REST_ROWS}.")
    values, rest = first_estimate(every.take(usable)), usable
    for _ in range(ROUNDS):
        noise = noise_of(period, values, noise_c)
        rest = usable & np.concatenate([_rest(one, values, noise) for one in rows])
        if rest.sum() < LEAST_REST_ROWS:
            break
        values = _robust(every.take(rest), values, noise.flow)
    if rest.sum() >= LEAST_REST_ROWS and not _shows_capacity(every.take(rest)):
        return _without_capacity(rows, every.take(rest), values, noise_c)
    return _judged(every, rest, np.concatenate([one.readied.ready for one in rows]), values, period, noise_c)


def windows(parts: Sequence[Readied]) -> list[Readied]:
    """The stretches, or of a long record windows of them."""
    total = sum(len(part.stretch) * part.stretch.period_s for part in parts)
    if total <= MOST_S:
        return list(parts)
    pieces = [piece for part in parts for piece in _pieces(part)]
    taken = np.unique(np.linspace(0, len(pieces) - 1, round(MOST_S / WINDOW_S)).astype(np.int64))
    return [pieces[place] for place in taken.tolist()]


def _pieces(part: Readied) -> list[Readied]:
    rows = max(round(WINDOW_S / part.stretch.period_s), 1)
    cuts = range(0, max(len(part.stretch) - rows // 2, 1), rows)
    return [Readied(part.stretch.take(slice(cut, cut + rows)), part.ready[cut : cut + rows]) for cut in cuts]


@dataclass(frozen=True, slots=True)
class _Part:
    readied: Readied
    balance: Balance

    @property
    def hot(self) -> Flags:
        return np.asarray(self.balance.temperature > HOT_C, dtype=np.bool_)

    @property
    def heats(self) -> Flags:
        """Rows of a heat-up: nothing is soldered in them."""
        return np.asarray(self.hot & ~self.readied.ready & (self.balance.warming > RISING_K_PER_S), dtype=np.bool_)

    @property
    def usable(self) -> Flags:
        return np.asarray(self.hot & (self.readied.ready | self.heats), dtype=np.bool_)


def _rest(one: _Part, values: Floats, noise: Noise) -> Flags:
    """The rows of a stretch that are far enough from any contact."""
    stretch = one.readied.stretch
    flow = _flow(one, values, noise)
    rest = np.ones(len(stretch), dtype=np.bool_)
    margin = max(round(MARGIN_S / stretch.period_s), 1)
    for span in find_spans(Flow(stretch, flow), noise):
        rest[max(span.first - margin, 0) : span.last + margin + 1] = False
    return rest


def _flow(one: _Part, values: Floats, noise: Noise) -> Floats:
    """The flow of a stretch, smoothed as draws are found in it."""
    period = one.readied.stretch.period_s
    flow = one.balance.power - one.balance.terms @ values
    more = float(np.sqrt(max(noise.smooth_s**2 - smoothing_s(period) ** 2, 0.0))) / period
    smoothed = smooth(flow, more) if more > 0.1 else flow
    return np.asarray(np.where(one.readied.ready, smoothed, 0.0), dtype=np.float64)


def _weights(left: Floats, noise: float) -> Floats:
    """What a row counts: less where heat leaves beyond noise, which is contact that was not found."""
    forward, backward = np.maximum(left, 0.0) / (2 * noise), np.minimum(left, 0.0) / (4 * noise)
    return np.asarray(1 / (1 + np.square(forward) + np.square(backward)), dtype=np.float64)


def _robust(rows: Rows, values: Floats, noise: float) -> Floats:
    for _ in range(REWEIGHTED):
        values = weighted_fit(rows.terms, rows.power, _weights(rows.power - rows.terms @ values, noise), WEAK, rows.warming_noise)
    return values


def _shows_capacity(rest: Rows) -> bool:
    """Whether the tip was seen warming or cooling without contact, beyond the noise of its temperature."""
    moved = float(np.square(rest.terms[:, 0]).mean())
    return moved > 0 and (moved - rest.warming_noise) / moved >= LEAST_SIGNAL


def _without_capacity(parts: Sequence[_Part], rest: Rows, values: Floats, noise_c: float) -> Identified:
    """Of a tip that only ever rested: a model that finds no draw, where none can be."""
    period = parts[0].readied.stretch.period_s
    for capacity in TRIED:
        tried = np.array([capacity, values[1], 0.0, 0.0])
        noise = noise_of(period, tried, noise_c)
        if any(find_spans(Flow(one.readied.stretch, _flow(one, tried, noise)), noise) for one in parts):
            return Identified(None, "The tip was never seen warming or cooling without contact: its heat capacity is not known.")
    loss = float(np.median(rest.power / np.maximum(rest.terms[:, 1], 1.0)))
    noise = noise_of(period, np.array([USUAL_CAPACITY, loss, 0.0, 0.0]), noise_c)
    unsure = (USUAL_CAPACITY, 0.1 * loss, 0.0, 0.0)
    return Identified(ThermalModel(USUAL_CAPACITY, loss, 0.0, 0.0, unsure, noise, noise_c, len(rest.power) * period))


def _judged(rows: Rows, rest: Flags, ready: Flags, values: Floats, period_s: float, noise_c: float) -> Identified:
    """The model with its uncertainties, where it is plausible."""
    noise, rest_s = noise_of(period_s, values, noise_c), float(rest.sum()) * period_s
    if rest.sum() < LEAST_REST_ROWS or rest_s < LEAST_REST_S:
        took = f"{LEAST_REST_S:g} s and {LEAST_REST_ROWS} readings"
        why = f"Only {rest_s:.1f} s ({rest.sum()} readings) are without contact; the tip's heat balance takes {took}."
        return Identified(None, why)
    unsure = _uncertainties(rows.terms[rest], rows.power[rest], values, noise.flow, max(round(CLUSTER_S / period_s), 1))
    capacity, loss, second, lag = values.tolist()
    model = ThermalModel(capacity, loss, second, lag, unsure, noise, noise_c, rest_s)
    flow = (rows.power - rows.terms @ values)[ready]
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


def _uncertainties(terms: Floats, power: Floats, values: Floats, noise: float, cluster: int) -> tuple[float, float, float, float]:
    """One standard deviation of each parameter."""
    left = power - terms @ values
    weight = _weights(left, noise)
    bread = np.linalg.inv((terms * weight[:, None]).T @ terms + WEAK)
    scores = np.add.reduceat(terms * (weight * left)[:, None], np.arange(0, len(left), cluster), axis=0)
    spread = bread @ (scores.T @ scores) @ bread
    capacity, loss, second, lag = np.sqrt(np.diag(spread)).tolist()
    return capacity, loss, second, lag
