"""Capability against worked examples, to the printed digits; each names where it is printed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from jbclog.analysis.spc import Capability, capability
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
