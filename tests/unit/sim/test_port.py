"""A port: states after their delays, alarms that latch, joints, tools in and out. Time only as it
is passed in.
"""

from __future__ import annotations

from itertools import pairwise
from random import Random

import pytest

from jbclog.core.quantities import OFF
from jbclog.sim.port import HIBERNATION, SLEEP, STAND, WORKING, PortTraits, SimPort
from jbclog.sim.tip import Comparator, JointSchedule, Tip

T0 = 1000.0


def port(joints_per_minute: float = 0.0, **character: object) -> SimPort:
    return SimPort(
        T0,
        2,
        Tip(23.0, 130.0),
        JointSchedule(joints_per_minute, 1.5, 7, T0),
        PortTraits(**character),
    )  # type: ignore[arg-type]


def working(made: SimPort, seconds: float = 20.0) -> SimPort:
    made.order(WORKING, False)
    made.advance_to(made.now + seconds)
    return made


def test_begins_in_extract_and_cold() -> None:
    made = port()
    made.advance_to(T0 + 100)
    assert (made.doing.state, made.doing.extractor, made.temperature(), made.power()) == (
        WORKING,
        True,
        23,
        0,
    )


def test_extract_can_be_made_to_keep_the_heat() -> None:
    made = port(extractor_cools=False)
    made.advance_to(T0 + 20)
    assert made.temperature() == 350


def test_goes_from_stand_to_sleep_to_hibernation_after_its_delays() -> None:
    made = working(port())
    stood = made.now
    made.order(STAND, False)
    assert made.seconds_to_sleep() == 300
    made.advance_to(stood + 299.9)
    assert (made.doing.state, made.temperature()) == (STAND, 350)
    made.advance_to(stood + 300.1)
    assert (made.doing.state, made.seconds_to_sleep(), made.doing.sleep_cycles) == (SLEEP, 1800, 1)
    made.advance_to(stood + 420)
    assert made.temperature() == 150
    made.advance_to(stood + 300 + 1800.1)
    assert (made.doing.state, made.seconds_to_sleep()) == (HIBERNATION, None)
    made.advance_to(stood + 4000)
    assert made.temperature() == 23
    working(made)
    assert (made.doing.state, made.temperature()) == (WORKING, 350)
    assert made.doing.hours(made.now, SLEEP) == pytest.approx(0.5)


def test_one_great_step_passes_through_the_same_states() -> None:
    made = working(port())
    made.order(STAND, False)
    made.advance_to(made.now + 5000)
    assert (made.doing.state, made.doing.sleep_cycles) == (HIBERNATION, 1)
    assert made.doing.hours(made.now, STAND) == pytest.approx(300 / 3600)


def test_a_delay_that_is_off_never_ends() -> None:
    made = working(port())
    made.tools[2].sleep_delay = OFF
    made.order(STAND, False)
    made.advance_to(made.now + 1e6)
    assert (made.doing.state, made.temperature(), made.seconds_to_sleep()) == (STAND, 350, None)


def test_a_stand_order_starts_the_delay_anew_but_wakes_nobody() -> None:
    made = working(port())
    made.order(STAND, False)
    made.advance_to(made.now + 200)
    made.order(STAND, False)
    assert made.seconds_to_sleep() == 300
    made.advance_to(made.now + 400)
    made.order(STAND, False)
    assert made.doing.state == SLEEP


def test_an_alarm_latches_after_its_delay_and_until_it_is_taken() -> None:
    made = working(port())
    made.settings.alarm_high_limit, made.settings.alarm_high_delay = 380, 1.6
    made.runaway_by_c = 20.0
    made.changed()
    while made.seen_c <= 380:
        made.advance_to(made.now + 0.01)
    risen = made.now
    made.advance_to(risen + 1.5)
    assert not made.high.latched
    made.advance_to(risen + 1.7)
    assert made.high.latched
    made.runaway_by_c = None
    made.changed()
    made.advance_to(made.now + 20)
    assert made.temperature() == 350
    assert [made.high.take(), made.high.take()] == [True, False]


def test_an_alarm_whose_delay_is_off_never_comes() -> None:
    made = port()
    made.settings.alarm_low_limit = 300
    made.advance_to(T0 + 100)
    assert not made.low.latched
    made.settings.alarm_low_delay = 0.0
    made.advance_to(T0 + 101)
    assert made.low.latched


def test_a_comparator_counts_from_the_moment_of_the_crossing() -> None:
    comparator = Comparator()
    comparator.see(-1.0, 3.0, 4.0, 14.0, 1.0)  # crossed at 11
    assert comparator.since == pytest.approx(11.0)
    assert comparator.latched
    comparator.see(3.0, -1.0, 1.0, 15.0, 1.0)
    assert comparator.since is None


def test_joints_come_only_while_it_works_hot_and_show_in_the_reading() -> None:
    made = port(12.0)
    made.advance_to(T0 + 60)
    assert made.power() == 0
    working(made, 10.0)
    readings = []
    for _ in range(600):
        made.advance_to(made.now + 0.1)
        readings.append((made.temperature(), made.power()))
    dips = sum(1 for (before, _), (after, _) in pairwise(readings) if before >= 346 > after)
    assert dips == 12  # per minute
    assert max(power for _, power in readings) > 400


def test_the_same_seed_gives_the_same_joints() -> None:
    def told(seed: int) -> list[int]:
        made = SimPort(
            T0,
            2,
            Tip(23.0, 130.0),
            JointSchedule(12.0, 1.5, seed, T0),
            PortTraits(0.5, noise=Random(seed)),
        )
        made.order(WORKING, False)
        values = []
        for n in range(300):
            made.advance_to(T0 + n / 5)
            values.append(made.temperature())
        return values

    assert told(1) == told(1)
    assert told(1) != told(2)


def test_adjust_moves_the_true_tip_and_not_the_reading() -> None:
    made = port(sensor_error_c=5.0)
    working(made)
    assert (made.temperature(), round(made.tip.temperature_c)) == (350, 345)
    made.tools[2].adjust = 5
    made.changed()
    made.advance_to(made.now + 20)
    assert (made.temperature(), round(made.tip.temperature_c)) == (350, 350)


def test_without_a_tool_there_is_nothing_to_read() -> None:
    made = working(port())
    made.plug(0)
    made.advance_to(made.now + 36)
    assert (made.temperature(), made.power(), made.port_error(), made.seconds_to_sleep()) == (
        0,
        0,
        4,
        None,
    )
    assert made.no_tool_s == pytest.approx(36)
    made.plug(made.tool_before)
    assert (made.tool, made.temperature()) == (2, 23)
    made.advance_to(made.now + 20)
    assert made.temperature() == 350


def test_the_transistor_warms_with_the_power_and_lags() -> None:
    made = port()
    assert made.transistor_temperature() == 33
    working(made, 2.0)
    # 130 W for two of its sixty seconds
    assert 33.5 < made.transistor_temperature() < 33 + 0.3 * 130 / 10
    made.advance_to(made.now + 1000)
    assert made.transistor_temperature() == pytest.approx(33 + 0.3 * 9.81, abs=0.1)
