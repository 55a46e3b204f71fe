"""The idle tip: its error, spread and drift.

The verdict (`analysis/verdict/idle.py`) defines which readings are idle, in the same blocks of ten
minutes, so these figures equal the verdict's. *Idle error* is the mean of temperature minus
setting, *idle spread* its standard deviation, *range* its highest minus its lowest. *Drift* is the
Theil-Sen slope (the median of the slopes between all pairs; H. Theil 1950, P. K. Sen 1968) of the
means of the idle readings of each `MEAN_S`, per hour; it needs `LEAST_MEANS` of them,
`LEAST_DRIFT_S` apart.

Idle readings have no single window: they come from stretches without a gap, and each stretch has to
settle again. `coverage` is the share of the run's rows whose temperature was read. A spread below
the resolution divided by √12 is that of the resolution, not of the tip; it has no value, because
the true one may be anything up to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np

from jbclog.analysis.joints.series import RESOLUTION_C, Series
from jbclog.analysis.joints.values import Values
from jbclog.analysis.joints.windows import joined, rows_of
from jbclog.analysis.metrics.metric import Basis, Value, metric, not_known
from jbclog.analysis.port_data import Floats
from jbclog.analysis.verdict.idle import (
    ENOUGH_ROWS,
    ENOUGH_S,
    NOT_IDLE,
    Block,
    by_block,
    idle_readings,
)

MEAN_S, LEAST_MEANS, LEAST_DRIFT_S, MOST_MEANS = 10.0, 6, 300.0, 500
FLOOR_C = RESOLUTION_C / sqrt(12)
DECIMALS: Final = 3


class Idling:
    """The idle readings of a port, from rows added window by window."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._rows: list[Series] = []  # those of an incomplete block
        self.errors = Values(DECIMALS)
        self.cells: list[_Cells] = []

    def take(self, series: Series) -> None:
        if not len(series.seconds):
            return
        held = joined([*self._rows, series])
        *complete, (_, last) = by_block(held.seconds)
        for _, rows in complete:
            self._add(held.rows.take(rows))
        self._rows = [rows_of(held, last)]

    def _add(self, block: Block) -> None:
        seconds, errors = idle_readings(block, self._period_s)
        if len(errors):
            self.errors.add(errors)
            self.cells.append(_cells(seconds, errors))

    def end(self) -> None:
        """End: there are no more rows."""
        for rest in self._rows:
            self._add(rest.rows)
        self._rows.clear()

    @property
    def is_too_short(self) -> bool:
        return self.errors.n < ENOUGH_ROWS or self.errors.n * self._period_s < ENOUGH_S


def _not_idle(port: Basis) -> Value:
    return not_known(NOT_IDLE, port.idling.errors.n, port.totals.temperature.coverage)


@metric(
    "idle_error_c",
    "°C",
    "Mean of temperature minus setting of the idle readings, which the verdict defines.",
)
def idle_error_c(port: Basis) -> Value:
    errors = port.idling.errors
    if port.idling.is_too_short:
        return _not_idle(port)
    return Value(errors.mean, errors.n, port.totals.temperature.coverage, RESOLUTION_C)


@metric(
    "idle_sd_c",
    "°C",
    "Standard deviation of temperature minus setting of the idle readings; none below the"
    " resolution divided by √12.",
)
def idle_sd_c(port: Basis) -> Value:
    errors, coverage = port.idling.errors, port.totals.temperature.coverage
    if port.idling.is_too_short:
        return _not_idle(port)
    if errors.sd < FLOOR_C:
        why = (
            "The readings come in whole degrees: a spread below"
            f" {FLOOR_C:.2f} °C cannot be told from none."
        )
        return not_known(why, errors.n, coverage)
    return Value(errors.sd, errors.n, coverage, RESOLUTION_C)


@metric(
    "idle_range_c",
    "°C",
    "Highest minus lowest of temperature minus setting of the idle readings.",
)
def idle_range_c(port: Basis) -> Value:
    errors = port.idling.errors
    if port.idling.is_too_short:
        return _not_idle(port)
    return Value(errors.range, errors.n, port.totals.temperature.coverage, RESOLUTION_C)


@metric(
    "drift_c_per_h",
    "°C/h",
    f"Theil-Sen slope of the idle error's means over {MEAN_S:g} s each; {LEAST_MEANS} means"
    f" over {LEAST_DRIFT_S:g} s at least.",
)
def drift_c_per_h(port: Basis) -> Value:
    coverage = port.totals.temperature.coverage
    if port.idling.is_too_short:
        return _not_idle(port)
    at, means = _means(port.idling.cells)
    if len(means) < LEAST_MEANS or at[-1] - at[0] < LEAST_DRIFT_S:
        why = (
            f"A drift takes {LEAST_MEANS} means of {MEAN_S:g} s over {LEAST_DRIFT_S:g} s or more;"
            f" there are {len(means)}."
        )
        return not_known(why, len(means), coverage)
    every = max(len(means) // MOST_MEANS, 1)
    slope = _theil_sen(at[::every], means[::every]) * 3600.0
    return Value(slope, len(means), coverage, FLOOR_C * 3600.0 / float(at[-1] - at[0]))


def _theil_sen(x: Floats, y: Floats) -> float:
    """Return the median slope of all pairs. With numpy: importing scipy.stats takes most of a
    second.
    """
    one, other = np.triu_indices(len(x), 1)
    return float(np.median((y[other] - y[one]) / (x[other] - x[one])))


@dataclass(frozen=True, slots=True)
class _Cells:
    """The idle readings of each `MEAN_S` that has any: its number, the sums of their seconds and
    errors, and their count.
    """

    number: Floats
    seconds: Floats
    errors: Floats
    count: Floats


def _cells(seconds: Floats, errors: Floats) -> _Cells:
    number, place, count = np.unique(
        np.floor_divide(seconds, MEAN_S), return_inverse=True, return_counts=True
    )
    columns = (
        np.asarray(one, dtype=np.float64)
        for one in (np.bincount(place, seconds), np.bincount(place, errors), count)
    )
    return _Cells(number, *columns)


def _means(cells: Sequence[_Cells]) -> tuple[Floats, Floats]:
    """Return the mean moment and the mean error of each cell."""
    columns = (
        [getattr(one, name) for one in cells] for name in ("number", "seconds", "errors", "count")
    )
    numbers, *sums = (np.concatenate(column) for column in columns)
    # a cell on the edge of two blocks is in both
    first = np.flatnonzero(np.diff(numbers, prepend=-np.inf))
    seconds, errors, count = (np.add.reduceat(column, first) for column in sums)
    return seconds / count, errors / count
