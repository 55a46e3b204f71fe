"""Charts against printed tables and worked examples, to the printed digits; each names where it is printed."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from jbclog.spc import ewma, individuals, means, moving_ranges, ranges
from jbclog.spc.constants import c4, d2, d3

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
    assert 1 + 3 * d3(n) / d2(n) == pytest.approx(high, abs=1.1e-3)  # the tables divide rounded figures


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
EWMA_DATA = [52.0, 47.0, 53.0, 49.3, 50.1, 47.0, 51.0, 50.1, 51.2, 50.5, 49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1]
EWMA_PRINTED = [
    *(50.60, 49.52, 50.56, 50.18, 50.16, 49.21, 49.75, 49.85, 50.26, 50.33),
    *(50.11, 49.36, 49.52, 50.05, 49.38, 49.92, 50.73, 51.23, 51.94, 51.99),
]


def test_ewma_of_nist() -> None:
    chart = ewma(EWMA_DATA, weight=0.3, centre=50, sigma=2.0539)
    assert chart.points.round(2).tolist() == pytest.approx(EWMA_PRINTED, abs=0.0101)
    assert chart.upper[-1] == pytest.approx(52.5884, abs=2e-3)  # the limit that all points come to
    assert chart.lower[-1] == pytest.approx(47.4115, abs=2e-3)
    assert chart.upper[0] == pytest.approx(50 + 3 * 0.3 * 2.0539)  # the first point has but its own variance
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
    with pytest.raises(ValueError, match="a chart takes"):
        individuals(wrong)


def test_a_chart_of_equal_values_has_no_signals() -> None:
    assert individuals([5.0] * 30).signals == ()
