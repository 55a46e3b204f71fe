"""From when on alarms count: from a tool's first arrival at its setting on, seen in the rows as the session sees it.

The same rule as `session/run/watch.py` (docs/reference/exit-codes.md): at work, and
within ±10 °C of the setting, or passed through it
from one reading to the next, or found hotter than it and not cooling for ten seconds.
"""

from __future__ import annotations

from typing import Final

BAND_C: Final = 10
COOLS_WITHIN_S: Final = 10.0
WORKING: Final = frozenset(["working", "on"])


class Arrival:
    """Whether the tool in one port has come to its setting. A tool that was changed has not."""

    __slots__ = ("_above", "before_c", "has_come")

    def __init__(self) -> None:
        self.has_come = False
        self.before_c: float | None = None  # the reading before
        self._above: tuple[float, float] | None = None  # since when it is hotter than its setting, and how hot it was then

    def forget(self) -> None:
        """The tool was changed."""
        self.has_come, self._above = False, None

    def see(self, seconds: float, value: float, setting: float | None, *, works: bool) -> None:
        """Take a reading in °C at `seconds`."""
        if setting is not None and works and not self.has_come:
            self.has_come = self._enters(value, setting) or self._stays_above(seconds, value, setting)
            self._note_above(seconds, value, setting)
        self.before_c = value

    def _enters(self, value: float, setting: float) -> bool:
        passed = self.before_c is not None and (self.before_c < setting) != (value < setting)
        return passed or abs(value - setting) <= BAND_C

    def _stays_above(self, seconds: float, value: float, setting: float) -> bool:
        if value <= setting + BAND_C or self._above is None:
            return False
        since, then = self._above
        return seconds - since >= COOLS_WITHIN_S and value >= then

    def _note_above(self, seconds: float, value: float, setting: float) -> None:
        if value <= setting + BAND_C:
            self._above = None
        elif self._above is None or seconds - self._above[0] >= COOLS_WITHIN_S:
            self._above = seconds, value
