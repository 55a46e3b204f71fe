"""Another station of the same model on the cable after an outage: its software and its plugged
hours reveal it.
"""

from __future__ import annotations

import pytest

from support.product import FAMILIES, IDENTITY_READS, LineFormat, readings_for
from support.virtual.lines import hot_air, plant
from support.virtual.virtual_run import RECIPE, VirtualRun, line_text, prepare

AWAY = "\n[[station.sim.fault]]\nkind = 'dropout'\nat_s = 4\nfor_s = 3\n"
HOURS = 120


def bench(hours: float = HOURS, duration_s: float = 20) -> VirtualRun:
    return prepare(
        line_text(f"counters = {{ plugged_hours = {hours} }}\n" + AWAY), duration_s=duration_s
    )


def exchange(
    run: VirtualRun, *, hours: float = 0.0, software: str | None = None, at_s: float = 5
) -> None:
    """Put another station there during the outage: more plugged hours, other software."""

    def exchanged() -> None:
        run.station.plant.start_counts["plugged_hours"] += hours
        if software is not None:
            run.station.device.identity.software = software

    run.at(at_s, exchanged)


def assert_gone(run: VirtualRun, said: str) -> None:
    """The change is reported once; nothing is recorded from the other station, and nothing is
    written to it.
    """
    (event,) = run.memory.of_kind("identity.changed")
    assert said in event.text
    assert "It is neither read nor written." in event.text
    assert event.severity == "critical"
    assert run.facts.outcome == "gone"
    assert run.memory.of_kind("link.back") == []
    assert [one.text for one in run.writes if one.at > run.t0 + 5] == []
    assert run.memory.column("temperature_c")[-1] is None


def assert_resumed(run: VirtualRun) -> None:
    assert run.memory.of_kind("identity.changed") == []
    assert len(run.memory.of_kind("link.back")) == 1
    assert run.facts.outcome == "completed"


def test_the_same_station_is_known() -> None:
    run = bench()
    exchange(run)
    assert_resumed(run.go())


def test_other_software_is_another_station() -> None:
    run = bench()
    exchange(run, software="7777777")
    mine = run.station.device.identity.software
    assert_gone(run.go(), f"a DDE with software 7777777, not the one with {mine}")


@pytest.mark.parametrize("hours", [-1, -100, 2, 1000])
def test_hours_that_fall_or_outrun_the_clock_are_those_of_another_station(hours: int) -> None:
    run = bench()
    exchange(run, hours=hours)
    assert_gone(
        run.go(), f"a DDE with {HOURS + hours} plugged hours on port 1, not the one with {HOURS}"
    )


def test_an_hour_may_have_become_full_meanwhile() -> None:
    """The counters count full hours."""
    run = bench()
    exchange(run, hours=1)
    assert_resumed(run.go())


def test_hours_are_looked_at_on_every_port() -> None:
    run = bench()
    ask = run.station.device.answer

    def answer(header: str, text: str, now: float) -> tuple[str, str] | None:
        is_other = text == "CP2" and now > run.t0 + 5
        return ("A", f"CP2{HOURS + 50:05d}") if is_other else ask(header, text, now)

    run.station.device.answer = answer  # type: ignore[method-assign]
    assert_gone(
        run.go(), f"a DDE with {HOURS + 50} plugged hours on port 2, not the one with {HOURS}"
    )


def test_hours_go_on_while_it_is_away() -> None:
    """An outage of two hours adds two hours: it is the same station."""
    away = AWAY.replace("for_s = 3", "for_s = 7300")
    run = prepare(
        line_text(f"counters = {{ plugged_hours = {HOURS} }}\n" + away, "ports = [1]"),
        duration_s=7400,
        rate=0.5,
    )
    run.go()
    assert run.memory.of_kind("identity.changed") == []
    assert run.memory.column("temperature_c")[-1] is not None


def test_hot_air_is_known_by_its_plugged_hours() -> None:
    """The station does not report software (manual 001)."""
    run = hot_air(f"counters = {{ plugged_hours = {HOURS} }}\n" + AWAY, duration_s=20)
    run.at(5, lambda: plant(run).start_counts.update(plugged_hours=HOURS - 20.0))
    assert_gone(
        run.go(), f"a JTSE with {HOURS - 20} plugged hours on port 1, not the one with {HOURS}"
    )


def test_hours_that_roll_over_are_those_of_the_same_station() -> None:
    run = prepare(line_text("counters = { plugged_hours = 99999.9 }\n" + AWAY), duration_s=20)
    run.at(5, lambda: run.station.plant.start_counts.update(plugged_hours=100_000.3))
    run.go()
    assert run.memory.of_kind("identity.changed") == []
    assert run.facts.outcome == "completed"


def test_cables_that_were_swapped_between_two_questions_are_known_by_the_next_hours() -> None:
    run = prepare(line_text(f"counters = {{ plugged_hours = {HOURS} }}\n"), duration_s=150)
    run.at(80, lambda: run.station.plant.start_counts.update(plugged_hours=HOURS + 50.0))
    run.go()
    lost, *_ = run.memory.of_kind("link.lost")
    hours = [
        one.time
        for one in run.memory.counters
        if one.counter == "plugged_h" and one.value is not None and one.port == 1
    ]
    # since then it may have been another
    assert lost.earliest == pytest.approx(hours[-1], abs=100_000)
    assert lost.text.startswith(
        f"This may be another station now: the plugged hours of port 1 are {HOURS + 50}, and were"
        f" {HOURS}."
    )
    assert_gone(run, f"a DDE with {HOURS + 50} plugged hours on port 1, not the one with {HOURS}")


# -- while the link stands -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("which", "name", "said"),
    [("model", "model", "NAE"), ("software", "software version", "7777777")],
)
def test_another_station_in_mid_run_is_known_at_the_next_reading_of_the_counters(
    which: str, name: str, said: str
) -> None:
    """No answer is lost or repeated: the cable is moved to another station between questions."""
    run = prepare(line_text(f"counters = {{ plugged_hours = {HOURS} }}\n"), duration_s=200)
    identity = run.station.device.identity
    before = getattr(identity, which)
    run.at(80, lambda: setattr(identity, which, said))
    run.go()
    lost, *_ = run.memory.of_kind("link.lost")
    assert lost.text.startswith(
        f"This may be another station now: its {name} is {said}, and was {before}."
    )
    assert lost.earliest is not None
    assert (
        55
        < lost.earliest / 1e6 - run.utc_s(run.t0)
        < 80
        < lost.time / 1e6 - run.utc_s(run.t0)
        < 145
    )
    (event,) = run.memory.of_kind("identity.changed")
    assert said in event.text
    assert run.facts.outcome == "gone"
    assert [one.text for one in run.writes if one.at > run.t0 + 80] == []
    assert run.memory.column("temperature_c")[-1] is None


def test_a_model_that_one_flipped_answer_names_is_not_believed() -> None:
    run = prepare(
        line_text(
            "[[station.sim.fault]]\nkind = 'flip'\nbits = 2\ncommand = 'model'\nat_s = 50\nfor_s ="
            " 20\nevery = 2\n"
        ),
        duration_s=100,
    )
    run.go()
    assert run.facts.outcome == "completed"
    assert run.memory.of_kind("link.lost") == []


def test_model_and_software_are_read_as_often_as_the_counters_and_planned_for() -> None:
    run = prepare(duration_s=310).go()
    asked = [one.text for one in run.heard if one.at > run.t0 + 30]
    # and once before the safe order
    assert (asked.count("RSMN"), asked.count("RSVR")) == (5 + 1, 5 + 1)
    readings = readings_for(
        FAMILIES["dde"],
        [1, 2],
        run.contexts["dde-1"].recipe,
        LineFormat(19200, "8N1"),
        addressed=False,
    )
    assert [
        (one.name, one.port, one.asks_port, one.period_s) for one in readings if one.is_identity
    ] == [
        ("model", 1, None, 60.0),
        ("software_version", 1, None, 60.0),
    ]
    assert {
        name: counts["due"]
        for name, counts in run.facts.watched["1"].items()
        if name in IDENTITY_READS
    } == {
        "model": 5,
        "software_version": 5,
    }


@pytest.mark.parametrize(
    ("which", "said"),
    [("model", "NAE"), ("software", "7777777")],
    ids=["another model", "another one of its model"],
)
@pytest.mark.parametrize("change", ["set", "status", "limit"])
def test_what_another_station_answers_is_no_change_of_this_one(
    which: str, said: str, change: str
) -> None:
    """Before a change is recorded, the identity is read again, because the cable may have been
    moved.
    """
    run = prepare(line_text(f"counters = {{ plugged_hours = {HOURS} }}\n"), duration_s=100)

    def swap() -> None:
        setattr(run.station.device.identity, which, said)
        port = run.station.plant.ports[1]
        if change == "status":
            port.order(1, False)
        else:
            setattr(
                port.settings,
                "selected_temperature" if change == "set" else "alarm_high_limit",
                300,
            )

    run.at(10, swap)
    run.go()
    assert run.memory.of_kind("setting.changed") == []
    assert (run.facts.settings_changed, run.facts.outcome) == (0, "gone")
    (event,) = run.memory.of_kind("identity.changed")
    assert said in event.text
    assert [one.text for one in run.writes if one.at > run.t0 + 10] == []


def test_a_change_costs_one_look_at_the_identity_and_ticks_none() -> None:
    run = prepare(duration_s=40, recipe=RECIPE + 'on_difference = "continue"\n')
    run.at(10, lambda: setattr(run.station.plant.ports[1].settings, "selected_temperature", 300))
    run.go()
    asked = [one.text for one in run.heard if run.t0 + 10 < one.at < run.t0 + 39]
    assert (asked.count("RSMN"), asked.count("RSVR")) == (1, 1)
    assert len(run.memory.of_kind("setting.changed")) == 1


def test_a_change_is_not_recorded_while_the_identity_cannot_be_read() -> None:
    """It is recorded as soon as the identity is confirmed."""
    fault = "[[station.sim.fault]]\nkind = 'flip'\ncommand = 'model'\nat_s = 5\nfor_s = 30\n"
    run = prepare(line_text(fault), duration_s=50)
    run.at(10, lambda: setattr(run.station.plant.ports[1].settings, "selected_temperature", 300))
    run.go()
    (event,) = run.memory.of_kind("setting.changed")
    assert event.time / 1e6 - run.utc_s(run.t0) >= 35


def test_hours_that_two_answers_told_are_asked_once_more_as_a_counter() -> None:
    run = prepare(line_text("", "ports = [1]"), duration_s=1).go()
    first = next(place for place, one in enumerate(run.heard) if one.text == "RPP1")
    started = [one.text for one in run.heard[:first]]
    assert (started.count("RCP1"), started.count("RCW1")) == (3, 2)
    assert [one.counter for one in run.memory.counters][:1] == ["plugged_h"]
