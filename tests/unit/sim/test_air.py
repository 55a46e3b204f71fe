"""Hot air: heater in its stream, thermocouple on the work, pump and suction, whatever the steps."""

from __future__ import annotations

import pytest

from jbclog.sim.hotair import (
    COLD_C,
    STILL_W_PER_K,
    STREAM_W_PER_K,
    AirStation,
    AirTraits,
    Heater,
    Thermocouple,
)
from jbclog.sim.tip import JointSchedule

ON, OFF, COOLING = (0, 0, 0, 0, 1), (0, 0, 0, 0, 0), (0, 0, 0, 1, 0)
ON_WITH_SUCTION = (0, 0, 1, 0, 1)


def station(per_minute: float = 0.0, seconds: float = 5.0, **character: object) -> AirStation:
    joints = JointSchedule(per_minute, seconds, 1)
    return AirStation(0.0, 1, Heater(23.0, 900.0), joints, AirTraits(**character))  # type: ignore[arg-type]


def hot(made: AirStation, seconds: float = 30.0) -> AirStation:
    made.order(ON)
    made.advance_to(made.now + seconds)
    return made


# -- the heater ------------------------------------------------------------------------------------


def test_heats_with_all_its_power_and_settles_on_the_target_without_passing_it() -> None:
    heater, hottest = Heater(23.0, 900.0), 0.0
    heater.step(1.0, 350.0, 0.5)
    assert heater.power_w == 900.0
    assert 60 < heater.temperature_c < 100
    for _ in range(600):
        heater.step(0.05, 350.0, 0.5)
        hottest = max(hottest, heater.temperature_c)
    assert hottest <= 350.0
    assert heater.temperature_c == pytest.approx(350.0, abs=0.1)
    assert heater.power_w == pytest.approx(
        (STILL_W_PER_K + 0.5 * STREAM_W_PER_K) * (350 - 23), rel=0.01
    )


def test_more_air_takes_more_power_and_cools_faster() -> None:
    powers, cooled = [], []
    for stream in (0.1, 0.5, 1.0):
        heater = Heater(23.0, 900.0)
        for _ in range(600):
            heater.step(0.1, 350.0, stream)
        powers.append(heater.power_w)
        heater.step(10.0, None, stream)
        cooled.append(heater.temperature_c)
    assert powers == sorted(powers)
    assert cooled == sorted(cooled, reverse=True)


@pytest.mark.parametrize("seconds", [0.01, 0.1, 1.0, 10.0])
@pytest.mark.parametrize("target", [350.0, 100.0, None])
def test_steps_of_any_length_end_at_the_same_place(seconds: float, target: float | None) -> None:
    """Each step is exact for its regime, so that how often somebody asks changes nothing."""
    one, other = Heater(23.0, 900.0), Heater(23.0, 900.0)
    one.temperature_c = other.temperature_c = 200.0
    one.step(10.0, target, 0.6)
    for _ in range(round(10 / seconds)):
        other.step(seconds, target, 0.6)
    assert other.temperature_c == pytest.approx(one.temperature_c, abs=0.01)
    assert other.power_w == pytest.approx(one.power_w, abs=0.5)


def test_what_it_cannot_reach_it_does_not_reach() -> None:
    heater = Heater(23.0, 100.0)
    heater.step(600.0, 350.0, 1.0)
    assert heater.power_w == 100.0
    assert heater.temperature_c == pytest.approx(123, abs=1)


def test_a_thermocouple_follows_the_air_with_a_lag() -> None:
    probe = Thermocouple(23.0)
    probe.step(1.0, 350.0, on_work=True)
    after_one = probe.temperature_c
    assert 60 < after_one < 100
    probe.step(60.0, 350.0, on_work=True)
    assert probe.temperature_c == pytest.approx(23 + 0.7 * 327, abs=1)
    probe.step(60.0, None, on_work=True)
    assert probe.temperature_c == pytest.approx(23, abs=1)


# -- the station -----------------------------------------------------------------------------------


def test_it_begins_off_and_cold_and_heats_when_told() -> None:
    made = station()
    made.advance_to(10)
    assert (made.status, made.power(), made.air_temperature()) == (OFF, 0, 23)
    hot(made)
    assert made.air_temperature() == 300
    assert made.status == ON


def test_cooling_blows_all_the_air_and_ends_by_itself() -> None:
    made = hot(station())
    made.order(COOLING)
    assert (made.stream, made.target_c) == (1.0, None)
    made.advance_to(made.now + 5)
    assert made.status == COOLING
    assert made.power() == 0
    made.advance_to(made.now + 120)
    assert made.status == OFF
    assert made.air_temperature() < COLD_C


def test_off_is_off_at_once() -> None:
    made = hot(station())
    made.order(OFF)
    made.advance_to(made.now + 5)
    assert (made.stream, made.power()) == (0.0, 0)
    assert made.air_temperature() > 280, "nothing blows through it"


def test_the_flow_is_a_share_of_the_greatest() -> None:
    made = hot(station())
    made.settings.selected_air_flow, made.limits.maximum_air_flow = 30, 120
    assert made.stream == 0.25


def test_a_tool_that_is_pulled_out_is_not_heated_and_its_successor_is_cold() -> None:
    made = hot(station())
    made.plug(0)
    made.advance_to(made.now + 1)
    assert (made.air_temperature(), made.port_error(), made.target_c) == (0, 9, None)
    made.plug(2)
    assert (made.air_temperature(), made.port_error()) == (23, 0)
    made.advance_to(made.now + 30)
    assert made.air_temperature() == 300


def test_errors_in_the_order_of_what_matters() -> None:
    made = station(has_thermocouple=False)
    assert (made.port_error(), made.external_temperature()) == (4, 0)
    made.error = 2
    assert made.port_error() == 2
    made.plug(0)
    assert made.port_error() == 9


def test_an_adjusted_tool_shows_what_it_is_set_to_and_is_another_temperature() -> None:
    made = station()
    made.adjust[1] = 10
    hot(made)
    assert made.air_temperature() == 300
    assert made.heater.temperature_c == pytest.approx(310, abs=0.5)


def test_work_is_warmed_under_the_nozzle_and_parts_are_lifted() -> None:
    made = hot(station(4, 8.0, lifts_parts=True), 12)
    seen, suctions = [], set()
    while made.now < 60:
        made.advance_to(made.now + 0.25)
        seen.append(made.external_temperature())
        suctions.add(made.status[2])
    assert max(seen) > 180
    assert min(seen) < 80
    assert suctions == {0, 1}
    assert made.suction_cycles == 4


def test_its_counters() -> None:
    made = station()
    made.start_counts = {"plugged_hours": 10.9, "work_hours": 5, "tool_cycles": 7}
    hot(made, 1800)
    made.order(OFF)
    made.advance_to(3600)
    made.order(ON_WITH_SUCTION)
    made.order(ON)
    counters = ("plugged_hours", "work_hours", "tool_cycles", "suction_cycles")
    assert [made.count(name) for name in counters] == [11, 5, 9, 1]
    made.advance_to(2 * 3600)
    assert made.count("work_hours") == 6


def test_a_restart_switches_off_and_a_reset_forgets() -> None:
    made = hot(station())
    made.settings.selected_air_temperature, made.limits.maximum_air_temperature, made.adjust[1] = (
        400,
        420,
        -5,
    )
    made.restart()
    assert (made.status, made.settings.selected_air_temperature) == (OFF, 400)
    made.reset_settings()
    assert (
        made.settings.selected_air_temperature,
        made.adjust[1],
        made.limits.maximum_air_temperature,
    ) == (300, 0, 420)
    made.factory_reset()
    assert made.limits.maximum_air_temperature == 450


def test_it_may_be_asked_as_rarely_or_as_often_as_one_likes() -> None:
    rare, often = station(4, 6.0, lifts_parts=True), station(4, 6.0, lifts_parts=True)
    for made in (rare, often):
        made.order(ON)
    rare.advance_to(3600)
    while often.now < 3600:
        often.advance_to(min(often.now + 1.7, 3600))
    assert rare.suction_cycles == pytest.approx(often.suction_cycles, abs=1)
    assert rare.air_temperature() == often.air_temperature() == 300
    assert rare.work_s == pytest.approx(often.work_s)


def test_a_misspelt_attribute_raises() -> None:
    with pytest.raises(AttributeError):
        station().selected = 1  # type: ignore[attr-defined]
