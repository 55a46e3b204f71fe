"""Joints on the plant on which their finding was tuned: a part of its trials, so that a changed
limit is seen here, too.
"""

from __future__ import annotations

import pytest

from jbclog.analysis.joints.joints import find_joints
from jbclog.sim.tip import CAPACITY_J_PER_K, Tip
from support.plants.joint_score import all_of, told
from support.plants.second_record import scores, series_of
from support.plants.tuning_plant import SEEDS, trial


@pytest.mark.parametrize("trials", [5, pytest.param(16, marks=pytest.mark.campaign)])
def test_joints_of_the_tuning_plant(trials: int) -> None:
    found = scores([trial(seed) for seed in SEEDS[:trials]], 10.0)
    print(told(found))
    assert all_of(found).f1 >= 0.97


@pytest.mark.parametrize("rated_w", [60.0, 130.0])
def test_the_heat_capacity_of_the_tip_is_found(
    monkeypatch: pytest.MonkeyPatch, rated_w: float
) -> None:
    """Nobody told it; in ‰·s/K it is the joules per kelvin over the watts of a per mille."""
    monkeypatch.setattr(
        "support.plants.tuning_plant.Tip", lambda ambient_c, _: Tip(ambient_c, rated_w)
    )
    models = [find_joints(series_of(trial(seed), 10.0)).model for seed in SEEDS[:3]]
    found = [0.0 if model is None else model.capacity for model in models]
    # half of them have a second mass
    assert min(found) == pytest.approx(1000 * CAPACITY_J_PER_K / rated_w, rel=0.06)
