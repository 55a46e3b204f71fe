"""From when on a tip can be soldered with: its heat-up is over.

It is once the tip has come within `NEAR_K` of its setpoint, and rises slower than `SLOW_K_PER_S`, since it went to work or
since its setpoint was last raised, or once it has stopped rising for `CALM_S`: a tip that never gets near its setpoint is
soldered with, too. Over a short gap of the record, and over a stand that left the tip warm, it stays ready if it is not much
colder than before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jbclog.analysis.joints.series import Stretch
from jbclog.analysis.verdict.idle import Flags

NEAR_K, SLOW_K_PER_S = 30.0, 5.0
SLOW_OVER_S: Final = 0.4
CALM_S, CALM_K = 2.0, 3.0
SHORT_GAP_S: Final = 15.0
TRUSTED_S: Final = 20.0  # from a window's first reading on, what was seen in the window before it decides


@dataclass(frozen=True, slots=True)
class Readied:
    """A stretch, and in which of its rows the tip is ready."""

    stretch: Stretch
    ready: Flags

    @property
    def start_s(self) -> float:
        return float(self.stretch.seconds[0])

    @property
    def length_s(self) -> float:
        return len(self.stretch) * self.stretch.period_s


def readied(stretches: Sequence[Stretch]) -> list[Readied]:
    """The stretches of a port in their order."""
    found: list[Readied] = []
    for stretch in stretches:
        before = found[-1] if found else None
        found.append(Readied(stretch, _ready(stretch, before)))
    return found


def continued(stretches: Sequence[Stretch], window_before: Sequence[Readied]) -> list[Readied]:
    """The same of a window of a record; what goes on from the window before it is ready where it was there."""
    found: list[Readied] = []
    trusted_s = float(stretches[0].seconds[0]) + TRUSTED_S if stretches else 0.0
    for stretch in stretches:
        told = _told(stretch, trusted_s, window_before)
        found.append(Readied(stretch, _ready(stretch, found[-1] if found else None, told)))
    return found


def _told(stretch: Stretch, until_s: float, window_before: Sequence[Readied]) -> tuple[int, bool] | None:
    """The last row of a stretch that the window before it tells of, and whether the tip was ready in it."""
    if stretch.seconds[0] > until_s:
        return None
    row = min(int(np.searchsorted(stretch.seconds, until_s)), len(stretch) - 1)
    moment = float(stretch.seconds[row])
    for part in window_before:
        if part.stretch.seconds[0] - 1e-6 <= moment <= part.stretch.seconds[-1] + 1e-6:
            return row, bool(part.ready[min(int(np.searchsorted(part.stretch.seconds, moment - 1e-6)), len(part.ready) - 1)])
    return None


def _ready(stretch: Stretch, before: Readied | None, told: tuple[int, bool] | None = None) -> Flags:
    """`told` is a row of which it is known, whatever came before it."""
    unknown, setpoint = np.isnan(stretch.setting), stretch.setting
    if unknown.any():
        setpoint = np.where(unknown, np.median(stretch.temperature), setpoint)
    rows = np.arange(len(stretch))
    near = ((stretch.temperature >= setpoint - NEAR_K) & _slow(stretch)) | _stopped(stretch)
    near[0] |= _stays_ready(stretch, before)
    raises = np.diff(setpoint, prepend=setpoint[0]) > 0
    if told is not None:
        row, is_ready = told
        near[: row + 1], raises[: row + 1] = is_ready, not is_ready
    raised = np.maximum.accumulate(np.where(raises, rows, 0))
    return np.asarray(np.maximum.accumulate(np.where(near, rows, -1)) >= raised, dtype=np.bool_)


def _slow(stretch: Stretch) -> Flags:
    """Rows at which the tip has risen little in the time before."""
    back = max(round(SLOW_OVER_S / stretch.period_s), 1)
    risen = np.full(len(stretch), np.inf)
    risen[back:] = stretch.temperature[back:] - stretch.temperature[:-back]
    return np.asarray(risen < SLOW_K_PER_S * max(back * stretch.period_s, SLOW_OVER_S), dtype=np.bool_)


def _stopped(stretch: Stretch) -> Flags:
    """Rows in which a hot tip has not risen for a while."""
    back = max(round(CALM_S / stretch.period_s), 1)
    stopped = np.zeros(len(stretch), dtype=np.bool_)
    temperature = stretch.temperature
    stopped[back:] = (temperature[back:] - temperature[:-back] < CALM_K) & (temperature[back:] > 100.0)
    return stopped


def _stays_ready(stretch: Stretch, before: Readied | None) -> bool:
    if before is None or not before.ready[-1]:
        return False
    short = stretch.seconds[0] - before.stretch.seconds[-1] <= SHORT_GAP_S
    return bool(short and stretch.temperature[0] >= before.stretch.temperature[-1] - NEAR_K)
