"""The filters of a heat balance: those of scipy, to the last bit, without loading it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import correlate1d, gaussian_filter1d

from jbclog.analysis.joints.thermal import _extended, _weighted, rate, smooth

RANDOM = np.random.default_rng(20261125)


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("sigma", [0.7, 1.0, 1.4, 5.0, 22.5])
@pytest.mark.parametrize("rows", [1, 2, 3, 60, 1000])
def test_smoothing_is_that_of_scipy(rows: int, sigma: float, order: int) -> None:
    values = np.round(RANDOM.normal(300, 20, rows))
    margin = int(4 * sigma + 1)
    expected = gaussian_filter1d(_extended(values, margin), sigma, order=order)
    assert np.array_equal(smooth(values, sigma, order), expected[margin : margin + rows])


@pytest.mark.parametrize("sides", ["alike", "opposite", "different"])
@pytest.mark.parametrize("count", [1, 3, 21])
def test_weighting_is_that_of_scipy(count: int, sides: str) -> None:
    values, weights = RANDOM.normal(0, 1, 500), RANDOM.normal(0, 1, count)
    weights += {"alike": 1, "opposite": -1, "different": 0}[sides] * weights[::-1]
    expected = correlate1d(values, weights)[count // 2 : len(values) - count // 2]
    assert np.array_equal(_weighted(values, weights), expected)


@pytest.mark.parametrize("rows", [0, 1, 2, 3, 60])
def test_a_rate_of_change_is_that_of_numpy(rows: int) -> None:
    flow = RANDOM.normal(0, 100, rows)
    expected = np.gradient(flow) / 0.1 if rows > 1 else np.zeros(rows)
    assert np.array_equal(rate(flow, 0.1), expected)
