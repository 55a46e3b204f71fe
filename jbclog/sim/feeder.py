"""The solder feeder: a motor that pushes wire forward and then draws it back a little. Physics only.

In the modes continuous and reload it feeds until it is stopped; in discontinuous and program one start feeds
one length. The counters count what was pushed forward; no manual says whether drawing back is taken off.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

from jbclog.protocol.commands.defaults import FEEDER_DEFAULTS
from jbclog.sim.factory_settings import fresh

UNTIL_STOPPED = ("continuous", "reload")


@dataclass(slots=True)
class FeederSettings:
    """What can be set, in mm and mm/s."""

    feeder_mode: str
    feeder_length: float
    feeder_speed: float
    feeder_diameter: float
    feeder_backward: float
    clog_detection: str


def fresh_feeder() -> FeederSettings:
    """The settings with which a virtual feeder begins; no manual prints a real one's."""
    return fresh(FeederSettings, FEEDER_DEFAULTS)


@dataclass(slots=True)
class Feeder:
    """Motor and counters. `settings` count for a feed from its start on."""

    settings: FeederSettings = field(default_factory=fresh_feeder)
    fed_mm: float = 0.0
    cycles: int = 0
    _start: float = -inf
    _forward_until: float = -inf
    _stopped: float = -inf
    _speed: float = 1.0

    def start(self, now: float) -> None:
        """Start feeding; nothing happens while it is running."""
        if self.motor(now) != 0:
            return
        self._count()
        self._start, self._speed = now, max(self.settings.feeder_speed, 0.1)
        forward_s = inf if self.settings.feeder_mode in UNTIL_STOPPED else self.settings.feeder_length / self._speed
        self._forward_until = now + forward_s
        self._stopped = self._forward_until + self.settings.feeder_backward / self._speed

    def stop(self, now: float) -> None:
        """Stop the motor at once."""
        self._forward_until = min(self._forward_until, now)
        self._stopped = min(self._stopped, now)
        self._count()

    def motor(self, now: float) -> int:
        """0 off, 1 forward, 2 backward, as the status word has it."""
        if now < self._forward_until:
            return 1
        return 2 if now < self._stopped else 0

    def dispensed_mm(self, now: float) -> float:
        """Wire pushed forward so far."""
        if self._start == -inf:
            return self.fed_mm
        return self.fed_mm + (min(now, self._forward_until) - self._start) * self._speed

    def dispensed_cycles(self, now: float) -> int:
        """Feeds begun and not running any more."""
        return self.cycles + (self._start > -inf and self.motor(now) == 0)

    def _count(self) -> None:
        """Take the finished feed into the counters."""
        if self._start > -inf:
            self.fed_mm = self.dispensed_mm(self._forward_until)
            self.cycles += 1
            self._start = -inf
