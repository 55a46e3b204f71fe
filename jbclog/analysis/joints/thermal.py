"""Heat balance of a tip: the heat flow into the work, from power and temperature alone.

The heater's power stays in the tip, goes to the air, or goes into the work, all in ‰ of full power:

    flow = power - capacity × T' - loss × (T - air) - second × T'' + lag × power'

*Capacity* is the tip's heat capacity in ‰·s/K, *loss* the heat that it gives to the air in ‰/K.
*Second* (‰·s²/K) is because heater and point are two masses with a resistance between them; *lag*
(s) is because the reported power or temperature comes late. The flow is zero at rest, while the tip
heats up and while it recovers, whatever the regulator does, and positive in contact with work.

Temperature and power are smoothed alike with a Gaussian, and all rates of change are those of the
smoothed signals. Everything is linear, so the noise of the flow and of its rate of change follow
from the noise of the temperature, and limits that are multiples of them have known error rates.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from jbclog.analysis.joints.series import Stretch
from jbclog.analysis.port_data import Floats

AIR_C: Final = 25.0
SMOOTH_S: Final = 0.1  # two draws half a second apart stay apart
COARSE_S: Final = 0.3  # smoothing at which a small flow shows
QUIET_PERMILLE: Final = 45.0  # a flow with more noise is smoothed more; a pad takes 300 ‰
SMOOTHER: Final = (1.0, 1.4, 2.0, 3.0, 4.5)
MOST_SMOOTH_S: Final = 0.45
SMOOTH_PERIODS: Final = 0.7  # a narrower sampled Gaussian has no useful derivative
STEP_NOISE: Final = 1 / np.sqrt(12)  # standard deviation of rounding to whole °C
MOST_NOISE_C: Final = 2.0
EPSILON: Final = float(np.finfo(np.float64).eps)
# steps of up to 10 ‰, and a heater that switches whole mains cycles
POWER_NOISE_PERMILLE: Final = 6.0
MOST_POWER_NOISE: Final = 200.0
FAST_S: Final = 0.25  # longest period; at longer ones, contact changes every reading
QUARTER_TO_SD: Final = 0.3186  # a quarter of normal values are within this many standard deviations
EDGE_NOISE_S: Final = 0.2  # time over which that noise changes


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations at rest: of the flow in ‰, of its rate of change in ‰/s, and of the flow
    smoothed to `COARSE_S` in ‰.

    `smooth_s` is the smoothing of the flow that they belong to; `floors` is a factor on the minimum
    limits in ‰.
    """

    flow: float
    rate: float
    coarse: float
    smooth_s: float
    floors: float = 1.0

    def times(self, factor: float) -> Noise:
        return replace(
            self, flow=factor * self.flow, rate=factor * self.rate, coarse=factor * self.coarse
        )


@dataclass(frozen=True, slots=True)
class Delay:
    """Delay of the temperature behind the power in s, and one standard deviation; or why it is not
    known.

    `rows` is by how many rows the power is moved so that both belong together; the model's `lag_s`
    is the rest. `moved_s` is how much earlier the joints are than the temperature shows them,
    including the lag. Both are 0 unless a delay is certain.
    """

    seconds: float | None = None
    uncertainty_s: float | None = None
    why: str | None = None
    rows: int = 0
    moved_s: float = 0.0


@dataclass(frozen=True, slots=True)
class ThermalModel:
    """The thermal model of a tip, from its own record. `uncertainties` are one standard deviation
    of the four parameters, in order.

    `temperature_noise` is that of a reading in °C.
    """

    capacity: float
    loss: float
    second: float
    lag_s: float
    uncertainties: tuple[float, float, float, float]
    noise: Noise
    temperature_noise: float
    delay: Delay = Delay()

    @property
    def values(self) -> Floats:
        return np.array([self.capacity, self.loss, self.second, self.lag_s])


@dataclass(frozen=True, slots=True)
class Balance:
    """The smoothed power of a record in ‰, and the terms that the four parameters multiply, a
    column each.
    """

    power: Floats
    terms: Floats

    @property
    def warming(self) -> Floats:
        return np.asarray(self.terms[:, 0], dtype=np.float64)

    @property
    def temperature(self) -> Floats:
        return np.asarray(self.terms[:, 1] + AIR_C, dtype=np.float64)


def smoothing_s(period_s: float) -> float:
    """Return the Gaussian's standard deviation in s at this sampling period."""
    return max(SMOOTH_S, SMOOTH_PERIODS * period_s)


def balance_of(stretch: Stretch) -> Balance:
    """Return the terms of the heat balance in each row of a stretch."""
    sigma, period = smoothing_s(stretch.period_s) / stretch.period_s, stretch.period_s
    above_air = stretch.temperature - AIR_C
    terms = (
        smooth(above_air, sigma, 1) / period,
        smooth(above_air, sigma, 0),
        smooth(above_air, sigma, 2) / period**2,
        -smooth(stretch.power, sigma, 1) / period,
    )
    return Balance(smooth(stretch.power, sigma, 0), np.stack(terms, axis=1))


def flow_of(stretch: Stretch, values: Floats, smooth_s: float) -> Floats:
    """Return the flow into the work in ‰ in each row, by one filter for the power and one for the
    temperature.
    """
    of_power, of_temperature = _kernels(stretch.period_s, values, smooth_s)
    above_air = stretch.temperature - AIR_C
    margin = len(of_power) // 2
    return _weighted(_extended(stretch.power, margin), of_power) - _weighted(
        _extended(above_air, margin), of_temperature
    )


def smooth(values: Floats, sigma: float, order: int = 0) -> Floats:
    """Smooth the values with a Gaussian of `sigma` rows, or with a derivative of it per row."""
    weights = _gaussian(sigma, order)
    return _weighted(_extended(values, len(weights) // 2), weights)


@lru_cache(maxsize=64)
def _gaussian(sigma: float, order: int) -> Floats:
    """Return a Gaussian of `sigma` rows, or its first or second derivative, as weights of rows:
    four standard deviations to each side.
    """
    away, steep = np.arange(-int(4 * sigma + 0.5), int(4 * sigma + 0.5) + 1), 1 / (sigma * sigma)
    bell = np.exp(-0.5 / (sigma * sigma) * away**2)
    polynomial = np.array(((1.0,), (0.0, -steep), (-steep, 0.0, steep * steep))[order])
    derived = (away[:, None] ** np.arange(order + 1)) @ polynomial * (bell / bell.sum())
    return np.asarray(derived[::-1], dtype=np.float64)


def _weighted(values: Floats, weights: Floats) -> Floats:
    """Return the weighted sum of each row and its neighbours; rows without all neighbours are left
    out.

    Equals `scipy.ndimage.correlate1d` to the last bit: importing that takes longer than finding the
    joints of a short run.
    """
    rows, middle = len(values) - len(weights) + 1, len(weights) // 2
    left, right = weights[:middle], weights[: -middle - 1 : -1]
    sign = next((one for one in (1, -1) if np.all(abs(left - one * right) <= EPSILON)), 0)
    if not sign:
        total: Floats = values[2 * middle :] * weights[-1]
        for place in range(2 * middle):
            total += values[place:][:rows] * weights[place]
        return total
    paired = np.add if sign > 0 else np.subtract
    total = values[middle:][:rows] * weights[middle]
    for place in range(middle):
        pair = paired(values[place:][:rows], values[2 * middle - place :][:rows])
        total += pair * weights[place]
    return total


def _extended(values: Floats, rows: int) -> Floats:
    """Extrapolate the values at both ends, so that a tip that warms at the end of a record keeps
    warming.
    """
    if len(values) < 2:
        return np.pad(values, rows, mode="edge")
    if len(values) <= rows or not rows:
        return np.pad(values, rows, mode="reflect", reflect_type="odd")
    # without the overhead of `np.pad`: a tip is identified in thousands of pieces
    before, behind = values[rows:0:-1], values[-2 : -rows - 2 : -1]
    return np.concatenate([2 * values[0] - before, values, 2 * values[-1] - behind])


def rate(flow: Floats, period_s: float) -> Floats:
    """Return the flow's rate of change in ‰/s."""
    if len(flow) < 2:
        return np.zeros(len(flow))
    # `np.gradient` without its overhead: a tip is identified in hundreds of pieces
    change = np.empty(len(flow))
    change[0], change[-1] = flow[1] - flow[0], flow[-1] - flow[-2]
    change[1:-1] = (flow[2:] - flow[:-2]) / 2
    return change / period_s


def noise_levels(
    period_s: float, values: Floats, temperature_noise: float, power_noise: float
) -> Iterator[Noise]:
    """Yield the noise of the flow that the noise of readings causes, from little smoothing to
    much.
    """
    least = smoothing_s(period_s)
    smoothings = [
        times * least for times in SMOOTHER if times == 1 or times * least <= MOST_SMOOTH_S
    ]
    return (
        noise_at(period_s, values, temperature_noise, power_noise, smooth_s)
        for smooth_s in smoothings
    )


def least_smoothed_noise(
    period_s: float, values: Floats, temperature_noise: float, power_noise: float
) -> Noise:
    """Return the noise at the least smoothing that keeps it below `QUIET_PERMILLE`, or at the
    most.
    """
    for found in noise_levels(period_s, values, temperature_noise, power_noise):
        if found.flow <= QUIET_PERMILLE:
            break
    return found


def noise_at(
    period_s: float, values: Floats, temperature_noise: float, power_noise: float, smooth_s: float
) -> Noise:
    """Return the noise of the flow at one smoothing."""
    fine = _kernels(period_s, values, smooth_s)
    coarse = _kernels(period_s, values, max(COARSE_S, smooth_s))
    still = np.zeros(2)  # before the kernel and behind it
    changes = [rate(np.concatenate([still, kernel, still]), period_s) for kernel in fine]

    def combined(kernels: Sequence[Floats], least: float) -> float:
        of_power, of_temperature = (_norm(kernel) for kernel in kernels)
        return float(
            np.hypot(of_temperature * temperature_noise, max(of_power * power_noise, least))
        )

    return Noise(
        combined(fine, POWER_NOISE_PERMILLE),
        combined(changes, POWER_NOISE_PERMILLE / EDGE_NOISE_S),
        combined(coarse, POWER_NOISE_PERMILLE),
        smooth_s,
    )


def _norm(kernel: Floats) -> float:
    return float(np.sqrt(np.square(kernel).sum()))


def term_noise(period_s: float, temperature_noise: float) -> Floats:
    """Return the covariance of the four terms of the heat balance that the noise of the temperature
    causes.
    """
    sigma = smoothing_s(period_s) / period_s
    impulse = _impulse(sigma)
    kernels = [smooth(impulse, sigma, order) / period_s**order for order in (1, 0, 2)]
    weights = np.stack([*kernels, np.zeros(len(impulse))])
    return np.asarray(weights @ weights.T * temperature_noise**2, dtype=np.float64)


def temperature_noise(stretches: Sequence[Stretch]) -> float:
    """Return the noise of a reading in °C, from the residuals of a parabola through five readings
    (Savitzky and Golay, 1964).
    """
    residuals = np.concatenate([_parabola_residuals(stretch.temperature) for stretch in stretches])
    if len(residuals) < 20:
        return 0.5
    spread = 1.4826 * float(np.median(np.abs(residuals - np.median(residuals)))) / np.sqrt(18 / 35)
    return float(min(max(spread, STEP_NOISE), MOST_NOISE_C))


def power_noise(stretches: Sequence[Stretch]) -> float:
    """Return the noise of a reading of the power in ‰, likewise, from the quarter of readings that
    a parabola fits best.

    Heat comes in bursts, and the reported power is a mean over some of them; contact changes it
    too, but not all of the time.
    """
    residuals = np.abs(
        np.concatenate([_parabola_residuals(stretch.power) for stretch in stretches])
    )
    if len(residuals) < 20 or stretches[0].period_s > FAST_S:
        return POWER_NOISE_PERMILLE
    return float(
        min(np.quantile(residuals, 0.25) / QUARTER_TO_SD / np.sqrt(18 / 35), MOST_POWER_NOISE)
    )


def _parabola_residuals(values: Floats) -> Floats:
    if len(values) < 5:
        return np.empty(0)
    fitted = (
        -3 * values[:-4]
        + 12 * values[1:-3]
        + 17 * values[2:-2]
        + 12 * values[3:-1]
        - 3 * values[4:]
    ) / 35
    return np.asarray(values[2:-2] - fitted, dtype=np.float64)


def _kernels(period_s: float, values: Floats, smooth_s: float) -> tuple[Floats, Floats]:
    """Return the weights of power and temperature, row by row, whose sum is the flow."""
    capacity, loss, second, lag = values
    still, once, twice = _derivatives(period_s, smooth_s)
    return still + lag * once, capacity * once + loss * still + second * twice


@lru_cache(maxsize=64)  # a fit needs the same few a hundred times
def _derivatives(period_s: float, smooth_s: float) -> tuple[Floats, ...]:
    """Return the kernels of a smoothed value and of its first and second time derivative."""
    sigma = smooth_s / period_s
    impulse = _impulse(sigma)
    return tuple(smooth(impulse, sigma, order)[::-1] / period_s**order for order in range(3))


def _impulse(sigma: float) -> Floats:
    impulse = np.zeros(2 * int(4 * sigma + 1) + 3)
    impulse[len(impulse) // 2] = 1.0
    return impulse
