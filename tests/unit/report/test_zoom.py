"""The data that a reader looks closer at: small, and no excursion lost."""

from __future__ import annotations

import base64
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from jbclog.report.facts import Zoom
from jbclog.report.spans import Span
from jbclog.report.trace import BACK, CUT_OFF, LATE, Grid, Trace, trace
from jbclog.report.zoom import ALL_STRETCHES, NOTHING, most_stretches, zoom_of


def traced(rows: int) -> Trace:
    second = np.arange(rows) / 10
    columns = {
        "time": pd.to_datetime((1_790_000_000 + second) * 1e6, unit="us", utc=True),
        "tick": np.arange(rows),
        "temperature_c": 350.0 + np.arange(rows) % 3,
        "power_permille": np.full(rows, 80.0),
        "set_c": np.where(np.arange(rows) % 50 == 0, 350.0, np.nan),
        "status": "working",
        "quality": "ok",
    }
    drawn = trace(pd.DataFrame(columns), Grid(1_790_000_000_000_000, 0.1))
    return replace(drawn, temperature=drawn.temperature.copy())


def series(zoom: Zoom | None) -> np.ndarray[tuple[int, int], np.dtype[np.int16]]:
    assert zoom is not None
    return np.frombuffer(base64.b64decode(zoom.data), "<i2").reshape(4, -1)


def test_a_single_reading_is_seen_in_eight_hours() -> None:
    drawn = traced(288_000)
    drawn.temperature[123_456], drawn.temperature[200_000] = 411.0, 12.0
    found = series(zoom_of(drawn, 12_000))
    assert found.shape == (4, 12_000)
    assert (found[1].max(), found[0].min()) == (411, 12)
    assert int(found[1].argmax()) == 123_456 * 12_000 // 288_000


def test_a_short_run_is_all_there() -> None:
    drawn = traced(500)
    found = series(zoom_of(drawn, 12_000))
    assert found[0].tolist() == found[1].tolist() == drawn.temperature.tolist()


def test_what_was_not_read_is_not_joined() -> None:
    drawn = traced(500)
    drawn.temperature[100:150] = np.nan
    found = series(zoom_of(drawn, 500))
    assert set(found[0, 100:150].tolist()) == {NOTHING}
    assert NOTHING not in found[0, :100]


def test_the_joints_are_there_too_and_those_without_recovery_apart() -> None:
    joints = [Span(10.0, 11.04, BACK), Span(20.0, 20.8, LATE), Span(30.0, 45.0, CUT_OFF)]
    found = zoom_of(replace(traced(500), joints=joints), 500)
    assert found is not None
    assert found.joints == "64.a,c8.8!,12c.96"
    crowded = zoom_of(replace(traced(500), joints=joints * 100), 500)
    assert crowded is not None
    assert crowded.joints == ""


def test_nothing_read_is_nothing_to_look_at() -> None:
    drawn = traced(50)
    assert zoom_of(replace(drawn, temperature=np.full(50, np.nan)), 100) is None


@pytest.mark.parametrize("ports", [1, 4, 32, 128])
def test_all_of_them_together_stay_small(ports: int) -> None:
    assert ports * most_stretches(ports) <= ALL_STRETCHES
