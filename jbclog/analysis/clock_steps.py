"""Steps of the wall clock in records of earlier versions, and the times of rows corrected for them.

The times of a run do not follow steps (`record/clock_steps.py`), those of earlier versions do. With
``--rate max`` there is no grid, and only UTC gives the interval between two rows. In these versions
the event `clock.step` has no `raw`; its value is the size in s, its time is by the new clock. The
time of the first row after it jumps as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from jbclog.record.clock_steps import COLUMNS, KIND
from jbclog.record.parts import row_groups

Floats = NDArray[np.float64]
# from a step's event to the first row after it; rows are written during an outage too
NEAR_S: Final = 60.0


def nominal_period(seconds: Floats) -> float:
    """Return the median interval of rows in s: the period where there is no grid."""
    return float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0


class Step(NamedTuple):
    """A step of the wall clock: its time by the new clock in s since 1970, and its size in s."""

    at_s: float
    size_s: float


def steps_of(folder: Path) -> list[Step]:
    """Return the steps of the wall clock in a sealed run, oldest first."""
    return steps_in(row_groups(folder, "events", COLUMNS))


def steps_in(events: Iterable[pa.Table]) -> list[Step]:
    """Return the steps among these events, which have `COLUMNS`, that their times follow."""
    steps: list[Step] = []
    for rows in events:
        followed = rows.filter(pc.and_(pc.equal(rows["kind"], KIND), pc.is_null(rows["raw"])))
        times_us = followed["time"].cast("int64").to_pylist()
        for time_us, value in zip(times_us, followed["value"].to_pylist(), strict=True):
            if value:
                steps.append(Step(time_us / 1e6, value))
    return steps


@dataclass(slots=True)
class Unstepped:
    """Corrects the times of one port's rows for the steps; takes them in pieces, oldest first."""

    steps: Sequence[Step]
    _taken: int = 0
    _last: float | None = None

    def of(self, utc_s: Floats) -> Floats:
        """Return the next times in s, corrected for the steps before each."""
        if not len(utc_s) or not self.steps:
            return utc_s
        corrected = utc_s - sum(step.size_s for step in self.steps[: self._taken])
        jumps, first = np.diff(utc_s, prepend=utc_s[0] if self._last is None else self._last), 0
        while (
            self._taken < len(self.steps)
            and (row := _first_after(self.steps[self._taken], utc_s, jumps, first)) is not None
        ):
            corrected[row:] -= self.steps[self._taken].size_s
            self._taken, first = self._taken + 1, row
        self._last = float(utc_s[-1])
        return corrected


def _first_after(step: Step, utc_s: Floats, jumps: Floats, first: int) -> int | None:
    """Return the first row after the step, from row `first` on; None if it is not among these."""
    has_jumped = (jumps * np.sign(step.size_s) >= abs(step.size_s) / 2) & (
        np.abs(utc_s - step.at_s) < NEAR_S
    )
    rows = np.flatnonzero(has_jumped[first:])
    return first + int(rows[0]) if len(rows) else None
