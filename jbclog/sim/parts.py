"""Small parts of a station: alarm comparators, and parts that the power warms with a lag. Physics only."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

from jbclog.core.quantities import Off


@dataclass(slots=True)
class Comparator:
    """Latches when a temperature has been beyond its limit for longer than the delay, until it is taken."""

    since: float | None = None
    latched: bool = False

    def see(self, before_k: float, after_k: float, seconds: float, now: float, delay_s: float | Off) -> None:
        """See how far beyond the limit the temperature was `seconds` ago and is `now` (negative: within)."""
        if after_k <= 0:
            self.since = None
            return
        if self.since is None:
            outside = after_k / (after_k - before_k) if before_k < 0 else 1.0
            self.since = now - seconds * outside
        if not isinstance(delay_s, Off) and now - self.since >= delay_s:
            self.latched = True

    def take(self) -> bool:
        """Whether it has latched since it was last taken."""
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
        """Its temperature now, given all the energy that has gone through it so far."""
        seconds = now - self.at
        if seconds > 0:
            end = (energy_j - self.energy_j) / seconds * self.kelvin_per_w
            self.rise_k = end + (self.rise_k - end) * exp(-seconds / self.lag_s)
            self.at, self.energy_j = now, energy_j
        return self.idle_c + self.rise_k
