"""A station's physics: feeder, counters, what a restart and a factory reset take away."""

from __future__ import annotations

from itertools import pairwise

import pytest

from jbclog.sim.port import STAND, WORKING, SimPort
from jbclog.sim.soldering_station import Feeder, SolderingStation, StationSettings
from jbclog.sim.tip import NEVER, JointSchedule, Tip

T0 = 1000.0


def plant(counts: dict[str, float] | None = None) -> SolderingStation:
    ports = {
        number: SimPort(T0, 2, Tip(23.0, 130.0), JointSchedule(0.0, 1.5, number))
        for number in (1, 2)
    }
    return SolderingStation(T0, ports, Feeder(), StationSettings(500, 90), counts or {})


def test_a_discontinuous_feed_goes_forward_then_backward_and_is_counted() -> None:
    feeder = Feeder()
    feeder.settings.feeder_length, feeder.settings.feeder_speed, feeder.settings.feeder_backward = (
        5.0,
        10.0,
        1.0,
    )
    feeder.start(100.0)
    assert [feeder.motor(at) for at in (100.0, 100.49, 100.51, 100.59, 100.61)] == [1, 1, 2, 2, 0]
    assert feeder.dispensed_mm(100.25) == pytest.approx(2.5)
    assert (
        feeder.dispensed_mm(200.0),
        feeder.dispensed_cycles(100.3),
        feeder.dispensed_cycles(200.0),
    ) == (
        pytest.approx(5.0),
        0,
        1,
    )
    feeder.start(200.0)
    assert (feeder.dispensed_mm(300.0), feeder.dispensed_cycles(300.0)) == (pytest.approx(10.0), 2)


def test_a_continuous_feed_runs_until_it_is_stopped() -> None:
    feeder = Feeder()
    feeder.settings.feeder_mode = "continuous"
    feeder.start(100.0)
    feeder.start(105.0)  # nothing new
    assert feeder.motor(1000.0) == 1
    feeder.stop(110.0)
    assert (feeder.motor(110.0), feeder.dispensed_mm(500.0), feeder.dispensed_cycles(500.0)) == (
        0,
        pytest.approx(100.0),
        1,
    )
    feeder.stop(600.0)
    assert feeder.dispensed_cycles(600.0) == 1


def test_counters_go_on_from_where_they_began() -> None:
    made = plant({"work_hours": 1200.0, "sleep_cycles": 9.0})
    port = made.ports[1]
    port.order(WORKING, False)
    made.advance_to(T0 + 3600)
    port.order(STAND, False)
    made.advance_to(T0 + 3600 + 300 + 1800 + 7200)
    now = port.now
    told = {
        name: made.count(name, port, now)
        for name in ("work_hours", "sleep_hours", "hibernation_hours", "sleep_cycles")
    }
    assert told == {
        "work_hours": pytest.approx(1200 + 1 + 300 / 3600),
        "sleep_hours": pytest.approx(0.5),
        "hibernation_hours": pytest.approx(2.0),
        "sleep_cycles": 10,
    }
    assert made.count("plugged_hours", port, now) == pytest.approx(1 + 300 / 3600 + 0.5 + 2)


def test_an_unknown_counter_is_an_error() -> None:
    made = plant()
    with pytest.raises(KeyError):
        made.count("smoke_breaks", made.ports[1], T0)


def test_a_restart_forgets_what_is_volatile_and_keeps_the_rest() -> None:
    made = plant()
    port = made.ports[1]
    port.settings.selected_temperature, port.settings.alarm_high_limit = 330, 380
    port.tools[2].sleep_delay = 3
    port.high.latched = True
    port.order(WORKING, False)
    made.restart(T0 + 5)
    assert (port.settings.selected_temperature, port.doing.extractor, port.high.latched) == (
        350,
        True,
        False,
    )
    assert (port.settings.alarm_high_limit, port.tools[2].sleep_delay) == (380, 3)
    port.settings.selected_temperature = 330
    made.store()
    made.restart(T0 + 6)
    assert port.settings.selected_temperature == 330


def test_a_factory_reset_takes_everything_but_the_counters() -> None:
    made = plant()
    port = made.ports[2]
    (
        port.settings.selected_temperature,
        port.settings.alarm_low_limit,
        made.settings.maximum_temperature,
    ) = (330, 300, 400)
    made.store()
    port.doing.sleep_cycles = 4
    made.factory_reset(T0 + 1)
    assert (
        port.settings.selected_temperature,
        port.stored_c,
        made.settings.maximum_temperature,
    ) == (350, 350, 500)
    assert str(port.settings.alarm_low_limit) == "off"
    assert made.count("sleep_cycles", port, T0 + 1) == 4


def test_the_transformer_warms_with_all_ports() -> None:
    made = plant()
    for port in made.ports.values():
        port.order(WORKING, False)
    assert made.transformer_temperature(T0) == 35
    assert 35.1 < made.transformer_temperature(T0 + 30) < 45


def test_joints_are_even_and_never_begin_before_their_time() -> None:
    joints = JointSchedule(12.0, 1.5, 3, T0)
    moment, found = T0, []
    while len(found) < 60:
        joint = joints.after(moment)
        assert moment < joint.start < joint.end
        found.append(joint)
        moment = joint.start
    assert found[-1].start - T0 == pytest.approx(300, abs=5)
    assert all(later.start > earlier.end for earlier, later in pairwise(found))
    assert joints.after(found[30].start) == found[31]
    assert JointSchedule(0.0, 1.5, 3).after(T0) == NEVER
