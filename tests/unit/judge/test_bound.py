"""Bounds of mean and spread: against exact quantiles, and how often they hold for readings that follow each other."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal, stats

from jbclog.judge.bound import FLOOR_C, LEAST_BATCHES, MOST_CELLS, Bound, Cells, chi_squared, known, students_t
from jbclog.judge.idle import IdleError
from jbclog.judge.rule import Result, Rule
from jbclog.judge.rules import bounded

Floats = NDArray[np.float64]
PERIOD_S = 0.1


def of(errors: Floats, seconds: Floats | None = None) -> IdleError:
    idle, at = IdleError(), np.arange(len(errors)) * PERIOD_S if seconds is None else seconds
    for part in np.array_split(np.arange(len(errors)), 7):  # it is fed in blocks
        idle.add(at[part], errors[part], PERIOD_S)
    return idle


def wandering(rng: np.random.Generator, rows: int, alike: float, sd: float) -> Floats:
    """First-order autoregressive readings with this correlation of neighbours and this standard deviation."""
    steps = rng.normal(0, sd * np.sqrt(1 - alike**2), rows)
    steps[0] = rng.normal(0, sd)
    return np.asarray(signal.lfilter([1], [1, -alike], steps), dtype=np.float64)


@pytest.mark.parametrize("freedom", [7, 10, 14, 19])
def test_students_t_is_that_of_the_tables(freedom: int) -> None:
    assert students_t(freedom) == pytest.approx(stats.t.ppf(0.975, freedom), abs=0.001)


@pytest.mark.parametrize("freedom", [6.0, 7.5, 19.0, 200.0, 1e5])
def test_chi_squared_is_that_of_the_tables(freedom: float) -> None:
    assert chi_squared(freedom) == pytest.approx(stats.chi2.ppf(0.05, freedom), rel=0.012)


@pytest.mark.parametrize(("alike", "least"), [(0.0, 0.92), (0.9, 0.92), (0.98, 0.90)])
def test_bounds_hold_as_often_as_they_say(alike: float, least: float) -> None:
    rng, held, spread_held = np.random.default_rng(7), 0, 0
    for _ in range(300):
        bounds = of(wandering(rng, 3000, alike, 2.0) - 1.0).bounds
        assert bounds is not None
        assert bounds.mean.low is not None
        held += bounds.mean.low <= -1.0 <= bounds.mean.high
        spread_held += bounds.sd.high >= 2.0
    assert held / 300 >= least
    assert spread_held / 300 >= least


def test_readings_that_follow_each_other_are_worth_fewer() -> None:
    rng = np.random.default_rng(3)
    independent, alike = (of(wandering(rng, 6000, one, 2.0)).bounds for one in (0.0, 0.98))
    assert independent is not None
    assert alike is not None
    assert independent.mean.n == alike.mean.n == 6000
    assert independent.mean.n_effective > 2000
    assert alike.mean.n_effective < 200  # (1 - 0.98) / (1 + 0.98) × 6000 = 61


def test_a_drift_is_in_the_bound() -> None:
    errors = np.random.default_rng(1).normal(0, 0.5, 6000) + np.linspace(-3, 3, 6000)
    bounds = of(errors).bounds
    assert bounds is not None
    assert bounds.mean.low is not None
    assert bounds.mean.high - bounds.mean.low > 1.0


def test_a_tip_that_stands_still_is_known_to_half_a_step() -> None:
    bounds = of(np.full(600, 2.0)).bounds
    assert bounds is not None
    assert (bounds.mean.low, bounds.mean.high) == (1.5, 2.5)
    assert bounds.sd.high == pytest.approx(FLOOR_C)


def test_too_short_for_a_bound() -> None:
    assert of(np.random.default_rng(1).normal(0, 1, round(LEAST_BATCHES * 3 / PERIOD_S) - 1)).bounds is None
    assert known(10, 0.0, 1.0, np.zeros(LEAST_BATCHES - 1)) is None


def test_a_month_of_readings_stays_small() -> None:
    cells = Cells()
    for day in range(30):
        at = day * 86_400 + np.arange(0, 86_400, 7.0)
        cells.add(at, np.full(len(at), float(day)))
    assert len(cells.counts) <= MOST_CELLS
    means = cells.batch_means(7.0)
    assert len(means) == 20
    assert sorted(means) == list(means)
    assert means.mean() == pytest.approx(14.5, abs=0.1)


def rule(observed: float, result: Result = Result.PASS) -> Rule:
    return Rule("idle_sd", "dde-1", 1, 5.0, observed, "°C", result, "4.8 °C of standard deviation while idle; 5 °C allowed.")


def test_a_bound_beyond_the_limit_is_missing_evidence() -> None:
    found = bounded(rule(4.8), Bound(None, 5.3, 100, 12.0))
    assert found.result is Result.MISSING
    assert found.text.endswith("The 95 % bound reaches 5.3 °C: too little was seen to be sure.")
    assert bounded(rule(4.8), Bound(None, 4.99, 100, 12.0)).result is Result.PASS
    assert bounded(rule(5.2, Result.FAIL), Bound(None, 5.9, 100, 12.0)).result is Result.FAIL
    assert bounded(rule(-4.0), Bound(-5.2, -2.8, 100, 12.0)).result is Result.MISSING
