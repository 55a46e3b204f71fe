"""An implausible value is asked again and marked; a series of them is reported once."""

from __future__ import annotations

import pytest

from support.oracles.account import reasons_of
from support.product import COLUMN
from support.virtual.answers import let_say
from support.virtual.lines import first_sample_s, hot_air, marks, one_port, say


def test_an_answer_that_the_next_one_contradicts_is_marked() -> None:
    run = one_port()
    say(run, "TT1", "00240", 10)
    run.go()
    (event,) = marks(run)
    assert (
        event.text
        == "The tip temperature of port 1 was 240 °C and 350 °C when asked 2 times; the last is"
        " believed."
    )
    assert (event.port, event.value, event.raw, event.severity) == (1, 350.0, "240 °C", "info")
    assert run.facts.doubted == {"tip_temperature": 1}
    assert 240 not in run.memory.column("temperature_c")[90:]
    assert {row[COLUMN["quality"]] for row in run.memory.samples} == {"ok"}


def test_a_jump_that_a_second_answer_bears_out_is_believed_and_marked() -> None:
    run = one_port()
    run.at(12, lambda: setattr(run.station.plant.ports[1], "stuck_c", 200))
    run.go()
    (event,) = marks(run)
    assert (
        event.text
        == "The tip temperature of port 1 jumped from 350 °C to 200 °C; a second answer bore it"
        " out."
    )
    assert event.earliest is not None
    assert 0 < event.time - event.earliest < 200_000
    assert run.memory.column("temperature_c")[-1] == 200


def test_it_is_told_once_a_series_and_counted_each_time() -> None:
    run = one_port(duration_s=150)
    say(run, "TT1", "00240", 10, 11, 12, 13, 100)
    run.go()
    assert len(marks(run)) == 2
    assert run.facts.doubted == {"tip_temperature": 5}


def test_heating_up_is_no_jump() -> None:
    for rate in (0.5, 1, None):
        run = one_port("noise_c = 3.0\n", duration_s=30, rate=rate).go()
        assert marks(run) == []
        assert run.facts.doubted == {}


def test_a_setting_is_not_found_changed_by_one_answer() -> None:
    run = one_port()
    say(run, "ST1", "00340", 10)
    run.go()
    (event,) = marks(run)
    assert event.raw == "340 °C"
    assert run.memory.of_kind("setting.changed") == []


def test_a_setting_that_was_changed_is_no_mark() -> None:
    run = one_port()
    say(run, "ST1", "00340", 10, times=1000)
    run.go()
    assert len(run.memory.of_kind("setting.changed")) == 1
    assert marks(run) == []


def test_an_error_that_only_one_answer_tells_is_none() -> None:
    for code, data in (("PE1", "00001"), ("SER", "00003")):
        run = one_port()
        say(run, code, data, 10)
        run.go()
        assert not {"port.error", "station.error"} & set(run.memory.kinds())
        assert len(marks(run)) == 1


def test_an_error_that_stays_is_told() -> None:
    run = one_port()
    say(run, "PE1", "00003", 10, times=1000)
    run.go()
    assert [event.code for event in run.memory.of_kind("port.error")] == [3]
    assert marks(run) == []


def test_a_counter_that_only_one_answer_tells_is_not_recorded() -> None:
    run = one_port("counters = { work_hours = 120 }\n", duration_s=75)
    say(run, "CW1", "00168", 0.5, 50)
    run.go()
    values = [one.value for one in run.memory.counters if one.counter == "work_h"]
    assert values == [120.0] * len(values)
    assert len(values) >= 3
    assert run.facts.doubted == {"work_hours": 2}


def test_a_counter_that_goes_on_is_recorded_as_it_goes() -> None:
    run = one_port("counters = { sleep_cycles = 7 }\n", duration_s=75)
    say(run, "CC1", "00008", 30, times=1000)
    run.go()
    assert [one.value for one in run.memory.counters if one.counter == "sleep_cycles"] == [
        7.0,
        8.0,
        8.0,
    ]
    assert marks(run) == []


def test_a_counter_that_goes_on_while_it_is_read_keeps_the_characters_of_its_answer() -> None:
    """Of three rising values the middle one is right, but it is not the station's last answer."""
    run = one_port(duration_s=5)
    ask, told = run.station.device.answer, iter(range(7, 1000))

    def answer(header: str, text: str, now: float) -> tuple[str, str] | None:
        return (
            ("A", f"CC1{next(told):05d}")
            if (header, text) == ("R", "CC1")
            else ask(header, text, now)
        )

    run.station.device.answer = answer  # type: ignore[method-assign]
    run.go()
    first = next(one for one in run.memory.counters if one.counter == "sleep_cycles")
    assert (first.value, first.raw) == (8.0, "00008")


def test_a_counter_that_is_refused_keeps_no_other_from_being_read() -> None:
    run = one_port("counters = { sleep_hours = 3 }\n", duration_s=5)
    ask = run.station.device.answer

    def answer(header: str, text: str, now: float) -> tuple[str, str] | None:
        return ("N", "00003") if (header, text) == ("R", "CW1") else ask(header, text, now)

    run.station.device.answer = answer  # type: ignore[method-assign]
    run.go()
    kept = {one.counter: one.value for one in run.memory.counters}
    assert list(kept) == [counter.name for counter in run.contexts["dde-1"].family.counters]
    assert [name for name, value in kept.items() if value is None] == ["work_h"]
    assert kept["sleep_h"] == 3.0
    assert (run.facts.outcome, run.memory.of_kind("counters.missed")) == ("completed", [])


def test_at_the_end_one_answer_bears_out_what_two_said_before() -> None:
    run = one_port("counters = { work_hours = 120 }\n", duration_s=5).go()
    assert [one.text for one in run.heard].count("RCW1") == 3  # two at the start, one at the end


# -- hot air ---------------------------------------------------------------------------------------


def test_an_external_temperature_that_only_one_answer_tells_is_not_recorded() -> None:
    run = hot_air(duration_s=20)
    say(run, "ET1", "00400", 10)
    run.go()
    (event,) = marks(run)
    assert (event.port, event.raw) == (1, "400 °C")
    assert event.text.startswith("The external temperature of port 1 was 400 °C and ")
    assert run.facts.doubted == {"external_temperature": 1}
    assert 400 not in run.memory.column("external_c")


def test_an_external_temperature_that_two_answers_tell_is_recorded_and_marked() -> None:
    run = hot_air(duration_s=20)
    say(run, "ET1", "00400", 10, times=1000)
    run.go()
    (event,) = marks(run)
    assert event.text.endswith("to 400 °C; a second answer bore it out.")
    assert run.memory.column("external_c")[-1] == 400


@pytest.mark.parametrize(
    ("code", "data", "name", "column", "held"),
    [
        ("SF1", "00700", "selected_air_flow", "set_flow_permille", 600),
        ("ST1", "00300", "selected_air_temperature", "setpoint_c", 320),
    ],
)
def test_a_setting_of_hot_air_is_not_found_changed_by_one_answer(
    code: str, data: str, name: str, column: str, held: int
) -> None:
    run = hot_air(duration_s=20)
    say(run, code, data, 10)
    run.go()
    assert run.facts.doubted == {name: 1}
    assert len(marks(run)) == 1
    assert run.memory.of_kind("setting.changed") == []
    assert run.facts.outcome == "completed"
    assert {one for one in run.memory.column(column) if one is not None} == {held}


# -- nothing to be held against --------------------------------------------------------------------


def test_the_first_temperature_of_a_run_is_asked_again() -> None:
    """00056 and 00416 differ in two bits and have the same check byte, so any first reading may be
    wrong.
    """
    run = one_port()
    say(run, "TT1", "00416", first_sample_s())
    run.go()
    assert 416 not in run.memory.column("temperature_c")
    assert run.facts.doubted == {"tip_temperature": 1}
    assert len(marks(run)) == 1


@pytest.mark.parametrize("code", ["QT1", "TT"])
def test_so_is_the_first_of_any_other_temperature(code: str) -> None:
    column = {"QT1": "transistor_c", "TT": "transformer_c"}[code]
    run = one_port(duration_s=40)
    say(run, code, "00433", first_sample_s(), 25)
    run.go()
    values = [value for value in run.memory.column(column) if value is not None]
    assert len(values) >= 3
    assert 433 not in values
    assert sum(run.facts.doubted.values()) == 2


# -- what cannot be --------------------------------------------------------------------------------

IMPOSSIBLE = {
    "QT1": ("transistor_c", "04033"),
    "TT": ("transformer_c", "04035"),
    "ED1": ("delay_s", "98899"),
    "PP1": ("power_permille", "89000"),
    "TT1": ("temperature_c", "04033"),
}


@pytest.mark.parametrize("code", IMPOSSIBLE)
def test_what_cannot_be_is_not_recorded_from_one_answer(code: str) -> None:
    column, data = IMPOSSIBLE[code]
    run = one_port(duration_s=40)
    say(run, code, data, 12, 25)
    run.go()
    assert int(data) not in run.memory.column(column)
    assert sum(run.facts.doubted.values()) == 2
    assert set(reasons_of(run, column)) <= {"not_counting"}


def test_of_three_answers_the_one_that_can_be_is_recorded() -> None:
    run = one_port()
    run.at(10, lambda: let_say(run.station.device, "TT1", "04033", "04035"))
    run.go()
    (event,) = marks(run)
    assert event.text.endswith(
        "4033 °C and 4035 °C and 350 °C when asked 3 times; the last is believed."
    )
    assert event.value == 350.0
    assert {4033, 4035}.isdisjoint(run.memory.column("temperature_c"))
    assert {row[COLUMN["quality"]] for row in run.memory.samples} == {"ok"}


@pytest.mark.parametrize("code", IMPOSSIBLE)
def test_nor_is_it_when_it_is_said_again_and_again(code: str) -> None:
    column, data = IMPOSSIBLE[code]
    run = one_port(duration_s=40)
    say(run, code, data, 12, times=1000)
    run.go()
    assert int(data) not in run.memory.column(column)
    assert "implausible" in reasons_of(run, column)
    (event,) = run.memory.of_kind("read.implausible")
    assert event.raw is not None
    assert event.raw.count(str(int(data))) == 2


def test_a_status_digit_that_only_one_answer_tells_is_not_recorded() -> None:
    run = one_port(duration_s=20)
    say(run, "PS1", "00100", 10)
    say(run, "PS1", "01000", 12)
    run.go()
    assert True not in run.memory.column("desoldering")
    assert run.facts.doubted == {"status": 2}


@pytest.mark.parametrize("times", [1, 1000])
def test_an_air_flow_beyond_all_is_not_recorded(times: int) -> None:
    run = hot_air("", duration_s=20)
    say(run, "SF1", "09600", 10, times=times)
    run.go()
    assert ("implausible" in reasons_of(run, "set_flow_permille")) == (times > 1)
    flows = [value for value in run.memory.column("set_flow_permille") if value is not None]
    assert flows
    assert max(flows) <= 1000


# -- borders: each number is held from both sides --------------------------------------------------


@pytest.mark.parametrize(
    ("code", "column", "greatest"),
    [
        ("PP1", "power_permille", 1500),  # half as much again as full
        ("ED1", "delay_s", 3600),  # 60 min, the longest delay
        ("TT1", "temperature_c", 600),
        ("QT1", "transistor_c", 600),
        ("TT", "transformer_c", 600),
    ],
)
def test_the_greatest_that_can_be_is_recorded_and_one_more_is_not(
    code: str, column: str, greatest: int
) -> None:
    for value, can_be in ((greatest, True), (greatest + 1, False)):
        run = one_port(duration_s=25)
        say(run, code, f"{value:05d}", 8, times=1000)
        run.go()
        assert (value in run.memory.column(column)) == can_be
        assert ("implausible" in reasons_of(run, column)) == (not can_be)


def test_a_flow_of_half_as_much_again_as_the_greatest_is_recorded_and_one_more_is_not() -> None:
    for value, can_be in ((1500, True), (1501, False)):
        run = hot_air("", duration_s=20)
        say(run, "SF1", f"{value:05d}", 10, times=1000)
        run.go()
        assert ("implausible" in reasons_of(run, "set_flow_permille")) == (not can_be)
        assert (max(flow or 0 for flow in run.memory.column("set_flow_permille")) >= 1500) == can_be


@pytest.mark.parametrize(("second", "is_marked"), [(305, False), (306, True)])
def test_two_answers_that_are_25_degrees_apart_do_not_contradict(
    second: int, is_marked: bool
) -> None:
    run = one_port()
    run.at(10, lambda: let_say(run.station.device, "TT1", "00280", f"{second:05d}"))
    run.go()
    assert second in run.memory.column("temperature_c")
    assert [event.raw for event in marks(run)] == ["280 °C"] * is_marked
    assert run.facts.doubted == ({"tip_temperature": 1} if is_marked else {})


@pytest.mark.parametrize("times", [1, 1000])
@pytest.mark.parametrize(("value", "is_doubted"), [(300, False), (299, True)])
def test_a_tip_may_change_by_50_degrees_from_one_tick_to_the_next(
    value: int, is_doubted: bool, times: int
) -> None:
    """The tip is at 350 °C. A single 299 is contradicted by the next answer; a repeated one is a
    jump.
    """
    run = one_port()
    say(run, "TT1", f"{value:05d}", 10, times=times)
    run.go()
    assert bool(marks(run)) == is_doubted
    assert bool(run.facts.doubted) == is_doubted
