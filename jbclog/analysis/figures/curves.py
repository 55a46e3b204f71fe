"""Curves and spans to draw: every excursion is kept, and no line crosses a gap.

A run of eight hours has 288 000 samples per port, and a page some 900 columns. The samples are
divided into equal intervals of time; the curve keeps minimum, maximum and mean of each.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, cast

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Readings = NDArray[np.float16] | NDArray[np.float32] | NDArray[np.float64]
"""Integers of at most six digits, NaN where not read; those of a long run in 16 bits (up to
`EXACT_IN_16`) or 32, which hold them exactly.
"""
EXACT_IN_16: Final = 2048
BLOCK_ROWS: Final = 1 << 17
Words = Sequence[str | None] | NDArray[np.object_] | pd.Categorical
"""A word for each row; None (no category): no word."""


def dates(t0_utc_us: int, seconds: ArrayLike) -> Floats:
    """Return seconds of a run as matplotlib dates: days since 1970, UTC."""
    return (t0_utc_us / 1e6 + np.asarray(seconds, dtype=np.float64)) / 86400


class GridSeconds:
    """Ascending seconds of rows on a grid, computed from their ticks where they are looked at: a
    tick takes four bytes, a second eight.
    """

    def __init__(self, ticks: NDArray[np.signedinteger[Any]], period_s: float) -> None:
        self.ticks, self._period_s = ticks, period_s

    def __len__(self) -> int:
        return len(self.ticks)

    def __getitem__(self, rows: Any) -> Any:
        """Return the seconds of these rows (a slice, a mask, indices), or of one row."""
        return self.ticks[rows] * self._period_s

    def first_from(self, second: float) -> int:
        """Return the index of the first row at or after this moment."""
        return bisect_left(self, second)

    def first_after(self, second: float) -> int:
        """Return the index of the first row after this moment."""
        return bisect_right(self, second)


Moments = Floats | GridSeconds
"""Seconds of the rows of a port."""


def rows_before(moments: Moments, start: float, end: float) -> slice:
    """Return the rows from `start` to before `end`."""
    if isinstance(moments, GridSeconds):
        return slice(moments.first_from(start), moments.first_from(end))
    return slice(*np.searchsorted(moments, [start, end]).tolist())


def rows_within(moments: Moments, start: float, end: float) -> slice | NDArray[np.bool_]:
    """Return the rows from `start` to `end`. Without a grid their times may descend: a clock was
    set back.
    """
    if isinstance(moments, GridSeconds):
        return slice(moments.first_from(start), moments.first_after(end))
    rows = moments >= start
    rows &= moments <= end
    return rows


@dataclass(frozen=True, slots=True)
class Envelope:
    """A curve to draw; NaN breaks the line. `low`, `high` and `mean` are the same array if every
    sample is in the curve.
    """

    seconds: Floats
    low: Floats
    high: Floats
    mean: Floats

    @property
    def whole(self) -> bool:
        """Whether every sample is in the curve."""
        return self.low is self.high


def envelope(seconds: Moments, values: Readings, stretches: int, joined_s: float) -> Envelope:
    """Return the curve of `values` (NaN: none) over `seconds`, of at most `stretches` × 2 points.

    No line joins samples further apart than `joined_s`.
    """
    there = ~np.isnan(values)
    if np.count_nonzero(there) <= 2 * stretches:
        return _every_sample(seconds[there], values[there].astype(np.float64), joined_s)
    begin = float(seconds[np.argmax(there)])
    end = float(seconds[len(there) - 1 - np.argmax(there[::-1])])
    width, found = (end - begin) / stretches, Stretches(stretches)
    for rows in blocks(len(values)):
        at, value = seconds[rows][there[rows]], values[rows][there[rows]]
        found.add(((at - begin) / width).astype(np.int64), at, value)
    number = np.flatnonzero(found.counts)
    middle = (found.first[number] + found.last[number]) / 2
    gaps = np.flatnonzero(np.diff(number) > max(1.0, np.ceil(joined_s / width)))
    return _broken(
        middle,
        found.low[number],
        found.high[number],
        found.sums[number] / found.counts[number],
        gaps,
    )


def quantile(values: NDArray[Any], share: float) -> float:
    """Return the quantile as `np.quantile` of the same values in 64 bits does, without a 64-bit
    copy. Reorders `values`.
    """
    place, part = divmod(share * (len(values) - 1), 1)
    values.partition([int(place), min(int(place) + 1, len(values) - 1)])
    return float(np.quantile(values[int(place) : int(place) + 2].astype(np.float64), part))


def quantile_of_readings(parts: Sequence[Readings], share: float) -> float:
    """Return the quantile of readings without NaN. 16-bit readings are counted by value, without a
    copy.
    """
    if any(part.itemsize > 2 for part in parts):
        return quantile(np.concatenate(parts), share)
    counts = np.zeros(2 * EXACT_IN_16 + 1, dtype=np.int64)
    for part in parts:
        for rows in blocks(len(part)):
            counts += np.bincount(part[rows].astype(np.int64) + EXACT_IN_16, minlength=len(counts))
    up_to = np.cumsum(counts)
    last = int(up_to[-1]) - 1
    place, between = divmod(share * last, 1)
    pair = np.searchsorted(up_to, [int(place), min(int(place) + 1, last)], side="right")
    return float(np.quantile((pair - EXACT_IN_16).astype(np.float64), between))


def blocks(rows: int, most: int | None = None) -> Iterator[slice]:
    """Yield slices of a limited number of rows, so that computations on them take little memory."""
    size = most or BLOCK_ROWS
    return (slice(first, min(first + size, rows)) for first in range(0, rows, size))


def extreme(values: Readings, which: Callable[[Readings], np.floating[Any]]) -> float | None:
    """Return the least or greatest known value without copying all; `which` is `np.min` or
    `np.max`.
    """
    parts = (values[rows] for rows in blocks(len(values)))
    found = [float(which(known)) for part in parts if len(known := part[~np.isnan(part)])]
    return float(which(np.array(found, dtype=np.float64))) if found else None


class Stretches:
    """Readings in `count` equal intervals: number, sum, least, greatest, first and last time."""

    def __init__(self, count: int) -> None:
        self.counts, self.sums = np.zeros(count, dtype=np.int64), np.zeros(count)
        self.low, self.high = np.full(count, np.inf), np.full(count, -np.inf)
        self.first, self.last = self.low.copy(), self.high.copy()

    def add(self, number: NDArray[np.int64], seconds: Floats, values: Readings) -> None:
        """Add readings by the number of their interval; those outside belong to the first or
        last.
        """
        if not len(number):
            return
        values = values.astype(np.float64, copy=False)  # 16-bit readings are compared in software
        number = np.clip(number, 0, len(self.counts) - 1)
        first = np.flatnonzero(np.diff(number, prepend=-1))
        place = number[first]
        np.add.at(self.counts, place, np.diff(np.append(first, len(number))))
        np.add.at(self.sums, place, np.add.reduceat(values, first))
        for found, of in ((self.low, values), (self.first, seconds)):
            np.minimum.at(found, place, np.minimum.reduceat(of, first))
        for found, of in ((self.high, values), (self.last, seconds)):
            np.maximum.at(found, place, np.maximum.reduceat(of, first))


def _every_sample(at: Floats, value: Floats, joined_s: float) -> Envelope:
    gaps = np.flatnonzero(np.diff(at) > joined_s)
    seconds, drawn = _insert(at, gaps, at), _insert(value, gaps, None)
    return Envelope(seconds, drawn, drawn, drawn)


def _broken(
    middle: Floats, low: Floats, high: Floats, mean: Floats, gaps: NDArray[np.int64]
) -> Envelope:
    return Envelope(
        _insert(middle, gaps, middle),
        _insert(low, gaps, None),
        _insert(high, gaps, None),
        _insert(mean, gaps, None),
    )


def _insert(values: Floats, gaps: NDArray[np.int64], times: Floats | None) -> Floats:
    """Insert a point after the first edge of each gap: NaN, or for times the edge itself."""
    return np.insert(values, gaps + 1, np.nan if times is None else times[gaps])


def lone(curve: Envelope) -> Envelope:
    """Return the points without a neighbour, drawn as dots because no line reaches them."""
    absent = np.isnan(curve.mean)
    before, after = np.append(True, absent[:-1]), np.append(absent[1:], True)
    alone = ~absent & before & after
    return Envelope(curve.seconds[alone], curve.low[alone], curve.high[alone], curve.mean[alone])


class Span(NamedTuple):  # a named tuple: a week has a hundred thousand
    """A time from `start` to `end` in seconds of the run, with the word for its state."""

    start: float
    end: float
    word: str

    @property
    def seconds(self) -> float:
        return self.end - self.start


def coded(codes: NDArray[np.integer[Any]], words: Sequence[str]) -> pd.Categorical:
    """Return the word for each row by its index in `words`; -1: no word."""
    return cast(
        pd.Categorical, pd.Categorical.from_codes(codes, pd.Index([*words], dtype="object"))
    )


def runs(seconds: Moments, words: Words, period_s: float) -> list[Span]:
    """Return runs of samples with the same word; None and a missing tick end a run. Each lasts
    until the tick after its last.
    """
    coded = (
        words
        if isinstance(words, pd.Categorical)
        else pd.Categorical(np.asarray(words, dtype=object))
    )
    codes, names = coded.codes, list(coded.categories)
    if not len(codes):
        return []
    breaks = codes[1:] != codes[:-1]
    for rows in blocks(len(breaks)):  # a week of steps would take as much as its trace
        breaks[rows] |= np.diff(seconds[rows.start : rows.stop + 1]) > 1.5 * period_s
    first = np.append(0, np.flatnonzero(breaks) + 1)
    last = np.append(first[1:], len(codes)) - 1
    known = codes[first] >= 0
    edges = zip(
        seconds[first[known]].tolist(),
        (seconds[last[known]] + period_s).tolist(),
        codes[first[known]],
        strict=True,
    )
    return [Span(start, end, names[code]) for start, end, code in edges]


def merged(spans: Iterable[Span], nearer_than_s: float) -> list[Span]:
    """Merge spans of one word that are too close to be distinguished."""
    firsts: list[Span] = []
    ends: list[float] = []
    for span in sorted(spans):  # a tuple: by start, end, word
        if firsts and firsts[-1].word == span.word and span.start - ends[-1] < nearer_than_s:
            ends[-1] = max(ends[-1], span.end)
        else:
            firsts.append(span)
            ends.append(span.end)
    return [
        one if end == one.end else one._replace(end=end)
        for one, end in zip(firsts, ends, strict=True)
    ]


def widened(span: Span, least_s: float) -> Span:
    """Return the span, widened to `least_s` so that it is visible."""
    lacking = max(0.0, least_s - span.seconds) / 2
    return span._replace(start=span.start - lacking, end=span.end + lacking)


def within(spans: Iterable[Span], start: float, end: float) -> list[Span]:
    """Return the parts of spans between `start` and `end`."""
    some = (span for span in spans if span.end > start and span.start < end)
    cut = [span._replace(start=max(span.start, start), end=min(span.end, end)) for span in some]
    return [span for span in cut if span.seconds > 0]
