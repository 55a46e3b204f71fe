"""The idle tip: which readings count as idle, and how far the tip was from its setpoint in them.

Definition. A reading counts as idle if
- the tool's status is working (hot air: on), temperature and power were read, and the setpoint is
  known: read at most `SETTING_HOLDS_S` before;
- the tool was in its port and the port worked, by the readings of both before and after it
  (`in_place`). After the last of these readings, the temperature must also be at most `LEAP_C`
  below the setpoint; a tip without its tool soon falls lower;
- the tip has *settled*: since it began to work, since its setpoint changed or since a gap in the
  record, there was a moment at which it had moved at most `CALM_C` in `CALM_S`. Its distance from
  the setpoint does not matter then, or a large error could never show;
- it is *at rest*: nothing draws heat, and the recovery from the last draw is over.

*Heat is drawn* while power exceeds the `HOLDING_QUANTILE` of the settled tip's power by more than
`HEADROOM_PERMILLE`, or is at its maximum (`FULL_PERMILLE`). On a line that never rests this
quantile is high and the gaps between draws are short; the rest of the definition is about these
gaps, whatever their level.

*The recovery ends* after a time that the block of readings itself shows. The temperatures after
each draw are aligned by the time since the draw (their age). The recovery takes `AGES_S` seconds if
from that age on the temperature no longer moves in the same direction after every draw: of the
temperature during half that age after it, minus the temperature during the whole age after that,
the mean over all draws is below `TAIL_C`, or below `CHANCE` standard errors. What the tip does by
itself differs from draw to draw and stays in. With fewer than `FEW` draws the two cannot be
separated: each rest then begins at the first age after which the tip moved less than `TAIL_C`, else
after the last age. Rests that are too short to show the end of the recovery do not count: a line
that never rests has no idle error.

The error is temperature minus setpoint: its mean, and its standard deviation around that mean.
Readings are evaluated in blocks of `BLOCK_S`, each of which begins unsettled, so that holding power
and recovery follow the day and memory stays small. With fewer than `ENOUGH_ROWS` idle readings or
less than `ENOUGH_S` of them, the figures are unknown, never zero.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import blake2b
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.verdict.bounds import Bounds, Cells, bounds_of_cells

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

# port errors with which a port works: none; a warning of overload (manuals 000 and 002)
WORKS = (0.0, 9.0)
BLOCK_S = 600.0
SETTING_HOLDS_S = 15.0  # the setpoint is due every 5 s; two lost readings are bridged
CALM_C, CALM_S = 2.0, 2.0
HOLDING_QUANTILE = 0.2
HEADROOM_PERMILLE = 100.0
BEFORE_JOINT_S = 0.3
FULL_PERMILLE = 970.0
AGES_S = (1.0, 1.5, 2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 20.0)
TAIL_C, CHANCE, FEW = 0.3, 2.0, 3
LEAP_C = 50.0
ENOUGH_ROWS, ENOUGH_S = 10, 3.0

NOT_IDLE = "The tip never rested long enough: its temperature did not settle in any pause."


@dataclass(frozen=True, slots=True)
class Block:
    """Rows of one port: time in s, temperature in °C, power in ‰, setpoint in °C, whether the tool
    works. NaN: not read.

    `tool` and `port_error` are codes as read; None: not considered.
    """

    seconds: Floats
    temperature: Floats
    power: Floats
    setting: Floats
    working: Flags
    tool: Floats | None = None
    port_error: Floats | None = None

    def take(self, rows: Flags | slice) -> Block:
        """Return these rows."""
        codes = [None if one is None else one[rows] for one in (self.tool, self.port_error)]
        return Block(
            self.seconds[rows],
            self.temperature[rows],
            self.power[rows],
            self.setting[rows],
            self.working[rows],
            *codes,
        )

    @property
    def in_place(self) -> Flags:
        """Rows in which the tool was in its port and the port worked."""
        if self.tool is None or self.port_error is None:
            return np.ones(len(self.seconds), dtype=np.bool_)
        return in_place(self.tool, self.port_error)


def by_block(seconds: Floats) -> list[tuple[int, Flags | slice]]:
    """Return the blocks of `BLOCK_S` that have any of these moments, and the rows of each."""
    if (np.diff(seconds) < 0).any():  # the clock was set back
        numbers = np.floor_divide(seconds + 1e-6, BLOCK_S).astype(np.int64)
        return [(number, numbers == number) for number in np.unique(numbers).tolist()]
    found, first = list[tuple[int, Flags | slice]](), 0
    while first < len(seconds):
        number = _block_of(seconds[first])
        stop = bisect_right(seconds, number, lo=first, key=_block_of)
        found.append((number, slice(first, stop)))
        first = stop
    return found


def _block_of(second: np.float64) -> int:
    return int(np.floor_divide(second + 1e-6, BLOCK_S))


@dataclass(slots=True)
class IdleError:
    """The idle readings of a port, as sums."""

    rows: int = 0
    seconds: float = 0.0
    total: float = 0.0
    squares: float = 0.0
    cells: Cells = field(default_factory=Cells)
    # the latest bounds, and their number of readings
    _bounds: tuple[int, Bounds | str] | None = field(
        default=None, init=False, repr=False, compare=False
    )

    def add(self, seconds: Floats, errors: Floats, period_s: float) -> None:
        """Add idle readings: their times in s and errors in °C, `period_s` apart."""
        if not len(errors):
            return
        self.cells.add(seconds, errors)
        self.rows += len(errors)
        self.seconds += len(errors) * period_s
        self.total += float(errors.sum())
        self.squares += float(np.square(errors).sum())

    @property
    def enough(self) -> bool:
        return self.rows >= ENOUGH_ROWS and self.seconds >= ENOUGH_S

    @property
    def mean_c(self) -> float | None:
        """Mean of temperature minus setpoint in °C; None with too few readings."""
        return self.total / self.rows if self.enough else None

    @property
    def sd_c(self) -> float | None:
        """Standard deviation of temperature minus setpoint in °C; None with too few readings."""
        if not self.enough:
            return None
        spread = self.squares - self.total * self.total / self.rows
        return sqrt(max(spread, 0.0) / (self.rows - 1))

    def bounds(self) -> Bounds | str:
        """Return the 95 % bounds of both (`bounds.py`), or why there are none."""
        mean, spread = self.mean_c, self.sd_c
        if mean is None or spread is None:
            return NOT_IDLE
        if self._bounds is None or self._bounds[0] != self.rows:  # a report needs them twice
            self._bounds = self.rows, bounds_of_cells(self.cells, self.seconds, mean, spread)
        return self._bounds[1]


def idle_readings(block: Block, period_s: float) -> tuple[Floats, Floats]:
    """Return the time in s of each idle reading, and its temperature minus setpoint in °C."""
    setting = setting_in_force(block.seconds, block.setting)

    def find() -> Flags:
        return _idle_rows(block, setting, period_s)

    idle = KEPT.rows(block, period_s, find)
    return block.seconds[idle], np.asarray(block.temperature[idle] - setting[idle], np.float64)


def _idle_rows(block: Block, setting: Floats, period_s: float) -> Flags:
    usable = (
        block.working & ~np.isnan(block.temperature) & ~np.isnan(block.power) & ~np.isnan(setting)
    )
    usable &= block.in_place & ~_may_be_pulled(block, setting)
    columns = (block.seconds, block.temperature, block.power, setting)
    seconds, temperature, power, in_force = (column[usable] for column in columns)
    starts = _stretch_starts(seconds, in_force, period_s)
    calm = settled(seconds, temperature, starts)
    found = np.zeros(len(usable), dtype=np.bool_)
    if not calm.any():
        return found
    errors = np.asarray(temperature - in_force, dtype=np.float64)
    found[usable] = calm & at_rest(seconds, power, errors, calm, starts, period_s)
    return found


class KeptRows:
    """Cache of which rows of blocks are idle, by a digest of the block.

    A report needs them twice, for its metrics and for its verdict, and computing them takes several
    times as long as a digest.
    """

    def __init__(self) -> None:
        self._found: dict[bytes, bytes] | None = None  # the rows in bits

    @contextmanager
    def while_in_use(self) -> Iterator[None]:
        """Keep the rows of each block from its first use to its second."""
        before, self._found = self._found, {}
        try:
            yield
        finally:
            self._found = before

    def rows(self, block: Block, period_s: float, find: Callable[[], Flags]) -> Flags:
        """Return the result of `find` for this block."""
        if self._found is None:
            return find()
        key = _digest(block, period_s)
        bits = self._found.pop(key, None)
        if bits is None:
            found = find()
            if len(self._found) < MOST_KEPT:
                self._found[key] = np.packbits(found).tobytes()
            return found
        packed = np.frombuffer(bits, dtype=np.uint8)
        return np.unpackbits(packed, count=len(block.seconds)).astype(np.bool_)


KEPT: Final = KeptRows()
MOST_KEPT: Final = 8192  # blocks, some 1 kB each at 10 Hz: a week of eight ports


def _digest(block: Block, period_s: float) -> bytes:
    codes = block.tool, block.port_error
    about = len(block.seconds), [one is None for one in codes], float(period_s)
    digest = blake2b(repr(about).encode(), digest_size=16)
    columns = block.seconds, block.temperature, block.power, block.setting, block.working, *codes
    for column in columns:
        if column is not None:
            digest.update(np.ascontiguousarray(column).data)
    return digest.digest()


def _may_be_pulled(block: Block, setting: Floats) -> Flags:
    """Return the rows that may be of a tool that was pulled after its last reading."""
    if block.tool is None or block.port_error is None:
        return np.zeros(len(block.seconds), dtype=np.bool_)
    return after_last(block.tool, block.port_error) & (block.temperature < setting - LEAP_C)


def setting_in_force(seconds: Floats, setting: Floats) -> Floats:
    """Return the setpoint last read in each row, for at most `SETTING_HOLDS_S`; NaN: not known."""
    held, read = np.full_like(setting, np.nan), np.flatnonzero(~np.isnan(setting))
    if len(read):  # it is read every few seconds, so that this is faster than a search in each row
        rows, known = np.diff(read, append=len(setting)), held[read[0] :]
        known[:] = np.repeat(setting[read], rows)
        known[seconds[read[0] :] - np.repeat(seconds[read], rows) > SETTING_HOLDS_S] = np.nan
    return held


def _stretch_starts(seconds: Floats, setting: Floats, period_s: float) -> Flags:
    """Return the first row of each stretch: after a gap, and where the setpoint changes."""
    starts = np.ones(len(seconds), dtype=np.bool_)
    starts[1:] = (np.diff(seconds) > max(1.0, 3 * period_s)) | (np.diff(setting) != 0)
    return starts


def settled(seconds: Floats, temperature: Floats, starts: Flags) -> Flags:
    """Return the rows at or after the first calm moment of their stretch."""
    rows = np.arange(len(seconds))
    start = np.maximum.accumulate(np.where(starts, rows, 0))
    # the row `CALM_S` before, or the next earlier one
    before = np.searchsorted(seconds, seconds - CALM_S + 1e-6, side="right") - 1
    calm = (before >= start) & (np.abs(temperature - temperature[before]) <= CALM_C)
    last_calm = np.maximum.accumulate(np.where(calm, rows, -1))
    return np.asarray(last_calm >= start, dtype=np.bool_)


def at_rest(
    seconds: Floats, power: Floats, errors: Floats, calm: Flags, starts: Flags, period_s: float
) -> Flags:
    """Return the rows in which nothing draws heat and the recovery from the last draw is over."""
    drawing = (power > np.quantile(power[calm], HOLDING_QUANTILE) + HEADROOM_PERMILLE) | (
        power >= FULL_PERMILLE
    )
    following = np.minimum.accumulate(np.where(drawing, seconds, np.inf)[::-1])[::-1]
    ahead = following - seconds >= max(BEFORE_JOINT_S, period_s)
    rests = _rests(seconds, drawing, calm, starts)
    old_enough = rests.age_s >= _recovered_s(rests, errors, calm & ahead, period_s)[rests.number]
    return np.asarray(~drawing & ahead & old_enough, dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class _Rests:
    """The rests of a block, separated by draws: for each row the number of its rest, and its age in
    s in that rest.

    `is_after`: for each rest, whether a draw, or a tip on its way to its setpoint, comes before it.
    """

    number: NDArray[np.int64]
    age_s: Floats
    is_after: Flags


def _rests(seconds: Floats, drawing: Flags, calm: Flags, starts: Flags) -> _Rests:
    rows = np.arange(len(seconds))
    start = np.maximum.accumulate(np.where(starts, rows, 0))
    moving = ~calm & (seconds - seconds[start] > CALM_S + 1e-6)  # not calm although it could be
    busy = drawing | moving
    begins = starts | (~busy & np.concatenate(([False], busy[:-1])))
    number = np.cumsum(begins) - 1
    last_busy = np.maximum.accumulate(np.where(busy, rows, -1))
    age = seconds - np.where(last_busy >= start, seconds[last_busy], seconds[start])
    first = np.flatnonzero(begins)
    return _Rests(
        number, age, np.asarray((first > 0) & busy[first - 1] & ~starts[first], dtype=np.bool_)
    )


def _recovered_s(rests: _Rests, errors: Floats, rows: Flags, period_s: float) -> Floats:
    """Return the age in s from which each rest counts; infinity where recovery shows no end."""
    seen = np.zeros(len(rests.is_after), dtype=np.bool_)
    seen[rests.number[rows]] = True
    after = int((rests.is_after & seen).sum())
    if after < FEW:
        needed = np.where(rests.is_after, AGES_S[-1], 0.0)
        for age in AGES_S[::-1]:
            by = _moved(rests, errors, rows, age, period_s)
            needed = np.where(rests.is_after & (np.abs(by) < TAIL_C), age, needed)
        return needed
    for age in AGES_S:
        by = _moved(rests, errors, rows, age, period_s)
        by = by[~np.isnan(by)]
        if len(by) < FEW:
            continue
        error = float(by.std(ddof=1)) / sqrt(len(by))
        if abs(float(by.mean())) < max(TAIL_C, CHANCE * error):
            return np.full(len(rests.is_after), age)
    return np.full(len(rests.is_after), np.inf)


def _moved(rests: _Rests, errors: Floats, rows: Flags, age_s: float, period_s: float) -> Floats:
    """Return by how many °C the temperature of each rest still falls after this age; NaN for a rest
    that is too short.
    """
    width, number = max(0.5, age_s / 2, 3 * period_s), len(rests.is_after)
    age = rests.age_s + 1e-6
    early, late = (
        rows & (age >= first) & (age < last)
        for first, last in ((age_s, age_s + width), (age_s + width, age_s + 3 * width))
    )
    means = []
    for part in (early, late):
        count = np.bincount(rests.number[part], minlength=number).astype(np.float64)
        total = np.bincount(rests.number[part], errors[part], minlength=number)
        means.append(total / np.where(count >= width / period_s / 2, count, np.nan))
    return np.asarray(means[0] - means[1], dtype=np.float64)


def in_place(tool: Floats, port_error: Floats) -> Flags:
    """Return the rows of one port in which the tool was in its port and the port worked. Codes are
    NaN where not read.

    Tool and port error are read every few seconds, temperature many times a second. So a row counts
    only if the readings before and after it agree: the same tool, and a port that works (`WORKS`;
    hot air has other codes, none of which is considered). With a reading on one side only, that one
    decides; without any reading the row counts.
    """
    if _is_never_changed(tool) and _works(port_error[~np.isnan(port_error)]).all():
        return np.ones(len(tool), dtype=np.bool_)  # the usual case, ten times as fast
    before, after = _neighbours(tool)
    is_same = np.isnan(before) | np.isnan(after) | (before == after)
    works = _is_good(tool, tool > 0) & _is_good(port_error, _works(port_error))
    return np.asarray(is_same & works, dtype=np.bool_)


def _works(port_error: Floats) -> Flags:
    works, warns = WORKS
    return np.asarray((port_error == works) | (port_error == warns), dtype=np.bool_)


def _is_never_changed(tool: Floats) -> bool:
    read = tool[~np.isnan(tool)]
    return not len(read) or bool(read[0] > 0 and (read == read[0]).all())


def after_last(tool: Floats, port_error: Floats) -> Flags:
    """Return the rows after the last reading of tool or port error; none without any reading."""
    read = np.flatnonzero(~np.isnan(tool) | ~np.isnan(port_error))
    rows = np.arange(len(tool))
    return np.asarray(rows > read[-1] if len(read) else np.zeros(len(tool)), dtype=np.bool_)


def _is_good(codes: Floats, good: Flags) -> Flags:
    before, after = _neighbours(np.where(np.isnan(codes), np.nan, good.astype(np.float64)))
    # also for NaN, where nothing was read
    return np.asarray((before != 0.0) & (after != 0.0), dtype=np.bool_)


def _neighbours(codes: Floats) -> tuple[Floats, Floats]:
    """Return the last code read up to each row, and the first from it on; NaN without one."""
    return _held(codes), _held(codes[::-1])[::-1]


def _held(codes: Floats) -> Floats:
    last = np.maximum.accumulate(np.where(np.isnan(codes), -1, np.arange(len(codes))))
    return np.asarray(np.where(last >= 0, codes[last], np.nan), dtype=np.float64)
