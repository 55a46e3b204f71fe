"""Partial statistics merge to the same last digit in any order, and are those of exact
arithmetic.
"""

from __future__ import annotations

import math
import pickle
import statistics
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from jbclog.analysis.fleet.moments import QUANTILE_ERROR, Moments, moments_of

ANY = st.lists(st.floats(), max_size=60)
LIKELY = st.lists(st.floats(-1000, 1000), min_size=2, max_size=200)


def of(values: list[float]) -> Moments:
    (found,) = moments_of(
        np.array(values, np.float64),
        np.ones(len(values), np.int64),
        np.zeros(len(values), np.int64),
        1,
    )
    return found


@given(ANY)
@example(
    [5e-324, -5e-324, 2.2250738585072014e-308, 1.7976931348623157e308, -0.0, math.nan, math.inf]
)
@settings(max_examples=150)
def test_sums_are_those_of_fractions(values: list[float]) -> None:
    known = [Fraction(one) for one in values if math.isfinite(one)]
    found = of(values)
    assert (found.n, found.unknown) == (len(known), len(values) - len(known))
    assert found.total == sum(known) * 2**1074
    assert found.squares == sum(one * one for one in known) * 2**2148
    assert (found.least, found.greatest) == (min(known, default=None), max(known, default=None))


@given(ANY, st.randoms(use_true_random=False), st.integers(1, 7))
@settings(max_examples=80)
def test_any_order_and_any_division_give_the_same(
    values: list[float], chance: object, parts: int
) -> None:
    shuffled = [*values]
    chance.shuffle(shuffled)  # type: ignore[attr-defined]  # of random.Random
    found = Moments()
    for part in range(parts):
        found.add(pickle.loads(pickle.dumps(of(shuffled[part::parts]))))
    assert found == of(values)
    assert repr([found.least, found.greatest, found.mean, found.sd]) == repr(
        [*_figures(of(values))]
    )


def _figures(one: Moments) -> tuple[float | None, ...]:
    return one.least, one.greatest, one.mean, one.sd


@given(LIKELY)
def test_mean_and_standard_deviation_are_rounded_from_the_exact_ones(values: list[float]) -> None:
    exact = [Fraction(one) for one in values]
    found = of(values)
    assert found.mean == float(sum(exact) / len(exact))
    assert found.sd == math.sqrt(float(statistics.variance(exact)))


@given(LIKELY, st.integers(0, 100))
@example([0.0, 1.0], 50)
def test_a_quantile_is_as_near_as_is_stated(values: list[float], percent: int) -> None:
    true = sorted(values)[max(1, math.ceil(Fraction(len(values) * percent, 100))) - 1]
    (found,) = of(values).quantiles([percent])
    assert found is not None
    assert abs(found - true) <= QUANTILE_ERROR * abs(true) + 2.0**-1022


def test_values_that_occur_many_times_count_so_often() -> None:
    values, counts, groups = (
        np.array([350.25, -0.1, np.nan]),
        np.array([30_000, 2, 5]),
        np.array([1, 0, 1]),
    )
    first, second = moments_of(values, counts, groups, 2)
    assert (first.n, first.total) == (2, Fraction(-0.1) * 2 * 2**1074)
    assert (second.n, second.unknown, second.total) == (
        30_000,
        5,
        Fraction(350.25) * 30_000 * 2**1074,
    )
    assert (second.sd, second.squares) == (0.0, Fraction(350.25) ** 2 * 30_000 * 2**2148)
    assert second.bins == dict.fromkeys(of([350.25]).bins, 30_000)


def test_the_largest_count_at_once_is_exact_and_more_are_refused() -> None:
    most = math.nextafter(2.0, 0.0)  # all bits of its mantissa are set
    (found,) = moments_of(np.array([most]), np.array([65_536]), np.array([0]), 1)
    assert found.squares == Fraction(most) ** 2 * 65_536 * 2**2148
    with pytest.raises(ValueError, match="at most 65536 at once"):
        moments_of(np.array([most]), np.array([65_537]), np.array([0]), 1)


def test_nothing_has_no_figures() -> None:
    assert of([0.0, 0.0, 5.0]).quantiles([5]) == [0.0]
    nothing = of([math.nan])
    assert (nothing.mean, nothing.sd, nothing.quantiles([50])) == (None, None, [None])
    assert of([1e308, -1e308]).sd is None  # above the largest double
