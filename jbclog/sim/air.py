"""The heater of a hot air tool in its air stream, and a thermocouple on the work. Physics only.

One heat capacity, the heater, gives its heat to the air that goes through it; what the tool's own thermocouple sees is
the heater's temperature. The regulator knows what holds the target and adds what is in proportion to the difference, so
that it never overshoots. Each step is the exact exponential of its regime, so steps may be as coarse as nothing changes.
"""

from __future__ import annotations

from math import exp, log

CAPACITY_J_PER_K = 15.0  # 25 to 350 °C in about ten seconds at 900 W and half the air
STILL_W_PER_K = 0.1  # with the pump off
STREAM_W_PER_K = 0.9  # 45 l/min of air carry so much away
GAIN_W_PER_K = 20.0
PROBE_LAG_S = 4.0  # a thermocouple on a board
ON_WORK, BESIDE_WORK = 0.7, 0.1  # what the work sees of the air's rise, under the nozzle and beside it


class Heater:
    """Temperature and heating power of one heater; `step` lets time go on."""

    __slots__ = ("ambient_c", "power_w", "rated_w", "temperature_c")

    def __init__(self, ambient_c: float, rated_w: float) -> None:
        self.ambient_c = ambient_c
        self.rated_w = rated_w
        self.temperature_c = ambient_c
        self.power_w = 0.0

    def step(self, seconds: float, target_c: float | None, stream: float) -> None:
        """Go on by `seconds` towards `target_c` (None: heater off) in a stream of 0 (pump off) to 1 (all of it)."""
        loss = STILL_W_PER_K + STREAM_W_PER_K * stream
        if target_c is None:
            self.power_w = 0.0
            self._drift(seconds, 0.0, loss)
            return
        seconds = self._leave_limit(seconds, target_c, loss)
        if seconds > 0:
            lag = CAPACITY_J_PER_K / (loss + GAIN_W_PER_K)
            self.temperature_c = target_c + (self.temperature_c - target_c) * exp(-seconds / lag)
            self.power_w = self._asked_w(target_c, loss)

    def _asked_w(self, target_c: float, loss: float) -> float:
        return loss * (target_c - self.ambient_c) + GAIN_W_PER_K * (target_c - self.temperature_c)

    def _leave_limit(self, seconds: float, target_c: float, loss: float) -> float:
        """While the regulator asks for more than all or less than nothing, give it that; what is left of `seconds`."""
        asked_w = self._asked_w(target_c, loss)
        if 0.0 <= asked_w <= self.rated_w:
            return seconds
        self.power_w = min(max(asked_w, 0.0), self.rated_w)
        edge = self.temperature_c + (asked_w - self.power_w) / GAIN_W_PER_K
        end = self.ambient_c + self.power_w / loss
        reached = (edge - end) / (self.temperature_c - end) if self.temperature_c != end else 1.0
        until_edge = -log(reached) * CAPACITY_J_PER_K / loss if 0.0 < reached < 1.0 else seconds
        self._drift(min(seconds, until_edge), self.power_w, loss)
        return seconds - until_edge

    def _drift(self, seconds: float, power_w: float, loss: float) -> None:
        end = self.ambient_c + power_w / loss
        self.temperature_c = end + (self.temperature_c - end) * exp(-seconds * loss / CAPACITY_J_PER_K)


class Probe:
    """A thermocouple on the work: it follows what the air does to the work, with a lag."""

    __slots__ = ("ambient_c", "temperature_c")

    def __init__(self, ambient_c: float) -> None:
        self.ambient_c = ambient_c
        self.temperature_c = ambient_c

    def step(self, seconds: float, air_c: float | None, *, on_work: bool) -> None:
        """Go on by `seconds` in air of `air_c` (None: none is blown)."""
        share = ON_WORK if on_work else BESIDE_WORK
        end = self.ambient_c if air_c is None else self.ambient_c + share * (air_c - self.ambient_c)
        self.temperature_c = end + (self.temperature_c - end) * exp(-seconds / PROBE_LAG_S)
