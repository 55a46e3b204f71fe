"""The station's own temperature while a thermometer is at the tip: the mean of several readings of a tip that stands still.

The tip *stands still* where it works, at least `LEAST` readings are there, the greatest and the least of them are no more than
`STILL_C` apart, and the setting was the same before and after them. Readings come in whole °C (manuals 000 and 002, R-TT), which
puts a floor of 1/√12 °C under what their mean can be known to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from statistics import fmean, stdev

STILL_C = 3.0
LEAST = 8
STEP_C = 1.0


@dataclass(frozen=True, slots=True)
class Own:
    """What the station said of its tip. `n` is 0 where a person read its display; what was not read is None."""

    temperature_c: float
    n: int = 0
    sd_c: float | None = None
    set_c: float | None = None
    adjust_c: float | None = None
    tool: str | None = None
    model: str | None = None

    @property
    def uncertainty_c(self) -> float:
        """The standard uncertainty of `temperature_c`: its steps, and the spread of its mean."""
        spread = (self.sd_c or 0.0) / sqrt(self.n) if self.n else 0.0
        return sqrt(STEP_C**2 / 12 + spread**2)


def unstable(readings: Sequence[float], states: Sequence[str], settings: Sequence[float]) -> str | None:
    """Why these readings cannot stand for the tip, in a sentence; None where they can."""
    other = next((state for state in states if state not in ("working", "on")), None)
    if other is not None:
        return f"the tool is in {other}, not working: its tip is not at its setting"
    if len(readings) < LEAST:
        return f"only {len(readings)} of its readings came; it takes {LEAST}"
    if len(set(settings)) > 1:
        return f"its setting was changed meanwhile, from {settings[0]:g} to {settings[-1]:g} °C"
    span = max(readings) - min(readings)
    if span > STILL_C:
        return f"the tip does not stand still: it moved by {span:g} °C while it was read, {STILL_C:g} °C are allowed"
    return None


def own_of(
    readings: Sequence[float], set_c: float | None, adjust_c: float | None = None, tool: str | None = None, model: str | None = None
) -> Own:
    """The mean of readings of a tip that stands still."""
    return Own(fmean(readings), len(readings), stdev(readings), set_c, adjust_c, tool, model)
