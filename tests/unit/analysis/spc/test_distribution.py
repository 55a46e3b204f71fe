"""Fits against scipy's, scores against scipy's distributions, and the tests of Anderson and Darling
against their tables.
"""

from __future__ import annotations

import numpy as np
import pytest

from jbclog.analysis.spc import distribution, fitting, probability_plot
from jbclog.analysis.spc.distribution import (
    FAMILIES,
    MOST_OUTLIERS,
    BoxCox,
    Fit,
    Floats,
    Lognormal,
    Threshold,
    Weibull,
    spread_over_steps,
)
from support.lazy import stats


def test_weibull_as_scipy_fits_it() -> None:
    values = 2.5 * np.random.default_rng(1).weibull(2.2, 100)
    shape, _, scale = stats.weibull_min.fit(values, floc=0)
    fitted = Weibull().fit(values)
    assert (float(fitted[0][0]), float(fitted[1][0])) == pytest.approx((shape, scale), rel=1e-3)
    expected = stats.norm.ppf(
        stats.weibull_min.cdf(values, float(fitted[0][0]), scale=float(fitted[1][0]))
    )
    assert Weibull().scores(fitted, values) == pytest.approx(expected, abs=1e-6)


def test_power_as_scipy_finds_it() -> None:
    values = np.random.default_rng(2).gamma(2, 1, 100)
    assert float(BoxCox().fit(values)[2][0]) == pytest.approx(
        float(stats.boxcox_normmax(values, method="mle")), abs=1e-4
    )


def test_logarithms_above_the_threshold_have_no_skewness() -> None:
    values = 5 + np.random.default_rng(3).lognormal(0, 0.6, 200)
    for side in (1.0, -1.0):
        fitted = Threshold().fit(side * values)
        assert stats.skew(Threshold().scores(fitted, side * values)) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("family", FAMILIES, ids=lambda one: one.name)
def test_scores_and_quantiles_are_inverse(family: Lognormal) -> None:
    values = np.random.default_rng(4).gamma(4, 1, 120)
    fitted = family.fit(values)
    assert family.quantiles(fitted, family.scores(fitted, values)) == pytest.approx(
        values, rel=1e-6
    )
    rows = np.stack([values, values[::-1] * 2])
    many = family.fit(rows)
    # a row is fitted as if alone
    assert [float(one[0, 0]) for one in many] == pytest.approx([float(one[0]) for one in fitted])


def test_weibull_tests_reject_as_often_as_they_say() -> None:
    chances = []
    for seed in range(600):
        values = np.random.default_rng(seed).weibull(1.7, 60)
        chances.append(Weibull().chance(Weibull().fit(values), values))
    assert np.mean(np.array(chances) < 0.05) == pytest.approx(0.05, abs=0.025)


@pytest.mark.parametrize(
    ("values", "name"),
    [
        (np.random.default_rng(5).normal(350, 2, 100), "normal"),
        (np.random.default_rng(6).lognormal(0, 0.5, 100), "lognormal"),
        (np.random.default_rng(7).weibull(1.5, 200), "Weibull"),
        (-5 - np.random.default_rng(8).lognormal(0, 0.5, 200), "lognormal with a threshold"),
    ],
)
def test_a_family_is_found(values: np.ndarray, name: str) -> None:
    found = fitting(values)
    assert found is not None
    assert found.name == name


def test_values_in_steps_are_spread_within_them() -> None:
    values = np.round(np.random.default_rng(9).normal(350, 2, 200))
    spread = spread_over_steps(values, 1.0)
    assert np.abs(spread - values).max() <= 0.5
    assert len(np.unique(spread)) == 200
    assert fitting(values) is None or fitting(values, 1.0) is not None
    assert fitting(values, 1.0) is not None


def test_probability_plot_is_a_line_where_the_family_fits() -> None:
    plot = probability_plot(np.random.default_rng(10).lognormal(0, 0.5, 150))
    assert plot.distribution == "lognormal"
    assert plot.line is not None
    assert np.corrcoef(plot.line, plot.values)[0, 1] > 0.98
    assert (np.diff(plot.values) >= 0).all()


def test_of_many_values_a_few_fits_find_the_outliers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A week of joints: a fit takes tens of milliseconds there, and was made for each of two
    thousand possible outliers.
    """
    fits: list[int] = []
    fit = distribution._fit

    def counted(family: distribution.Family, points: Floats) -> Fit | None:
        fits.append(len(points))
        return fit(family, points)

    monkeypatch.setattr(distribution, "_fit", counted)
    values = np.random.default_rng(7).uniform(1.0, 2.0, 20_000)  # no family fits
    assert fitting(values) is None
    assert len(fits) == len(FAMILIES)
    values[:3] = 40.0, 41.0, 42.0  # far beyond what nothing fits
    assert fitting(values) is None
    values[:60] = np.linspace(6.0, 8.0, 60)  # more than are left out
    assert fitting(values) is None
    assert len(fits) == 3 * len(FAMILIES)


def test_more_than_a_few_outliers_are_a_tail() -> None:
    values = np.random.default_rng(7).normal(100.0, 1.0, 4000)
    few = np.concatenate([values, np.full(MOST_OUTLIERS, 130.0)])
    found = fitting(few)
    assert found is not None
    assert (found.name, found.outliers) == ("normal", MOST_OUTLIERS)
    assert fitting(np.append(few, 130.0)) is None
