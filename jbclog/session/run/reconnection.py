"""Pauses before a lost link is tried again.

If floods recur, attempts become less frequent, because each costs a second of listening.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

FIRST_SEEK_S: Final = 0.25
SEEK_GROWTH: Final = 1.3  # gentle, so that the search hardly prolongs a short outage
LONGEST_SEEK_S: Final = 5.0
FIRST_AFTER_FLOOD_S: Final = 1.0
FLOOD_GROWTH: Final = 2.0
LONGEST_AFTER_FLOOD_S: Final = 15.0
FORGOTTEN_S: Final = 60.0  # time without a flood after which the next one counts as the first


@dataclass(slots=True)
class Reconnection:
    """The floods of one link so far, and the pauses between attempts to reconnect."""

    is_flooded: bool = False  # until the station is back
    flood_pause_s: float = 0.0
    flood_ended: float | None = None  # monotonic seconds

    def begin_flood(self, now: float) -> None:
        again = self.flood_ended is not None and now - self.flood_ended < FORGOTTEN_S
        if again:
            self._lengthen()
        else:
            self.flood_pause_s = FIRST_AFTER_FLOOD_S
        self.is_flooded = True

    def end_flood(self, now: float) -> None:
        """Register that the station is back."""
        if self.is_flooded:
            self.is_flooded = False
            self.flood_ended = now

    def first_pause_s(self) -> float:
        """Return the pause before the first attempt."""
        return self.flood_pause_s if self.is_flooded else FIRST_SEEK_S

    def next_pause_s(self, pause_s: float) -> float:
        """Return the pause after a failed attempt that followed a pause of `pause_s`."""
        if not self.is_flooded:
            return min(SEEK_GROWTH * pause_s, LONGEST_SEEK_S)
        self._lengthen()
        return self.flood_pause_s

    def _lengthen(self) -> None:
        self.flood_pause_s = min(FLOOD_GROWTH * self.flood_pause_s, LONGEST_AFTER_FLOOD_S)
