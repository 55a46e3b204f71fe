"""The heat that leaves the tip into what it touches, from power and temperature alone.

Whatever the heater puts in either stays in the tip, goes to the air, or goes into the work:

    flow into the work = power - holding power - heat capacity × dT/dt + lag × dP/dt      (all in ‰ of the full power)

So heating up, a changed setting and the recovery after a joint, in which the power is high because the tip itself takes the
heat, leave the flow near zero, whatever the regulator does. Nothing of it is told by the station; all of it is found:

- *Holding power* is what keeps the tip hot when it touches nothing. Per kelvin above the air it changes slowly, so it is the
  `HOLDING_QUANTILE` per cent quantile of (power - capacity × dT/dt) / (T - `AIR_C`) among the readings of `HOLDING_S` around
  each moment in which the tip was ready, times (T - `AIR_C`).
- *Heat capacity* in ‰·s/K and *lag* in s are those with which the flow is sparsest: the least sum of square roots of the flow
  beyond `NEGLIGIBLE_PERMILLE`, which is least where the flow is zero outside touches. The capacity is never
  more than heating up at full power leaves room for; for the lag, a flow out of the work into the tip, which does not exist,
  counts `BACKWARD` times. The lag is that of a tip behind a resistance, as far as power shows it.

Before the tip has first come within `READY_K` of its setting (of its median temperature, where the setting is not known), since it
went to work, its setting was raised or the record had a gap, nothing is soldered, and no flow is told.

Temperature and power are smoothed alike, with a Gaussian of `SMOOTH_S` (but of `SMOOTH_PERIODS` at least); the rate of change is
that of the smoothed temperature. The noise is taken from the lower side of the flow, on which there are no joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jbclog.features.series import Stretch
from jbclog.judge.idle import Flags, Floats

AIR_C = 25.0
SMOOTH_S, SMOOTH_PERIODS = 0.15, 0.6
LOOK_S = 0.3  # the smoothing with which the constants are found
HOLDING_QUANTILE, HOLDING_S = 35.0, 60.0
HOLDING_LOOKS = 150
LOWER_SIDE = 0.9  # standard deviations from the 10 % to the 35 % quantile of flow at rest
READY_K = 30.0
HOT_C = 100.0  # a tip that is colder says little of its losses
NEGLIGIBLE_PERMILLE = 20.0
BACKWARD = 3.0
FULL_PERMILLE, RISING_K_PER_S, LEAST_RISING = 970.0, 20.0, 5
BUSY_PERMILLE, BUSY_K_PER_S, BUSY_PERMILLE_PER_S = 60.0, 6.0, 200.0
CAPACITIES = np.geomspace(2.0, 60.0, 69)  # ‰·s/K: 130 W and 1.2 J/K are 9.2
LAGS = np.arange(0.0, 0.45, 0.05)
USUAL_CAPACITY = 9.0
LEAST_ROWS, MOST_ROWS = 20, 20_000


@dataclass(frozen=True, slots=True)
class Tip:
    """What was found of a tip: ‰·s/K, s, and whether there was anything to find them from."""

    capacity: float
    lag_s: float
    found: bool


@dataclass(frozen=True, slots=True)
class Flow:
    """The heat flow into the work in ‰ at each moment of a stretch, and the holding power in ‰."""

    stretch: Stretch
    flow: Floats
    holding: Floats


@dataclass(frozen=True, slots=True)
class Flows:
    """The heat flows of a port, their noise (standard deviation, ‰) and the smoothing that they have gone through, in s."""

    parts: list[Flow]
    noise: float
    smooth_s: float


@dataclass(frozen=True, slots=True)
class _Smooth:
    """A stretch smoothed, with its rates of change a second."""

    temperature: Floats
    power: Floats
    warming: Floats
    surge: Floats


def find_tip(stretches: Sequence[Stretch]) -> Tip:
    """Heat capacity and lag of the tip, from all that happened to it."""
    parts = [_smooth(stretch, smoothing(stretch.period_s, LOOK_S)) for stretch in stretches]
    if not parts:
        return Tip(USUAL_CAPACITY, 0.0, False)
    whole = _Smooth(*(np.concatenate([getattr(part, name) for part in parts]) for name in _Smooth.__slots__))
    capacity = _capacity(whole)
    return Tip(USUAL_CAPACITY, 0.0, False) if capacity is None else Tip(capacity, _lag(whole, capacity), True)


def find_flows(stretches: Sequence[Stretch], tip: Tip) -> Flows:
    """The heat flow into the work in each stretch."""
    if not stretches:
        return Flows([], 0.0, 0.0)
    return _flows(stretches, tip, smoothing(stretches[0].period_s, SMOOTH_S))


def smoothing(period_s: float, smooth_s: float) -> float:
    """The Gaussian's standard deviation in s at this rate."""
    return max(smooth_s, SMOOTH_PERIODS * period_s)


def _flows(stretches: Sequence[Stretch], tip: Tip, smooth_s: float) -> Flows:
    smooth = [_smooth(stretch, smooth_s) for stretch in stretches]
    gross = [part.power - tip.capacity * part.warming + tip.lag_s * part.surge for part in smooth]
    ends = np.cumsum([len(stretch) for stretch in stretches])[:-1]
    rise = np.concatenate([_rise(part.temperature) for part in smooth])
    ready = np.concatenate([_ready(stretch) for stretch in stretches])
    holding = _holding_per_kelvin(np.concatenate(gross) / rise, ready, stretches[0].period_s) * rise
    flow = np.where(ready, np.concatenate(gross) - holding, 0.0)
    parts = zip(stretches, np.split(flow, ends), np.split(holding, ends), strict=True)
    low, high = np.quantile(flow[ready], [0.10, 0.35]) if ready.any() else (0.0, 0.0)
    return Flows([Flow(*part) for part in parts], float(high - low) / LOWER_SIDE, smooth_s)


def _ready(stretch: Stretch) -> Flags:
    """From when on the tip can be soldered with: it has been near its setting since the setting was last raised."""
    unknown = np.isnan(stretch.setting)
    setting = np.where(unknown, np.median(stretch.temperature), stretch.setting)
    near, rows = stretch.temperature >= setting - READY_K, np.arange(len(stretch))
    raised = np.maximum.accumulate(np.where(np.diff(setting, prepend=setting[0]) > 0, rows, 0))
    return np.asarray(np.maximum.accumulate(np.where(near, rows, -1)) >= raised, dtype=np.bool_)


def _holding_per_kelvin(per_kelvin: Floats, ready: Flags, period_s: float) -> Floats:
    """The running quantile of the rows in which the tip was ready; looked at `HOLDING_LOOKS` times in its window, which is fast."""
    moments = np.flatnonzero(ready).astype(np.float64)
    if not len(moments):
        return np.zeros(len(per_kelvin))
    every = max(round(HOLDING_S / period_s / HOLDING_LOOKS), 1)
    from scipy.ndimage import percentile_filter  # here, so that a verb which measures nothing does not load it

    looked = percentile_filter(
        per_kelvin[ready][::every], HOLDING_QUANTILE, size=round(HOLDING_S / period_s / every) | 1, mode="mirror"
    )
    return np.asarray(np.interp(np.arange(len(per_kelvin)), moments[::every], looked), dtype=np.float64)


def _smooth(stretch: Stretch, smooth_s: float) -> _Smooth:
    from scipy.ndimage import gaussian_filter1d

    period = stretch.period_s
    sigma = smooth_s / period
    return _Smooth(
        gaussian_filter1d(stretch.temperature, sigma),
        gaussian_filter1d(stretch.power, sigma),
        gaussian_filter1d(stretch.temperature, sigma, order=1) / period,
        gaussian_filter1d(stretch.power, sigma, order=1) / period,
    )


def _above_holding(power: Floats, temperature: Floats) -> Floats:
    hot = temperature > HOT_C
    if not hot.any():
        return power
    per_kelvin = np.percentile(power[hot] / _rise(temperature[hot]), HOLDING_QUANTILE)
    return np.asarray(power - per_kelvin * _rise(temperature), dtype=np.float64)


def _rise(temperature: Floats) -> Floats:
    return np.maximum(temperature - AIR_C, 50.0)


def _capacity(tip: _Smooth) -> float | None:
    """The capacity with which the flow is sparsest; None where nothing ever happened."""
    above = _above_holding(tip.power, tip.temperature)
    busy = _some((np.abs(above) > BUSY_PERMILLE) | (np.abs(tip.warming) > BUSY_K_PER_S))
    if busy.sum() < LEAST_ROWS:
        return None
    power, warming = above[busy], tip.warming[busy]
    crowded = [_crowdedness(power - capacity * warming, 1.0) for capacity in CAPACITIES]
    return min(float(CAPACITIES[int(np.argmin(crowded))]), _most(tip, above))


def _most(tip: _Smooth, above: Floats) -> float:
    """The greatest capacity that heating up at full power leaves room for: what goes into the work is not less than nothing."""
    rising = (tip.power >= FULL_PERMILLE) & (tip.warming >= RISING_K_PER_S) & (tip.temperature > HOT_C)
    return float(np.median(above[rising] / tip.warming[rising])) if rising.sum() >= LEAST_RISING else np.inf


def _lag(tip: _Smooth, capacity: float) -> float:
    """The lag with which the flow is sparsest, flow out of the work counting more."""
    flow = _above_holding(tip.power - capacity * tip.warming, tip.temperature)
    busy = _some((np.abs(flow) > BUSY_PERMILLE) | (np.abs(tip.surge) > BUSY_PERMILLE_PER_S))
    if busy.sum() < LEAST_ROWS:
        return 0.0
    crowded = [_crowdedness(flow[busy] + lag * tip.surge[busy], BACKWARD) for lag in LAGS]
    return float(LAGS[int(np.argmin(crowded))])


def _some(busy: Flags) -> Flags:
    """No more than `MOST_ROWS` of them, evenly taken: a long run says nothing new."""
    places = np.flatnonzero(busy)
    few = np.zeros(len(busy), dtype=np.bool_)
    few[places[:: max(len(places) // MOST_ROWS, 1)]] = True
    return few


def _crowdedness(flow: Floats, backward: float) -> float:
    forward = np.sqrt(np.maximum(flow - NEGLIGIBLE_PERMILLE, 0.0)).sum()
    return float(forward + backward * np.sqrt(np.maximum(-flow - NEGLIGIBLE_PERMILLE, 0.0)).sum())
