"""What a tool is doing, what it goes over to by itself, and its hours. Physics only.

::

    working ──stand──▶ stand ──sleep delay──▶ sleep ──hibernation delay──▶ hibernation
       ▲                 │                      │                             │
       └─────working─────┴──────────────────────┴─────────────────────────────┘

A stand order starts the sleep delay anew, except for a tool that already sleeps or hibernates. A delay that
is off never ends, and hibernation is counted from the sleep (manual 002, W-Dxy and W-Hxy).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

from jbclog.core.quantities import OFF, Off

WORKING, STAND, SLEEP, HIBERNATION = range(4)


@dataclass(slots=True)
class ToolSettings:
    """What a port keeps for one kind of tool: °C and minutes."""

    adjust: int
    sleep_temperature: int
    sleep_delay: int | Off
    hibernation_delay: int | Off


def _no_seconds() -> dict[int, float]:
    return dict.fromkeys((WORKING, STAND, SLEEP, HIBERNATION), 0.0)


@dataclass(slots=True)
class ToolState:
    """The state since `began`. Factory setting is "Extract (stand by)" (manuals 002, 004)."""

    began: float
    state: int = WORKING
    extractor: bool = True
    sleep_cycles: int = 0
    seconds: dict[int, float] = field(default_factory=_no_seconds)

    def order(self, state: int, extractor: bool, now: float) -> None:
        """Work (0), stand (1) or extract, as somebody orders it."""
        asleep = self.state in (SLEEP, HIBERNATION)
        self.extractor = extractor
        if not (state == STAND and asleep):
            self._enter(state, now)

    def due(self, delays: ToolSettings) -> float:
        """When the next state comes by itself; never is infinity."""
        minutes: int | Off = OFF
        if self.state == STAND:
            minutes = delays.sleep_delay
        elif self.state == SLEEP:
            minutes = delays.hibernation_delay
        return inf if isinstance(minutes, Off) else self.began + 60.0 * minutes

    def go_on(self, now: float) -> None:
        """Stand becomes sleep, sleep becomes hibernation."""
        if self.state == STAND:
            self.sleep_cycles += 1
        self._enter(self.state + 1, now)

    def hours(self, now: float, *states: int) -> float:
        """Hours spent in `states` so far."""
        running = now - self.began if self.state in states else 0.0
        return (sum(self.seconds[state] for state in states) + running) / 3600

    def _enter(self, state: int, now: float) -> None:
        self.seconds[self.state] += now - self.began
        self.state, self.began = state, now
