"""Figures in JSON and text without what arithmetic of floats adds to them."""

from __future__ import annotations

import math

import pandas as pd

from jbclog.analysis import compare
from jbclog.analysis.spc import Refused
from jbclog.analysis.trend import Point, Trend
from jbclog.core.text import exact, exact_figures

DUST = (
    0.1 + 0.2,
    10.000000000000002 - 10.0,
    5.2896540000000005,
    91.99999999999999,
    -6931.5999999999985,
)


def test_what_arithmetic_adds_is_rounded_off_and_nothing_else() -> None:
    assert [exact(value) for value in (DUST[0], *DUST[2:])] == [0.3, 5.289654, 92.0, -6931.6]
    assert exact(DUST[1], 10) == 0.0
    assert exact(0.6516201495853711) == 0.651620149585
    for same in (0.0, 1e-9, 123456789012.0, 1e-300, math.inf, -math.inf):
        assert exact(same) == same
    assert math.isnan(exact(math.nan, 1.0))


def test_figures_are_found_wherever_they_are() -> None:
    given = {"a": [0.1 + 0.2, {"b": (2.0000000000000004, None, True, 3, "0.30000000000000004")}]}
    assert exact_figures(given) == {"a": [0.3, {"b": [2.0, None, True, 3, "0.30000000000000004"]}]}


def test_equal_metrics_differ_by_nothing() -> None:
    """Two runs whose wire was fed at 10 mm/s differed by -1.776e-15 mm/s."""

    class Measured:
        def __init__(self, speed: float | None) -> None:
            self.speed = speed

        def metrics(self) -> pd.DataFrame:
            names = [
                {"station": "ale-1", "port": 1, "metric": name, "uom": "mm/s"}
                for name in ("wire_speed_mm_s", "other")
            ]
            return pd.DataFrame(
                [
                    {**one, "value": value}
                    for one, value in zip(names, (self.speed, None), strict=True)
                ]
            )

    table = compare._metrics(Measured(10.000000000000002), Measured(10.0))  # type: ignore[arg-type]
    assert table.set_index("metric")["difference"]["wire_speed_mm_s"] == 0.0
    assert pd.isna(table.set_index("metric")["difference"]["other"])
    assert exact_figures(0.4) == compare._metrics(Measured(4.6), Measured(5.0))["difference"].max()  # type: ignore[arg-type]


def test_a_mean_of_figures_that_cancel_is_zero() -> None:
    points = [
        Point(f"r{at}", None, value, 1, None, None, None)
        for at, value in enumerate((0.1, 0.2, -0.3))
    ]
    trend = Trend("dde-1", 1, "idle_error_c", "°C", points, Refused("too_few", "none"), None)
    assert sum(point.value or 0 for point in points) != 0
    assert trend.mean == 0.0
