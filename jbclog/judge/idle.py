"""The idle tip: how far from its setting it holds when nothing is being soldered.

Definition. A reading counts as idle when
- the tool's status is working (hot air: on), temperature and power were read, and the setting in force is
  known: read at most `SETTING_HOLDS_S` before;
- the tool was in its port and the port worked, by what was read of both before and behind it (`in_place`); behind the last
  of that the temperature is at most `LEAP_C` below the setting, which is what a tip that is pulled is not for long;
- the tip has *settled*: since it went to work, since its setting changed or since a gap in the record, there
  was a moment at which it had moved no more than `CALM_C` in `CALM_S`. How far it was from the setting then
  does not matter, or a large error could never be seen;
- it is *outside joints*: power is at most `HEADROOM_PERMILLE` above the tip's holding power, which is the
  `HOLDING_QUANTILE` of its power while settled, and was so from `AFTER_JOINT_S` before to `BEFORE_JOINT_S` after.

The error is temperature minus setting: its mean, and its standard deviation around that mean. Readings are looked at in blocks of
`BLOCK_S`, each beginning unsettled, so that holding power follows the day and memory stays small. With fewer
than `ENOUGH_ROWS` idle readings or `ENOUGH_S` of them the figures are unknown, never zero.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from jbclog.judge.bound import Cells, Known, known
from jbclog.judge.in_place import behind_all, in_place

BLOCK_S = 600.0
SETTING_HOLDS_S = 15.0  # the setting is due each 5 s; two losses are bridged
CALM_C, CALM_S = 2.0, 2.0
HOLDING_QUANTILE = 0.2
HEADROOM_PERMILLE = 100.0
AFTER_JOINT_S, BEFORE_JOINT_S = 1.0, 0.3
LEAP_C = 50.0
ENOUGH_ROWS, ENOUGH_S = 10, 3.0

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


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

    def take(self, rows: Flags) -> Block:
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
    """Sums over all idle readings of a port."""

    rows: int = 0
    seconds: float = 0.0
    total: float = 0.0
    squares: float = 0.0
    cells: Cells = field(default_factory=Cells)

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
        """Mean of temperature minus setting in °C, or None."""
        return self.total / self.rows if self.enough else None

    @property
    def sd_c(self) -> float | None:
        """Standard deviation of temperature minus setting in °C, or None."""
        if not self.enough:
            return None
        spread = self.squares - self.total * self.total / self.rows
        return sqrt(max(spread, 0.0) / (self.rows - 1))

    @property
    def bounds(self) -> Known | None:
        """The 95 % bounds of both (`judge/bound.py`), or None."""
        mean, spread = self.mean_c, self.sd_c
        if mean is None or spread is None:
            return None
        return known(self.rows, mean, spread, self.cells.batch_means(self.seconds / self.rows))


def idle_errors(block: Block, period_s: float) -> Floats:
    """Temperature minus setting in °C of each idle reading of the block."""
    return idle_readings(block, period_s)[1]


def idle_readings(block: Block, period_s: float) -> tuple[Floats, Floats]:
    """The seconds of each idle reading of the block, and its temperature minus setting in °C."""
    setting = setting_in_force(block.seconds, block.setting)
    known = block.working & ~np.isnan(block.temperature) & ~np.isnan(block.power) & ~np.isnan(setting)
    known &= block.in_place & ~_fallen(block, setting)
    rows, in_force = block.take(known), setting[known]
    calm = settled(rows.seconds, rows.temperature, _stretch_starts(rows.seconds, in_force, period_s))
    if not calm.any():
        return np.empty(0), np.empty(0)
    idle = calm & outside_joints(rows.seconds, rows.power, calm)
    return rows.seconds[idle], np.asarray(rows.temperature[idle] - in_force[idle], dtype=np.float64)


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


def outside_joints(seconds: Floats, power: Floats, calm: Flags) -> Flags:
    """Which rows are far enough, before and after, from any row with more than holding power."""
    busy = power > np.quantile(power[calm], HOLDING_QUANTILE) + HEADROOM_PERMILLE
    last = np.maximum.accumulate(np.where(busy, seconds, -np.inf))
    following = np.minimum.accumulate(np.where(busy, seconds, np.inf)[::-1])[::-1]
    return np.asarray((seconds - last >= AFTER_JOINT_S) & (following - seconds >= BEFORE_JOINT_S), dtype=np.bool_)
