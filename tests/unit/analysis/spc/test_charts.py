"""Charts against printed tables and worked examples, to the printed digits; each names where it is
printed.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from jbclog.analysis.spc import (
    control_chart,
    cusum,
    ewma,
    individuals,
    means,
    means_by_sd,
    moving_ranges,
    ranges,
    rates,
    sds,
    shares,
)
from jbclog.analysis.spc.charts import c4, d2, d3

# Montgomery, Introduction to Statistical Quality Control, appendix VI; the same in ASTM E2587
PRINTED = {  # n: c4, d2, d3, A2, D3, D4
    2: (0.7979, 1.128, 0.853, 1.880, 0.0, 3.267),
    3: (0.8862, 1.693, 0.888, 1.023, 0.0, 2.574),
    4: (0.9213, 2.059, 0.880, 0.729, 0.0, 2.282),
    5: (0.9400, 2.326, 0.864, 0.577, 0.0, 2.114),
    6: (0.9515, 2.534, 0.848, 0.483, 0.0, 2.004),
    7: (0.9594, 2.704, 0.833, 0.419, 0.076, 1.924),
    8: (0.9650, 2.847, 0.820, 0.373, 0.136, 1.864),
    9: (0.9693, 2.970, 0.808, 0.337, 0.184, 1.816),
    10: (0.9727, 3.078, 0.797, 0.308, 0.223, 1.777),
}


@pytest.mark.parametrize("n", PRINTED)
def test_constants_as_printed(n: int) -> None:
    c, mean, sd, a2, low, high = PRINTED[n]
    assert round(c4(n), 4) == c
    assert round(d2(n), 3) == mean
    assert round(d3(n), 3) == sd
    assert round(3 / (d2(n) * sqrt(n)), 3) == a2
    assert max(1 - 3 * d3(n) / d2(n), 0) == pytest.approx(low, abs=6e-4)
    # the tables divide rounded figures
    assert 1 + 3 * d3(n) / d2(n) == pytest.approx(high, abs=1.1e-3)


# NIST/SEMATECH e-Handbook, 6.3.2.2 "Individuals Control Charts": flow rates of ten batches
FLOW_RATES = [49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1]


def test_individuals_of_nist() -> None:
    chart = individuals(FLOW_RATES)
    assert round(chart.centre, 2) == 50.81
    assert round(moving_ranges(FLOW_RATES).centre, 4) == 1.8778
    assert chart.upper[0] == pytest.approx(55.8041, abs=2e-3)  # printed with 1.128 for d2
    assert chart.lower[0] == pytest.approx(45.8159, abs=2e-3)
    assert chart.signals == ()


# NIST/SEMATECH e-Handbook, 6.3.2.4 "EWMA Control Charts": EWMA0 = 50, s = 2.0539, lambda = 0.3
EWMA_DATA = [
    52.0,
    47.0,
    53.0,
    49.3,
    50.1,
    47.0,
    51.0,
    50.1,
    51.2,
    50.5,
    49.6,
    47.6,
    49.9,
    51.3,
    47.8,
    51.2,
    52.6,
    52.4,
    53.6,
    52.1,
]
EWMA_PRINTED = [
    *(50.60, 49.52, 50.56, 50.18, 50.16, 49.21, 49.75, 49.85, 50.26, 50.33),
    *(50.11, 49.36, 49.52, 50.05, 49.38, 49.92, 50.73, 51.23, 51.94, 51.99),
]


def test_ewma_of_nist() -> None:
    chart = ewma(EWMA_DATA, weight=0.3, centre=50, sigma=2.0539)
    assert chart.points.round(2).tolist() == pytest.approx(EWMA_PRINTED, abs=0.0101)
    assert chart.upper[-1] == pytest.approx(52.5884, abs=2e-3)  # the limit that all points come to
    assert chart.lower[-1] == pytest.approx(47.4115, abs=2e-3)
    # the first point has but its own variance
    assert chart.upper[0] == pytest.approx(50 + 3 * 0.3 * 2.0539)
    assert chart.signals == ()


def test_limits_are_the_textbook_s_a2_and_d4() -> None:
    """Montgomery 6.2: means ± A2 R-bar, ranges from D3 to D4 R-bar."""
    rows = np.random.default_rng(1).normal(1.5, 0.14, (25, 5))
    spread = np.ptp(rows, axis=1).mean()
    middle, widths = means(rows), ranges(rows)
    assert middle.upper[0] - middle.centre == pytest.approx(0.577 * spread, rel=1e-3)
    assert widths.upper[0] == pytest.approx(2.114 * spread, rel=1e-3)
    assert widths.lower[0] == 0


def test_sigma_of_an_individuals_chart_is_that_of_the_process() -> None:
    values = np.random.default_rng(2).normal(350, 2, 20_000)
    assert individuals(values).sigma == pytest.approx(2, rel=0.02)


def test_a_point_beyond_the_limit_is_a_signal_on_every_chart() -> None:
    values = np.random.default_rng(3).normal(0, 1, 30)
    values[20] = 12
    for chart in (individuals(values), moving_ranges(values), ewma(values)):
        assert any(one.test == 1 and one.last in (19, 20) for one in chart.signals), chart.name
    rows = np.random.default_rng(4).normal(0, 1, (30, 4))
    rows[7] += 9
    assert {one.last for one in means(rows).signals if one.test == 1} == {7}
    rows[9, 0] += 30
    assert 9 in {one.last for one in ranges(rows).signals}


@pytest.mark.parametrize("wrong", [[1.0], [1.0, float("nan"), 2.0], [[1.0, 2.0]]])
def test_what_is_no_row_of_known_values_is_refused(wrong: list[float]) -> None:
    with pytest.raises(ValueError, match="a chart needs"):
        individuals(wrong)


def test_a_chart_of_equal_values_has_no_signals() -> None:
    assert individuals([5.0] * 30).signals == ()


# Montgomery, Introduction to Statistical Quality Control, table 9.1: mean 10 for 20 values, then
# 11; sigma 1
CUSUM_DATA = [
    *(
        9.45,
        7.99,
        9.29,
        11.66,
        12.16,
        10.18,
        8.04,
        11.46,
        9.20,
        10.34,
        9.03,
        11.47,
        10.51,
        9.40,
        10.08,
    ),
    *(
        9.37,
        10.62,
        10.31,
        8.52,
        10.84,
        10.90,
        9.33,
        12.29,
        11.50,
        10.60,
        11.08,
        10.38,
        11.62,
        11.31,
        10.52,
    ),
]


def test_cusum_of_montgomery() -> None:
    """Table 9.2: the upper sum is 5.28 at value 29 and 5.30 at 30, beyond h = 5; individuals show
    nothing.
    """
    up, down = cusum(CUSUM_DATA, centre=10, sigma=1)
    assert up.points[[0, 3, 4, 28, 29]].round(2).tolist() == [0.0, 1.16, 2.82, 5.28, 5.30]
    assert down.points[[0, 1, 2]].round(2).tolist() == [-0.05, -1.56, -1.77]
    assert [one.last + 1 for one in up.signals] == [29, 30]
    assert down.signals == ()
    assert individuals(CUSUM_DATA, centre=10, sigma=1, tests=(1,)).signals == ()


def test_p_chart_of_montgomery() -> None:
    """Example 7.1, cans of orange juice: p-bar 0.2313, limits 0.0524 and 0.4102; samples 15 and 23
    are beyond.
    """
    found = [
        12,
        15,
        8,
        10,
        4,
        7,
        16,
        9,
        14,
        10,
        5,
        6,
        17,
        12,
        22,
        8,
        10,
        5,
        13,
        11,
        20,
        18,
        24,
        15,
        9,
        12,
        7,
        13,
        9,
        6,
    ]
    chart = shares(found, 50)
    assert (round(chart.centre, 4), round(chart.lower[0], 4), round(chart.upper[0], 4)) == (
        0.2313,
        0.0524,
        0.4102,
    )
    assert [one.last + 1 for one in chart.signals] == [15, 23]


def test_u_chart_of_montgomery() -> None:
    """Example 7.4, shipments: u-bar 0.0740, limits 0 and 0.1894."""
    found = [2, 3, 8, 1, 1, 4, 1, 4, 5, 1, 8, 2, 4, 3, 4, 1, 8, 3, 7, 4]
    chart = rates(found, 50)
    assert (round(chart.centre, 4), chart.lower[0], round(chart.upper[0], 4)) == (
        0.0740,
        0.0,
        0.1894,
    )
    assert chart.signals == ()


@pytest.mark.parametrize(
    ("n", "a3", "b3", "b4"), [(2, 2.659, 0, 3.267), (5, 1.427, 0, 2.089), (10, 0.975, 0.284, 1.716)]
)
def test_limits_by_standard_deviations_are_the_textbook_s(
    n: int, a3: float, b3: float, b4: float
) -> None:
    """Montgomery, appendix VI: A3, B3, B4."""
    rows = np.random.default_rng(n).normal(74, 0.01, (25, n))
    spread = rows.std(axis=1, ddof=1).mean()
    middle, widths = means_by_sd(rows), sds(rows)
    assert (middle.upper[0] - middle.centre) / spread == pytest.approx(a3, abs=6e-4)
    assert (widths.lower[0] / spread, widths.upper[0] / spread) == pytest.approx((b3, b4), abs=6e-4)


def test_limits_are_on_the_scale_of_the_distribution() -> None:
    """A lognormal feature: three sigma of its mean would call its tail out of the ordinary, and
    allow values below zero.
    """
    values = np.random.default_rng(12).lognormal(0, 0.6, 300)
    found = control_chart(values)
    assert isinstance(found, tuple)
    chart, spans = found
    assert chart.distribution == "lognormal"
    assert chart.lower[0] > 0
    assert chart.upper[0] == pytest.approx(
        np.exp(np.log(values).mean() + 3 * np.log(values).std(ddof=1))
    )
    plain = [one for one in individuals(values).signals if one.test == 1]
    assert len([one for one in chart.signals if one.test == 1]) < len(plain)
    assert len(spans.signals) < len(moving_ranges(values).signals)
