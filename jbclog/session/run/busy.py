"""Ticks that the computer, or a slow station, came too late for, told together: how many, in how many places, and how late.

A busy hour must not become thousands of events, and nobody is to wait long for the first: one is told once nothing more was
skipped for `QUIET_S`, and every `LONGEST_S` where it goes on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

KIND: Final = "host.busy"
SLOW_KIND: Final = "station.slow"
QUIET_S: Final = 10.0
LONGEST_S: Final = 300.0


@dataclass(slots=True)
class Busy:
    """What has not been told yet. Times are monotonic seconds; `since` is when the first of the ticks was due."""

    ticks: int = 0
    places: int = 0
    late_s: float = 0.0
    since: float = 0.0
    last: float = 0.0

    def add(self, ticks: int, due: float, now: float) -> None:
        """`ticks` from the one that was due at `due` on were not run; it is `now`."""
        if not self.ticks:
            self.since = due
        self.ticks += ticks
        self.places += 1
        self.late_s = max(self.late_s, now - due)
        self.last = now

    def is_to_be_told(self, now: float) -> bool:
        return self.ticks > 0 and (now - self.last >= QUIET_S or now - self.since >= LONGEST_S)

    def text(self, period_s: float) -> str:
        return f"The computer was busy: {self._what(period_s)}; less work beside the run helps."

    def text_of_station(self, period_s: float, name: str) -> str:
        return f"{name} was slow to answer, or did not: {self._what(period_s)}; a lower rate leaves more time."

    def _what(self, period_s: float) -> str:
        ticks = f"{self.ticks} tick{'' if self.ticks == 1 else 's'} of {period_s:g} s"
        places = "" if self.places == 1 else f" in {self.places} places"
        return f"{ticks} not run{places}, {self.late_s:.2f} s late at most"
