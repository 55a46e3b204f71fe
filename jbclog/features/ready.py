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

from jbclog.features.series import Stretch
from jbclog.judge.idle import Flags

NEAR_K, SLOW_K_PER_S = 30.0, 5.0
SLOW_OVER_S: Final = 0.4
CALM_S, CALM_K = 2.0, 3.0
SHORT_GAP_S: Final = 15.0


@dataclass(frozen=True, slots=True)
class Readied:
    """A stretch, and in which of its rows the tip is ready."""

    stretch: Stretch
    ready: Flags


def readied(stretches: Sequence[Stretch]) -> list[Readied]:
    """The stretches of a port in their order."""
    found: list[Readied] = []
    for stretch in stretches:
        before = found[-1] if found else None
        found.append(Readied(stretch, _ready(stretch, before)))
    return found


def _ready(stretch: Stretch, before: Readied | None) -> Flags:
    unknown = np.isnan(stretch.setting)
    setpoint = np.where(unknown, np.median(stretch.temperature), stretch.setting)
    rows = np.arange(len(stretch))
    near = ((stretch.temperature >= setpoint - NEAR_K) & _slow(stretch)) | _stopped(stretch)
    near[0] |= _stays_ready(stretch, before)
    raised = np.maximum.accumulate(np.where(np.diff(setpoint, prepend=setpoint[0]) > 0, rows, 0))
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
