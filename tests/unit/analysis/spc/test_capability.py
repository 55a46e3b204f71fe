"""Capability and gauge studies against worked examples, to the printed digits; each names where it
is printed.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from jbclog.analysis.spc import Capability, capability, gauge_study
from jbclog.analysis.spc.capability import actual_index, indices
from jbclog.core.errors import UsageError


def of_mean_and_sd(mean: float, sd: float, n: int) -> NDArray[np.float64]:
    """Values with exactly that mean and standard deviation."""
    values = np.random.default_rng(n).normal(size=n)
    scaled = (values - values.mean()) / values.std(ddof=1)
    return np.asarray(mean + sd * scaled, dtype=np.float64)


def test_indices_of_nist() -> None:
    """NIST/SEMATECH e-Handbook, 6.1.6 "What is Process Capability": USL 20, LSL 8, mean 16, s 2: Cp
    1.0, Cpk 0.6667, Cpl 1.3333
    """
    both = indices(of_mean_and_sd(16, 2, 50), 8, 20)
    assert both.pp is not None
    assert round(both.pp.value, 4) == 1.0
    assert round(both.ppk.value, 4) == 0.6667
    assert round(indices(of_mean_and_sd(16, 2, 50), 8, None).ppk.value, 4) == 1.3333
    assert indices(of_mean_and_sd(16, 2, 50), 8, None).pp is None


def test_interval_of_montgomery() -> None:
    """Montgomery, example 8.4: limits 38 and 62, n = 20, s = 1.75: Cp 2.29, from 1.57 to 3.01."""
    pp = indices(of_mean_and_sd(50, 1.75, 20), 38, 62).pp
    assert pp is not None
    # it goes on with the rounded 2.29
    assert (pp.value, pp.low, pp.high) == pytest.approx((2.29, 1.57, 3.01), abs=0.0055)


@pytest.mark.parametrize(("n", "bound"), [(10, 0.79), (30, 1.03), (100, 1.17), (300, 1.24)])
def test_bounds_of_a_cpk_of_1_33(n: int, bound: float) -> None:
    """Bissell 1990, one-sided 95 %."""
    assert actual_index(1.33, n, n - 1).bound == pytest.approx(bound, abs=0.006)


def test_the_bound_holds_what_it_says() -> None:
    """Of 2000 studies of a process with a Ppk of 1.33, about 95 % have a bound below it."""
    generator = np.random.default_rng(5)
    bounds = [indices(generator.normal(0, 1, 50), -3.99, 10).ppk.bound for _ in range(2000)]
    assert np.mean(np.array(bounds) < 1.33) == pytest.approx(0.95, abs=0.015)


def test_a_stable_process_has_its_indices() -> None:
    found = capability(
        np.random.default_rng(6).normal(350, 2, 200), lower=340, upper=360, resolution=1
    )
    assert isinstance(found, Capability)
    assert found.cp is not None
    assert found.cp.value == pytest.approx(10 / 6, rel=0.1)
    assert found.cpk.low < found.cpk.bound < found.cpk.value < found.cpk.high


@pytest.mark.parametrize("limits", [{}, {"lower": 3.0, "upper": 3.0}, {"lower": 4.0, "upper": 3.0}])
def test_without_limits_there_is_no_capability(limits: dict[str, float]) -> None:
    with pytest.raises(UsageError, match="limit"):
        capability(np.zeros(50), **limits)


# AIAG, Measurement Systems Analysis: 3 appraisers, 10 parts, 3 trials; the figures are those of its
# analysis of variance, and of the same data in Minitab's help ("Gageaiag")
AIAG = np.array(
    [
        [0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36],
        [0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25],
        [0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31],
        [0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68],
        [0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62],
        [0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50],
        [0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49],
        [-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77],
        [-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16],
    ]
).reshape(3, 3, 10)  # appraiser, trial, part
CROSSED = AIAG.transpose(2, 0, 1)


def test_the_study_of_aiag() -> None:
    study = gauge_study(CROSSED)
    assert [(one.name, round(one.squares, 4), one.freedom) for one in study.table] == [
        ("parts", 88.3619, 9),
        ("operators", 3.1673, 2),
        ("repeatability", 3.1179, 78),
    ]
    parts, operators, rest = study.table
    assert (round(parts.f or 0, 3), round(operators.f or 0, 3), round(rest.mean_square, 5)) == (
        245.614,
        39.617,
        0.03997,
    )
    assert round(study.repeatability, 6) == 0.199933
    assert round(study.reproducibility, 6) == 0.226838
    assert study.gauge == pytest.approx(0.302373, abs=2e-6)
    assert round(study.parts, 5) == 1.04233
    assert round(study.total, 5) == 1.08530
    assert [
        round(study.percent(one), 2)
        for one in (study.gauge, study.repeatability, study.reproducibility, study.parts)
    ] == [*(27.86, 18.42, 20.90, 96.04)]
    assert study.categories == 4
    assert study.verdict == "marginal"
    assert study.notes == ("The interaction is not significant and is pooled with repeatability.",)


def test_an_interaction_that_matters_is_not_pooled() -> None:
    data = CROSSED.copy()
    data[::2, 0] += 0.8  # the first appraiser measures every other part otherwise
    study = gauge_study(data)
    assert [one.name for one in study.table] == [
        "parts",
        "operators",
        "operators × parts",
        "repeatability",
    ]
    assert study.notes == () or "below zero" in study.notes[0]
    assert study.table[2].chance is not None
    assert study.table[2].chance < 0.01


def test_a_variance_below_zero_counts_as_zero_and_is_said() -> None:
    data = np.random.default_rng(7).normal(0, 1, (10, 3, 3)) + np.arange(10)[:, None, None]
    data -= data.mean(axis=(0, 2), keepdims=True)  # appraisers that agree better than chance would
    study = gauge_study(data)
    assert study.reproducibility == 0
    assert any("operators came out below zero" in note for note in study.notes)


def test_a_gauge_that_sees_no_difference_is_unacceptable() -> None:
    study = gauge_study(np.random.default_rng(8).normal(0, 1, (10, 3, 3)))
    assert study.verdict == "unacceptable"


def test_a_gauge_that_sees_every_difference_is_acceptable() -> None:
    data = np.random.default_rng(9).normal(0, 0.1, (10, 3, 3)) + 10 * np.arange(10)[:, None, None]
    assert gauge_study(data).verdict == "acceptable"


@pytest.mark.parametrize(
    "data", [np.zeros((10, 3)), np.zeros((1, 3, 3)), np.full((4, 2, 2), np.nan)]
)
def test_what_is_no_crossed_study_is_refused(data: NDArray[np.float64]) -> None:
    with pytest.raises(UsageError):
        gauge_study(data)
