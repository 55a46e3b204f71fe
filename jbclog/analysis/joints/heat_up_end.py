"""When a tip is ready to solder: the end of its heat-up.

A tip is ready once it has come within `NEAR_K` of its setpoint and rises slower than
`SLOW_K_PER_S`, since it began to work or since its setpoint was last raised; or once it has stopped
rising for `CALM_S`, because a tip that never reaches its setpoint is used, too. Across a short gap
of the record, and across a stand that left the tip warm, it stays ready if it is not much colder
than before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jbclog.analysis.joints.series import Stretch
from jbclog.analysis.port_data import Flags

NEAR_K, SLOW_K_PER_S = 30.0, 5.0
SLOW_FOR_S: Final = 0.4
CALM_S, CALM_K = 2.0, 3.0
SHORT_GAP_S: Final = 15.0
TRUSTED_S: Final = 20.0  # this long after a window's first reading, the window before decides


@dataclass(frozen=True, slots=True)
class ReadyStretch:
    """A stretch, and its rows in which the tip is ready."""

    stretch: Stretch
    ready: Flags

    @property
    def start_s(self) -> float:
        return float(self.stretch.seconds[0])

    @property
    def length_s(self) -> float:
        return len(self.stretch) * self.stretch.period_s


def ready_stretches(stretches: Sequence[Stretch]) -> list[ReadyStretch]:
    """Return the stretches of a port, in order of time, with their ready rows."""
    found: list[ReadyStretch] = []
    for stretch in stretches:
        before = found[-1] if found else None
        found.append(ReadyStretch(stretch, _ready(stretch, before)))
    return found


def ready_stretches_of_window(
    stretches: Sequence[Stretch], window_before: Sequence[ReadyStretch]
) -> list[ReadyStretch]:
    """Return the stretches of one window of a record with their ready rows.

    A stretch that continues from the window before is ready where it was ready there.
    """
    found: list[ReadyStretch] = []
    trusted_s = float(stretches[0].seconds[0]) + TRUSTED_S if stretches else 0.0
    for stretch in stretches:
        known_row = _last_known_row(stretch, trusted_s, window_before)
        found.append(
            ReadyStretch(stretch, _ready(stretch, found[-1] if found else None, known_row))
        )
    return found


def _last_known_row(
    stretch: Stretch, until_s: float, window_before: Sequence[ReadyStretch]
) -> tuple[int, bool] | None:
    """Return the last row of a stretch that the window before contains, and whether the tip was
    ready in it; or None.
    """
    if stretch.seconds[0] > until_s:
        return None
    row = min(int(np.searchsorted(stretch.seconds, until_s)), len(stretch) - 1)
    moment = float(stretch.seconds[row])
    for part in window_before:
        if part.stretch.seconds[0] - 1e-6 <= moment <= part.stretch.seconds[-1] + 1e-6:
            return row, bool(
                part.ready[
                    min(
                        int(np.searchsorted(part.stretch.seconds, moment - 1e-6)),
                        len(part.ready) - 1,
                    )
                ]
            )
    return None


def _ready(
    stretch: Stretch, before: ReadyStretch | None, known_row: tuple[int, bool] | None = None
) -> Flags:
    """Return the rows in which the tip is ready; `known_row` overrides everything before that
    row.
    """
    unknown, setpoint = np.isnan(stretch.setting), stretch.setting
    if unknown.any():
        setpoint = np.where(unknown, np.median(stretch.temperature), setpoint)
    rows = np.arange(len(stretch))
    near = (
        (stretch.temperature >= setpoint - NEAR_K) & _rises_slowly(stretch)
    ) | _has_stopped_rising(stretch)
    near[0] |= _stays_ready(stretch, before)
    raises = np.diff(setpoint, prepend=setpoint[0]) > 0
    if known_row is not None:
        row, is_ready = known_row
        near[: row + 1], raises[: row + 1] = is_ready, not is_ready
    raised = np.maximum.accumulate(np.where(raises, rows, 0))
    return np.asarray(np.maximum.accumulate(np.where(near, rows, -1)) >= raised, dtype=np.bool_)


def _rises_slowly(stretch: Stretch) -> Flags:
    """Return the rows before which the tip has risen little."""
    back = max(round(SLOW_FOR_S / stretch.period_s), 1)
    risen = np.full(len(stretch), np.inf)
    risen[back:] = stretch.temperature[back:] - stretch.temperature[:-back]
    return np.asarray(
        risen < SLOW_K_PER_S * max(back * stretch.period_s, SLOW_FOR_S), dtype=np.bool_
    )


def _has_stopped_rising(stretch: Stretch) -> Flags:
    """Return the rows before which a hot tip has not risen for a while."""
    back = max(round(CALM_S / stretch.period_s), 1)
    stopped = np.zeros(len(stretch), dtype=np.bool_)
    temperature = stretch.temperature
    stopped[back:] = (temperature[back:] - temperature[:-back] < CALM_K) & (
        temperature[back:] > 100.0
    )
    return stopped


def _stays_ready(stretch: Stretch, before: ReadyStretch | None) -> bool:
    """Return whether the tip was ready in the stretch before and is still about as warm."""
    if before is None or not before.ready[-1]:
        return False
    short = stretch.seconds[0] - before.stretch.seconds[-1] <= SHORT_GAP_S
    return bool(short and stretch.temperature[0] >= before.stretch.temperature[-1] - NEAR_K)
