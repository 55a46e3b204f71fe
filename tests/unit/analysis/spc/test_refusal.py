"""What would mislead is refused, with the reason in a sentence; what would not is given."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from jbclog.analysis.spc import Refused, capability, control_chart, individuals, subgroup_charts
from jbclog.analysis.spc.distribution import _distance_from_normal, chance_of_normal
from jbclog.analysis.spc.refusal import lag_1
from jbclog.core.errors import UsageError
from support.lazy import stats

Floats = NDArray[np.float64]


def normal(n: int, sd: float = 2.0, seed: int = 1) -> Floats:
    return np.random.default_rng(seed).normal(350, sd, n)


def alike(n: int, share: float, seed: int = 2) -> Floats:
    """Values whose neighbours are alike: each is a share of the one before."""
    noise = np.random.default_rng(seed).normal(size=n)
    values = np.zeros(n)
    for place in range(1, n):
        values[place] = share * values[place - 1] + noise[place]
    return values


def reason(found: object) -> str:
    assert isinstance(found, Refused)
    assert found.text.endswith(".")
    return found.kind


def test_too_few() -> None:
    assert reason(control_chart(normal(19))) == "too_few"
    assert not isinstance(control_chart(normal(20)), Refused)
    assert reason(capability(normal(29), lower=340)) == "too_few"
    assert reason(subgroup_charts(normal(95).reshape(19, 5))) == "too_few"


def test_an_infinite_value_is_an_error_and_not_left_out() -> None:
    with pytest.raises(UsageError, match="division by zero"):
        capability([1.0, 2.0, math.inf], upper=3.0)


def test_values_that_were_not_read_do_not_count() -> None:
    values = normal(40)
    values[::2] = np.nan
    assert not isinstance(control_chart(values), Refused)
    values[1] = np.nan
    assert reason(control_chart(values)) == "too_few"


@pytest.mark.parametrize("share", [0.5, 0.9, 0.98])
def test_neighbours_that_are_alike(share: float) -> None:
    values = alike(500, share)
    assert reason(control_chart(values)) == "autocorrelated"
    assert reason(capability(values, lower=-20, upper=20)) == "autocorrelated"
    beyond = {one.last for one in individuals(values).signals if one.test == 1}
    assert len(beyond) / len(values) > 0.01  # what it would have said: stable processes give 0.0027


def test_raw_samples_of_a_tip_are_refused() -> None:
    """A temperature at 10 Hz, slower than its samples, in whole degrees."""
    values = np.round(350 + 3 * alike(600, 0.97))
    assert reason(control_chart(values, resolution=1)) == "autocorrelated"


def test_chance_is_no_likeness() -> None:
    refused = sum(isinstance(control_chart(normal(25, seed=seed)), Refused) for seed in range(200))
    assert refused <= 6  # 1 % by construction


def test_a_spread_below_the_resolution() -> None:
    values = np.round(normal(100, sd=0.15))
    assert reason(control_chart(values, resolution=1)) == "unresolved"
    assert reason(capability(values, lower=340, upper=360, resolution=1)) == "unresolved"
    assert reason(capability(np.full(50, 350.0), lower=340)) == "unresolved"
    assert not isinstance(control_chart(np.round(normal(100, sd=3)), resolution=1), Refused)


def test_halves_that_rounding_makes_a_spread_of() -> None:
    """350.5 ± 0.15 rounds to 350 and 351: a standard deviation of a half that no tip has."""
    values = np.round(np.random.default_rng(3).normal(350.5, 0.15, 200))
    assert values.std() > 1 / np.sqrt(12)
    assert reason(capability(values, lower=340, upper=360, resolution=1)) == "unresolved"


def test_a_process_that_is_not_stable() -> None:
    stepped = normal(100)
    stepped[50] += 14
    assert reason(capability(stepped, lower=300, upper=400)) == "unstable"
    sides = np.concatenate([normal(45) + 1.3, normal(45, seed=5) - 1.3])
    assert reason(capability(sides, lower=300, upper=400)) in ("unstable", "autocorrelated")


def test_a_long_stable_series_is_stable() -> None:
    """Of 5000 values some are beyond three sigma; that alone is no reason."""
    values = normal(5000, seed=11)
    assert any(one.test == 1 for one in individuals(values).signals)
    assert not isinstance(capability(values, lower=330, upper=370), Refused)


def test_values_that_are_not_normal() -> None:
    assert (
        reason(capability(np.random.default_rng(4).uniform(0, 1, 400), lower=-1, upper=2))
        == "not_normal"
    )


def test_anderson_darling_as_scipy_has_it() -> None:
    """At scipy's critical values the chance is the one that they are for (Stephens)."""
    for seed in range(300):
        values = np.random.default_rng(seed).normal(size=60)
        a = stats.anderson(values, "norm", method="interpolate").statistic * (
            1 + 0.75 / 60 + 2.25 / 3600
        )
        for critical, chance in ((0.631, 0.10), (0.752, 0.05), (1.035, 0.01)):
            ours = chance_of_normal(_distance_from_normal(values))
            assert (ours < chance) == (a > critical) or abs(a - critical) < 0.02


def test_lag_1_is_the_correlation_with_the_next() -> None:
    assert lag_1(np.array([1.0, -1.0] * 50)) == pytest.approx(-0.99)
    assert lag_1(alike(20_000, 0.7)) == pytest.approx(0.7, abs=0.02)
