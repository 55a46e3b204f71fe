"""The values in the rows, compared with the bytes on the serial line and with the plant."""

from __future__ import annotations

import pytest

from support.oracles.account import assert_account_holds, reasons_in, wrong_values
from support.product import COLUMN, FAMILIES, ROBOT_PROTOCOL, SampleRow
from support.virtual.lines import AIR, fault
from support.virtual.virtual_run import RECIPE, VirtualRun, line_text, prepare

ALL_FAMILIES = 'families = ["soldering", "dde", "nae", "dme", "hde", "ucr", "ale"]'
GOING_ON = RECIPE + 'on_difference = "continue"\n'


def of_family(family: str, sim: str = "", keys: str = "", **more: object) -> VirtualRun:
    line = line_text(sim, keys).replace('family = "dde"', f'family = "{family}"')
    recipe = AIR if family == "jtse" else RECIPE
    return prepare(line, recipe + 'on_difference = "continue"\n', **more)  # type: ignore[arg-type]


def cells(run: VirtualRun, column: str, port: int = 1) -> set[object]:
    """Return the values of a column without nulls."""
    return set(run.memory.column(column, port)) - {None}


def answered_otherwise(
    run: VirtualRun, code: str, data: str, begin_s: float, end_s: float, times: int = 1_000_000
) -> None:
    """Change the station's answer to a question for a while, or for a number of times."""
    asked, left = run.station.device.answer, iter(range(times))

    def answer(header: str, text: str, now: float) -> tuple[str, str] | None:
        found = asked(header, text, now)
        meant = header == "R" and text == code and run.t0 + begin_s <= now < run.t0 + end_s
        return ("A", code + data) if meant and next(left, None) is not None else found

    run.station.device.answer = answer  # type: ignore[method-assign]


# -- every family ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "family", [name for name, family in FAMILIES.items() if family.protocol == ROBOT_PROTOCOL]
)
@pytest.mark.parametrize(
    "keys",
    ["", "address = false", "baudrate = 38400\nformat = '8E1'"],
    ids=["", "no addresses", "8E1"],
)
def test_every_family_is_run_to_the_end(family: str, keys: str) -> None:
    run = of_family(family, "noise_c = 2.0", keys, duration_s=15, rate="fit").go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert_account_holds(run)
    assert wrong_values(run) == []
    assert set(run.facts.safe_state.values()) == {"verified"}
    assert {row[COLUMN["quality"]] for row in run.memory.samples} == {"ok"}


def test_ports_of_hde_are_those_that_answer() -> None:
    run = of_family("hde", duration_s=2).go()
    assert run.facts.ports == [1, 2]
    asked = [one.text for one in run.heard if one.text.startswith("RCT")]
    # two answers each; a refusal is one
    assert asked[:6] == ["RCT1", "RCT1", "RCT2", "RCT2", "RCT3", "RCT4"]


def test_a_port_that_the_station_does_not_have_is_refused() -> None:
    run = of_family("hde", fault("nak", code=4, port=4), "ports = [1, 4]", duration_s=2).go()
    assert run.facts.outcome == "refused"
    assert "no port 4" in run.facts.reason
    assert run.writes == []


# -- times -----------------------------------------------------------------------------------------


def test_time_is_that_of_the_last_byte_of_the_temperature() -> None:
    run = prepare(line_text("", "ports = [1]"), duration_s=5).go()
    for row in run.memory.samples:
        asked = [
            one
            for one in run.heard
            if one.text == "RTT1" and run.utc_s(one.at) * 1e6 < int(str(row[COLUMN["time"]]))
        ][-1]
        answered_s = run.utc_s(asked.at) + 27 * 10 / 19200 + 0.001
        assert int(str(row[COLUMN["time"]])) == pytest.approx(answered_s * 1e6, abs=1)


def test_late_is_that_of_the_first_question_and_not_of_its_repetition() -> None:
    run = prepare(
        line_text(fault("silence", command="tip_temperature", at_s=5, every=7), "ports = [1]"),
        duration_s=12,
        rate=2,
    ).go()
    assert len([one for one in run.heard if one.text == "RTT1"]) > len(run.memory.samples)
    late = [int(str(value)) for value in run.memory.column("late_us") if value is not None]
    assert max(late) < 100


def test_late_and_scan_are_told_from_the_questions() -> None:
    """`late_us`: first question sent minus due; `scan_us`: last answer minus first question of the
    port.
    """
    run = prepare(line_text("", "ports = [1]"), duration_s=5).go()
    asked = [
        place
        for place, one in enumerate(run.heard)
        if one.text == "RTT1" and run.heard[place - 1].text != "RTT1"
    ]
    firsts = asked[-len(run.memory.samples) :]
    for row, begin, end in zip(run.memory.samples, firsts, firsts[1:], strict=False):
        due_s, first_s, last_s = (
            run.t0 + int(str(row[COLUMN["tick"]])) * 0.1,
            run.heard[begin].at,
            run.heard[end - 1].at,
        )
        assert int(str(row[COLUMN["late_us"]])) == pytest.approx((first_s - due_s) * 1e6, abs=1)
        assert int(str(row[COLUMN["scan_us"]])) == pytest.approx(
            (last_s - first_s) * 1e6 + 15_062, abs=1100
        )


# -- what the station says -------------------------------------------------------------------------


def test_the_digits_of_the_status_word() -> None:
    run = of_family("ale", duration_s=20)
    run.at(5, lambda: run.station.plant.feeder.start(run.driver.clock.monotonic()))
    run.at(8, lambda: run.station.plant.ports[1].order(0, True))
    run.at(11, lambda: run.station.plant.ports[1].order(1, False))
    run.go()
    assert cells(run, "status") == {"working", "stand"}
    assert cells(run, "cooling") == {True, False}
    assert cells(run, "motor") == {"off", "forward", "backward"}
    assert cells(run, "desoldering") == {False}


def test_motor_and_feeding_are_columns_of_ale_alone() -> None:
    run = prepare(duration_s=5).go()
    assert cells(run, "motor") == cells(run, "feeding") == set()
    assert not any(
        "motor" in reasons_in(row) or "feeding" in reasons_in(row) for row in run.memory.samples
    )


def test_a_countdown_that_does_not_run_has_no_time_left() -> None:
    run = prepare(duration_s=25).go()
    told = [row for row in run.memory.samples if "delay_s" in reasons_in(row)]
    assert {reasons_in(row)["delay_s"] for row in told} == {"not_counting"}
    assert cells(run, "delay_s") == set()
    assert {row[COLUMN["quality"]] for row in told} == {"ok"}


def test_a_countdown_that_runs_is_recorded() -> None:
    run = prepare(recipe=RECIPE.replace('"working"', '"stand"'), duration_s=25).go()
    left = sorted(int(str(value)) for value in cells(run, "delay_s"))
    assert left
    assert 270 < left[0] <= left[-1] <= 300


def test_station_wide_signals_stand_in_the_first_port_s_rows() -> None:
    run = prepare(duration_s=15).go()
    assert cells(run, "station_error") == {0}
    assert cells(run, "transformer_c") != set()
    assert cells(run, "station_error", 2) == cells(run, "transformer_c", 2) == set()


# -- what is not believed at once ------------------------------------------------------------------


def test_a_temperature_that_cannot_be_is_null_and_implausible() -> None:
    run = prepare(line_text("", "ports = [1]"), duration_s=8)
    answered_otherwise(run, "TT1", "04711", 5, 6)
    run.go()
    bad = [
        row for row in run.memory.samples if reasons_in(row).get("temperature_c") == "implausible"
    ]
    assert len(bad) == pytest.approx(10, abs=2)
    assert {row[COLUMN["quality"]] for row in bad} == {"implausible"}
    assert max(cells(run, "temperature_c")) < 600  # type: ignore[type-var]


@pytest.mark.parametrize(
    ("code", "data"),
    [("TT1", "00420"), ("TT1", "04711"), ("PS1", "00001"), ("ST1", "00300"), ("CT1", "00003")],
)
def test_one_doubtful_answer_is_asked_again_and_does_nothing(code: str, data: str) -> None:
    """Two flipped bits pass the check byte once in eleven times. One answer neither stops a run nor
    gives a value.
    """
    run = prepare(line_text("joints_per_minute = 0", "ports = [1]"), duration_s=20)
    answered_otherwise(run, code, data, 10, 20, times=1)
    run.go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert run.memory.of_kind("setting.changed") == run.memory.of_kind("tool.changed") == []
    assert {row[COLUMN["quality"]] for row in run.memory.samples} == {"ok"}
    late = [row for row in run.memory.samples if int(str(row[COLUMN["tick"]])) > 100]
    assert {row[COLUMN["temperature_c"]] for row in late} <= set(range(345, 356))


def test_a_jump_that_stays_is_believed() -> None:
    """The tool was exchanged for a cold one."""
    run = prepare(
        line_text("" + fault("tool", port=1, code=3, at_s=10), "ports = [1]"), duration_s=15
    ).go()
    values = [int(str(value)) for value in run.memory.column("temperature_c") if value is not None]
    assert min(values[90:]) < 60
    reasons = [reasons_in(row).get("temperature_c") for row in run.memory.samples]
    assert set(reasons) == {None, "skipped", "pulled"}
    assert reasons.count("pulled") < 10  # until a tip could have cooled that far
    assert reasons.count("skipped") <= 1  # while the settings of the new tool are read


def test_what_came_and_answered_nothing_is_counted() -> None:
    run = prepare(
        line_text(
            fault("noise", at_s=5, bytes_count=9, every=10)
            + fault("late", at_s=9, by_s=0.2, every=50)
        ),
        duration_s=15,
    ).go()
    assert run.facts.garbage_bytes > 50
    assert sum(run.facts.strays.values()) >= 1
    assert set(run.facts.strays) <= {"echo", "address", "code", "late", "unasked"}


# -- what the station does not have ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "signal"),
    [
        ("transistor_temperature", "transistor_c"),
        ("power", "power_permille"),
        ("alarm_flags", "alarm_high"),
        ("work_hours", "work_h"),
    ],
)
def test_a_signal_that_the_station_does_not_have_is_listed_once_and_not_due(
    command: str, signal: str
) -> None:
    run = prepare(line_text(fault("nak", code=4, command=command)), duration_s=25).go()
    assert run.facts.outcome == "completed"
    assert signal in run.facts.not_supported
    assert {due.get(signal, 0) for due in run.facts.due.values()} == {0}
    letters = FAMILIES["dde"].commands[command].letters
    assert len([one for one in run.heard if one.text == f"R{letters}1"]) == 1
    assert {row[COLUMN["quality"]] for row in run.memory.samples} == {"ok"}
    assert_account_holds(run)


def test_a_signal_that_was_there_and_is_refused_later_goes_on_being_asked() -> None:
    run = prepare(
        line_text(fault("nak", code=4, command="power", at_s=5, for_s=2)), duration_s=12
    ).go()
    refused = [row for row in run.memory.samples if reasons_in(row).get("power_permille") == "nak4"]
    assert len(refused) == pytest.approx(40, abs=6)
    assert {row[COLUMN["quality"]] for row in refused} == {"nak"}
    assert run.memory.column("power_permille")[-1] is not None
    assert len(run.memory.of_kind("read.nak4")) == 2  # once a port
    assert_account_holds(run)


# -- errors of station and ports -------------------------------------------------------------------


def rows_of(run: VirtualRun, port: int) -> list[SampleRow]:
    return [row for row in run.memory.samples if row[COLUMN["port"]] == port]


@pytest.mark.parametrize(
    ("code", "kind", "severity", "words"),
    [
        (1, "port.error", "error", "short circuit"),
        (3, "port.error", "error", "open circuit"),
        (9, "port.error", "warning", "warning: overload"),
        (6, "port.state", "warning", "detecting the tool"),
        (42, "port.error", "error", "unknown port error 42"),
    ],
)
def test_a_port_error_is_told_once_with_its_number_and_once_when_it_is_gone(
    code: int, kind: str, severity: str, words: str
) -> None:
    run = prepare(duration_s=20)
    run.at(5, lambda: setattr(run.station.plant.ports[2], "error", code))
    run.at(12, lambda: setattr(run.station.plant.ports[2], "error", 0))
    run.go()
    (event,) = run.memory.of_kind(kind)
    assert (event.port, event.code, event.severity) == (2, code, severity)
    assert words in event.text
    assert [event.code for event in run.memory.of_kind("port.ok")] == [0]
    assert cells(run, "port_error", 2) == {0, code}
    assert cells(run, "port_error", 1) == {0}


@pytest.mark.parametrize(
    ("code", "severity", "words"),
    [
        (3, "error", "memory"),
        (7, "warning", "transformer overload"),
        (77, "error", "unknown station error 77"),
    ],
)
def test_a_station_error_is_told_once_with_its_number(code: int, severity: str, words: str) -> None:
    run = prepare(duration_s=25)
    run.at(5, lambda: setattr(run.station.plant, "station_error", code))
    run.at(14, lambda: setattr(run.station.plant, "station_error", 0))
    run.go()
    (event,) = run.memory.of_kind("station.error")
    assert (event.code, event.severity) == (code, severity)
    assert words in event.text
    assert len(run.memory.of_kind("station.ok")) == 1
    assert cells(run, "station_error") == {0, code}


# -- counters --------------------------------------------------------------------------------------


def test_counters_at_start_and_end_and_in_between() -> None:
    run = prepare(
        line_text("counters = {work_hours = 811, sleep_cycles = 99999}", "ports = [1]"),
        duration_s=150,
    ).go()
    found = [
        (one.value, one.uom, one.raw) for one in run.memory.counters if one.counter == "work_h"
    ]
    assert found == [(811.0, "h", "00811")] * 4  # at the start, twice, at the end
    assert {one.counter for one in run.memory.counters} == {
        one.name for one in FAMILIES["dde"].counters
    }


def test_a_counter_that_cannot_be_read_is_null_with_its_reason() -> None:
    run = prepare(
        line_text(fault("silence", command="work_hours", at_s=10), "ports = [1]"), duration_s=65
    ).go()
    assert [(one.value, one.raw) for one in run.memory.counters if one.counter == "work_h"][1:] == [
        (None, "<timeout>")
    ] * 2
    assert_account_holds(run)


def test_dispensed_length_is_hexadecimal_and_in_mm() -> None:
    run = of_family("ale", "counters = {dispensed_length = 409.6}", duration_s=2).go()
    assert {
        (one.value, one.uom, one.raw)
        for one in run.memory.counters
        if one.counter == "dispensed_mm"
    } == {(409.6, "mm", "01000")}
