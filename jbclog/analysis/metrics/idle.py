"""The idle tip: its error, its spread, its drift.

Definitions. Which readings are idle is the verdict's definition (`judge.idle`), in the same blocks of ten minutes, so that these
figures and the verdict's are the same. *Idle error*: mean of temperature minus setting. *Idle spread*: its standard deviation;
*range*: its highest minus its lowest. *Drift*: the Theil-Sen slope (the median of the slopes between all pairs; H. Theil 1950,
P. K. Sen 1968) of the means of the idle readings of each `MEAN_S`, over an hour; it takes `LEAST_MEANS` of them, `LEAST_DRIFT_S`
apart.

Idle readings have no one window: they are taken from stretches without a gap, each of which has to settle anew. `coverage` is
the share of the run's rows whose temperature was read. A spread below the resolution divided by √12 is the resolution's, not
the tip's; then there is no value, since the true one may be anything up to it.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import sqrt

import numpy as np

from jbclog.analysis.joints.figure import Figure, no_figure
from jbclog.analysis.joints.series import RESOLUTION_C, Series
from jbclog.analysis.verdict.idle import BLOCK_S, ENOUGH_ROWS, ENOUGH_S, NOT_IDLE, Floats, idle_readings

MEAN_S, LEAST_MEANS, LEAST_DRIFT_S, MOST_MEANS = 10.0, 6, 300.0, 500
FLOOR_C = RESOLUTION_C / sqrt(12)


def idling(series: Series) -> list[Figure]:
    """Idle error, spread, range and drift of a port."""
    seconds, errors = _idle(series)
    coverage = series.whole(series.rows.temperature).coverage
    if len(errors) < ENOUGH_ROWS or len(errors) * series.period_s < ENOUGH_S:
        names = (("idle_error_c", "°C"), ("idle_sd_c", "°C"), ("idle_range_c", "°C"), ("drift_c_per_h", "°C/h"))
        return [no_figure(name, unit, NOT_IDLE, len(errors), coverage) for name, unit in names]
    return [
        Figure("idle_error_c", float(errors.mean()), "°C", len(errors), coverage, RESOLUTION_C),
        _spread(errors, coverage),
        Figure("idle_range_c", float(np.ptp(errors)), "°C", len(errors), coverage, RESOLUTION_C),
        _drift(seconds, errors, coverage),
    ]


def _idle(series: Series) -> tuple[Floats, Floats]:
    blocks = list(_blocks(series))
    if not blocks:
        return np.empty(0), np.empty(0)
    return np.concatenate([seconds for seconds, _ in blocks]), np.concatenate([errors for _, errors in blocks])


def _blocks(series: Series) -> Iterator[tuple[Floats, Floats]]:
    numbers = np.floor_divide(series.seconds + 1e-6, BLOCK_S)
    for number in np.unique(numbers):
        yield idle_readings(series.rows.take(numbers == number), series.period_s)


def _spread(errors: Floats, coverage: float) -> Figure:
    spread = float(errors.std(ddof=1))
    if spread < FLOOR_C:
        why = f"The readings come in whole degrees: a spread below {FLOOR_C:.2f} °C cannot be told from none."
        return no_figure("idle_sd_c", "°C", why, len(errors), coverage)
    return Figure("idle_sd_c", spread, "°C", len(errors), coverage, RESOLUTION_C)


def _drift(seconds: Floats, errors: Floats, coverage: float) -> Figure:
    at, means = _means(seconds, errors)
    if len(means) < LEAST_MEANS or at[-1] - at[0] < LEAST_DRIFT_S:
        why = f"A drift takes {LEAST_MEANS} means of {MEAN_S:g} s over {LEAST_DRIFT_S:g} s or more; there are {len(means)}."
        return no_figure("drift_c_per_h", "°C/h", why, len(means), coverage)
    every = max(len(means) // MOST_MEANS, 1)
    slope = _theil_sen(at[::every], means[::every]) * 3600.0
    return Figure("drift_c_per_h", slope, "°C/h", len(means), coverage, FLOOR_C * 3600.0 / float(at[-1] - at[0]))


def _theil_sen(x: Floats, y: Floats) -> float:
    """The median of the slopes between all pairs, by numpy: scipy.stats takes most of a second to load."""
    one, other = np.triu_indices(len(x), 1)
    return float(np.median((y[other] - y[one]) / (x[other] - x[one])))


def _means(seconds: Floats, errors: Floats) -> tuple[Floats, Floats]:
    """The mean moment and error of each `MEAN_S` that has idle readings."""
    _, place, count = np.unique(np.floor_divide(seconds, MEAN_S), return_inverse=True, return_counts=True)
    return np.bincount(place, seconds) / count, np.bincount(place, errors) / count
