"""`jbclog read` prints nothing as fact that one answer alone says, or that cannot be."""

from __future__ import annotations

import json

import pytest

from jbclog.protocol.commands.ranges import TEMPERATURES
from jbclog.session.manual.read import APART, settled
from support.virtual.manual import Bench, Make, says, station_text

DDE = station_text("dde-1", "dde", sim="tools = { 1 = 2, 2 = 1 }\ncounters = { work_hours = 120 }")
JTSE = station_text("jtse-1", "jtse")
DISPLAY = "read it again, and compare with the station's display"


def asked(bench: Bench, code: str) -> int:
    return bench.wires["dde-1"].texts.count("R" + code)


@pytest.mark.parametrize(
    ("name", "code", "data", "told"),
    [
        ("tool", "CT1", "04040", "2: T245/T470/TR245/TR470"),
        ("port_error", "PE1", "04040", "0: ok"),
        ("station_error", "SER", "00005", "0: ok"),
        ("software_version", "SVR", "9.99", "1.00a"),
        ("work_hours", "CW1", "00168", "120 h"),
        ("selected_temperature", "ST1", "00340", "350 °C"),
        ("status", "PS1", "01000", "extractor"),
        ("tip_temperature", "TT1", "00433", "23 °C"),
        ("transistor_temperature", "QT1", "04033", "33 °C"),
        ("transformer_temperature", "TT", "00433", "35 °C"),
        ("power", "PP1", "00900", "0 ‰"),
        ("time_to_sleep", "ED1", "00120", "not counting (99999)"),
    ],
)
def test_what_one_answer_alone_says_is_not_told(
    make: Make, name: str, code: str, data: str, told: str
) -> None:
    bench = make(DDE)
    says(bench, "dde-1", code, data)
    ended = bench.do(
        "read", "dde-1", name, *([] if code in ("SER", "SVR", "TT") else ["--port", "1"])
    )
    assert (ended.code, ended.out) == (0, f"{told}\n")
    assert asked(bench, code) >= 3


def test_a_counter_is_asked_until_two_answers_agree(make: Make) -> None:
    bench = make(DDE)
    assert bench.do("read", "dde-1", "work_hours", "--port", "1").out == "120 h\n"
    assert asked(bench, "CW1") == 2


def test_a_counter_that_goes_on_is_told_with_the_characters_of_its_own_answer(make: Make) -> None:
    bench = make(DDE)
    says(bench, "dde-1", "CW1", "00120", "00121", "00122")
    told = json.loads(bench.do("read", "dde-1", "work_hours", "--port", "1", "--json").out)
    assert (told["value"], told["raw"]) == (121, "00121")


IMPOSSIBLE = [
    ("transformer_temperature", "TT", "04033", "transformer_temperature: the station says 4033 °C"),
    (
        "transistor_temperature",
        "QT1",
        "00601",
        "transistor_temperature of port 1: the station says 601 °C",
    ),
    ("tip_temperature", "TT1", "04033", "tip_temperature of port 1: the station says 4033 °C"),
    ("power", "PP1", "09000", "power of port 1: the station says 9000 ‰"),
    ("time_to_sleep", "ED1", "98899", "time_to_sleep of port 1: the station says 98899 s"),
]


@pytest.mark.parametrize(("name", "code", "data", "told"), IMPOSSIBLE)
def test_what_cannot_be_is_no_value_however_often_it_is_said(
    make: Make, name: str, code: str, data: str, told: str
) -> None:
    bench = make(DDE)
    says(bench, "dde-1", code, data, last=True)
    words = ("read", "dde-1", name, *([] if code == "TT" else ["--port", "1"]))
    ended = bench.do(*words)
    assert (ended.code, ended.out, ended.err) == (
        3,
        "",
        f"error: dde-1: {told}, which is impossible; {DISPLAY}\n",
    )
    assert asked(bench, code) == 2
    ended = bench.do(*words, "--json")
    facts = json.loads(ended.out)
    assert (ended.code, facts["value"], facts["text"], facts["raw"]) == (3, None, None, data)
    assert (facts["reason"], facts["problem"]) == (
        "implausible",
        f"{told.partition(': ')[2]}, which is impossible; {DISPLAY}",
    )


def test_among_everything_too(make: Make) -> None:
    bench = make(DDE)
    says(bench, "dde-1", "TT", "04033", last=True)
    ended = bench.do("read", "dde-1", "--all")
    assert ended.code == 3
    (line,) = [
        line for line in ended.out.splitlines() if line.startswith("transformer_temperature")
    ]
    assert (
        line.split(maxsplit=1)[1]
        == f"not read: the station says 4033 °C, which is impossible; {DISPLAY}"
    )


def test_what_cannot_be_and_is_another_each_time_is_told_with_all_of_it(make: Make) -> None:
    bench = make(DDE)
    says(bench, "dde-1", "TT1", "04033", "00601", "04035", "04037")
    ended = bench.do("read", "dde-1", "tip_temperature", "--port", "1")
    assert (ended.code, ended.out) == (3, "")
    assert "the station says 4033 °C, 601 °C, 4035 °C, 4037 °C, which is impossible" in ended.err


def test_what_cannot_be_bears_nothing_out(make: Make) -> None:
    """Of 4033, 300 and 23 °C the middle one is no more likely than of 300 and 23 °C."""
    bench = make(DDE)
    says(bench, "dde-1", "TT1", "04033", "00300")
    assert bench.do("read", "dde-1", "tip_temperature", "--port", "1").out == "23 °C\n"


def test_answers_that_never_agree_are_no_value(make: Make) -> None:
    bench = make(DDE)
    says(bench, "dde-1", "TT1", "00100", "00300", "04033", "00200")
    ended = bench.do("read", "dde-1", "tip_temperature", "--port", "1")
    assert (ended.code, ended.out) == (3, "")
    assert "the station says 100 °C, 300 °C, 4033 °C, 200 °C when asked 4 times" in ended.err


def test_an_air_flow_beyond_all_is_no_value(make: Make) -> None:
    bench = make(JTSE)
    says(bench, "jtse-1", "SF1", "09600", last=True)
    ended = bench.do("read", "jtse-1", "selected_air_flow", "--port", "1")
    assert (ended.code, ended.out) == (3, "")
    assert "the station says 9600 raw, which is impossible" in ended.err


def test_what_means_nothing_without_a_tool_is_void_even_where_it_cannot_be(make: Make) -> None:
    bench = make(station_text("dde-1", "dde", sim="tools = { 1 = 0 }"))
    says(bench, "dde-1", "TT1", "04033", last=True)
    ended = bench.do("read", "dde-1", "tip_temperature", "--port", "1")
    assert (ended.code, ended.out) == (0, "not known: no tool (port error 4)\n")


def test_what_reading_clears_is_asked_once(make: Make) -> None:
    bench = make(DDE)
    bench.do("read", "dde-1", "alarm_flags", "--port", "1")
    assert asked(bench, "TA1") == 1


@pytest.mark.parametrize(
    ("given", "value"),
    [
        ([300], None),
        ([300, 325], 325),
        ([300, 326], None),
        ([300, 274], None),
        ([300, 100, 310], 310),
        ([100, 200, 300], 200),
        ([300, 200, 100], 200),
        ([100, 300, 200], None),
    ],
)
def test_two_that_are_near_or_the_middle_one_of_three_in_order(
    given: list[int], value: int | None
) -> None:
    assert settled(given, 25) == value


def test_how_near_is_said_for_every_signal_that_moves() -> None:
    assert {*TEMPERATURES, "power_permille", "delay_s"} == set(APART)
    assert (APART["temperature_c"], APART["power_permille"], APART["delay_s"]) == (25, 100, 2)
