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
- it is *at rest*: no heat was drawn for `REST_S` before it, and none is drawn right after it.

*Heat is drawn* while power exceeds the `HOLDING_QUANTILE` of the settled tip's power by more than
`HEADROOM_PERMILLE`, or is at its maximum (`FULL_PERMILLE`). A line that never pauses for `REST_S`
has no idle error.

The error is temperature minus setpoint: its mean, and its standard deviation around that mean.
Readings are evaluated in blocks of `BLOCK_S`, each of which begins unsettled, so that the holding
power follows the day and memory stays small. With fewer than `ENOUGH_ROWS` idle readings or less
than `ENOUGH_S` of them, the figures are unknown, never zero.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from math import sqrt

import numpy as np

from jbclog.analysis.port_data import Flags, Floats, in_place, setting_in_force
from jbclog.analysis.verdict.bounds import Bounds, Cells, bounds_of_cells

BLOCK_S = 600.0
CALM_C, CALM_S = 2.0, 2.0
HOLDING_QUANTILE = 0.2
HEADROOM_PERMILLE = 100.0
REST_S = 10.0
BEFORE_JOINT_S = 0.3
FULL_PERMILLE = 970.0
LEAP_C = 50.0
ENOUGH_ROWS, ENOUGH_S = 10, 3.0

NOT_IDLE = (
    "The tip never rested long enough. Rest begins when it has settled and no heat was drawn for"
    f" {REST_S:g} s."
)


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
        return bounds_of_cells(self.cells, self.seconds, mean, spread)


def idle_readings(block: Block, period_s: float) -> tuple[Floats, Floats]:
    """Return the time in s of each idle reading, and its temperature minus setpoint in °C."""
    setting = setting_in_force(block.seconds, block.setting)
    usable = (
        block.working & ~np.isnan(block.temperature) & ~np.isnan(block.power) & ~np.isnan(setting)
    )
    usable &= block.in_place & ~_may_be_pulled(block, setting)
    seconds = block.seconds[usable]
    temperature = block.temperature[usable]
    setting = setting[usable]
    starts = _stretch_starts(seconds, setting, period_s)
    calm = settled(seconds, temperature, starts)
    if not calm.any():
        return seconds[:0], temperature[:0]
    idle = calm & at_rest(seconds, block.power[usable], calm, period_s)
    return seconds[idle], np.asarray(temperature[idle] - setting[idle], dtype=np.float64)


def _may_be_pulled(block: Block, setting: Floats) -> Flags:
    """Return the rows that may be of a tool that was pulled after its last reading."""
    if block.tool is None or block.port_error is None:
        return np.zeros(len(block.seconds), dtype=np.bool_)
    return after_last(block.tool, block.port_error) & (block.temperature < setting - LEAP_C)


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


def at_rest(seconds: Floats, power: Floats, calm: Flags, period_s: float) -> Flags:
    """Return the rows in which no heat was drawn for `REST_S`, and none is drawn right after."""
    holding = np.quantile(power[calm], HOLDING_QUANTILE)
    is_drawing = (power > holding + HEADROOM_PERMILLE) | (power >= FULL_PERMILLE)
    last_draw = np.maximum.accumulate(np.where(is_drawing, seconds, -np.inf))
    next_draw = np.minimum.accumulate(np.where(is_drawing, seconds, np.inf)[::-1])[::-1]
    is_after = seconds - last_draw >= REST_S - 1e-6
    is_before = next_draw - seconds >= max(BEFORE_JOINT_S, period_s) - 1e-6
    return np.asarray(is_after & is_before, dtype=np.bool_)


def after_last(tool: Floats, port_error: Floats) -> Flags:
    """Return the rows after the last reading of tool or port error; none without any reading."""
    read = np.flatnonzero(~np.isnan(tool) | ~np.isnan(port_error))
    rows = np.arange(len(tool))
    return np.asarray(rows > read[-1] if len(read) else np.zeros(len(tool)), dtype=np.bool_)
