"""Rows that have no grid, on a wall clock that was stepped: their times as if it had never been.

With ``--rate max`` only UTC tells how far two rows are apart. A step of that clock is an event (`clock.step`, its value the size in
seconds, its time by the new clock); the first row behind it is the one whose time jumps with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from jbclog.core.foreign.tables import open_table

Floats = NDArray[np.float64]
NEAR_S: Final = 60.0  # a row is told within seconds of its event; an outage has rows, too


class Step(NamedTuple):
    """A step of the wall clock: when, by the new clock in seconds since 1970, and by how much."""

    at_s: float
    size_s: float


def steps_of(folder: Path) -> list[Step]:
    """The steps of the wall clock in a sealed run, in their order."""
    found = []
    for part in sorted((folder / "events").glob("part-*.parquet")):
        with open_table(part) as table:
            found += [step for events in table.groups(["time", "kind", "value"]) for step in _steps_in(events)]
    return found


def _steps_in(events: pa.Table) -> list[Step]:
    rows = zip(events["time"].cast("int64").to_pylist(), events["kind"].to_pylist(), events["value"].to_pylist(), strict=True)
    return [Step(time / 1e6, value) for time, kind, value in rows if kind == "clock.step" and value]


@dataclass(slots=True)
class Unstepped:
    """Takes the steps out of the times of one port's rows, given piece by piece in their order."""

    steps: Sequence[Step]
    _taken: int = 0
    _last: float | None = None

    def of(self, utc_s: Floats) -> Floats:
        """These times in seconds, less the steps before each."""
        if not len(utc_s) or not self.steps:
            return utc_s
        out = utc_s - sum(step.size_s for step in self.steps[: self._taken])
        jumps, first = np.diff(utc_s, prepend=utc_s[0] if self._last is None else self._last), 0
        while self._taken < len(self.steps) and (place := _behind(self.steps[self._taken], utc_s, jumps, first)) is not None:
            out[place:] -= self.steps[self._taken].size_s
            self._taken, first = self._taken + 1, place
        self._last = float(utc_s[-1])
        return out


def _behind(step: Step, utc_s: Floats, jumps: Floats, first: int) -> int | None:
    """The first row behind the step; None where it is not among these."""
    is_behind = (jumps * np.sign(step.size_s) >= abs(step.size_s) / 2) & (np.abs(utc_s - step.at_s) < NEAR_S)
    places = np.flatnonzero(is_behind[first:])
    return first + int(places[0]) if len(places) else None
