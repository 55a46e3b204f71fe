"""The tip: it heats, holds, dips in a joint and comes back, whatever the steps."""

from __future__ import annotations

import pytest

from jbclog.sim.tip import LOSS_W_PER_K, Tip


def hot_tip(target_c: float = 350.0) -> Tip:
    tip = Tip(23.0, 130.0)
    for _ in range(400):
        tip.step(0.05, target_c, 0.0, 0.0)
    return tip


def test_heats_with_all_its_power_and_settles_on_the_target() -> None:
    tip = Tip(23.0, 130.0)
    tip.step(0.5, 350.0, 0.0, 0.0)
    assert tip.power_w == 130.0
    assert 60 < tip.temperature_c < 120
    tip = hot_tip()
    assert tip.temperature_c == pytest.approx(350.0, abs=0.1)
    assert tip.power_w == pytest.approx(LOSS_W_PER_K * (350 - 23), rel=0.02)


def test_never_overshoots_by_much_when_heating() -> None:
    tip = Tip(23.0, 130.0)
    hottest = 0.0
    for _ in range(400):
        tip.step(0.025, 350.0, 0.0, 0.0)
        hottest = max(hottest, tip.temperature_c)
    assert hottest < 353


def test_a_joint_makes_it_dip_and_the_power_rise_until_it_is_back() -> None:
    tip = hot_tip()
    idle_w, temperatures, powers = tip.power_w, [], []
    for _ in range(60):
        tip.step(0.05, 350.0, 0.35, 150.0)
        temperatures.append(tip.temperature_c)
        powers.append(tip.power_w)
    assert 330 < min(temperatures) < 345
    assert max(powers) > 5 * idle_w
    # the integral part brings it back within the joint
    assert temperatures[-1] > min(temperatures) + 3


@pytest.mark.parametrize("seconds", [0.05, 0.5, 5.0])
def test_steps_of_any_length_end_at_the_same_place(seconds: float) -> None:
    tip = Tip(23.0, 130.0)
    for _ in range(round(30 / seconds)):
        tip.step(seconds, 350.0, 0.0, 0.0)
    assert tip.temperature_c == pytest.approx(350.0, abs=0.5)


def test_heater_off_cools_exponentially_and_draws_nothing() -> None:
    coarse, fine = hot_tip(), hot_tip()
    coarse.step(40.0, None, 0.0, 0.0)
    for _ in range(400):
        fine.step(0.1, None, 0.0, 0.0)
    assert coarse.temperature_c == pytest.approx(fine.temperature_c, abs=1e-6)
    # one time constant: 1.2 J/K / 0.03 W/K
    assert coarse.temperature_c == pytest.approx(23 + 327 / 2.718281828, abs=0.5)
    assert coarse.power_w == 0.0


def test_a_misspelt_attribute_raises() -> None:
    with pytest.raises(AttributeError):
        Tip(23.0, 130.0).temprature_c = 350.0  # type: ignore[attr-defined]  # that is the point
