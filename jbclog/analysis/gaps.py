"""A gap: the time from the last reading of a signal to its next one, where readings that were due
between the two are missing.

- Of each signal of each port. A reading was due where its column has a value or `reasons` names it,
  as in the accounting. So a signal that is read every 5 s and was missed once has a gap of 10 s.
- Its seconds are those of the run's clock between the times of the two rows. A missing reading
  belongs to the gap in which it was due: those that a late answer left no time for were due before
  that answer, although their rows follow it.
- A tick without a row (the host was suspended, or its rows are lost) is a missing reading of the
  signals that are read at every tick, with the reason `NO_ROWS`.
- Where no reading is before it, it starts at the first moment at which one was due; where none is
  after it, it stops at the last one. Then it lasted *at least* its seconds.
- With ``--rate max`` nothing is due at a certain time. There a pause between two rows of more than
  `STALLED_US` is a gap, too, in which no reading is missing.

Gaps of a signal are in order and share no time. Everything that tells of a gap takes it from here.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

NO_ROWS: Final = "no_rows"
"""Reason of a tick without a row; the accounting counts those of a host that stood still as
``skipped``.
"""
BETWEEN_REASONS: Final = ";"
STALLED_US: Final = 500_000

Counts = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Gap(NamedTuple):  # a named tuple: a week has a hundred thousand
    """A gap; its times are by the run's clock, in µs since 1970 UTC.

    `missing`: readings that were due in it. `reasons`: each once, in order of appearance.
    `at_least`: no reading is before it, or none after it, so that it may have lasted longer.
    """

    start_us: int
    stop_us: int
    missing: int
    reasons: tuple[str, ...]
    at_least: bool

    @property
    def seconds(self) -> float:
        return (self.stop_us - self.start_us) / 1e6

    @property
    def reasons_text(self) -> str:
        return BETWEEN_REASONS.join(self.reasons)


class Missing(NamedTuple):
    """Missing readings in order: a moment at which each was due, in µs, how many (ticks without a
    row share a moment), and the number of the reason of each among `words`.
    """

    due_us: Counts
    counts: Counts
    codes: Counts
    words: Sequence[str]


NONE: Final = np.empty(0, np.int64)
NOTHING: Final = Missing(NONE, NONE, NONE, [])


@dataclass(slots=True)
class _Open:
    """A gap that later rows may belong to. `number`: of the readings before it."""

    number: int
    start_us: int
    last_due_us: int
    missing: int = 0
    reasons: dict[str, None] = field(default_factory=dict)
    stop_us: int | None = None


class SignalGaps:
    """The gaps of one signal of one port. Its rows are added in pieces, oldest first."""

    def __init__(self) -> None:
        self._readings = 0  # how many there are
        self._recent = np.empty(0, np.int64)  # times of those that a gap may still begin or end at
        self._open: _Open | None = None
        self._starts, self._stops, self._missing = array("q"), array("q"), array("q")
        self._reasons = array("l")
        self._texts: dict[tuple[str, ...], int] = {}
        self._is_open_at_start = False
        self._is_open_at_end = False

    def add(self, times_us: Counts, is_read: Flags, missing: Missing) -> None:
        """Add the next rows: their times, which never step back, whether each has a reading, and
        the readings missing in or between them.
        """
        if not len(times_us):
            return
        readings = np.concatenate([self._recent, times_us[is_read]])
        before = self._readings - len(self._recent)
        self._readings = before + len(readings)
        if len(missing.due_us):
            self._count(readings, before, missing)
        if self._open is not None and self._open.stop_us is None:
            self._close(self._open, readings, before)
        needed = max(int(np.searchsorted(readings, times_us[-1])) - 1, 0)
        self._recent = readings[needed:]

    def _count(self, readings: Counts, before: int, missing: Missing) -> None:
        places = np.searchsorted(readings, missing.due_us) + before
        edges = np.flatnonzero((np.diff(places) != 0) | (np.diff(missing.codes) != 0)) + 1
        firsts = [0, *edges.tolist()]
        lasts = [*(edges - 1).tolist(), len(places) - 1]
        counts = np.add.reduceat(missing.counts, firsts).tolist()
        for first, last, count in zip(firsts, lasts, counts, strict=True):
            number = int(places[first])
            gap = self._open
            if gap is None or gap.number != number:
                self._finish(readings, before)
                start = missing.due_us[first] if number == 0 else readings[number - before - 1]
                gap = self._open = _Open(number, int(start), int(start))
            gap.missing += count
            gap.last_due_us = int(missing.due_us[last])
            gap.reasons.setdefault(missing.words[int(missing.codes[first])])

    def _close(self, gap: _Open, readings: Counts, before: int) -> None:
        """Let the gap stop at the first reading after it, if that is among these."""
        place = gap.number - before
        if place < len(readings):
            gap.stop_us = int(readings[place])

    def _finish(self, readings: Counts, before: int) -> None:
        gap = self._open
        if gap is None:
            return
        if gap.stop_us is None:
            self._close(gap, readings, before)
        self._is_open_at_start |= gap.number == 0
        self._is_open_at_end = gap.stop_us is None
        reasons = tuple(gap.reasons)
        self._starts.append(gap.start_us)
        self._stops.append(gap.last_due_us if gap.stop_us is None else gap.stop_us)
        self._missing.append(gap.missing)
        self._reasons.append(self._texts.setdefault(reasons, len(self._texts)))
        self._open = None

    def end(self, missing: Missing = NOTHING) -> None:
        """End the rows; `missing` are readings that were due after them."""
        if len(missing.due_us):
            self._count(self._recent, self._readings - len(self._recent), missing)
        self._finish(self._recent, self._readings - len(self._recent))

    def __len__(self) -> int:
        return len(self._starts)

    def __iter__(self) -> Iterator[Gap]:
        texts = [*self._texts]
        last = len(self) - 1
        rows = zip(self._starts, self._stops, self._missing, self._reasons, strict=True)
        for place, (start, stop, missing, reasons) in enumerate(rows):
            at_least = (place == 0 and self._is_open_at_start) or (
                place == last and self._is_open_at_end
            )
            yield Gap(start, stop, missing, texts[reasons], at_least)

    @property
    def readings(self) -> int:
        """The number of readings."""
        return self._readings

    @property
    def longest_s(self) -> float:
        """Seconds of the longest gap; 0 without one."""
        starts = np.frombuffer(self._starts, np.int64)
        stops = np.frombuffer(self._stops, np.int64)
        return int((stops - starts).max(initial=0)) / 1e6

    @property
    def most_missing(self) -> int:
        """Number of readings that are missing in the gap with the most."""
        return max(self._missing, default=0)


class PortClock:
    """The times of a port's rows, and its ticks without a row; rows come in pieces, oldest first.

    `period_us`: 0 without a grid. `first_tick`: the first one at which the port was to be read, if
    known.
    """

    def __init__(self, period_us: float, first_tick: int | None = None) -> None:
        self._period_us = period_us
        self._first_tick = first_tick
        self._last: tuple[int, int] | None = None  # time and tick

    def never_back(self, times_us: Counts) -> Counts:
        """Return the next times such that none is before the one of the row before it, as in runs
        of 0.1.0, whose skipped rows have the time at which they were due.
        """
        if self._last is not None:
            times_us = np.maximum(times_us, self._last[0])
        return np.maximum.accumulate(times_us)

    def without_rows(self, times_us: Counts, ticks: Counts) -> tuple[Counts, Missing]:
        """Return the readings missing before these rows because ticks have no row, each with the
        row that it is before.
        """
        if not len(times_us):
            return NONE, NOTHING
        before_us, before_tick = self._before(int(times_us[0]), int(ticks[0]))
        self._last = int(times_us[-1]), int(ticks[-1])
        passed_us = np.diff(times_us, prepend=before_us)
        if not self._period_us:
            rows = np.flatnonzero(passed_us > STALLED_US)
            return rows, _no_rows(times_us[rows], np.zeros(len(rows), np.int64))
        lacking = np.diff(ticks, prepend=before_tick) - 1
        rows = np.flatnonzero(lacking > 0)
        lacking, row_us = lacking[rows], times_us[rows]
        last_us = row_us - passed_us[rows]
        # ticks that were due before the row before came, because its answer was late itself
        over_us = lacking * self._period_us - passed_us[rows]
        early = np.clip(np.floor(over_us / self._period_us) + 1, 0, lacking).astype(np.int64)
        later = lacking - early
        due_us = row_us - (later * self._period_us).astype(np.int64)
        due_us = np.maximum(due_us, last_us + 1)
        moments = np.stack([last_us, due_us], axis=1).ravel()
        counts = np.stack([early, later], axis=1).ravel()
        some = counts > 0
        return np.repeat(rows, 2)[some], _no_rows(moments[some], counts[some])

    def _before(self, time_us: int, tick: int) -> tuple[int, int]:
        """Return time and tick of the row before the next one, whose are given."""
        if self._last is not None:
            return self._last
        lacking = 0 if self._first_tick is None else max(tick - self._first_tick, 0)
        return time_us - round(lacking * self._period_us) - 1, tick - lacking - 1

    def after(self, last_tick: int | None) -> Missing:
        """Return the readings missing between the last row and this tick."""
        if self._last is None or last_tick is None or not self._period_us:
            return NOTHING
        time_us, tick = self._last
        count = last_tick - tick
        if count <= 0:
            return NOTHING
        first_and_last = np.array([1, count]) * self._period_us
        return _no_rows(time_us + first_and_last.astype(np.int64), np.array([1, count - 1]))


def _no_rows(due_us: Counts, count: Counts) -> Missing:
    return Missing(due_us, count, np.zeros(len(count), np.int64), [NO_ROWS])


class Why(NamedTuple):
    """The reason of each row by its number among `words`; -1: none."""

    codes: Counts
    words: Sequence[str]

    def missing(self, times_us: Counts, rows: Counts) -> Missing:
        """Return the readings that are missing in these rows."""
        return Missing(times_us[rows], np.ones(len(rows), np.int64), self.codes[rows], self.words)


def why(reasons: pa.DictionaryArray, signals: Sequence[str]) -> Why:
    """Return the reason of each row that names one of these signals, of the first one named."""
    named = [_reason(text, signals) for text in reasons.dictionary.to_pylist()]
    words = [*dict.fromkeys(word for word in named if word is not None)]
    code_of = np.array([-1 if word is None else words.index(word) for word in named] + [-1])
    texts = pc.fill_null(reasons.indices, len(named)).to_numpy(zero_copy_only=False)
    return Why(code_of[texts], words)


def _reason(text: str | None, signals: Sequence[str]) -> str | None:
    for item in (text or "").split(BETWEEN_REASONS):
        column, _, reason = item.partition("=")
        if column in signals:
            return reason
    return None


def in_order(rows: Counts, missing: Missing, places: Counts, without_rows: Missing) -> Missing:
    """Return the readings missing in rows and those missing before rows, in order."""
    if not len(places):
        return missing
    if not len(rows):
        return without_rows
    order = np.argsort(np.concatenate([2 * rows + 1, 2 * places]), kind="stable")
    codes = np.concatenate([missing.codes, without_rows.codes + len(missing.words)])
    return Missing(
        np.concatenate([missing.due_us, without_rows.due_us])[order],
        np.concatenate([missing.counts, without_rows.counts])[order],
        codes[order],
        [*missing.words, *without_rows.words],
    )
