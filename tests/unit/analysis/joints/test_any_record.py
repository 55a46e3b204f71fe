"""Whatever a record holds: each metric has a finite value or a reason, joints are in order and
inside the record.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from jbclog.analysis.joints.series import Cycles, Series
from jbclog.analysis.joints.solder_wire import Wire
from jbclog.analysis.metrics.measures import measure_port
from jbclog.analysis.verdict.idle import Block
from support.campaigns.slices import first
from support.records.made_series import made


def any_series(seed: int) -> Series:
    """Short or long, with noise, steps, stuck values, losses in bursts, states that come and go, a
    setting read or not.
    """
    rng = np.random.default_rng(seed)
    hz = float(rng.choice([0.5, 1, 2, 5, 10, 20]))
    series = made(float(rng.choice([0.3, 2, 10, 60, 200])), hz=hz)
    count = len(series.seconds)
    walk = np.cumsum(rng.normal(0, rng.choice([0.0, 0.5, 20.0]), count))
    temperature = np.clip(np.round(350 + walk), 0, 500)
    power = np.clip(
        np.round(
            rng.choice([0.0, 100.0, 1000.0]) + rng.normal(0, rng.choice([0.0, 20.0, 400.0]), count)
        ),
        0,
        1000,
    )
    setting = np.where(
        rng.random(count) < rng.choice([0.0, 0.02, 1.0]),
        rng.choice([0.0, 300.0, 350.0], count),
        np.nan,
    )
    lost = np.zeros(count, dtype=np.bool_)
    for _ in range(int(rng.integers(0, 6)) if count else 0):
        start = int(rng.integers(0, count))
        lost[start : start + int(rng.integers(1, 40))] = True
    temperature, power = (
        np.where(lost | (rng.random(count) < 0.02), np.nan, column)
        for column in (temperature, power)
    )
    resting = np.cumsum(rng.random(count) < 0.01) % 2 == 1
    rows = Block(series.seconds, temperature, power, setting, ~resting & ~lost)
    feeding = (
        None
        if rng.random() < 0.5
        else np.where(rng.random(count) < 0.1, np.nan, (rng.random(count) < 0.2).astype(float))
    )
    return replace(
        series,
        rows=rows,
        known=~lost,
        feeding=feeding,
        rated_w=float(rng.choice([20.0, 130.0])),
        on_grid=bool(rng.random() < 0.8),
        cycles=any_cycles(seed),
    )


def any_wire(seed: int) -> Wire:
    rng = np.random.default_rng(seed)
    at = np.sort(rng.uniform(-1, 200, int(rng.integers(0, 6))))
    grown = np.cumsum(rng.choice([0.0, 5.0, 5.0, -3.0], len(at)))
    return Wire(at, grown, None if seed % 2 else 5.0)


def any_cycles(seed: int) -> Cycles | None:
    rng = np.random.default_rng([seed, 4])
    at = np.sort(rng.uniform(-1, 200, int(rng.choice([0, 1, 5, 100]))))
    counted = np.cumsum(rng.choice([0.0, 1.0, 3.0], len(at)) - (rng.random(len(at)) < 0.03) * 4)
    return Cycles(at, counted) if rng.random() < 0.8 else None


@pytest.mark.parametrize("seed", first(20, range(80)))
def test_every_figure_has_a_value_or_a_reason(seed: int) -> None:
    series = any_series(seed)
    for kind in ("tip", "air", "omega"):
        measured = measure_port(series, kind, any_wire(seed))
        for figure in measured.figures:
            assert (figure.value is None) == (figure.why is not None), figure
            assert figure.value is None or math.isfinite(figure.value), figure
            assert figure.why != "", figure
            assert figure.coverage is None or 0 <= figure.coverage <= 100, figure
    joints = measure_port(series, "tip").joints
    assert all(one.end_s <= two.start_s for one, two in pairwise(joints))
    assert all(
        series.seconds[0] <= one.start_s <= one.end_s <= series.seconds[-1] for one in joints
    )
    assert all(0 <= one.draw.confidence <= 1 for one in joints)
