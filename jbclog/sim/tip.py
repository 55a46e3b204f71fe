"""The heated tip of a virtual tool, and the joints that cool it.

One heat capacity loses heat to the air and, in a joint, to the work. A proportional-integral
regulator with limited output makes the tip dip in a joint, the power rise, and the integral part
bring the tip back. Each step is the exact exponential of its regime (heater full, regulating, or
off), so steps may be as long as a joint.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, exp, inf, log
from random import Random

from jbclog.core.quantities import Off

# Joints follow each other evenly, with a little jitter from the seed; the n-th joint is always the
# same, so that a run can be repeated.

LOAD_W_PER_K = 0.35
LOAD_C = 150.0  # temperature of solder and pad while heated
MOST_OF_PERIOD = 0.6  # maximum duration of a joint, as a share of the time between two


@dataclass(frozen=True, slots=True)
class SimJoint:
    """Start and end of a joint in seconds, and its heat draw in W/K."""

    start: float
    end: float
    load_w_per_k: float


NEVER = SimJoint(inf, inf, 0.0)


class JointSchedule:
    """The joints of one tool from `origin` on."""

    __slots__ = ("_origin", "_period", "_seconds", "_seed")

    def __init__(self, per_minute: float, seconds: float, seed: int, origin: float = 0.0) -> None:
        self._period = 60.0 / per_minute if per_minute > 0 else inf
        self._seconds = min(seconds, MOST_OF_PERIOD * self._period)
        self._seed = seed
        self._origin = origin

    def after(self, moment: float) -> SimJoint:
        """Return the first joint that begins after `moment`."""
        if self._period == inf:
            return NEVER
        number = max(ceil((moment - self._origin) / self._period) - 1, 0)
        while (joint := self._joint(number)).start <= moment:
            number += 1
        return joint

    def _joint(self, number: int) -> SimJoint:
        scatter = Random(self._seed * 1_000_003 + number)
        start = self._origin + (number + 0.4 + 0.2 * scatter.random()) * self._period
        return SimJoint(
            start,
            start + self._seconds * (0.85 + 0.15 * scatter.random()),
            LOAD_W_PER_K * (0.8 + 0.4 * scatter.random()),
        )


@dataclass(slots=True)
class Comparator:
    """Latches when a temperature was beyond its limit for longer than the delay, until `take`."""

    since: float | None = None
    latched: bool = False

    def see(
        self, before_k: float, after_k: float, seconds: float, now: float, delay_s: float | Off
    ) -> None:
        """Process how far beyond the limit it was `seconds` ago and is `now` (negative: within)."""
        if after_k <= 0:
            self.since = None
            return
        if self.since is None:
            outside = after_k / (after_k - before_k) if before_k < 0 else 1.0
            self.since = now - seconds * outside
        if not isinstance(delay_s, Off) and now - self.since >= delay_s:
            self.latched = True

    def take(self) -> bool:
        """Return and clear the latch."""
        was, self.latched = self.latched, False
        return was


@dataclass(slots=True)
class WarmPart:
    """A part that the heating power warms with a lag: a transistor, the transformer."""

    lag_s: float
    kelvin_per_w: float
    idle_c: float
    at: float
    rise_k: float = 0.0
    energy_j: float = 0.0

    def temperature_c(self, now: float, energy_j: float) -> float:
        """Return its temperature in °C, given the total energy so far."""
        seconds = now - self.at
        if seconds > 0:
            end = (energy_j - self.energy_j) / seconds * self.kelvin_per_w
            self.rise_k = end + (self.rise_k - end) * exp(-seconds / self.lag_s)
            self.at, self.energy_j = now, energy_j
        return self.idle_c + self.rise_k


CAPACITY_J_PER_K = 1.2  # 25 to 350 °C in about three seconds at 130 W, as a cartridge of that size
LOSS_W_PER_K = 0.03  # 10 W hold 350 °C
GAIN_W_PER_K = 2.5
INTEGRAL_S = 1.0
UNWINDING_S = 0.2  # the integral part falls faster than it rises, to limit overshoot


class Tip:
    """Temperature and heating power of one tip; `step` simulates."""

    __slots__ = ("ambient_c", "integral_w", "power_w", "rated_w", "temperature_c")

    def __init__(self, ambient_c: float, rated_w: float) -> None:
        self.ambient_c = ambient_c
        self.rated_w = rated_w
        self.temperature_c = ambient_c
        self.integral_w = 0.0
        self.power_w = 0.0

    def step(
        self, seconds: float, target_c: float | None, load_w_per_k: float, load_c: float
    ) -> None:
        """Simulate `seconds` towards `target_c` (None: heater off) with a joint of `load_w_per_k`
        at `load_c`.
        """
        loss = LOSS_W_PER_K + load_w_per_k
        sink_w = LOSS_W_PER_K * self.ambient_c + load_w_per_k * load_c
        if target_c is None:
            self.integral_w = self.power_w = 0.0
            self._drift(seconds, sink_w, loss)
        else:
            seconds = self._leave_limit(seconds, target_c, sink_w, loss)
            if seconds > 0:
                self._regulate(seconds, target_c, sink_w, loss)

    def _drift(self, seconds: float, inflow_w: float, loss: float) -> None:
        """Relax towards the temperature at which `inflow_w` equals the loss."""
        end = inflow_w / loss
        self.temperature_c = end + (self.temperature_c - end) * exp(
            -seconds * loss / CAPACITY_J_PER_K
        )

    def _leave_limit(self, seconds: float, target_c: float, sink_w: float, loss: float) -> float:
        """Simulate while the regulator's output is limited; return the remaining seconds."""
        asked_w = self.integral_w + GAIN_W_PER_K * (target_c - self.temperature_c)
        if 0.0 <= asked_w <= self.rated_w:
            return seconds
        self.power_w = min(max(asked_w, 0.0), self.rated_w)
        edge = target_c + (self.integral_w - self.power_w) / GAIN_W_PER_K
        end = (sink_w + self.power_w) / loss
        reached = (edge - end) / (self.temperature_c - end) if self.temperature_c != end else 1.0
        until_edge = -log(reached) * CAPACITY_J_PER_K / loss if 0.0 < reached < 1.0 else seconds
        self._drift(min(seconds, until_edge), sink_w + self.power_w, loss)
        return seconds - until_edge

    def _regulate(self, seconds: float, target_c: float, sink_w: float, loss: float) -> None:
        """Regulate within the limits: the integral approaches the power that holds the target."""
        holding_w = min(max(loss * target_c - sink_w, 0.0), self.rated_w)
        lag = UNWINDING_S if self.integral_w > holding_w else INTEGRAL_S
        before_w = self.integral_w
        self.integral_w = holding_w + (before_w - holding_w) * exp(-seconds / lag)
        mean_w = (before_w + self.integral_w) / 2
        self._drift(seconds, sink_w + mean_w + GAIN_W_PER_K * target_c, loss + GAIN_W_PER_K)
        asked_w = self.integral_w + GAIN_W_PER_K * (target_c - self.temperature_c)
        self.power_w = min(max(asked_w, 0.0), self.rated_w)
