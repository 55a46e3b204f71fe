"""A disconnected station: its ticks keep their rows, nothing is written to it, and it is examined
before it counts again.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

import pytest

from support.oracles.account import assert_account_holds, reasons_in, wrong_values
from support.product import COLUMN, FAMILIES, STAND, WORKING
from support.virtual.lines import fault
from support.virtual.virtual_run import RECIPE, VirtualRun, line_text, prepare

GOING_ON = RECIPE + 'on_difference = "continue"\n'


def away_for_3_s(kind: str) -> str:
    """Return a fault that makes the station unavailable for 3 s, in one of several ways."""
    return fault(kind, at_s=4, for_s=3, **({"code": 5} if kind == "nak" else {}))


def writes_between(run: VirtualRun, begin_s: float, end_s: float) -> list[str]:
    return [one.text for one in run.writes if run.t0 + begin_s <= one.at < run.t0 + end_s]


def second(run: VirtualRun, tick: object) -> float:
    """Return the second of the run at which a tick was due."""
    assert isinstance(tick, int)
    assert run.facts.period_s is not None
    return tick * run.facts.period_s


def missing(run: VirtualRun, why: str) -> list[float]:
    """Return the due times of the ticks whose temperature is missing for that reason."""
    return [
        second(run, row[COLUMN["tick"]])
        for row in run.memory.samples
        if reasons_in(row).get("temperature_c") == why
    ]


# -- rows and account ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "why", "lost", "back"),
    [
        ("dropout", "disconnected", "link.lost", "link.back"),
        ("silence", "disconnected", "link.lost", "link.back"),
        ("restart", "disconnected", "link.lost", "link.back"),
        ("nak", "robot_off", "robot.off", "robot.on"),
    ],
)
def test_every_tick_has_its_rows_and_every_reading_its_reason(
    kind: str, why: str, lost: str, back: str
) -> None:
    run = prepare(line_text(away_for_3_s(kind)), GOING_ON, duration_s=12).go()
    assert_account_holds(run)
    gone = missing(run, why)
    assert min(gone) == pytest.approx(4.0, abs=0.5)
    # sought with back-off, and looked at before it counts
    assert max(gone) == pytest.approx(7.0, abs=1.5)
    assert len(set(gone)) == pytest.approx(33, abs=10)
    assert run.facts.outages == 1
    kinds = [event.kind for event in run.memory.events if event.kind in (lost, back)]
    assert kinds == [lost, back]
    assert run.facts.outcome == "completed"
    assert wrong_values(run) == []


@pytest.mark.parametrize("rate", [4, 0.25])
def test_a_slow_reading_is_due_as_often_as_without_an_outage(rate: float) -> None:
    """At 0.25 Hz, one of 5 s is due in two ticks of three, and one of 2 s in each."""
    seconds = 150 / rate
    gone = fault("dropout", at_s=0.1 * seconds, for_s=0.8 * seconds)
    runs = [
        prepare(line_text(sim, "ports = [1]"), GOING_ON, duration_s=seconds, rate=rate).go()
        for sim in (gone, "")
    ]
    away, connected = (run.facts.due["1"] for run in runs)
    assert [run.facts.outages for run in runs] == [1, 0]
    assert connected["tool"] > 5
    assert away == pytest.approx(connected, abs=1)  # one may be due in the tick that is lost


@pytest.mark.parametrize("kind", ["dropout", "silence", "nak"])
def test_nothing_is_written_while_it_is_away_or_when_it_is_back(kind: str) -> None:
    run = prepare(line_text(away_for_3_s(kind)), GOING_ON, duration_s=12).go()
    assert writes_between(run, 2, 12) == []
    assert [write.value for write in run.station.log.written("status") if write.port == 1] == [
        WORKING,
        STAND,
    ]


@pytest.mark.parametrize("kind", ["dropout", "silence"])
@pytest.mark.parametrize("for_s", [1.0, 2.0, 30.0])
def test_one_that_goes_away_as_the_run_ends_is_sought_for_three_seconds(
    kind: str, for_s: float
) -> None:
    run = prepare(line_text(fault(kind, at_s=11.8, for_s=for_s)), duration_s=12).go()
    assert_account_holds(run)
    assert run.facts.outages == 1
    if for_s < 3:
        assert (run.facts.outcome, run.facts.reason) == ("completed", "")
        assert len(run.memory.of_kind("link.back")) == 1
        assert run.facts.safe_state == {1: "verified", 2: "verified"}
    else:
        assert run.facts.outcome == "gone"
        away = re.search(
            r"not reachable for the last (\d+\.\d) s; waited 3 s after the end of the run",
            run.facts.reason,
        )
        assert away is not None, run.facts.reason
        assert 2.9 < float(away[1]) < 8.0


def test_a_hot_tip_behind_a_cut_cable_is_critical() -> None:
    run = prepare(line_text(away_for_3_s("dropout")), duration_s=12).go()
    (event,) = run.memory.of_kind("link.lost")
    assert event.severity == "critical"
    assert re.search(r"port 1 at [23]\d\d °C", event.text)


def test_a_seek_with_back_off() -> None:
    """In an outage of ten minutes: two questions about every five seconds, not hundreds."""
    run = prepare(line_text(fault("silence", at_s=4, for_s=600)), duration_s=610).go()
    asked = [one.text for one in run.heard if run.t0 + 60 < one.at < run.t0 + 600]
    assert 150 < len(asked) < 250
    assert_account_holds(run)


def test_without_a_grid_an_outage_leaves_a_row_a_scan_and_no_flood() -> None:
    """With `--rate max` ticks count scans; scans that did not take place get no rows afterwards."""
    run = prepare(line_text(away_for_3_s("dropout"), "ports = [1]"), duration_s=60, rate="max").go()
    ticks = run.memory.column("tick")
    assert ticks == list(range(len(ticks)))
    times = [int(str(moment)) / 1e6 for moment in run.memory.column("time")]
    steps = [after - before for before, after in pairwise(times)]
    assert min(steps) > 0.02
    assert max(steps) < 1
    assert_account_holds(run)


# -- who is back -----------------------------------------------------------------------------------


def test_another_model_is_never_resumed() -> None:
    run = prepare(line_text(away_for_3_s("dropout")), duration_s=20)
    run.at(5, lambda: setattr(run.station.device.identity, "model", "NAE"))
    run.go()
    assert run.facts.outcome == "gone"
    assert len(run.memory.of_kind("identity.changed")) == 1
    assert missing(run, "disconnected")[-1] == pytest.approx(second(run, run.facts.last_tick))
    assert_account_holds(run)


def test_it_is_resumed_once_the_right_one_is_back() -> None:
    run = prepare(line_text(away_for_3_s("dropout")), duration_s=30)
    run.at(5, lambda: setattr(run.station.device.identity, "model", "NAE"))
    run.at(15, lambda: setattr(run.station.device.identity, "model", "DDE"))
    run.go()
    assert run.facts.outcome == "completed"
    assert max(missing(run, "disconnected")) == pytest.approx(15, abs=4)
    assert run.facts.safe_state == {1: "verified", 2: "verified"}


def test_identity_and_settings_are_read_before_its_samples_count() -> None:
    run = prepare(line_text(away_for_3_s("dropout")), duration_s=12).go()
    after = [one.text for one in run.heard if one.at > run.t0 + 7]
    first = after.index("RTT1")
    assert after[0] == "RSMN"
    assert {
        "RCT1",
        "RST1",
        "RPS1",
        "RHA1",
        "RLA1",
        "RHD1",
        "RLD1",
        "RA12",
        "RS12",
        "RD12",
        "RH12",
        "RST2",
    } <= set(after[:first])


# -- what has changed meanwhile --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("selected_temperature", 300),
        ("alarm_high_limit", 400),
        ("alarm_low_delay", 9.0),
        ("alarm_high_limit", "off"),
    ],
)
def test_a_difference_is_an_event_and_stops_the_run(name: str, value: object) -> None:
    from support.product import OFF

    run = prepare(line_text(away_for_3_s("dropout")), duration_s=20)
    run.at(
        5,
        lambda: setattr(
            run.station.plant.ports[2].settings, name, OFF if value == "off" else value
        ),
    )
    run.go()
    assert run.facts.outcome == "stopped"
    assert name.replace("_", " ") in run.facts.reason
    (event,) = run.memory.of_kind("setting.changed")
    assert event.port == 2
    assert len(run.memory.of_kind("link.back")) == 1
    assert [one.text for one in run.writes][-2:] == ["WPS100001", "WPS200001"]
    assert_account_holds(run)


def test_the_recipe_may_go_on_with_a_difference_and_nothing_is_written_again() -> None:
    run = prepare(line_text(away_for_3_s("dropout")), GOING_ON, duration_s=20)
    run.at(5, lambda: setattr(run.station.plant.ports[2].settings, "selected_temperature", 300))
    run.go()
    assert run.facts.outcome == "completed"
    assert run.facts.settings_changed == 1
    assert writes_between(run, 2, 20) == []
    assert run.station.plant.ports[2].settings.selected_temperature == 300


def test_a_restart_is_found_by_what_it_lost() -> None:
    """The selected temperature is volatile (manual 002, W-STx); the tool is in its first state."""
    recipe = RECIPE.replace("select_c = 350", "select_c = 300")
    run = prepare(line_text(away_for_3_s("restart")), recipe, duration_s=20).go()
    assert run.facts.outcome == "stopped"
    found = {event.raw for event in run.memory.of_kind("setting.changed")}
    assert any("selected_temperature" in str(raw) for raw in found)
    assert {
        write.value for write in run.station.log.written("status") if write.at > run.t0 + 5
    } == {STAND}


def test_a_tool_s_own_way_from_stand_to_sleep_is_no_difference() -> None:
    sim = "settings = {sleep_delay = 1, hibernation_delay = 5}" + fault(
        "dropout", at_s=50, for_s=30
    )
    recipe = RECIPE.replace("delay_min = 5", "delay_min = 1").replace('"working"', '"stand"')
    run = prepare(line_text(sim), recipe, duration_s=120).go()
    assert run.facts.outcome == "completed"
    assert {"stand", "sleep"} <= set(run.memory.column("status"))
    assert run.facts.settings_changed == 0


def test_a_tool_exchanged_while_it_was_away_is_no_changed_setting() -> None:
    run = prepare(
        line_text(away_for_3_s("dropout") + fault("tool", port=1, code=3, at_s=5)), duration_s=20
    )
    run.at(1, lambda: setattr(run.station.plant.ports[1].tools[3], "sleep_temperature", 210))
    run.go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert [event.port for event in run.memory.of_kind("tool.changed")] == [1]
    read = [
        row.readback
        for row in run.memory.settings
        if (row.setting, row.tool_name) == ("sleep_temperature", FAMILIES["dde"].tool_name(3))
    ]
    assert read == ["210"]


# -- when the run ends meanwhile -------------------------------------------------------------------


def test_gone_at_the_end_of_its_duration() -> None:
    run = prepare(line_text(fault("dropout", at_s=4, for_s=1000)), duration_s=10).go()
    assert run.facts.outcome == "gone"
    assert second(run, run.facts.last_tick) == pytest.approx(
        run.memory.column("tick")[0] * 0.1 + 9.9
    )  # type: ignore[operator]
    assert_account_holds(run)


@pytest.mark.parametrize("at_s", [4.5, 5.0, 6.95, 7.3])
def test_ended_while_it_is_away(at_s: float) -> None:
    run = prepare(line_text(fault("dropout", at_s=4, for_s=1000)), duration_s=None)
    run.at(at_s, lambda: run.driver.end("SIGINT"))
    run.go()
    assert run.facts.outcome == "gone"
    assert len(run.facts.unsafe) == 2
    assert_account_holds(run)


@pytest.mark.parametrize("kind", ["dropout", "silence"])
@pytest.mark.parametrize("at_s", [4.7, 5.5])
def test_one_that_was_only_late_when_the_run_was_ended_is_not_gone(kind: str, at_s: float) -> None:
    """It confirmed its safe state, so the signal is the only reason for the end."""
    run = prepare(line_text(fault(kind, at_s=4, for_s=2.0)), duration_s=None)
    run.at(at_s, lambda: run.driver.end("ended by SIGTERM"))
    run.go()
    assert run.facts.safe_state == {1: "verified", 2: "verified"}
    assert run.facts.outcome == "completed"
    assert run.facts.reason.startswith("ended by SIGTERM")
    assert run.memory.of_kind("station.gone") == []
    assert_account_holds(run)


def test_one_that_was_only_looked_at_is_let_go_at_once() -> None:
    """`jbclog safe` may need its port, for tools that somebody else has heated."""
    recipe = '[recipe]\nname = "look"\nrevision = 1\nfamilies = ["dde"]\n'
    sim = "settings = {sleep_delay = 5, hibernation_delay = 30}"
    run = prepare(line_text(sim + fault("dropout", at_s=4, for_s=2.0)), recipe, duration_s=None)
    run.at(4.7, lambda: run.driver.end("ended by SIGTERM"))
    run.go()
    assert (run.facts.outcome, run.facts.touched) == ("gone", [])
    assert run.driver.clock.monotonic() < run.t0 + 5
    assert_account_holds(run)


# -- found changed without any outage --------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "within_s"),
    [
        (lambda port: setattr(port.settings, "selected_temperature", 300), 6),
        (lambda port: port.order(1, False), 1),
        (lambda port: port.order(0, True), 1),  # extractor: the heater is off
        (lambda port: setattr(port.settings, "alarm_high_limit", 400), 70),
    ],
    ids=["set", "stand", "extractor", "limit"],
)
def test_a_setting_changed_by_somebody_else_is_found(change: object, within_s: float) -> None:
    assert callable(change)
    run = prepare(duration_s=200)
    run.at(5, lambda: change(run.station.plant.ports[1]))
    run.go()
    assert run.facts.outcome == "stopped"
    (event,) = run.memory.of_kind("setting.changed")
    assert event.severity == "error"
    assert run.heard[-1].at - run.t0 < 5 + within_s + 2


def test_a_tool_that_somebody_else_puts_to_work_is_found() -> None:
    run = prepare(line_text(), RECIPE.replace('"working"', '"stand"'), duration_s=60)
    run.at(5, lambda: run.station.plant.ports[1].order(0, False))
    run.go()
    assert run.facts.outcome == "stopped"
    assert [write.value for write in run.station.log.written("status") if write.port == 1][
        -1
    ] == STAND


def test_the_tool_s_state_is_nobody_s_business_where_the_recipe_has_none() -> None:
    recipe = RECIPE.replace('status = "working"\n', "")
    run = prepare(line_text(away_for_3_s("dropout")), recipe, duration_s=20)
    run.at(3, lambda: run.station.plant.ports[1].order(1, False))
    run.at(5, lambda: run.station.plant.ports[2].order(1, False))
    run.go()
    assert run.facts.outcome == "completed", run.facts.reason


def test_a_station_that_falls_silent_at_its_last_counters_is_not_asked_for_each_of_them() -> None:
    run = prepare(line_text("", "ports = [1]"), duration_s=3)
    (tap,) = run.taps.values()
    receive = tap.receive

    def silent_at_the_end(data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        replies, asked = receive(data, now), [one.text for one in tap.heard]
        return (
            []
            if asked.count("WPS100001")
            and asked.count("RCP1") > asked[: asked.index("WPS100001")].count("RCP1")
            else replies
        )

    tap.receive = silent_at_the_end  # type: ignore[method-assign]
    run.go()
    assert run.facts.outcome == "completed"
    assert run.memory.kinds().count("counters.missed") == 1
    assert [one.raw for one in run.memory.counters if one.value is None] == ["<timeout>"]
