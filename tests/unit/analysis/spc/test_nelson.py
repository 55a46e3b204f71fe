"""Nelson's tests: a pattern that meets each, one point less that does not, and a slow reading of
the rules beside them.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.analysis.spc import individuals
from jbclog.analysis.spc.nelson import (
    ALL_TESTS,
    DEFAULT_TESTS,
    FALSE_ALARMS,
    TESTS,
    FalseAlarms,
    false_alarms,
    signals,
)

PATTERNS: dict[int, list[float]] = {
    1: [3.1],
    2: [0.5, 0.1, 0.4, 0.2, 0.7, 0.3, 0.6, 0.1, 0.2],
    3: [-1.4, -0.9, -0.3, 0.2, 0.8, 1.1],
    4: [0.5, -0.4, 0.6, -0.5, 0.3, -0.6, 0.7, -0.2, 0.4, -0.3, 0.9, -0.8, 0.2, -0.1],
    5: [2.1, -0.4, 2.3],
    6: [1.2, 1.1, -0.3, 1.4, 1.7],
    7: [0.9, -0.8, -0.2, 0.1, 0.5, -0.6, -0.7, 0.3, 0.2, -0.1, 0.9, 0.4, -0.9, -0.3, 0.8],
    8: [1.2, -1.1, 1.3, 1.4, -1.6, -1.2, 1.1, -1.5],
}


@pytest.mark.parametrize("test", PATTERNS)
def test_the_pattern_meets_it(test: int) -> None:
    pattern = PATTERNS[test]
    (signal,) = [one for one in signals(np.array(pattern)) if one.test == test]
    assert (signal.first, signal.last) == (0, len(pattern) - 1)
    assert signal.text == TESTS[test - 1].text
    mirrored = [one.test for one in signals(-np.array(pattern))]
    assert test in mirrored


@pytest.mark.parametrize("test", [test for test in PATTERNS if test != 1])
def test_a_point_less_does_not(test: int) -> None:
    assert test not in [one.test for one in signals(np.array(PATTERNS[test][1:]))]
    assert test not in [one.test for one in signals(np.array(PATTERNS[test][:-1]))]


def test_points_on_a_line_are_on_no_side() -> None:
    assert signals(np.zeros(30), tests=(1, 2, 3, 4, 5, 6, 8)) == ()
    assert signals(np.array([3.0]), tests=(1,)) == ()
    assert signals(np.array([2.0, 0, 2.0]), tests=(5,)) == ()
    assert signals(np.array([0.5] * 8 + [0.0, 0.5]), tests=(2,)) == ()


def slowly(zones: list[float]) -> set[tuple[int, int]]:
    """The rules as Nelson's figure words them, point by point."""
    found = set()
    for last in range(len(zones)):

        def back(count: int, last: int = last) -> list[float] | None:
            return zones[last - count + 1 : last + 1] if last + 1 >= count else None

        for sign in (1, -1):
            if sign * zones[last] > 3:
                found.add((1, last))
            if (nine := back(9)) and all(sign * one > 0 for one in nine):
                found.add((2, last))
            if (six := back(6)) and all(sign * (b - a) > 0 for a, b in itertools.pairwise(six)):
                found.add((3, last))
            if (
                (three := back(3))
                and sign * zones[last] > 2
                and sum(sign * one > 2 for one in three) >= 2
            ):
                found.add((5, last))
            if (
                (five := back(5))
                and sign * zones[last] > 1
                and sum(sign * one > 1 for one in five) >= 4
            ):
                found.add((6, last))
        if fourteen := back(14):
            steps = [b - a for a, b in itertools.pairwise(fourteen)]
            if all(a * b < 0 for a, b in itertools.pairwise(steps)):
                found.add((4, last))
        if (fifteen := back(15)) and all(abs(one) < 1 for one in fifteen):
            found.add((7, last))
        if (
            (eight := back(8))
            and all(abs(one) > 1 for one in eight)
            and min(eight) < 0 < max(eight)
        ):
            found.add((8, last))
    return found


@given(
    st.lists(
        st.sampled_from([-3.5, -2.5, -1.5, -1.2, -0.5, -0.2, 0.0, 0.2, 0.5, 1.2, 1.5, 2.5, 3.5]),
        max_size=60,
    )
)
def test_as_the_slow_reading_has_it(zones: list[float]) -> None:
    assert {(one.test, one.last) for one in signals(np.array(zones))} == slowly(zones)


@pytest.mark.parametrize("test", [1, 2])
def test_rates_of_a_stable_process(test: int) -> None:
    """How often a pattern begins in normal values, against the rate that the check of stability
    goes by.
    """
    zones = np.random.default_rng(test).normal(size=400_000)
    places = [one.last for one in signals(zones, tests=(test,))]
    begun = sum(b - a > 1 for a, b in zip([-9, *places], places, strict=False))
    assert begun / len(zones) == pytest.approx(TESTS[test - 1].rate or 0, rel=0.1)


def test_the_default_is_four_of_them_and_the_others_are_there() -> None:
    values = np.array(PATTERNS[4] * 3)
    assert 4 not in {one.test for one in individuals(values).signals}
    assert 4 in {one.test for one in individuals(values, ALL_TESTS).signals}
    assert individuals(values).tests == DEFAULT_TESTS == (1, 2, 3, 5)


@pytest.mark.parametrize("tests", [DEFAULT_TESTS, ALL_TESTS])
def test_false_alarms_are_those_that_are_stated(tests: tuple[int, ...]) -> None:
    held(tests, 300, seed=9_001, error=0.15)


@pytest.mark.campaign
@pytest.mark.parametrize("tests", [DEFAULT_TESTS, ALL_TESTS])
def test_campaign_of_false_alarms(
    tests: tuple[int, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    found = held(tests, 10_000, seed=9_002, error=0.03)
    with capsys.disabled():
        print(f"\ntests {tests}: {found.text}; {100 * 10_000} points tried")


def held(tests: tuple[int, ...], series: int, seed: int, error: float) -> FalseAlarms:
    found, stated = false_alarms(tests, series, seed), FALSE_ALARMS[tests]
    assert found.per_100 == pytest.approx(stated.per_100, rel=error)
    assert found.run_length == pytest.approx(stated.run_length, rel=error)
    assert found.series == pytest.approx(stated.series, rel=error)
    return found
