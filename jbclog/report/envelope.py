"""Fewer points than samples, and still every excursion: the least and the greatest of each stretch are kept.

A run of eight hours has 288 000 samples a port and a page some 900 columns. The samples are cut into as many stretches of
equal time, and of each are kept its least, its greatest and its mean value. Nothing is joined across a gap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Envelope:
    """A curve to draw. NaN breaks the line. `low`, `high` and `mean` are the same array where nothing was left out."""

    seconds: Floats
    low: Floats
    high: Floats
    mean: Floats

    @property
    def whole(self) -> bool:
        """Whether every sample is in the drawing."""
        return self.low is self.high


def envelope(seconds: Floats, values: Floats, stretches: int, joined_s: float) -> Envelope:
    """The curve of `values` (NaN: none) over `seconds`, at most `stretches` × 2 points wide.

    Samples further apart than `joined_s` are not joined by a line.
    """
    there = ~np.isnan(values)
    at, value = seconds[there], values[there]
    if len(at) <= 2 * stretches:
        return _every_sample(at, value, joined_s)
    width = (at[-1] - at[0]) / stretches
    number = np.minimum(((at - at[0]) / width).astype(np.int64), stretches - 1)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    counts = np.diff(np.append(first, len(number)))
    middle = (at[first] + at[np.append(first[1:], len(at)) - 1]) / 2
    low, high = np.minimum.reduceat(value, first), np.maximum.reduceat(value, first)
    mean = np.add.reduceat(value, first) / counts
    gaps = np.flatnonzero(np.diff(number[first]) > max(1.0, np.ceil(joined_s / width)))
    return _broken(middle, low, high, mean, gaps)


def _every_sample(at: Floats, value: Floats, joined_s: float) -> Envelope:
    gaps = np.flatnonzero(np.diff(at) > joined_s)
    seconds, drawn = _insert(at, gaps, at), _insert(value, gaps, None)
    return Envelope(seconds, drawn, drawn, drawn)


def _broken(middle: Floats, low: Floats, high: Floats, mean: Floats, gaps: NDArray[np.int64]) -> Envelope:
    return Envelope(_insert(middle, gaps, middle), _insert(low, gaps, None), _insert(high, gaps, None), _insert(mean, gaps, None))


def _insert(values: Floats, gaps: NDArray[np.int64], times: Floats | None) -> Floats:
    """A point behind each gap's first edge: NaN, or for times the edge itself."""
    return np.insert(values, gaps + 1, np.nan if times is None else times[gaps])


def lone(curve: Envelope) -> Envelope:
    """Only the points that no line reaches, because there is nothing on either side of them: to be drawn as dots."""
    absent = np.isnan(curve.mean)
    before, after = np.append(True, absent[:-1]), np.append(absent[1:], True)
    alone = ~absent & before & after
    return Envelope(curve.seconds[alone], curve.low[alone], curve.high[alone], curve.mean[alone])
