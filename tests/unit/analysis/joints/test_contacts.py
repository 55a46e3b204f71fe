"""Contacts and draws: those of many stretches looked at together are those of each alone."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from jbclog.analysis.joints.contacts import Flow, find_contacts
from jbclog.analysis.joints.draws import find_draws
from jbclog.analysis.joints.parameters import JointOptions, settings_for
from jbclog.analysis.joints.series import Stretch
from jbclog.analysis.joints.thermal import Noise, ThermalModel, smooth

PERIOD_S = 0.1


NOISE = Noise(8.0, 60.0, 4.0, 0.1)
SEEDS = range(120)


@cache
def some_flows(seed: int) -> list[Flow]:
    """Stretches with contacts, many of which last until an edge, where the next stretch begins in
    one or warms it up; some are too short to show any.
    """
    rng, flows, start_s = np.random.default_rng(seed), list[Flow](), 0.0
    for rows in rng.choice([1, 2, 3, 5, 9, 20, 100], 12).tolist():
        seconds = start_s + PERIOD_S * np.arange(rows)
        flow = rng.normal(0, 5, rows)
        for first in rng.integers(-10, rows, 1 + rows // 25).tolist():
            flow[max(first, 0) : first + int(rng.integers(2, 25))] += rng.choice([40, 90, 400])
        flow[: rng.integers(0, 6)] += rng.choice([12, 200])
        falling = flow[rows // 2 : rows - int(rng.integers(0, 4))]
        falling += np.linspace(rng.choice([60, 400]), 22, len(falling))
        if rng.integers(2):
            flow = np.abs(smooth(flow, 1.0))
        flows.append(Flow(Stretch(PERIOD_S, seconds, flow, flow, flow), flow))
        start_s = float(seconds[-1]) + rng.uniform(0.1, 4)  # some closer than draws are merged
    return flows


@pytest.mark.parametrize("expected_every_s", [None, 2.0])
def test_stretches_together_are_as_each_alone(expected_every_s: float | None) -> None:
    found = 0
    for flows in map(some_flows, SEEDS):
        alone, begin = [], 0
        for one in flows:
            for contact in find_contacts([one], NOISE, expected_every_s):
                alone.append((*contact[:2], *(begin + row for row in contact[2:])))
            begin += len(one.flow)
        assert [*map(tuple, find_contacts(flows, NOISE, expected_every_s))] == alone
        found += len(alone)
    assert found > len(SEEDS)


def test_no_draw_continues_in_the_next_stretch() -> None:
    settings = settings_for(JointOptions(), PERIOD_S, wire_decides=False)
    model, found = ThermalModel(10, 0.3, 0, 0, (1, 0.1, 0, 0), NOISE, 0.3), 0
    for flows in map(some_flows, SEEDS):
        alone = [draw for one in flows for draw in find_draws([one], model, settings)]
        assert find_draws(flows, model, settings) == alone
        found += len(alone)
    assert found > len(SEEDS)
