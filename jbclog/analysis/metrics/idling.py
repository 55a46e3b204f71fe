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

from jbclog.analysis.joints.figure import Figure, no_figure
from jbclog.analysis.joints.series import RESOLUTION_C, Series
from jbclog.analysis.joints.values import Values
from jbclog.analysis.joints.windows import joined, rows_of
from jbclog.analysis.verdict.idle import (
    ENOUGH_ROWS,
    ENOUGH_S,
    NOT_IDLE,
    Block,
    Floats,
    by_block,
    idle_readings,
)

MEAN_S, LEAST_MEANS, LEAST_DRIFT_S, MOST_MEANS = 10.0, 6, 300.0, 500
FLOOR_C = RESOLUTION_C / sqrt(12)
DECIMALS: Final = 3


class Idling:
    """Idle error, spread, range and drift of a port, from rows added window by window."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._rows: list[Series] = []  # those of an incomplete block
        self._errors = Values(DECIMALS)
        self._cells: list[_Cells] = []

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
            self._errors.add(errors)
            self._cells.append(_cells(seconds, errors))

    def figures(self, coverage: float) -> list[Figure]:
        """Return the figures of all rows added."""
        for held in self._rows:
            self._add(held.rows)
        self._rows.clear()
        errors = self._errors
        if errors.n < ENOUGH_ROWS or errors.n * self._period_s < ENOUGH_S:
            names = (
                ("idle_error_c", "°C"),
                ("idle_sd_c", "°C"),
                ("idle_range_c", "°C"),
                ("drift_c_per_h", "°C/h"),
            )
            return [no_figure(name, unit, NOT_IDLE, errors.n, coverage) for name, unit in names]
        return [
            Figure("idle_error_c", errors.mean, "°C", errors.n, coverage, RESOLUTION_C),
            _spread(errors.sd, errors.n, coverage),
            Figure("idle_range_c", errors.range, "°C", errors.n, coverage, RESOLUTION_C),
            _drift(self._cells, coverage),
        ]


def _spread(spread: float, n: int, coverage: float) -> Figure:
    if spread < FLOOR_C:
        why = (
            "The readings come in whole degrees: a spread below"
            f" {FLOOR_C:.2f} °C cannot be told from none."
        )
        return no_figure("idle_sd_c", "°C", why, n, coverage)
    return Figure("idle_sd_c", spread, "°C", n, coverage, RESOLUTION_C)


def _drift(cells: Sequence[_Cells], coverage: float) -> Figure:
    at, means = _means(cells)
    if len(means) < LEAST_MEANS or at[-1] - at[0] < LEAST_DRIFT_S:
        why = (
            f"A drift takes {LEAST_MEANS} means of {MEAN_S:g} s over {LEAST_DRIFT_S:g} s or more;"
            f" there are {len(means)}."
        )
        return no_figure("drift_c_per_h", "°C/h", why, len(means), coverage)
    every = max(len(means) // MOST_MEANS, 1)
    slope = _theil_sen(at[::every], means[::every]) * 3600.0
    return Figure(
        "drift_c_per_h",
        slope,
        "°C/h",
        len(means),
        coverage,
        FLOOR_C * 3600.0 / float(at[-1] - at[0]),
    )


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
