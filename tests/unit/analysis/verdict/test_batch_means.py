"""The bounds of rules 1 and 2, kept for the runs that were judged by them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from jbclog.analysis.verdict.batch_means import (
    CELL_S,
    LEAST_BATCHES,
    bounds_by_batches,
    chi_squared,
    means_of_batches,
    students_t,
)
from jbclog.analysis.verdict.bounds import MOST_CELLS, Cells
from jbclog.analysis.verdict.idle import IdleError
from support.lazy import stats

PERIOD_S = 0.1


def of(errors: NDArray[np.float64]) -> IdleError:
    idle = IdleError(rules=2)
    idle.add(np.arange(len(errors)) * PERIOD_S, errors, PERIOD_S)
    return idle


@pytest.mark.parametrize("freedom", [7, 10, 14, 19])
def test_students_t_is_that_of_the_tables(freedom: int) -> None:
    assert students_t(freedom) == pytest.approx(stats.t.ppf(0.975, freedom), abs=0.001)


@pytest.mark.parametrize("freedom", [6.0, 7.5, 19.0, 200.0, 1e5])
def test_chi_squared_is_that_of_the_tables(freedom: float) -> None:
    assert chi_squared(freedom) == pytest.approx(stats.chi2.ppf(0.05, freedom), rel=0.012)


def test_readings_of_nothing_but_noise_have_the_bound_of_the_textbook() -> None:
    found = of(np.random.default_rng(3).normal(0, 2.0, 6000)).bounds
    assert found is not None
    mean, sd = found
    assert mean.low is not None
    assert (mean.high - mean.low) / 2 == pytest.approx(1.96 * 2.0 / np.sqrt(6000), rel=0.4)
    assert sd.high == pytest.approx(2.0, rel=0.1)


def test_too_short_for_a_bound() -> None:
    assert (
        of(np.random.default_rng(1).normal(0, 1, round(LEAST_BATCHES * 3 / PERIOD_S) - 1)).bounds
        is None
    )
    assert bounds_by_batches(10, 0.0, 1.0, np.zeros(LEAST_BATCHES - 1)) is None


def test_a_month_of_readings_stays_small() -> None:
    cells = Cells(CELL_S)
    for day in range(30):
        at = day * 86_400 + np.arange(0, 86_400, 7.0)
        cells.add(at, np.full(len(at), float(day)))
    assert len(cells.held) <= MOST_CELLS
    means = means_of_batches(cells, 7.0)
    assert len(means) == 20
    assert sorted(means) == list(means)
    assert means.mean() == pytest.approx(14.5, abs=0.1)
