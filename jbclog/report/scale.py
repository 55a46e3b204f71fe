"""Scales of a drawing, of values and of time, and where they have their marks."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from math import ceil, floor, log10
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

# -- scale --------------------------------------------------------------------------------------------------------------------

Floats = NDArray[np.float64]

COARSE: Final = 0.2  # the share of the height that all values below a knee have
ROUND: Final = (1, 2, 5)  # steps that people count in; the values are whole numbers


@dataclass(frozen=True, slots=True)
class Scale:
    """`low` lies at `start` and `high` at `end`, in points; below a `knee` it is coarser. What lies beyond is drawn at the edge."""

    low: float
    high: float
    start: float
    end: float
    knee: float | None = None

    def at(self, values: ArrayLike) -> Floats:
        """Where these values are; NaN stays NaN."""
        return np.interp(np.asarray(values, dtype=np.float64), *self._corners())

    def place(self, value: float) -> float:
        """Where this value is."""
        return float(self.at(value))

    def _corners(self) -> tuple[list[float], list[float]]:
        if self.knee is None:
            return [self.low, self.high], [self.start, self.end]
        return [self.low, self.knee, self.high], [self.start, self.start + COARSE * (self.end - self.start), self.end]


def round_marks(low: float, high: float, most: int, *, whole: bool = True) -> list[float]:
    """Round numbers from `low` to `high`, some `most` of them, not more; only `whole` ones if wanted."""
    least = max((high - low) / most, 1e-9)
    power = floor(log10(least))
    power = max(power, 0) if whole else power
    steps = [one * 10.0**exponent for exponent in (power, power + 1) for one in ROUND]
    step = next(one for one in steps if one >= least - 1e-9)
    return [round(n * step, 9) for n in range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1)]


def spread(places: list[float], least: float, bottom: float, top: float) -> list[float]:
    """`places` (ascending) moved as little as needed to lie at least `least` apart, within bottom and top if they fit."""
    out: list[float] = []
    for place in places:
        out.append(max(place, out[-1] + least) if out else max(place, bottom))
    if out and out[-1] > top:
        out[-1] = top
        for i in range(len(out) - 2, -1, -1):
            out[i] = min(out[i], out[i + 1] - least)
    return out


# -- timescale ----------------------------------------------------------------------------------------------------------------
# Where a time axis has its marks: on round UTC times, few enough not to touch each other.

MINUTE, HOUR, DAY = 60, 3600, 86400
STEPS_S = (
    *(1, 2, 5, 10, 15, 30),
    *(MINUTE * n for n in (1, 2, 5, 10, 15, 30)),
    *(HOUR * n for n in (1, 2, 3, 6, 12)),
    *(DAY * n for n in (1, 2, 7, 14, 30, 90)),
)
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def moment(utc_us: int) -> datetime:
    """UTC of microseconds since 1970, exactly."""
    return EPOCH + timedelta(microseconds=utc_us)


def time_marks(t0_utc_us: int, start_s: float, end_s: float, at_most: int) -> list[tuple[float, str]]:
    """Places (seconds of the run) and labels of the marks between `start_s` and `end_s`."""
    step = next((step for step in STEPS_S if (end_s - start_s) / step <= at_most - 1), STEPS_S[-1])
    zero_s = t0_utc_us / 1e6
    first = ceil((zero_s + start_s) / step - 1e-9)
    count = int((zero_s + end_s) / step + 1e-9) - first + 1
    return [((first + i) * step - zero_s, _label((first + i) * step, step)) for i in range(max(count, 0))]


def _label(utc_s: int, step: int) -> str:
    at = moment(utc_s * 1_000_000)
    if step >= DAY or (step >= HOUR and at.hour == at.minute == 0):
        return at.strftime("%m-%d")
    return at.strftime("%H:%M" if step >= MINUTE else "%H:%M:%S")


def duration_text(seconds: float) -> str:
    """``7 h 59 min 38 s``, ``2 min 5 s``, ``20.0 s``."""
    if round(seconds, 1) < 60:
        return f"{seconds:.1f} s"
    hours, rest = divmod(round(seconds), 3600)
    minutes, left = divmod(rest, 60)
    parts = [(hours, "h"), (minutes, "min"), (left, "s")]
    return " ".join(f"{number} {unit}" for number, unit in parts if number)
