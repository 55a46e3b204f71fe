"""Hot air: recipe, samples and safe states, compared with the bytes on the serial line and with the
heater.
"""

from __future__ import annotations

import pytest

from support.oracles.account import assert_account_holds, reasons_in, wrong_values
from support.product import (
    COLUMN,
    AirModel,
    Command,
    StationFacts,
    StationLease,
    Value,
    WriteForbidden,
    lease_of,
    patch,
)
from support.virtual.lines import AIR, fault, hot_air, plant
from support.virtual.virtual_run import VirtualRun, line_text, prepare


def cells(run: VirtualRun, column: str) -> list[object]:
    """Return the values of a column without nulls."""
    return [value for value in run.memory.column(column) if value is not None]


def written(run: VirtualRun) -> list[str]:
    return [one.text for one in run.writes]


def after_the_run(run: VirtualRun) -> tuple[int, ...]:
    return plant(run).status


# -- the recipe on the station ---------------------------------------------------------------------


def test_mode_and_flow_come_before_heat_and_the_tool_is_switched_on_last() -> None:
    run = hot_air("settings = { work_mode = 'profile' }", duration_s=5).go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert written(run) == [
        "WWM100000",
        "WSF100600",
        "WSE100180",
        "WST100320",
        "WPS100001",
        "WPS100010",
    ]
    assert [
        (row.setting, row.uom, row.written, row.outcome)
        for row in run.memory.settings
        if row.requested
    ] == [
        ("work_mode", "", "manual", "confirmed"),
        ("selected_air_flow", "raw", "600", "confirmed"),
        ("selected_external_temperature", "°C", "180", "confirmed"),
        ("selected_air_temperature", "°C", "320", "confirmed"),
        ("status", "", "00001", "confirmed"),
    ]


def test_what_holds_is_not_written() -> None:
    settings = (
        "selected_air_temperature = 320, selected_air_flow = 600, selected_external_temperature ="
        " 180, status = 'on'"
    )
    run = hot_air(f"settings = {{ {settings} }}", duration_s=5).go()
    assert written(run) == ["WPS100010"]
    assert {row.outcome for row in run.memory.settings if row.requested} == {"unchanged"}


def test_a_tool_that_is_not_switched_on_stops_the_run() -> None:
    run = hot_air(fault("nak", code=4, command="status", only="write", for_s=2), duration_s=5).go()
    assert [
        (row.nak, row.outcome)
        for row in run.memory.settings
        if row.setting == "status" and row.requested
    ] == [(4, "refused")]
    assert (run.facts.outcome, run.memory.samples) == ("refused", [])


@pytest.mark.parametrize(("greatest", "raw"), [(1000, 600), (100, 60), (45, 27), (999, 599)])
def test_the_flow_is_a_share_of_what_the_station_says_is_its_greatest(
    greatest: int, raw: int
) -> None:
    """docs/reference/contradictions.md, B-33: per mille, per cent and litres are all shares of the
    maximum.
    """
    settings = f"minimum_air_flow = 1, selected_air_flow = 20, maximum_air_flow = {greatest}"
    run = hot_air(f"settings = {{ {settings} }}", duration_s=15).go()
    assert f"WSF1{raw:05d}" in written(run)
    assert set(cells(run, "set_flow_permille")) == {round(1000 * raw / greatest)}
    (event,) = run.memory.of_kind("protocol.anomaly")
    assert (event.code, event.port, event.severity) == (33, 1, "info")
    held = {row.setting: row.readback for row in run.memory.settings}
    assert (held["selected_air_flow"], held["maximum_air_flow"]) == (str(raw), str(greatest))


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        (
            "temperature_c = 320",
            "temperature_c = 451",
            "451 °C on port 1 is above the station's maximum of 450 °C",
        ),
        (
            "temperature_c = 320",
            "temperature_c = 149",
            "149 °C on port 1 is below the station's minimum of 150 °C",
        ),
        (
            "external_set_c = 180",
            "external_set_c = 501",
            "501 °C on port 1 is above the station's maximum of 500 °C",
        ),
        (
            "flow_permille = 600",
            "flow_permille = 99",
            (
                "99 ‰ of the station's maximum air flow on port 1, 99 raw, is below the station's"
                " minimum of 100 raw"
            ),
        ),
    ],
)
def test_what_the_station_does_not_allow_is_refused_before_the_first_write(
    key: str, value: str, said: str
) -> None:
    run = hot_air(recipe=AIR.replace(key, value), duration_s=5).go()
    assert run.facts.outcome == "refused"
    assert said in run.facts.reason
    assert "Nothing was written" in run.facts.reason
    assert written(run) == []


def test_a_station_that_does_not_tell_its_greatest_flow_gets_none() -> None:
    run = hot_air(fault("nak", code=4, command="maximum_air_flow"), duration_s=5).go()
    assert (
        "600 ‰ of the station's maximum air flow on port 1 cannot be calculated" in run.facts.reason
    )
    assert written(run) == []


def test_without_a_greatest_flow_the_flow_in_force_is_no_share() -> None:
    recipe = AIR.replace("flow_permille = 600\n", "")
    run = hot_air(
        fault("nak", code=4, command="maximum_air_flow"), recipe=recipe, duration_s=15
    ).go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert cells(run, "set_flow_permille") == []
    assert {reasons_in(row).get("set_flow_permille") for row in run.memory.samples} == {
        None,
        "no_maximum",
    }
    assert_account_holds(run)
    assert "raw" in {row.uom for row in run.memory.settings if row.setting == "selected_air_flow"}


def test_without_a_status_in_the_recipe_nothing_is_switched_on() -> None:
    run = hot_air(recipe=AIR.replace('status = "on"', ""), duration_s=5).go()
    assert "WPS100001" not in written(run)
    assert set(cells(run, "status")) == {"off"}


def test_on_and_cooling_at_once_is_not_on() -> None:
    run = hot_air(duration_s=5)
    asked = run.station.device.answer
    run.station.device.answer = lambda header, text, now: (  # type: ignore[method-assign]
        ("A", "PS100011") if text == "PS1" and plant(run).is_on else asked(header, text, now)
    )
    run.go()
    assert run.facts.outcome == "refused"
    assert "requested 00001, but 00011 was read back" in run.facts.reason


# -- samples ---------------------------------------------------------------------------------------


def test_air_and_work_are_sampled_each_tick_and_hold_what_the_station_said() -> None:
    run = hot_air(
        "joints_per_minute = 6\njoint_seconds = 4\nsuction_each_joint = true\nnoise_c = 1.0",
        duration_s=60,
    ).go()
    assert_account_holds(run)
    assert wrong_values(run) == []
    for column in ("temperature_c", "external_c", "power_permille", "status"):
        assert len(cells(run, column)) == len(run.memory.samples)
    assert {row[COLUMN["quality"]] for row in run.memory.samples} == {"ok"}
    assert {row[COLUMN["reasons"]] for row in run.memory.samples} == {None}
    assert set(cells(run, "desoldering")) == {True, False}
    assert set(cells(run, "cooling")) == {False}
    assert set(cells(run, "setpoint_c")) == {320}
    assert set(cells(run, "tool")) == {1}


def test_columns_that_hot_air_does_not_have_are_never_due() -> None:
    run = hot_air(duration_s=15).go()
    for column in (
        "motor",
        "alarm_high",
        "alarm_low",
        "transformer_c",
        "transistor_c",
        "delay_s",
        "feeding",
    ):
        assert cells(run, column) == []
        assert column not in run.facts.due["1"]
    assert run.facts.not_supported == []
    assert not [
        one.text for one in run.heard if one.text[:3] in ("RTA", "RTT", "RQT", "RED", "RHA", "RLA")
    ]


def test_suction_and_cooling_by_hand_are_seen() -> None:
    run = hot_air(duration_s=20, recipe=AIR.replace('status = "on"', ""))
    run.at(5, lambda: plant(run).order((0, 0, 1, 0, 1)))
    run.at(10, lambda: plant(run).order((0, 0, 0, 1, 0)))
    run.go()
    words = (
        tuple(row[COLUMN[name]] for name in ("status", "cooling", "desoldering"))
        for row in run.memory.samples
    )
    assert list(dict.fromkeys(words)) == [
        ("off", False, False),
        ("on", False, True),
        ("off", True, False),
    ]
    assert written(run) == ["WSF100600", "WSE100180", "WST100320", "WPS100010"]


def test_its_counters_are_its_own() -> None:
    sim = (
        "counters = { plugged_hours = 17, tool_cycles = 5 }\nsuction_each_joint ="
        " true\njoints_per_minute = 12"
    )
    run = hot_air(sim, duration_s=65).go()
    first = {one.counter: one.value for one in run.memory.counters[:4]}
    last = {one.counter: one.value for one in run.memory.counters[-4:]}
    assert first == {"on_h": 17, "work_h": 0, "tool_cycles": 6, "suction_cycles": 0}
    assert last == {
        "on_h": 17,
        "work_h": 0,
        "tool_cycles": 6,
        "suction_cycles": plant(run).suction_cycles,
    }
    assert plant(run).suction_cycles > 5


# -- the thermocouple on the work ------------------------------------------------------------------


def test_without_a_thermocouple_its_temperature_is_null_and_the_row_is_well() -> None:
    """docs/reference/contradictions.md, B-44, from the first row on."""
    run = hot_air("thermocouple = false", duration_s=15).go()
    assert cells(run, "external_c") == []
    assert {row[COLUMN["reasons"]] for row in run.memory.samples} == {"external_c=no_thermocouple"}
    assert {row[COLUMN["quality"]] for row in run.memory.samples} == {"ok"}
    (event,) = run.memory.of_kind("port.error")
    assert (event.code, event.severity) == (4, "warning")
    assert "external thermocouple needed" in event.text
    assert_account_holds(run)


@pytest.mark.parametrize("data", ["00023", "99999", "-0050", "00000"])
def test_whatever_is_said_without_a_thermocouple_means_nothing(data: str) -> None:
    run = hot_air("thermocouple = false", duration_s=5)
    asked = run.station.device.answer
    run.station.device.answer = lambda header, text, now: (  # type: ignore[method-assign]
        ("A", f"ET1{data}") if text == "ET1" else asked(header, text, now)
    )
    run.go()
    assert {row[COLUMN["reasons"]] for row in run.memory.samples} == {"external_c=no_thermocouple"}
    assert run.memory.of_kind("read.implausible") == []
    assert len([one for one in run.heard if one.text == "RET1"]) == len(run.memory.samples), (
        "asked once a tick"
    )


def test_a_refusal_without_a_thermocouple_is_asked_again_once_there_is_one() -> None:
    run = hot_air(
        "thermocouple = false" + fault("nak", code=4, command="external_temperature", for_s=6),
        duration_s=15,
    )
    run.at(7, lambda: setattr(plant(run).character, "has_thermocouple", True))
    run.go()
    assert len(cells(run, "external_c")) > 30
    assert run.facts.not_supported == []
    assert run.memory.of_kind("port.ok")


def test_a_thermocouple_that_is_put_on_hot_work_leaps_and_is_believed() -> None:
    run = hot_air(duration_s=15)
    run.at(5, lambda: setattr(plant(run).probe, "temperature_c", 250.0))
    run.go()
    assert max(int(str(value)) for value in cells(run, "external_c")) > 200
    assert {row[COLUMN["quality"]] for row in run.memory.samples} == {"ok"}


# -- the tool --------------------------------------------------------------------------------------


def test_a_tool_that_is_pulled_out_gives_no_temperature() -> None:
    run = hot_air(fault("tool", code=0, at_s=8), duration_s=20).go()
    assert "no_tool" in {row[COLUMN["quality"]] for row in run.memory.samples}
    (changed,) = run.memory.of_kind("tool.changed")
    assert "from JT to none" in changed.text
    assert [event.code for event in run.memory.of_kind("port.state")] == [9]
    assert after_the_run(run)[4] == 0


def test_another_tool_is_told_and_goes_on() -> None:
    """No delay can be off here: the safe states of hot air switch the heater off, whatever the
    tool.
    """
    run = hot_air(fault("tool", code=2, at_s=8), duration_s=20).go()
    (changed,) = run.memory.of_kind("tool.changed")
    assert "from JT to TE" in changed.text
    assert run.memory.of_kind("safety.no_cooldown") == []
    assert written(run).count("WPS100010") == 1
    assert [row.tool_name for row in run.memory.settings if row.setting == "adjust"] == ["JT", "TE"]


def test_no_tool_is_no_run_unless_the_recipe_says_so() -> None:
    run = hot_air("tools = { 1 = 0 }", duration_s=5).go()
    assert "no tool in port 1" in run.facts.reason
    run = hot_air("tools = { 1 = 0 }", recipe=AIR + "require_tool = false\n", duration_s=5).go()
    assert run.facts.outcome == "completed"
    assert "WPS100001" not in written(run)


# -- the safe state --------------------------------------------------------------------------------


def test_the_run_ends_with_the_heater_off_and_the_pump_on() -> None:
    run = hot_air(duration_s=20).go()
    assert run.facts.safe_state == {1: "verified"}
    assert after_the_run(run) == (0, 0, 0, 1, 0)
    (event,) = run.memory.of_kind("safety.safe_state")
    assert event.text.endswith("as read back: cooling.")
    plant(run).advance_to(plant(run).now + 120)
    assert plant(run).air_temperature() < 60
    assert after_the_run(run) == (0, 0, 0, 0, 0), "cooling has ended by itself"


def test_off_may_be_the_safe_state() -> None:
    run = hot_air(recipe=AIR + 'safe_state = "off"\n', duration_s=10).go()
    assert written(run)[-1] == "WPS100000"
    assert run.facts.safe_state == {1: "verified"}


@pytest.mark.parametrize(
    ("safe", "code", "then"),
    [("cooling", "PS100010", "WPS100000"), ("off", "PS100000", "WPS100010")],
)
def test_where_one_safe_state_is_refused_the_other_follows(safe: str, code: str, then: str) -> None:
    run = hot_air(recipe=AIR + f'safe_state = "{safe}"\n', duration_s=10)
    asked = run.station.device.answer
    run.station.device.answer = lambda header, text, now: (  # type: ignore[method-assign]
        ("N", "PS100003") if (header, text) == ("W", code) else asked(header, text, now)
    )
    run.go()
    assert written(run)[-2:] == [f"W{code}", then]
    assert run.facts.safe_state == {1: "verified"}
    assert plant(run).target_c is None


def test_a_tool_that_stays_on_is_not_safe() -> None:
    run = hot_air(fault("nak", code=3, command="status", only="write", at_s=8), duration_s=10).go()
    assert run.facts.safe_state == {1: "failed"}
    (sentence,) = run.facts.unsafe
    assert (
        "jtse-1 port 1: could not be put in its safe state, its air may be hot (last read 320 °C)"
        in sentence
    )
    assert run.memory.of_kind("safety.not_safe")


def test_cooling_does_not_count_while_it_is_on() -> None:
    run = hot_air(duration_s=10)
    asked = run.station.device.answer
    run.station.device.answer = lambda header, text, now: (  # type: ignore[method-assign]
        ("A", "PS100011")
        if text == "PS1" and "WPS100010" in written(run)
        else asked(header, text, now)
    )
    run.go()
    assert run.facts.safe_state == {1: "sent"}
    assert run.facts.unsafe


# -- what changes and what goes away ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        (
            "selected_air_temperature",
            250,
            "selected air temperature of port 1 was found changed: 250 °C instead of 320 °C",
        ),
        (
            "selected_air_flow",
            300,
            "selected air flow of port 1 was found changed: 300 raw instead of 600 raw",
        ),
        (
            "selected_external_temperature",
            90,
            "selected external temperature of port 1 was found changed: 90 °C instead of 180 °C",
        ),
        (
            "work_mode",
            "profile",
            "work mode of port 1 was found changed: profile instead of manual",
        ),
    ],
)
def test_a_setting_that_somebody_changed_stops_the_run(name: str, value: object, said: str) -> None:
    run = hot_air(recipe=AIR + "[sampling]\ncounters_every_s = 5\n", duration_s=30)
    run.at(8, lambda: setattr(plant(run).settings, name, value))
    run.go()
    assert run.facts.outcome == "stopped"
    assert said in run.facts.reason
    assert after_the_run(run)[4] == 0


def test_a_tool_that_somebody_switched_off_stops_the_run() -> None:
    run = hot_air(duration_s=30)
    run.at(8, lambda: plant(run).order((0, 0, 0, 1, 0)))
    run.go()
    assert "status of port 1 was found changed: 00010 instead of 00001" in run.facts.reason


def test_hot_air_behind_a_broken_cable_is_critical_and_nothing_is_switched_on_again() -> None:
    run = hot_air(fault("dropout", at_s=8, for_s=5), duration_s=25).go()
    (lost,) = run.memory.of_kind("link.lost")
    assert lost.severity == "critical"
    assert "Its air stays as it was last set: port 1 at" in lost.text
    assert run.memory.of_kind("link.back")
    assert run.facts.outcome == "completed", run.facts.reason
    assert written(run).count("WPS100001") == 1
    assert_account_holds(run)


def test_a_restart_is_found_by_what_is_off() -> None:
    run = hot_air(fault("restart", at_s=8, for_s=3), duration_s=25).go()
    assert run.facts.outcome == "stopped"
    assert "status of port 1 was found changed: 00000 instead of 00001" in run.facts.reason
    assert written(run).count("WPS100001") == 1


def test_air_that_runs_away_is_recorded_as_it_was() -> None:
    run = hot_air(fault("overheat", at_s=10, by_c=60), duration_s=25).go()
    assert max(int(str(value)) for value in cells(run, "temperature_c")) == 380
    assert wrong_values(run) == []


def test_a_reading_that_sticks_is_recorded_as_it_was() -> None:
    run = hot_air(fault("stuck", at_s=3), duration_s=15).go()
    assert len(set(cells(run, "temperature_c")[-80:])) == 1


@pytest.mark.parametrize(
    ("code", "severity"), [(1, "error"), (5, "error"), (8, "error"), (10, "warning"), (42, "error")]
)
def test_port_errors_are_those_of_hot_air(code: int, severity: str) -> None:
    run = hot_air(duration_s=15)
    run.at(5, lambda: setattr(plant(run), "error", code))
    run.go()
    (event,) = [one for one in run.memory.events if one.kind in ("port.error", "port.state")]
    assert (event.code, event.severity) == (code, severity)


def test_no_write_of_a_run_is_dangerous() -> None:
    """`run` writes to hot air only settings of the recipe and the status (docs/reference/faults.md,
    I7).
    """
    run = hot_air("joints_per_minute = 6", duration_s=30).go()
    assert {text[1:4] for text in written(run)} <= {"WM1", "SF1", "SE1", "ST1", "PS1"}


# -- which station it is ---------------------------------------------------------------------------


def test_auto_finds_hot_air_by_its_model() -> None:
    line = line_text("tool = 1\nmodel = 'JTSE'").replace('family = "dde"', 'family = "auto"')
    run = prepare(line, AIR, duration_s=5).go()
    assert (run.facts.outcome, run.facts.family, run.facts.model) == ("completed", "jtse", "JTSE")
    assert run.facts.safe_state == {1: "verified"}
    assert written(run)[-1] == "WPS100010"


def test_hot_air_where_a_soldering_station_should_be_is_not_written_to() -> None:
    """00001, which means stand elsewhere, would switch its heater on."""
    run = prepare(line_text("model = 'JTSE'"), duration_s=5).go()
    assert "the line file says family dde, the station says model JTSE" in run.facts.reason
    assert written(run) == []


def test_a_soldering_station_where_hot_air_should_be_is_not_written_to() -> None:
    run = hot_air("model = 'DDE'", duration_s=5).go()
    assert "the line file says family jtse, the station says model DDE" in run.facts.reason
    assert written(run) == []


# -- suction: one word orders heat and suction -----------------------------------------------------


def with_keys(air: str = "", run: str = "", status: str = 'status = "on"') -> str:
    return AIR.replace('mode = "manual"', f'mode = "manual"\n{air}').replace(
        'status = "on"', f"{status}\n{run}"
    )


def sucking(recipe: str, *, begins: bool = True, sim: str = "", **more: object) -> VirtualRun:
    """Return a run whose station holds a part at the start, or does not."""
    run = hot_air(sim, recipe=recipe, duration_s=5, **more)
    plant(run).suck(on=begins)
    return run


def words(run: VirtualRun) -> list[str]:
    """Return the status words that were written, whatever the outcome."""
    return [one.text.removeprefix("WPS1") for one in run.writes if one.text.startswith("WPS")]


@pytest.mark.parametrize("begins", [True, False])
@pytest.mark.parametrize(
    ("keys", "start", "end"),
    [
        ({}, None, None),
        ({"air": 'suction = "keep"', "run": 'safe_suction = "keep"'}, None, None),
        ({"air": 'suction = "on"'}, 1, 1),
        ({"air": 'suction = "off"'}, 0, 0),
        ({"run": 'safe_suction = "off"'}, None, 0),
        ({"air": 'suction = "on"', "run": 'safe_suction = "off"'}, 1, 0),
    ],
)
def test_suction_is_kept_or_ordered_at_the_start_and_at_the_end(
    begins: bool, keys: dict[str, str], start: int | None, end: int | None
) -> None:
    run = sucking(with_keys(**keys), begins=begins).go()
    at_start, at_end = (int(begins) if digit is None else digit for digit in (start, end))
    assert words(run) == [f"00{at_start}01", f"00{at_end}10"]
    assert plant(run).has_suction == bool(at_end)
    assert run.facts.safe_state == {1: "verified"}
    assert run.facts.outcome == "completed"


@pytest.mark.parametrize(("asked", "digit"), [("on", 1), ("off", 0)])
@pytest.mark.parametrize("is_on", [True, False])
def test_suction_alone_leaves_the_heater_as_it_is(asked: str, digit: int, is_on: bool) -> None:
    run = sucking(with_keys(f'suction = "{asked}"', status=""), begins=not digit)
    if is_on:
        plant(run).order((0, 0, 1 - digit, 0, 1))
    run.go()
    assert words(run)[0] == f"00{digit}0{int(is_on)}"


def test_what_a_key_switches_during_the_run_is_kept_at_the_end() -> None:
    run = sucking(with_keys(), begins=False)
    run.at(3, lambda: plant(run).suck(on=True))
    run.go()
    assert words(run) == ["00001", "00110"]
    assert run.facts.suction == [1]
    assert "read back: cooling with suction" in run.memory.of_kind("safety.safe_state")[0].text


def test_a_single_answer_does_not_decide_it() -> None:
    """Two flipped bits in one column pass the check byte."""
    run = sucking(with_keys(), begins=True)
    seen: list[bool] = []

    def flicker(_run: VirtualRun = run) -> None:
        plant(_run).has_suction = False
        seen.append(True)

    run.at(2.9999, flicker)
    run.at(3.15, lambda: setattr(plant(run), "has_suction", True))
    run.go()
    assert seen
    assert words(run)[-1] == "00110"


def test_the_safe_order_does_not_wait_for_a_reading_of_the_status() -> None:
    """The station stops answering reads of the status; the safe order uses the last confirmed digit
    at once.
    """
    run = sucking(with_keys(), sim=fault("silence", command="status", only="read", at_s=3))
    run.go()
    last_tick = max(one.at for one in run.heard if one.text == "RAT1" and one.at <= run.t0 + 7)
    first = next(one for one in run.writes if one.text == "WPS100110")
    assert first.at >= last_tick - 1.0
    assert words(run)[1] == "00110"


def test_a_word_that_keeps_suction_and_is_refused_is_followed_by_the_plain_one_then_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    takes = AirModel.allowed

    def refuses(words: list[tuple[int, ...]]) -> None:
        def allowed(face: AirModel, command: Command, value: Value) -> bool:
            return not (command.name == "status" and value in words) and takes(face, command, value)

        patch(monkeypatch, "AirModel.allowed", allowed)

    refuses([(0, 0, 1, 1, 0)])
    run = sucking(with_keys()).go()
    assert words(run) == ["00101", "00110", "00010"]
    (event,) = run.memory.of_kind("safety.safe_state")
    assert (event.severity, event.text) == (
        "warning",
        (
            "Port 1: the tool is in its safe state, as read back: cooling; cooling with suction was"
            " refused with N 00003."
        ),
    )
    refuses([(0, 0, 1, 1, 0), (0, 0, 0, 1, 0)])
    run = sucking(with_keys()).go()
    assert words(run) == ["00101", "00110", "00010", "00000"]
    assert run.facts.safe_state == {1: "verified"}


def test_suction_that_was_asked_for_and_is_not_read_back_is_a_mismatch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    patch(monkeypatch, "AirStation.suck", lambda station, *, on: None)
    run = hot_air(recipe=with_keys('suction = "on"'), duration_s=3).go()
    assert run.facts.outcome == "refused"
    assert "status of port 1" in run.facts.reason


@pytest.mark.parametrize(
    "word", [(0, 0, 1, 1, 0), (0, 0, 1, 0, 0), (0, 0, 0, 0, 1), (0, 0, 1, 0, 1)]
)
def test_of_the_words_exactly_those_are_permitted_that_the_recipe_and_the_station_lead_to(
    word: tuple[int, ...],
) -> None:
    run = sucking(with_keys(), begins=False).go()
    context = next(iter(run.contexts.values()))
    command = context.command("status")
    permit = context.listed_writes()
    for allowed in ((0, 0, 0, 0, 1), (0, 0, 0, 1, 0), (0, 0, 0, 0, 0)):
        permit(command, allowed, 1, None)
    if word != (0, 0, 0, 0, 1):
        with pytest.raises(WriteForbidden):
            permit(command, word, 1, None)


@pytest.mark.parametrize("begins", [True, False])
def test_the_guard_is_told_of_suction_before_the_first_sample(begins: bool) -> None:
    """The read-back of the first order says it; the guard may have to act right then."""
    run = sucking(with_keys(), begins=begins)
    leases: list[tuple[int, ...]] = []
    facts = run.memory.facts

    def note(told: StationFacts) -> None:
        if words(run):
            leases.append(lease_of(told).suction)
        facts(told)

    run.memory.facts = note  # type: ignore[method-assign]
    run.go()
    assert leases[0] == ((1,) if begins else ())


def test_the_guard_is_told_of_the_last_confirmed_digit() -> None:
    run = sucking(with_keys())
    run.at(3, lambda: plant(run).suck(on=False))
    leases: list[tuple[int, ...]] = []
    facts = run.memory.facts

    def note(told: StationFacts) -> None:
        leases.append(lease_of(told).suction)
        facts(told)

    run.memory.facts = note  # type: ignore[method-assign]
    run.go()
    assert (1,) in leases
    assert leases[-1] == ()
    assert StationLease.from_json(lease_of(run.facts).to_json()) == lease_of(run.facts)
