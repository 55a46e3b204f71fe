"""From values to places on a drawing, and the round values at which an axis has its marks."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, log10
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
