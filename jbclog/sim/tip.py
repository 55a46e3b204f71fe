"""The tip: a heated cartridge, its regulator, and a solder joint that cools it. Physics only.

One heat capacity loses heat to the air and, in a joint, to the work. The regulator is proportional and
integral with a limited output, so that in a joint the tip dips, the power rises, and the integral part
brings the tip back. Each step is the exact exponential of its regime (heater full, regulating, or off), so
steps may be as coarse as a joint lasts.
"""

from __future__ import annotations

from math import exp, log

CAPACITY_J_PER_K = 1.2  # 25 to 350 °C in about three seconds at 130 W, as a cartridge of that size does
LOSS_W_PER_K = 0.03  # 10 W hold 350 °C
GAIN_W_PER_K = 2.5
INTEGRAL_S = 1.0
UNWINDING_S = 0.2  # the integral part falls faster than it rises, against overshoot


class Tip:
    """Temperature and heating power of one tip; `step` lets time go on."""

    __slots__ = ("ambient_c", "integral_w", "power_w", "rated_w", "temperature_c")

    def __init__(self, ambient_c: float, rated_w: float) -> None:
        self.ambient_c = ambient_c
        self.rated_w = rated_w
        self.temperature_c = ambient_c
        self.integral_w = 0.0
        self.power_w = 0.0

    def step(self, seconds: float, target_c: float | None, load_w_per_k: float, load_c: float) -> None:
        """Go on by `seconds` towards `target_c` (None: heater off) with a joint of `load_w_per_k` at `load_c`."""
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
        """Relax towards the temperature at which `inflow_w` and the loss are equal."""
        end = inflow_w / loss
        self.temperature_c = end + (self.temperature_c - end) * exp(-seconds * loss / CAPACITY_J_PER_K)

    def _leave_limit(self, seconds: float, target_c: float, sink_w: float, loss: float) -> float:
        """While the regulator asks for more than all or less than nothing, give it that; what is left of `seconds`."""
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
        """Regulate within the limits: the integral part goes towards what holds the target."""
        holding_w = min(max(loss * target_c - sink_w, 0.0), self.rated_w)
        lag = UNWINDING_S if self.integral_w > holding_w else INTEGRAL_S
        before_w = self.integral_w
        self.integral_w = holding_w + (before_w - holding_w) * exp(-seconds / lag)
        mean_w = (before_w + self.integral_w) / 2
        self._drift(seconds, sink_w + mean_w + GAIN_W_PER_K * target_c, loss + GAIN_W_PER_K)
        asked_w = self.integral_w + GAIN_W_PER_K * (target_c - self.temperature_c)
        self.power_w = min(max(asked_w, 0.0), self.rated_w)
