"""Bounds of mean and spread: the arithmetic against exact figures. How often they hold is in
`test_coverage.py`.
"""

from __future__ import annotations

import numpy as np
import pytest

from jbclog.analysis.verdict.bounds import (
    FLOOR_C,
    LEAST_S,
    MOST_CELLS,
    Bound,
    Bounds,
    Cells,
    bounds_of_cells,
    cosines_for,
)
from jbclog.analysis.verdict.port_rules import judge_bounded
from jbclog.analysis.verdict.rule import Judged, Result
from support.lazy import stats
from support.plants.idle_courses import Floats, bounds_of, idle_of, slow, told

HZ = 10.0


def of(errors: Floats) -> Bounds:
    found = bounds_of(errors, HZ)
    assert isinstance(found, Bounds)
    return found


def width(found: Bounds) -> float:
    assert found.mean.low is not None
    return found.mean.high - found.mean.low


@pytest.mark.parametrize(
    ("minutes", "cosines"), [(5, 5), (10, 5), (11.9, 5), (12, 6), (14, 6), (600, 6)]
)
def test_long_rest_has_more_cosines(minutes: float, cosines: int) -> None:
    assert cosines_for(60 * minutes) == cosines


def test_the_bound_of_the_mean_is_students_t_of_the_slowest_cosines() -> None:
    """Worked out once more from the readings themselves."""
    errors = told(np.random.default_rng(8), slow(3.0)(np.random.default_rng(9), 900, HZ), 0.4, 1.5)
    at = (np.arange(len(errors)) + 0.5) / len(errors)
    projections = [
        float(np.mean(np.sqrt(2) * np.cos(np.pi * number * at) * (errors - errors.mean())))
        for number in range(1, 7)
    ]
    half = stats.t.ppf(0.975, 6) * np.sqrt(np.mean(np.square(projections)))
    found = of(errors)
    assert found.mean.high == pytest.approx(errors.mean() + half, rel=1e-3)
    assert found.half(0.95) == pytest.approx(half, rel=0.01)


def test_readings_that_follow_each_other_are_worth_fewer() -> None:
    rng = np.random.default_rng(3)
    independent = [of(2 * rng.standard_normal(6000)) for _ in range(15)]
    alike = [of(2 * slow(5.0)(rng, 600, HZ)) for _ in range(15)]
    assert {found.mean.n for found in (*independent, *alike)} == {6000}
    assert np.median([found.mean.n_effective for found in independent]) > 1500
    assert np.median([found.mean.n_effective for found in alike]) < 120  # 600 / (2 × 5) = 60
    assert (
        np.median([found.sd.high for found in alike])
        > np.median([found.sd.high for found in independent])
        > 2.0
    )


def test_a_drift_is_in_the_bound() -> None:
    drifting = np.random.default_rng(1).normal(0, 0.5, 6000) + np.linspace(-3, 3, 6000)
    assert width(of(drifting)) > 3.0


def test_the_more_is_seen_the_narrower_the_bound() -> None:
    rng = np.random.default_rng(2)
    widths = [
        np.median([width(of(told(rng, slow(1.0)(rng, seconds, HZ), 0, 1))) for _ in range(25)])
        for seconds in (300, 1200, 4800)
    ]
    assert widths[0] > 1.5 * widths[1] > 2.25 * widths[2]


def test_half_of_the_interval_grows_with_its_level() -> None:
    found = of(np.random.default_rng(4).standard_normal(3600))
    assert found.half(0.5) < found.half(0.9) < found.half(0.95) < found.half(0.999)
    assert found.half(0.95) == pytest.approx(width(found) / 2)


def test_a_tip_that_stands_still_is_known_to_half_a_step() -> None:
    found = of(np.full(3000, 2.0))
    assert (found.mean.low, found.mean.high) == pytest.approx((1.5, 2.5), abs=1e-4)
    assert found.sd.high == pytest.approx(FLOOR_C)


def test_a_tip_between_two_steps_is_known_to_what_they_hide() -> None:
    """One reading in five is a degree higher; a tip that hardly moves may then be anywhere from the
    middle to the edge.
    """
    found = of(np.where(np.arange(6000) % 5 == 0, 1.0, 0.0))
    assert found.mean.high >= 0.499


def test_too_little_for_a_bound() -> None:
    text = bounds_of(np.random.default_rng(1).normal(0, 1, 2995), HZ)
    assert (
        text == "A 95 % bound takes 300 s of the tip at rest, and 15 readings; there are 299.5 s."
    )
    assert isinstance(bounds_of(np.random.default_rng(1).normal(0, 1, 14), 0.01), str)
    assert isinstance(bounds_of_cells(Cells(), LEAST_S - 1, 0.0, 1.0), str)


def test_a_month_of_readings_stays_small_and_its_drift_is_seen() -> None:
    cells = Cells()
    for day in range(30):
        at = day * 86_400 + np.arange(0, 86_400, 7.0)
        cells.add(at, np.full(len(at), float(day)))
    assert len(cells.sums) <= MOST_CELLS
    counts, sums, squares = cells.in_order()
    assert sums.sum() / counts.sum() == pytest.approx(14.5, abs=0.1)
    assert squares.sum() / counts.sum() == pytest.approx(np.mean(np.arange(30.0) ** 2), rel=0.01)
    found = bounds_of_cells(cells, 30 * 86_400.0, 14.5, 8.66)
    assert isinstance(found, Bounds)
    assert width(found) > 5


def test_it_does_not_matter_in_how_many_pieces_they_come() -> None:
    errors = told(np.random.default_rng(6), slow(3.0)(np.random.default_rng(5), 400, HZ), 0.4, 1.5)
    one = idle_of(errors, HZ)
    other = idle_of(errors[:0], HZ)
    for place in range(0, len(errors), 37):
        other.add(
            np.arange(place, min(place + 37, len(errors))) / HZ, errors[place : place + 37], 1 / HZ
        )
    first, second = one.bounds(), other.bounds()
    assert isinstance(first, Bounds)
    assert isinstance(second, Bounds)
    assert (first.mean.high, first.sd.high) == pytest.approx((second.mean.high, second.sd.high))


TEXT = "4.8 °C of standard deviation while idle; 5 °C allowed."


def judged(figure: float, bound: Bound | str, *, bare: bool = False) -> Judged:
    return judge_bounded(figure, 5.0, TEXT, bound, bare=bare)


def test_a_bound_beyond_the_limit_is_missing_evidence() -> None:
    found = judged(4.8, Bound(None, 5.3, 100, 12.0))
    assert found.result is Result.MISSING
    assert found.text.endswith("The 95 % bound is 5.3 °C: a longer record is needed.")
    assert judged(4.8, Bound(None, 4.99, 100, 12.0)).result is Result.PASS
    assert judged(5.2, Bound(None, 5.9, 100, 12.0)).result is Result.FAIL
    assert judged(-4.0, Bound(-5.2, -2.8, 100, 12.0)).result is Result.MISSING


def test_no_bound_is_missing_evidence_unless_figures_are_judged_bare() -> None:
    why = "A 95 % bound takes 300 s."
    assert judged(0.3, why) == Judged(0.3, Result.MISSING, f"{TEXT} {why}")
    assert judged(0.3, why, bare=True) == Judged(0.3, Result.PASS, TEXT)
    assert judged(4.8, Bound(None, 5.3, 100, 12.0), bare=True).result is Result.PASS
    assert judged(5.2, why).result is Result.FAIL
    assert judged(5.2, why, bare=True).result is Result.FAIL
