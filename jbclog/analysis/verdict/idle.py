"""The idle tip: when its tool was in place, and how far from its setpoint it held.

Definition. A reading counts as idle when
- the tool's status is working (hot air: on), temperature and power were read, and the setpoint in force is
  known: read at most `SETTING_HOLDS_S` before;
- the tool was in its port and the port worked, by what was read of both before and behind it (`in_place`); behind the last
  of that the temperature is at most `LEAP_C` below the setpoint, which is what a tip that is pulled is not for long;
- the tip has *settled*: since it went to work, since its setpoint changed or since a gap in the record, there
  was a moment at which it had moved no more than `CALM_C` in `CALM_S`. How far it was from the setpoint then
  does not matter, or a large error could never be seen;
- it is *at rest*: nothing draws heat, and what the last draw left behind is over. See below.

*Heat is drawn* while power is more than `HEADROOM_PERMILLE` above the `HOLDING_QUANTILE` of the settled tip's power, or is all that
there is (`FULL_PERMILLE`). A line that never rests has a high quantile and gaps between draws that are short; what follows is about
these gaps, whatever their level.

*The recovery is over* after a time that the block itself shows: the temperature behind each draw is laid over the others by its
age, and the recovery lasts `AGES_S` seconds if behind that age the temperature no longer moves the same way after every draw. That
is: the mean over all draws of (temperature from that age on, for half as long again) minus (temperature after that, for as long
again twice) is less than `TAIL_C`, or less than `CHANCE` standard errors. What the tip does in its own time, slow or fast, differs
from draw to draw and stays in. With fewer than `FEW` draws there is no telling the two apart: each rest then begins at the first
age behind which the tip moved less than `TAIL_C`, after the greatest of these ages otherwise. Where rests are too short to see the
recovery end, nothing of them counts: a line that never rests has no idle error.

The error is temperature minus setpoint: its mean, and its standard deviation around that mean. Readings are looked at in blocks of
`BLOCK_S`, each beginning unsettled, so that holding power and recovery follow the day and memory stays small. With fewer
than `ENOUGH_ROWS` idle readings or `ENOUGH_S` of them the figures are unknown, never zero.

Rules 1 and 2 took as rest what was `AFTER_JOINT_S` behind such a draw and `BEFORE_JOINT_S` before one, and runs that were judged by
them are judged so again.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil, floor, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.verdict.bounds import MEANS_CELL_S, Bound, Cells, Known, batch_means, known, known_by_batches
from jbclog.analysis.verdict.versions import BOUNDS_HOLD, RULES

# -- in place -----------------------------------------------------------------------------------------------------------------
# When a tool was in its port and the port at work, as far as that was read.
#
# Tool and port error are read every few seconds, temperature and power many times a second: of a tool that is pulled some readings
# come before anybody knows. So a reading counts only where the last port error that was read before it and the first behind it both
# say that the port works (`WORKS`, manuals 000 and 002; hot air has other codes, of which none is asked here), and where the
# tool before and behind it is one and the same. Where nothing was read on one side the other decides; where neither was ever read,
# nothing is known against the tool.

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

WORKS = (0.0, 9.0)  # ok; a warning of overload


def in_place(tool: Floats, port_error: Floats) -> Flags:
    """Of each row of one port, in their order. `tool` and `port_error` are codes, NaN where they were not read."""
    if _is_never_changed(tool) and np.isin(port_error[~np.isnan(port_error)], WORKS).all():
        return np.ones(len(tool), dtype=np.bool_)  # as nearly always, and ten times as fast
    before, behind = _neighbours(tool)
    is_same = np.isnan(before) | np.isnan(behind) | (before == behind)
    works = _is_good(tool, tool > 0) & _is_good(port_error, np.isin(port_error, WORKS))
    return np.asarray(is_same & works, dtype=np.bool_)


def _is_never_changed(tool: Floats) -> bool:
    read = tool[~np.isnan(tool)]
    return not len(read) or bool(read[0] > 0 and (read == read[0]).all())


def behind_all(tool: Floats, port_error: Floats) -> Flags:
    """Which rows come when neither was read any more, though it had been: nothing bears them out."""
    read = np.flatnonzero(~np.isnan(tool) | ~np.isnan(port_error))
    rows = np.arange(len(tool))
    return np.asarray(rows > read[-1] if len(read) else np.zeros(len(tool)), dtype=np.bool_)


def _is_good(codes: Floats, good: Flags) -> Flags:
    before, behind = _neighbours(np.where(np.isnan(codes), np.nan, good.astype(np.float64)))
    return np.asarray((before != 0.0) & (behind != 0.0), dtype=np.bool_)  # NaN is not 0 either: nothing was read there


def _neighbours(codes: Floats) -> tuple[Floats, Floats]:
    """The last code that was read up to each row, and the first from it on; NaN where there is none."""
    return _held(codes), _held(codes[::-1])[::-1]


def _held(codes: Floats) -> Floats:
    last = np.maximum.accumulate(np.where(np.isnan(codes), -1, np.arange(len(codes))))
    return np.asarray(np.where(last >= 0, codes[last], np.nan), dtype=np.float64)


# -- percent ------------------------------------------------------------------------------------------------------------------
# Limits in per cent, judged with the resolution of the run: readings are counted one by one.
#
# A limit that lies between two counts is the lower one: of 194 readings 99.5 % are 193.03, and 193 keep it. 100 % are all of them.

RESOLVES: Final = 20
"""With fewer readings than this one of them is too much to let pass."""


def allowed_misses(due: int, least_percent: float) -> int:
    """How many of the readings due may be missing."""
    return ceil(due * (100 - least_percent) / 100 - 1e-9)


def floored(percent: float) -> float:
    """Two decimals, never rounded up to a limit that is missed."""
    return floor(percent * 100 + 1e-9) / 100


def shown(figure: float) -> str:
    """Up to two decimals, without the zeros behind."""
    return f"{figure:.2f}".rstrip("0").rstrip(".")


# -- idle ---------------------------------------------------------------------------------------------------------------------

BLOCK_S = 600.0
SETTING_HOLDS_S = 15.0  # the setting is due each 5 s; two losses are bridged
CALM_C, CALM_S = 2.0, 2.0
HOLDING_QUANTILE = 0.2
HEADROOM_PERMILLE = 100.0
AFTER_JOINT_S, BEFORE_JOINT_S = 1.0, 0.3
FULL_PERMILLE = 970.0
AGES_S = (1.0, 1.5, 2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 20.0)
TAIL_C, CHANCE, FEW = 0.3, 2.0, 3
LEAP_C = 50.0
ENOUGH_ROWS, ENOUGH_S = 10, 3.0

NOT_IDLE = "The tip never rested long enough: its temperature did not settle in any pause."
NOT_SEEN_IDLE = "The tool was not idle long enough."  # of rules 1 and 2


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive rows of one port: seconds on the grid, °C, ‰, °C as read, and whether the tool works. NaN: no value.

    `tool` and `port_error` are the codes that were read; None where they are not looked at.
    """

    seconds: Floats
    temperature: Floats
    power: Floats
    setting: Floats
    working: Flags
    tool: Floats | None = None
    port_error: Floats | None = None

    def take(self, rows: Flags | slice) -> Block:
        codes = [None if one is None else one[rows] for one in (self.tool, self.port_error)]
        return Block(self.seconds[rows], self.temperature[rows], self.power[rows], self.setting[rows], self.working[rows], *codes)

    @property
    def in_place(self) -> Flags:
        """In which rows the tool was in its port and the port worked."""
        if self.tool is None or self.port_error is None:
            return np.ones(len(self.seconds), dtype=np.bool_)
        return in_place(self.tool, self.port_error)


@dataclass(slots=True)
class IdleError:
    """Sums over all idle readings of a port, for version `rules` of the rules."""

    rules: int = RULES
    rows: int = 0
    seconds: float = 0.0
    total: float = 0.0
    squares: float = 0.0
    cells: Cells = field(init=False)

    def __post_init__(self) -> None:
        self.cells = Cells() if self.rules >= BOUNDS_HOLD else Cells(MEANS_CELL_S)

    def add(self, seconds: Floats, errors: Floats, period_s: float) -> None:
        """Take idle readings with their times on the run's axis, `period_s` apart."""
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
        """Mean of temperature minus setpoint in °C, or None."""
        return self.total / self.rows if self.enough else None

    @property
    def sd_c(self) -> float | None:
        """Standard deviation of temperature minus setpoint in °C, or None."""
        if not self.enough:
            return None
        spread = self.squares - self.total * self.total / self.rows
        return sqrt(max(spread, 0.0) / (self.rows - 1))

    def known(self) -> Known | str:
        """The 95 % bounds of both by the rules of today (`analysis/verdict/bounds.py`), or a sentence why there are none."""
        mean, spread = self.mean_c, self.sd_c
        if mean is None or spread is None:
            return NOT_IDLE
        return known(self.cells, self.seconds, mean, spread)

    @property
    def bounds(self) -> tuple[Bound, Bound] | None:
        """The 95 % bounds of both, or None."""
        mean, spread = self.mean_c, self.sd_c
        if mean is None or spread is None:
            return None
        if self.rules < BOUNDS_HOLD:
            return known_by_batches(self.rows, mean, spread, batch_means(self.cells, self.seconds / self.rows))
        found = self.known()
        return None if isinstance(found, str) else (found.mean, found.sd)


def idle_readings(block: Block, period_s: float, rules: int = RULES) -> tuple[Floats, Floats]:
    """The seconds of each idle reading of the block, and its temperature minus setpoint in °C, by version `rules`."""
    setting = setting_in_force(block.seconds, block.setting)
    known = block.working & ~np.isnan(block.temperature) & ~np.isnan(block.power) & ~np.isnan(setting)
    known &= block.in_place & ~_fallen(block, setting)
    rows, in_force = block.take(known), setting[known]
    starts = _stretch_starts(rows.seconds, in_force, period_s)
    calm = settled(rows.seconds, rows.temperature, starts)
    if not calm.any():
        return np.empty(0), np.empty(0)
    errors = np.asarray(rows.temperature - in_force, dtype=np.float64)
    if rules < BOUNDS_HOLD:
        idle = calm & outside_joints(rows.seconds, rows.power, calm)
    else:
        idle = calm & at_rest(rows.seconds, rows.power, errors, calm, starts, period_s)
    return rows.seconds[idle], errors[idle]


def _fallen(block: Block, setting: Floats) -> Flags:
    """What may be a tip that was pulled since its tool was last asked for."""
    if block.tool is None or block.port_error is None:
        return np.zeros(len(block.seconds), dtype=np.bool_)
    return behind_all(block.tool, block.port_error) & (block.temperature < setting - LEAP_C)


def setting_in_force(seconds: Floats, setting: Floats) -> Floats:
    """The setting last read, for `SETTING_HOLDS_S` at most; NaN where it is not known."""
    last = np.maximum.accumulate(np.where(np.isnan(setting), -1, np.arange(len(setting))))
    held = setting[last]
    held[(last < 0) | (seconds - seconds[last] > SETTING_HOLDS_S)] = np.nan
    return held


def _stretch_starts(seconds: Floats, setting: Floats, period_s: float) -> Flags:
    """Where a stretch begins: at the first row, after a gap, and where the setting changes."""
    starts = np.ones(len(seconds), dtype=np.bool_)
    starts[1:] = (np.diff(seconds) > max(1.0, 3 * period_s)) | (np.diff(setting) != 0)
    return starts


def settled(seconds: Floats, temperature: Floats, starts: Flags) -> Flags:
    """Which rows come at or after their stretch's first calm moment."""
    rows = np.arange(len(seconds))
    start = np.maximum.accumulate(np.where(starts, rows, 0))
    before = np.searchsorted(seconds, seconds - CALM_S + 1e-6, side="right") - 1  # the row CALM_S ago, or the one before that
    calm = (before >= start) & (np.abs(temperature - temperature[before]) <= CALM_C)
    last_calm = np.maximum.accumulate(np.where(calm, rows, -1))
    return np.asarray(last_calm >= start, dtype=np.bool_)


def at_rest(seconds: Floats, power: Floats, errors: Floats, calm: Flags, starts: Flags, period_s: float) -> Flags:
    """In which rows nothing draws heat and the recovery from the last draw is over."""
    drawing = (power > np.quantile(power[calm], HOLDING_QUANTILE) + HEADROOM_PERMILLE) | (power >= FULL_PERMILLE)
    following = np.minimum.accumulate(np.where(drawing, seconds, np.inf)[::-1])[::-1]
    ahead = following - seconds >= max(BEFORE_JOINT_S, period_s)
    rests = _rests(seconds, drawing, calm, starts)
    old_enough = rests.age_s >= _recovered_s(rests, errors, calm & ahead, period_s)[rests.number]
    return np.asarray(~drawing & ahead & old_enough, dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class _Rests:
    """The parts of a block between draws: of each row the number of its part and how long that has lasted.

    `is_after` of each part: whether a draw, or a tip on its way to its setpoint, comes before it.
    """

    number: NDArray[np.int64]
    age_s: Floats
    is_after: Flags


def _rests(seconds: Floats, drawing: Flags, calm: Flags, starts: Flags) -> _Rests:
    rows = np.arange(len(seconds))
    start = np.maximum.accumulate(np.where(starts, rows, 0))
    moving = ~calm & (seconds - seconds[start] > CALM_S + 1e-6)  # it was not calm as soon as it could be
    busy = drawing | moving
    begins = starts | (~busy & np.concatenate(([False], busy[:-1])))
    number = np.cumsum(begins) - 1
    last_busy = np.maximum.accumulate(np.where(busy, rows, -1))
    age = seconds - np.where(last_busy >= start, seconds[last_busy], seconds[start])
    first = np.flatnonzero(begins)
    return _Rests(number, age, np.asarray((first > 0) & busy[first - 1] & ~starts[first], dtype=np.bool_))


def _recovered_s(rests: _Rests, errors: Floats, rows: Flags, period_s: float) -> Floats:
    """From which age on each part is at rest; infinite where that cannot be seen."""
    parts = len(rests.is_after)
    after = int(rests.is_after[np.unique(rests.number[rows])].sum())
    moved = [_moved(rests, errors, rows, age, period_s) for age in AGES_S]
    if after < FEW:
        needed = np.where(rests.is_after, AGES_S[-1], 0.0)
        for age, by in zip(AGES_S[::-1], moved[::-1], strict=True):
            needed = np.where(rests.is_after & (np.abs(by) < TAIL_C), age, needed)
        return needed
    for age, by in zip(AGES_S, moved, strict=True):
        by = by[~np.isnan(by)]
        if len(by) < FEW:
            continue
        error = float(by.std(ddof=1)) / sqrt(len(by))
        if abs(float(by.mean())) < max(TAIL_C, CHANCE * error):
            return np.full(parts, age)
    return np.full(parts, np.inf)


def _moved(rests: _Rests, errors: Floats, rows: Flags, age_s: float, period_s: float) -> Floats:
    """By how much the temperature of each part still falls behind this age, in °C; NaN where it is too short to see that."""
    width, parts = max(0.5, age_s / 2, 3 * period_s), len(rests.is_after)
    age = rests.age_s + 1e-6
    early, late = (
        rows & (age >= first) & (age < last) for first, last in ((age_s, age_s + width), (age_s + width, age_s + 3 * width))
    )
    means = []
    for part, least in ((early, width / period_s / 2), (late, width / period_s / 2)):
        count = np.bincount(rests.number[part], minlength=parts).astype(np.float64)
        total = np.bincount(rests.number[part], errors[part], minlength=parts)
        means.append(total / np.where(count >= least, count, np.nan))
    return np.asarray(means[0] - means[1], dtype=np.float64)


def outside_joints(seconds: Floats, power: Floats, calm: Flags) -> Flags:
    """Which rows are far enough, before and after, from any row with more than holding power."""
    busy = power > np.quantile(power[calm], HOLDING_QUANTILE) + HEADROOM_PERMILLE
    last = np.maximum.accumulate(np.where(busy, seconds, -np.inf))
    following = np.minimum.accumulate(np.where(busy, seconds, np.inf)[::-1])[::-1]
    return np.asarray((seconds - last >= AFTER_JOINT_S) & (following - seconds >= BEFORE_JOINT_S), dtype=np.bool_)
