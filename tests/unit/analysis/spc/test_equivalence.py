"""Two one-sided tests: equivalent, different, not known; against figures of another way."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from jbclog.analysis.spc import Equivalence, Refused, equivalence
from jbclog.core.errors import UsageError
from support.lazy import stats


def held(first: list[float], second: list[float], margin: float, step: float = 0.0) -> Equivalence:
    found = equivalence(first, second, margin, step=step)
    assert isinstance(found, Equivalence)
    return found


def test_both_one_sided_tests_are_scipys() -> None:
    rng = np.random.default_rng(1)
    first, second = list(rng.normal(0, 1, 14)), list(rng.normal(0.4, 2, 19))
    found = held(first, second, 2.0)
    above = stats.ttest_ind(
        np.array(second) + 2.0, first, equal_var=False, alternative="greater"
    ).pvalue
    below = stats.ttest_ind(
        np.array(second) - 2.0, first, equal_var=False, alternative="less"
    ).pvalue
    assert found.p == pytest.approx(max(above, below))
    interval = stats.ttest_ind(second, first, equal_var=False).confidence_interval(0.90)
    assert (found.low, found.high) == pytest.approx((interval.low, interval.high))
    assert (found.p < 0.05) == (found.verdict == "equivalent")


@pytest.mark.parametrize(
    ("shift", "verdict"),
    [(0.0, "equivalent"), (1.5, "equivalent"), (2.0, "not known"), (4.0, "different")],
)
def test_a_shift_is_told(shift: float, verdict: str) -> None:
    values = [-0.2, 0.1, 0.3, -0.1, 0.0, 0.2, -0.3, 0.1, -0.1, 0.0]
    assert held(values, [value + shift for value in values], 2.0).verdict == verdict
    assert held(values, [value - shift for value in values], 2.0).verdict == verdict


def test_a_wide_spread_is_not_taken_for_sameness() -> None:
    noise = list(np.random.default_rng(2).normal(0, 9, 10))
    assert held(noise, noise[::-1], 1.0).verdict == "not known"


def test_no_more_than_five_in_a_hundred_at_the_margin_itself_are_called_equivalent() -> None:
    rng = np.random.default_rng(3)
    called = [
        held(list(rng.normal(0, 1, 12)), list(rng.normal(2, 1, 12)), 2.0).verdict == "equivalent"
        for _ in range(2000)
    ]
    assert np.mean(called) < 0.05 + 3 * sqrt(0.05 * 0.95 / 2000)


def test_values_that_stand_still_are_known_to_their_step_only() -> None:
    assert held([350.0] * 8, [351.0] * 8, 1.6, step=0.5).verdict == "equivalent"
    assert held([350.0] * 8, [351.0] * 8, 1.4, step=0.5).verdict == "not known"


def test_too_few_are_refused_and_a_margin_is_above_zero() -> None:
    assert isinstance(equivalence([1.0] * 7, [1.0] * 20, 1.0), Refused)
    assert isinstance(equivalence([], [1.0] * 20, 1.0), Refused)
    for margin in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(UsageError):
            equivalence([1.0] * 9, [1.0] * 9, margin)
