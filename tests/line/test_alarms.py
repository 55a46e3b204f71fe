"""Alarm flags. The station latches a flag and clears it when it is read, so the session asks once,
and believes a flag only if temperatures confirm it.

The comparator of the virtual station latches a flag by itself if its tip is beyond the limit; for a
flag without a cause, these tests latch it.
"""

from __future__ import annotations

import pytest

from support.oracles.account import reasons_in
from support.product import COLUMN, EventRow
from support.virtual.lines import fault, say
from support.virtual.virtual_run import RECIPE, VirtualRun, line_text, prepare

AT_TEMPERATURE_S = 10.0  # long after the tip has reached its setting
ONE_PORT = "ports = [1]"


def one_port(sim: str = "", recipe: str = RECIPE, duration_s: float = 30) -> VirtualRun:
    """A run of one port without joints, whose tip would cool otherwise."""
    return prepare(
        line_text("joints_per_minute = 0\n" + sim, ONE_PORT), recipe, duration_s=duration_s
    )


def latch(run: VirtualRun, side: str, at_s: float) -> None:
    """Set a flag of the station at that second, without a cause."""
    run.at(at_s, lambda: setattr(getattr(run.station.plant.ports[1], side), "latched", True))


def told(run: VirtualRun) -> list[str]:
    """Return the kinds of alarm events after the tip was hot, oldest first."""
    begin = run.memory.samples[0][COLUMN["time"]] + int(AT_TEMPERATURE_S * 1e6)  # type: ignore[operator]
    return [
        event.kind
        for event in run.memory.events
        if event.kind.startswith("alarm.") and event.time >= begin
    ]


def only(run: VirtualRun, kind: str) -> EventRow:
    (event,) = run.memory.of_kind(kind)
    return event


def times_asked(run: VirtualRun) -> int:
    """Return how often the flags were read: whenever due, and once after the end of sampling."""
    return [one.text for one in run.heard].count("RTA1")


# -- what counts -----------------------------------------------------------------------------------


def test_an_alarm_that_temperatures_bear_out() -> None:
    run = one_port(fault("overheat", at_s=12, for_s=6, by_c=20)).go()
    event = only(run, "alarm.high")
    assert (event.severity, event.port, event.limit_value) == ("error", 1, 380)
    assert event.value is not None
    assert event.value > 380
    assert (run.facts.alarms, run.facts.unconfirmed_alarms) == (1, 0)
    assert told(run) == ["alarm.high", "alarm.high.ended"]
    assert True in run.memory.column("alarm_high")


def test_its_time_is_the_interval_between_two_readings() -> None:
    """A flag shows that there was an alarm, not when (docs/reference/faults.md, F-40)."""
    run = one_port(fault("overheat", at_s=12, for_s=6, by_c=20)).go()
    event = only(run, "alarm.high")
    flags = [
        int(str(row[COLUMN["time"]]))
        for row in run.memory.samples
        if row[COLUMN["alarm_high"]] is not None
    ]
    assert event.earliest is not None
    assert 1.9e6 < event.time - event.earliest < 2.2e6
    assert any(abs(event.earliest - time) < 0.2e6 for time in flags)


def test_it_is_kept_at_once() -> None:
    """The station has cleared the flag by then."""
    run = one_port(fault("overheat", at_s=12, for_s=6, by_c=20)).go()
    assert only(run, "alarm.high") in run.memory.urgent


def test_an_alarm_set_and_cleared_between_two_readings_is_caught() -> None:
    run = one_port(fault("overheat", at_s=12.2, for_s=1.2, by_c=30), duration_s=25).go()
    assert run.facts.alarms == 1


def test_an_alarm_that_goes_on_is_one() -> None:
    run = one_port(fault("overheat", at_s=12, for_s=15, by_c=20)).go()
    assert run.memory.column("alarm_high").count(True) > 4
    assert run.facts.alarms == 1


def test_an_alarm_that_comes_again_is_another() -> None:
    run = one_port(
        fault("overheat", at_s=12, for_s=4, by_c=20) + fault("overheat", at_s=25, for_s=4, by_c=20),
        duration_s=40,
    ).go()
    assert told(run) == ["alarm.high", "alarm.high.ended"] * 2
    assert run.facts.alarms == 2


def test_a_low_alarm() -> None:
    run = one_port("", duration_s=30)
    run.at(12, lambda: setattr(run.station.plant.ports[1], "stuck_c", 200))
    latch(run, "low", 13)
    run.go()
    assert only(run, "alarm.low").value == 200
    assert run.facts.alarms == 1


@pytest.mark.parametrize(
    ("side", "seen", "kind"),
    [
        ("high", 380, "alarm.unconfirmed"),
        ("high", 381, "alarm.high"),
        ("low", 250, "alarm.unconfirmed"),
        ("low", 249, "alarm.low"),
    ],
)
def test_only_a_temperature_beyond_the_limit_bears_a_flag_out(
    side: str, seen: int, kind: str
) -> None:
    run = one_port()
    run.at(12, lambda: setattr(run.station.plant.ports[1], "stuck_c", seen))
    latch(run, side, 13)
    run.go()
    assert only(run, kind).raw == side
    assert (run.facts.alarms, run.facts.unconfirmed_alarms) == (
        (0, 1) if kind == "alarm.unconfirmed" else (1, 0)
    )


@pytest.mark.parametrize(
    ("word", "high", "low"),
    [
        ("00000", False, False),
        ("00001", True, False),
        ("00010", False, True),
        ("00011", True, True),
    ],
)
def test_each_flag_has_its_digit_and_its_column(word: str, high: bool, low: bool) -> None:
    """The units digit is the flag of the high alarm, the tens digit that of the low one (manual
    000, 4.8.27).
    """
    run = one_port(duration_s=20)
    say(run, "TA1", word, 12.0)
    run.go()
    flags = [
        (row[COLUMN["alarm_high"]], row[COLUMN["alarm_low"]])
        for row in run.memory.samples
        if row[COLUMN["alarm_high"]] is not None and int(str(row[COLUMN["tick"]])) > 120
    ]
    assert flags[0] == (high, low)
    assert set(flags[1:]) == {(False, False)}  # a flag that was read is cleared


def test_an_alarm_of_the_last_seconds_is_not_lost() -> None:
    """It is raised after the last reading of the flags; they are read once more when the tool is
    safe.
    """
    run = one_port(fault("overheat", at_s=12.4, by_c=20), duration_s=13).go()
    assert True not in run.memory.column("alarm_high")
    assert run.facts.alarms == 1
    assert run.heard.index(next(one for one in run.heard if one.text == "WPS100001")) < max(
        place for place, one in enumerate(run.heard) if one.text == "RTA1"
    )


# -- what does not ---------------------------------------------------------------------------------


@pytest.mark.parametrize("side", ["high", "low"])
def test_a_flag_of_the_first_reading_was_there_before(side: str) -> None:
    run = one_port("settings = {status = 'working'}", duration_s=20)
    latch(run, side, 0.01)
    run.go()
    assert run.memory.of_kind("alarm.before_run")[0].severity == "info"
    assert (run.facts.alarms, run.facts.unconfirmed_alarms) == (0, 0)


def test_what_was_there_before_and_goes_on_counts_from_its_second_reading_on() -> None:
    """The first reading cleared the flag, so it was raised again during the run."""
    sim = "settings = {status = 'working', alarm_high_limit = 380, alarm_high_delay = 0.5}" + fault(
        "overheat", by_c=4
    )
    recipe = RECIPE.replace("select_c = 350", "select_c = 375")
    run = one_port(sim, recipe, duration_s=20)
    run.station.plant.ports[1].tip.temperature_c = 384.0
    run.go()
    assert [event.kind for event in run.memory.events if event.kind.startswith("alarm.")] == [
        "alarm.before_run",
        "alarm.high",
    ]
    assert run.facts.alarms == 1


def test_heating_up_is_no_alarm() -> None:
    """The tip passes the lower limit from below; the flag may be read after the tip has reached its
    setpoint.
    """
    for step in range(20):
        recipe = RECIPE.replace("delay_s = 2.0", f"delay_s = {0.1 * step:.1f}")
        run = one_port("", recipe, duration_s=15).go()
        assert (run.facts.alarms, run.facts.unconfirmed_alarms) == (0, 0), step
        assert (
            "alarm.low.not_working" in run.memory.kinds()
            or "alarm.before_run" in run.memory.kinds()
        )


@pytest.mark.parametrize("status", ["stand"])
def test_a_tool_that_does_not_work_has_no_alarms(status: str) -> None:
    run = one_port("", RECIPE.replace('"working"', f'"{status}"'))
    latch(run, "high", 12)
    run.go()
    assert told(run) == ["alarm.high.not_working", "alarm.high.ended"]
    assert (run.facts.alarms, run.facts.unconfirmed_alarms) == (0, 0)


# -- what is not borne out -------------------------------------------------------------------------


def test_a_flag_without_a_temperature_beyond_the_limit_is_unconfirmed() -> None:
    run = one_port()
    latch(run, "high", 12)
    run.go()
    event = only(run, "alarm.unconfirmed")
    assert (event.severity, event.raw, event.limit_value, event.value) == (
        "warning",
        "high",
        380,
        350,
    )
    assert (run.facts.alarms, run.facts.unconfirmed_alarms) == (0, 1)
    assert told(run) == ["alarm.unconfirmed", "alarm.high.ended"]


def test_an_old_temperature_bears_nothing_out() -> None:
    """The tip was beyond the limit in an earlier period, too short for the station's delay; the
    flag comes later.
    """
    run = one_port(
        fault("overheat", at_s=12, for_s=0.7, by_c=20),
        RECIPE.replace("delay_s = 0.5", "delay_s = 5.0"),
    )
    latch(run, "high", 20)
    run.go()
    assert (run.facts.alarms, run.facts.unconfirmed_alarms) == (0, 1)


def test_it_stays_unconfirmed_until_a_temperature_bears_it_out() -> None:
    run = one_port(fault("overheat", at_s=14, for_s=6, by_c=20), duration_s=40)
    for second in (12.0, 13.9):
        latch(run, "high", second)
    run.go()
    assert told(run) == ["alarm.unconfirmed", "alarm.high", "alarm.high.ended"]
    assert (run.facts.alarms, run.facts.unconfirmed_alarms) == (1, 0)


# -- what is not known -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sim", "why"),
    [
        (fault("silence", command="alarm_flags", at_s=11.9, for_s=2), "timeout"),
        (fault("flip", command="alarm_flags", at_s=11.9, for_s=2), None),
    ],
    ids=["lost", "corrupt"],
)
def test_a_lost_answer_makes_the_flags_unknown_and_is_not_asked_for_again(
    sim: str, why: str | None
) -> None:
    run = one_port(sim).go()
    event = only(run, "alarm.unknown")
    assert event.severity == "warning"
    assert event.earliest is not None
    missed = [row for row in run.memory.samples if "alarm_high" in reasons_in(row)]
    assert len(missed) == 1
    assert missed[0][COLUMN["alarm_high"]] is missed[0][COLUMN["alarm_low"]] is None
    if why:
        assert reasons_in(missed[0]) == {"alarm_high": why, "alarm_low": why}
    assert times_asked(run) == run.facts.due["1"]["alarm_high"] + 1


def test_an_alarm_whose_answer_was_lost_is_never_reported_as_none() -> None:
    run = one_port(
        fault("overheat", at_s=12, for_s=1.5, by_c=20)
        + fault("silence", command="alarm_flags", at_s=11.9, for_s=4)
    ).go()
    assert run.memory.of_kind("alarm.unknown") != []
    lost = [row for row in run.memory.samples if "alarm_high" in reasons_in(row)]
    assert all(row[COLUMN["alarm_high"]] is None for row in lost)


def test_what_was_hot_before_an_answer_was_lost_bears_out_no_flag_behind_it() -> None:
    """The flag that it raised was lost with the answer; the next one was raised later."""
    run = one_port(
        fault("overheat", at_s=11, for_s=1.5, by_c=20)
        + fault("silence", command="alarm_flags", at_s=12.9, for_s=2.5)
    )
    latch(run, "high", 15.5)
    run.go()
    lost, unconfirmed = run.memory.of_kind("alarm.unknown"), only(run, "alarm.unconfirmed")
    assert unconfirmed.earliest == pytest.approx(lost[-1].time, abs=2e5)
    assert run.facts.alarms == 0


@pytest.mark.parametrize("word", ["00200", "20001", "00100", "11111"])
def test_digits_that_no_manual_describes_are_a_format_error(word: str) -> None:
    run = one_port()
    asked = run.station.device.answer

    def answer(header: str, text: str, now: float) -> tuple[str, str] | None:
        found = asked(header, text, now)
        return ("A", f"TA1{word}") if text == "TA1" and run.t0 + 12 < now < run.t0 + 14 else found

    run.station.device.answer = answer  # type: ignore[method-assign]
    run.go()
    assert {reason for row in run.memory.samples for reason in reasons_in(row).values()} - {
        "not_counting"
    } == {"format"}
    assert only(run, "alarm.unknown").severity == "warning"
    assert times_asked(run) == run.facts.due["1"]["alarm_high"] + 1


def test_a_refusal_clears_nothing() -> None:
    """After N 4 the station has not sent its flags, so it has not cleared them."""
    run = one_port(fault("nak", code=3, command="alarm_flags", at_s=11.9, for_s=2)).go()
    assert run.memory.of_kind("alarm.unknown") == []


def test_flags_that_nobody_asked_for_are_not_lost() -> None:
    run = one_port(fault("dropout", at_s=12, for_s=8), RECIPE + 'on_difference = "continue"\n').go()
    assert len(run.memory.of_kind("alarm.unknown")) <= 1


def test_nobody_else_reads_the_flags() -> None:
    """Sampling reads them when they are due; reading settings does not, nor does the end of an
    outage. They are read once more when the tool is safe.
    """
    run = one_port(fault("dropout", at_s=12, for_s=2), RECIPE + 'on_difference = "continue"\n').go()
    disconnected = sum(
        reasons_in(row).get("alarm_high") == "disconnected" for row in run.memory.samples
    )
    due = run.facts.due["1"]["alarm_high"] + 1
    assert due - disconnected <= times_asked(run) <= due


def test_a_tip_that_is_found_hotter_than_its_setting_and_does_not_cool_has_arrived() -> None:
    """At one reading in four seconds, a runaway tip is never read near its setpoint; it is still an
    alarm.
    """
    slow = RECIPE + "\n[sampling]\nrate_hz = 0.25\n"
    run = one_port(fault("overheat", by_c=60.0), slow, duration_s=60).go()
    assert not [
        row for row in run.memory.samples if row[COLUMN["temperature_c"]] in range(340, 361)
    ]
    assert only(run, "alarm.high").value == 440
    assert run.facts.alarms == 1


def test_a_runaway_behind_an_exchange_of_the_tool_is_an_alarm() -> None:
    pulled = fault("tool", at_s=6.0, for_s=7.0, code=0) + fault(
        "overheat", at_s=10.0, for_s=30.0, by_c=60.0
    )
    run = one_port(pulled, duration_s=40).go()
    assert run.facts.alarms == 1


def test_a_tip_that_cools_down_to_its_setting_is_no_alarm() -> None:
    """It was at 450 °C before; its flag stays set until it has cooled below the limit."""
    run = one_port("settings = {status = 'working'}", duration_s=40)
    run.station.plant.ports[1].tip.temperature_c = 450
    run.go()
    assert run.memory.samples[0][COLUMN["temperature_c"]] > 380  # type: ignore[operator]
    assert run.facts.alarms == 0
