"""The recipe on the station: each setting that differs is written and read back, and has a row in
`settings`.
"""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from support.product import FAMILIES, OFF, SETTING_REPEATS, STAND, WORKING, SettingRow
from support.virtual.lines import fault, say
from support.virtual.virtual_run import RECIPE, VirtualRun, is_cold_in_extractor, line_text, prepare

ALL_FAMILIES = 'families = ["soldering", "dde", "nae", "dme", "hde", "ucr", "ale"]'
TOOL_2, TOOL_3 = (FAMILIES["dde"].tool_name(code) for code in (2, 3))


def rows(run: VirtualRun, setting: str, port: int | None = 1) -> list[SettingRow]:
    """Return the rows of a setting, but not those of its earlier value and of lost writes."""
    found = [
        row
        for row in run.memory.settings
        if (row.setting, row.port) == (setting, port) and row.outcome != "repeated"
    ]
    return found[1:] if len(found) > 1 and found[0].outcome == "read" else found


def outcome(run: VirtualRun, setting: str, port: int | None = 1) -> str:
    (row,) = rows(run, setting, port)
    return row.outcome


def moment_of(question: str) -> float:
    """Return the second at which an undisturbed run sends that question, counted as for faults."""
    run = prepare(duration_s=1).go()
    return round(next(one.at for one in run.heard if one.text == question) - run.heard[0].at, 4)


def assert_stopped_before_sampling(run: VirtualRun, *words: str) -> None:
    """The run was refused with these words, nothing was sampled, and every tool that was written to
    is safe.
    """
    assert run.facts.outcome == "refused"
    assert run.memory.samples == []
    for word in words:
        assert word in run.facts.reason
    (context,) = run.contexts.values()
    for port in {write.port for write in run.station.log.writes if write.port}:
        told = [write.value for write in run.station.log.written("status") if write.port == port]
        if context.step > 2:
            assert told == [STAND]
        else:  # it rested, and would be heated to be told to stand
            assert told == []
            assert is_cold_in_extractor(run.station, port)


# -- outcomes --------------------------------------------------------------------------------------


def test_what_differs_is_written_once_read_back_and_confirmed() -> None:
    run = prepare(duration_s=1).go()
    (row,) = rows(run, "alarm_high_limit")
    assert row[5:] == ("°C", "380", "380", "380", None, "confirmed")
    assert [one.text for one in run.writes].count("WHA100380") == 1
    assert run.station.plant.ports[1].settings.alarm_high_limit == 380
    before, _ = [
        row for row in run.memory.settings if (row.setting, row.port) == ("alarm_high_limit", 1)
    ]
    assert (before.requested, before.written, before.readback, before.outcome) == (
        None,
        None,
        "off",
        "read",
    )
    written = next(place for place, one in enumerate(run.heard) if one.text == "WHA100380")
    assert run.heard[written + 1].text == "RHA1"


def test_what_already_holds_is_not_written_again() -> None:
    run = prepare(duration_s=1).go()
    (row,) = rows(run, "selected_temperature")
    assert (row.requested, row.written, row.readback, row.outcome) == (
        "350",
        None,
        "350",
        "unchanged",
    )
    assert not any(one.text.startswith("WST") for one in run.writes)


def test_a_recipe_that_holds_already_writes_nothing_the_second_time() -> None:
    once = prepare(duration_s=1).go()
    held = (
        "alarm_high_limit = 380, alarm_high_delay = 0.5, alarm_low_limit = 250, alarm_low_delay ="
        " 2.0, status = 'stand'"
    )
    again = prepare(
        line_text(f"settings = {{{held}}}"), RECIPE.replace('"working"', '"stand"'), duration_s=1
    ).go()
    assert {row.outcome for row in again.memory.settings if row.requested} == {"unchanged"}
    # the safe state at the end
    assert [one.text for one in again.writes] == ["WPS100001", "WPS200001"]
    assert len(once.writes) > len(again.writes)


def test_a_key_that_the_recipe_does_not_have_is_read_and_recorded_and_left_alone() -> None:
    run = prepare(line_text("settings = {adjust = -7}"), duration_s=1).go()
    (row,) = rows(run, "adjust")
    assert (row.tool_name, row.requested, row.written, row.readback, row.outcome) == (
        TOOL_2,
        None,
        None,
        "-7",
        "read",
    )
    assert not any(one.text.startswith("WA1") for one in run.writes)
    assert outcome(run, "maximum_temperature", None) == "read"


def test_values_of_one_port() -> None:
    run = prepare(recipe=RECIPE + "\n[port.2.temperature]\nselect_c = 330\n", duration_s=1).go()
    assert [run.station.plant.ports[port].settings.selected_temperature for port in (1, 2)] == [
        350,
        330,
    ]
    assert (outcome(run, "selected_temperature", 1), outcome(run, "selected_temperature", 2)) == (
        "unchanged",
        "confirmed",
    )


def test_heat_is_asked_for_last() -> None:
    """A failure before that leaves the tool no worse than it was."""
    sim = "settings = {selected_temperature = 100, sleep_delay = 9, hibernation_delay = 60}"
    run = prepare(line_text(sim, "ports = [1]"), duration_s=1).go()
    names = [write.name for write in run.station.log.writes]
    assert names[:2] == ["sleep_delay", "hibernation_delay"]
    assert names[-3:] == ["selected_temperature", "status", "status"]


def test_sections_of_other_families_are_unsupported_and_stop_nothing() -> None:
    run = prepare(recipe=RECIPE + "\n[feeder]\nlength_mm = 7.5\n", duration_s=1).go()
    assert outcome(run, "feeder_length", None) == "unsupported"
    assert run.facts.outcome == "completed"


def test_a_setting_that_the_station_does_not_know_is_unsupported_and_stops_nothing() -> None:
    run = prepare(line_text(fault("nak", code=4, command="alarm_low_delay")), duration_s=1).go()
    assert outcome(run, "alarm_low_delay") == "unsupported"
    assert "alarm_low_delay" in run.facts.not_supported
    assert run.facts.outcome == "completed"


# -- what stops it ---------------------------------------------------------------------------------


def clamped(run: VirtualRun) -> None:
    """Let the station acknowledge a limit of 380 and keep 375."""
    asked = run.station.device.answer

    def answer(header: str, text: str, now: float) -> tuple[str, str] | None:
        return asked(header, "HA100375" if (header, text) == ("W", "HA100380") else text, now)

    run.station.device.answer = answer  # type: ignore[method-assign]


def test_a_value_that_did_not_take_stops_the_run() -> None:
    run = prepare(line_text("settings = {alarm_high_limit = 400}"), duration_s=5)
    clamped(run)
    run.go()
    (row,) = rows(run, "alarm_high_limit")
    assert (row.requested, row.written, row.readback, row.outcome) == (
        "380",
        "380",
        "375",
        "mismatch",
    )
    assert_stopped_before_sampling(
        run,
        "alarm high limit of port 1",
        "requested 380 °C, but ",
        "375 °C was read back",
        "previous value: 400 °C",
    )
    assert rows(run, "alarm_high_limit", 2) == []  # nothing more is tried


@pytest.mark.parametrize("code", [1, 2, 3, 4, 5, 6, 99999])
def test_a_refusal_stops_the_run(code: int) -> None:
    run = prepare(
        line_text(fault("nak", code=code, command="alarm_high_limit", only="write")), duration_s=5
    ).go()
    (row,) = rows(run, "alarm_high_limit")
    assert (row.written, row.readback, row.nak, row.outcome) == ("380", None, code, "refused")
    assert_stopped_before_sampling(
        run,
        "alarm high limit of port 1",
        "requested 380 °C, but ",
        f"N {code:05d}",
        "previous value: off",
    )
    sent = 1 + SETTING_REPEATS if code in (1, 2) else 1  # what was not understood was not done
    assert [one.text for one in run.writes].count("WHA100380") == sent


def test_a_setting_that_is_told_and_not_taken_is_refused_and_stops_the_run() -> None:
    """It answers the read, so it has the setting: without a stop it would heat at the old value."""
    sim = "settings = {selected_temperature = 400}" + fault(
        "nak", code=4, command="selected_temperature", only="write"
    )
    run = prepare(line_text(sim).replace("dde", "hde"), duration_s=5).go()
    (row,) = rows(run, "selected_temperature")
    assert (row.requested, row.nak, row.outcome) == ("350", 4, "refused")
    assert_stopped_before_sampling(
        run,
        "selected temperature of port 1",
        "requested 350 °C, but ",
        "N 00004",
        "previous value: 400 °C",
    )


def test_a_status_that_is_told_and_not_taken_stops_the_run() -> None:
    run = prepare(
        line_text(fault("nak", code=4, command="status", only="write", for_s=2)), duration_s=5
    ).go()
    assert [(row.port, row.nak, row.outcome) for row in rows(run, "status") if row.requested] == [
        (1, 4, "refused")
    ]
    assert (run.facts.outcome, run.memory.samples) == ("refused", [])
    assert "N 00004" in run.facts.reason


def test_a_status_that_is_not_told_is_unsupported_and_nobody_puts_the_tool_to_work() -> None:
    run = prepare(line_text(fault("nak", code=4, command="status", only="read")), duration_s=1).go()
    assert outcome(run, "status") == "unsupported"
    assert WORKING not in [write.value for write in run.station.log.written("status")]
    assert run.facts.touched == [1, 2]  # and told to rest at the end: it may be at work


def test_a_setting_that_one_port_alone_does_not_tell_is_written_on_the_other() -> None:
    run = prepare(
        line_text(fault("nak", code=4, command="alarm_low_delay", port=2)), duration_s=1
    ).go()
    assert (outcome(run, "alarm_low_delay", 1), outcome(run, "alarm_low_delay", 2)) == (
        "confirmed",
        "unsupported",
    )


def test_a_write_whose_acknowledgement_is_lost_is_settled_by_reading() -> None:
    run = prepare(
        line_text(fault("silence", command="alarm_high_limit", only="write")), duration_s=1
    ).go()
    assert outcome(run, "alarm_high_limit") == "confirmed"
    assert [one.text for one in run.writes].count("WHA100380") == 1
    assert run.facts.outcome == "completed"


def test_a_write_that_cannot_be_read_back_is_unconfirmed_and_stops_the_run() -> None:
    run = prepare(
        line_text(fault("silence", command="alarm_high_limit", at_s=moment_of("WHA100380"))),
        duration_s=5,
    ).go()
    assert outcome(run, "alarm_high_limit") == "unconfirmed"
    assert_stopped_before_sampling(
        run,
        "alarm high limit of port 1",
        "requested 380 °C, but ",
        "could not be read back",
        "in 4 writes",
    )


# -- what is lost on the way -----------------------------------------------------------------------


def lose(run: VirtualRun, code: str, times: int) -> None:
    """Lose the first `times` writes of `code` on the way to the station."""
    (tap,) = run.taps.values()
    through, left = tap.receive, [times]

    def receive(data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        if f"W{code}".encode() in data and left[0]:
            left[0] -= 1
            return []
        return through(data, now)

    tap.receive = receive  # type: ignore[method-assign]


@pytest.mark.parametrize("times", range(1, 1 + SETTING_REPEATS))
@pytest.mark.parametrize(
    ("code", "setting", "asked"),
    [
        ("HA1", "alarm_high_limit", "380"),
        ("ST1", "selected_temperature", "350"),
        ("PS1", "status", "00000"),
    ],
)
def test_a_lost_write_is_written_again(code: str, setting: str, asked: str, times: int) -> None:
    run = prepare(line_text("settings = {selected_temperature = 300}"), duration_s=1)
    lose(run, code, times)
    run.go()
    assert run.facts.outcome == "completed"
    again = [
        row
        for row in run.memory.settings
        if (row.setting, row.port, row.outcome) == (setting, 1, "repeated")
    ]
    assert (
        len(again)
        == len(run.memory.of_kind("setting.repeated"))
        == run.facts.settings_repeated
        == times
    )
    before = {"alarm_high_limit": "off", "selected_temperature": "300", "status": "00010"}[setting]
    assert [(row.readback, row.written) for row in again] == [
        (before, row.requested) for row in again
    ]
    assert (rows(run, setting)[-1].outcome, again[0].requested) == ("confirmed", asked)
    assert [event.value for event in run.memory.of_kind("setting.repeated")] == list(
        range(2, 2 + times)
    )


def test_a_write_that_is_always_lost_stops_the_run_and_says_how_often_it_was_tried() -> None:
    run = prepare(line_text("settings = {alarm_high_limit = 400}"), duration_s=5)
    lose(run, "HA1", 99)
    run.go()
    assert outcome(run, "alarm_high_limit") == "mismatch"
    assert run.facts.settings_repeated == SETTING_REPEATS
    assert_stopped_before_sampling(
        run,
        "alarm high limit of port 1",
        "400 °C was read back",
        f"in {1 + SETTING_REPEATS} writes",
    )


@pytest.mark.parametrize("code", ["ST1", "PS1"])
def test_what_heats_is_written_again_only_where_two_answers_say_that_the_old_value_stands(
    code: str,
) -> None:
    """Its acknowledgement is lost and it cannot be read back, so it is not known whether it was
    done.
    """
    run = prepare(line_text("settings = {selected_temperature = 300}"), duration_s=5)
    (tap,) = run.taps.values()
    through, written = tap.receive, []

    def receive(data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        is_safe_order = b"WPS100001" in data
        written.extend([data] if f"W{code}".encode() in data and not is_safe_order else [])
        is_deaf = (
            bool(written)
            and code.encode() in data
            and not is_safe_order
            and run.facts.outcome == "running"
        )
        return [] if is_deaf else through(data, now)

    tap.receive = receive  # type: ignore[method-assign]
    run.go()
    assert len(written) == 1
    assert (run.facts.outcome, run.facts.settings_repeated) == ("refused", 0)
    assert [write.value for write in run.station.log.written("status")] in (
        [],
        [STAND],
        [STAND, STAND],
    )


def test_between_two_writes_of_what_heats_the_old_value_is_read_twice() -> None:
    run = prepare(line_text("settings = {selected_temperature = 300}"), duration_s=1)
    lose(run, "ST1", 1)
    run.go()
    (written,) = [one.at for one in run.writes if one.text == "WST100350"]
    first = next(event.time for event in run.memory.of_kind("setting.repeated")) / 1e6
    answers = [
        one
        for one in run.heard
        if one.text == "RST1" and one.at < written and one.clean == "AST100300"
    ]
    assert [one.at for one in answers][-2:] == sorted(one.at for one in answers)[-2:]
    assert len([one for one in answers if run.utc_s(one.at) > first - 1.0]) == 2


def test_nothing_is_written_again_once_the_run_is_to_end() -> None:
    run = prepare(line_text("settings = {selected_temperature = 300}"), duration_s=5)
    lose(run, "ST1", 99)
    at_s = moment_of_loss() + 0.5
    run.at(at_s, lambda: run.driver.end("ended by a test"))
    run.go()
    assert run.facts.outcome == "completed"
    assert not any(one.text == "WST100350" for one in run.writes)
    assert outcome(run, "selected_temperature") == "unconfirmed"
    assert WORKING not in [write.value for write in run.station.log.written("status")]


def moment_of_loss() -> float:
    """Return the second at which a run sends the setpoint to a station at 300 °C."""
    run = prepare(line_text("settings = {selected_temperature = 300}"), duration_s=1).go()
    return next(one.at for one in run.heard if one.text == "WST100350") - run.t0


@pytest.mark.parametrize(
    "command", ["software_version", "tool", "plugged_hours", "alarm_low_limit", "status"]
)
def test_a_station_that_says_nothing_for_a_moment_is_asked_again(command: str) -> None:
    """It is silent for longer than the client's own repeats and probes take."""
    run = prepare(duration_s=1)
    (tap,) = run.taps.values()
    (context,) = run.contexts.values()
    through, since = tap.receive, [0.0]
    code = context.command(command).letters.encode()

    def receive(data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        since[0] = since[0] or (now if b"R" + code in data else 0.0)
        return [] if since[0] and now < since[0] + 0.7 else through(data, now)

    tap.receive = receive  # type: ignore[method-assign]
    run.go()
    assert run.facts.outcome == "completed"
    assert command not in run.facts.not_supported
    assert run.facts.software is not None


@pytest.mark.parametrize(("kind", "told"), [("silence", True), ("nak", False)])
def test_a_software_that_could_not_be_read_is_not_known_and_one_that_is_refused_is_not_supported(
    kind: str, told: bool
) -> None:
    keys = {"code": 4} if kind == "nak" else {}
    run = prepare(line_text(fault(kind, command="software_version", **keys)), duration_s=1).go()
    assert run.facts.outcome == "completed"
    assert run.facts.software is None
    assert ("software_version" in run.facts.not_supported) != told
    events = run.memory.of_kind("identity.not_known")
    assert [event.severity for event in events] == ["warning"] * told
    assert all(
        "in 5 tries" in event.text and "identified without it" in event.text for event in events
    )


def test_a_software_that_is_told_later_than_the_start_makes_nobody_another_station() -> None:
    run = prepare(
        line_text(fault("silence", command="software_version", at_s=0, for_s=30)), duration_s=150
    ).go()
    assert (run.facts.outcome, run.facts.outages, run.facts.software) == ("completed", 0, None)
    assert len(run.memory.of_kind("identity.not_known")) == 1


def test_a_link_that_breaks_in_a_write_leaves_it_unconfirmed() -> None:
    at_s = moment_of("WHA100380") + 0.001
    run = prepare(line_text(fault("dropout", at_s=at_s, for_s=3)), duration_s=5).go()
    assert run.facts.outcome == "gone"
    assert outcome(run, "alarm_high_limit") == "unconfirmed"
    assert "alarm high limit of port 1" in run.facts.reason


def test_robot_mode_that_only_a_write_shows_to_be_off_is_said_with_what_to_do() -> None:
    """The station answers a write with N 00005 and still answers every read, so nothing showed it
    earlier.
    """
    run = prepare(line_text(fault("nak", only="write", code=5)), duration_s=5).go()
    assert run.facts.outcome == "refused"
    words = (
        "refused it with N 00005, Robot mode is off, although it answers reads; switch it on in the"
        " station's menu"
    )
    assert words in run.facts.reason
    assert [one.text for one in run.writes if not one.text.startswith("WPS")] == ["WHA100380"]


# -- what is known before the first write ----------------------------------------------------------


@pytest.mark.parametrize(
    ("sim", "keys", "recipe", "words"),
    [
        (
            "settings = {maximum_temperature = 340}",
            "",
            RECIPE,
            ["350 °C on port 1", "maximum of 340 °C"],
        ),
        (
            "settings = {minimum_temperature = 360}",
            "",
            RECIPE,
            ["350 °C on port 1", "minimum of 360 °C"],
        ),
        (
            "settings = {sleep_delay = 'off'}",
            "",
            RECIPE.replace("[sleep]\ndelay_min = 5", ""),
            ["sleep delay", "never cools"],
        ),
        (
            "settings = {hibernation_delay = 'off'}",
            "",
            RECIPE.replace("[hibernation]\ndelay_min = 30", ""),
            ["hibernation delay"],
        ),
        ("robot_mode = false", "", RECIPE, ["Robot mode is off"]),
        ('model = "NAE"', "", RECIPE, ["family dde", "model NAE"]),
        ("tool = 0", "", RECIPE, ["no tool in port 1", "require_tool"]),
        ("tools = {2 = 0}", "", RECIPE, ["no tool in port 2"]),
        ("wire = true", "baudrate = 9600", RECIPE, ["10 Hz does not fit", "best rate is"]),
    ],
    ids=[
        "maximum",
        "minimum",
        "sleep off",
        "hibernation off",
        "robot mode",
        "model",
        "no tools",
        "one tool",
        "rate",
    ],
)
def test_nothing_is_written_where_the_station_does_not_fit(
    sim: str, keys: str, recipe: str, words: list[str]
) -> None:
    run = prepare(line_text(sim, keys), recipe, duration_s=5).go()
    assert run.facts.outcome == "refused"
    assert all(word in run.facts.reason for word in words), run.facts.reason
    assert run.writes == []
    assert run.memory.samples == []


def test_an_auto_station_of_another_family_than_the_recipe_s_is_refused_before_any_write() -> None:
    line = line_text('model = "DME"').replace('family = "dde"', 'family = "auto"')
    run = prepare(line, RECIPE.replace(ALL_FAMILIES, 'families = ["dde"]'), duration_s=5).go()
    assert run.facts.outcome == "refused"
    assert "not for family dme" in run.facts.reason
    assert run.writes == []


def test_an_auto_station_is_what_its_model_says() -> None:
    line = line_text('model = "ALE"').replace('family = "dde"', 'family = "auto"')
    run = prepare(line, duration_s=1).go()
    assert (run.facts.family, run.facts.model, run.facts.outcome) == ("ale", "ALE", "completed")


def test_a_station_that_does_not_answer_is_absent() -> None:
    run = prepare(line_text(fault("silence")), duration_s=5).go()
    assert run.facts.outcome == "gone"
    assert "no usable answer" in run.facts.reason
    assert run.writes == []


def test_delays_that_are_off_may_be_allowed_and_are_told() -> None:
    recipe = RECIPE.replace("[sleep]\ndelay_min = 5", "") + "allow_no_cooldown = true\n"
    run = prepare(line_text("settings = {sleep_delay = 'off'}"), recipe, duration_s=1).go()
    assert run.facts.outcome == "completed"
    assert {event.severity for event in run.memory.of_kind("safety.no_cooldown")} == {"warning"}
    assert run.station.plant.ports[1].tools[2].sleep_delay is OFF


@pytest.mark.parametrize(
    ("command", "name"),
    [("sleep_delay", "sleep delay"), ("hibernation_delay", "hibernation delay")],
)
@pytest.mark.parametrize("family", ["dde", "soldering"])
def test_a_delay_that_the_station_does_not_tell_is_not_taken_to_be_on(
    command: str, name: str, family: str
) -> None:
    """Whatever the recipe requires: a delay that cannot be read is not written."""
    line = line_text(fault("nak", code=4, command=command)).replace('"dde"', f'"{family}"')
    run = prepare(line, duration_s=1).go()
    assert run.facts.outcome == "refused"
    assert f"{name} of port 1 not reported by the station" in run.facts.reason
    assert run.writes == []
    allowed = prepare(line, RECIPE + "allow_no_cooldown = true\n", duration_s=1).go()
    assert allowed.facts.outcome == "completed"
    assert [event.port for event in allowed.memory.of_kind("safety.no_cooldown")] == [1, 2]


def test_a_delay_that_the_recipe_switches_on_is_enough() -> None:
    run = prepare(
        line_text("settings = {sleep_delay = 'off', hibernation_delay = 'off'}"), duration_s=1
    ).go()
    assert run.facts.outcome == "completed"
    assert outcome(run, "sleep_delay") == "confirmed"


# -- tools -----------------------------------------------------------------------------------------


def test_a_port_without_a_tool_is_recorded_and_never_put_to_work() -> None:
    run = prepare(
        line_text("tools = {2 = 0}"), RECIPE + "require_tool = false\n", duration_s=5
    ).go()
    orders = [write.value for write in run.station.log.written("status") if write.port == 2]
    assert WORKING not in orders
    assert set(run.memory.column("quality", 2)) == {"no_tool"}
    assert set(run.memory.column("temperature_c", 2)) == {None}
    assert set(run.memory.column("quality", 1)) == {"ok"}
    assert [event.port for event in run.memory.of_kind("tool.absent")] == [2]


def test_settings_of_a_tool_go_to_the_tool_that_is_there() -> None:
    """Adjust, sleep and hibernation belong to the tool that is connected at the start."""
    sim = "tools = {1 = 3}\nsettings = {sleep_delay = 1}"
    run = prepare(line_text(sim, "ports = [1]"), duration_s=1).go()
    assert {(write.port, write.tool) for write in run.station.log.written("sleep_delay")} == {
        (1, 3)
    }
    assert rows(run, "sleep_delay")[0].tool_name == TOOL_3


def test_a_tool_changed_in_the_run_is_read_and_not_written() -> None:
    run = prepare(
        line_text("settings = {sleep_delay = 7}" + fault("tool", port=1, code=3, at_s=4)),
        duration_s=12,
    )
    run.at(3, lambda: setattr(run.station.plant.ports[1].tools[3], "adjust", -9))
    run.go()
    (event,) = run.memory.of_kind("tool.changed")
    assert f"from {TOOL_2} to {TOOL_3}" in event.text
    assert [row.readback for row in rows(run, "adjust") if row.tool_name == TOOL_3] == ["-9"]
    assert [one.text for one in run.writes if run.t0 + 4 < one.at < run.t0 + 12] == []


def assert_soon_in_stand(run: VirtualRun) -> None:
    orders = [
        (write.at < run.t0 + 15, write.value)
        for write in run.station.log.written("status")
        if write.port == 1
    ]
    assert orders[:2] == [(True, WORKING), (True, STAND)]


def test_a_new_tool_that_would_not_cool_goes_to_the_safe_state() -> None:
    run = prepare(
        line_text(fault("tool", port=1, code=3, at_s=4)),
        RECIPE + 'on_difference = "continue"\n',
        duration_s=20,
    )
    run.at(3, lambda: setattr(run.station.plant.ports[1].tools[3], "sleep_delay", OFF))
    run.go()
    assert_soon_in_stand(run)


def test_a_new_tool_whose_delay_is_not_known_goes_to_the_safe_state() -> None:
    """The delay of the previous tool is not that of the new one."""
    sim = fault("tool", port=1, code=3, at_s=4)
    run = prepare(line_text(sim), RECIPE + 'on_difference = "continue"\n', duration_s=20)
    ask = run.station.device.answer
    run.station.device.answer = lambda header, text, now: (  # type: ignore[method-assign]
        ("A", "D13xx.xx") if text == "D13" else ask(header, text, now)
    )
    run.go()
    assert len(run.memory.of_kind("tool.unknown")) == 1
    assert_soon_in_stand(run)


# -- the list of what a run may write --------------------------------------------------------------


def test_no_other_command_is_ever_written() -> None:
    """docs/reference/faults.md, S-5: the writes of `run` are a fixed list without any dangerous
    one.
    """
    recipe = RECIPE.replace("select_c = 350", "select_c = 300\nadjust_c = -3").replace(
        "[sleep]\n", "[sleep]\ntemperature_c = 200\n"
    )
    recipe += (
        '\n[feeder]\nmode = "continuous"\nlength_mm = 7.5\nspeed_mm_s = 3\ndiameter_mm ='
        " 0.8\nbackward_mm = 2\n"
    )
    recipe += "clog_detection = true\n"
    sim = "settings = {sleep_delay = 9, hibernation_delay = 60}"
    run = prepare(
        line_text(sim).replace('"dde"', '"ale"').replace("dde-1", "ale-1"), recipe, duration_s=3
    ).go()
    assert {write.name for write in run.station.log.writes} == {
        *(
            "adjust",
            "sleep_temperature",
            "sleep_delay",
            "hibernation_delay",
            "selected_temperature",
            "status",
            "stop_feeding",
        ),
        *(
            "alarm_high_limit",
            "alarm_high_delay",
            "alarm_low_limit",
            "alarm_low_delay",
            "clog_detection",
        ),
        *("feeder_mode", "feeder_length", "feeder_speed", "feeder_diameter", "feeder_backward"),
    }
    assert run.facts.outcome == "completed"


def test_a_tool_whose_number_no_command_can_carry_is_recorded_as_that_number() -> None:
    """A command has one character for the number of a tool (manual 002, W-Axy)."""
    run = prepare(recipe=RECIPE + "\nallow_no_cooldown = true\n", duration_s=12)
    say(run, "CT1", "00012", 0, times=1000)
    run.go()
    assert run.facts.outcome == "completed"
    assert run.facts.tool_names[1] == "tool_12"
    assert set(run.memory.column("tool")) == {12, None}
    assert outcome(run, "sleep_delay") == outcome(run, "hibernation_delay") == "unsupported"
    assert outcome(run, "selected_temperature") == "unchanged"
    (told,) = run.memory.of_kind("tool.unknown")
    assert (told.port, told.code) == (1, 12)
    assert run.facts.safe_state[1] == "verified"


def test_whether_such_a_tool_cools_is_not_known_and_so_it_is_not_put_to_work() -> None:
    run = prepare(duration_s=5)
    say(run, "CT1", "00012", 0, times=1000)
    run.go()
    assert run.facts.outcome == "refused"
    assert (
        "sleep delay and hibernation delay of port 1 not reported by the station"
        in run.facts.reason
    )
    assert run.writes == []
