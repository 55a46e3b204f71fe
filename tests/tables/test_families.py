"""Walks every command, signal and counter of every family."""

from __future__ import annotations

import re
from collections import Counter as Tally

import pytest
from codes import PORTS, codes, codes_of
from hypothesis import given, settings
from hypothesis import strategies as st

from jbclog.commands.command import Command, Effect, Limits, Scope
from jbclog.commands.family import FAMILIES, Family, family_of
from jbclog.commands.hotair import AIR_STATUS
from jbclog.commands.robot import COMMUNICATION_ERRORS
from jbclog.commands.signals import Pace
from jbclog.commands.status import SOLDERING_STATUS
from jbclog.quantities import (
    HIGHEST_C,
    OFF,
    AlarmDelay,
    AlarmLimit,
    Choice,
    Delay,
    HexLength,
    Number,
    Scaled,
    Text,
    Unsigned,
    Value,
    Whole,
    Word,
)
from jbclog.rows import SIGNAL_COLUMNS, SIGNAL_OF_COLUMN

UNITS = {"", "°C", "‰", "h", "count", "s", "min", "mm", "mm/s", "raw"}  # raw: no manual prints one (digest B-33)

families = pytest.mark.parametrize("family", FAMILIES.values(), ids=lambda family: family.name)
EVERY = [(family, command) for family in FAMILIES.values() for command in family.commands.values()]
commands = pytest.mark.parametrize(
    ("family", "command"), [pytest.param(family, command, id=f"{family.name}-{command.name}") for family, command in EVERY]
)
DISTINCT = list(dict.fromkeys(command for _, command in EVERY))  # most families share most rows
distinct_commands = pytest.mark.parametrize("command", DISTINCT, ids=lambda command: command.name)


@commands
def test_a_command_says_all_that_is_to_be_known_of_it(family: Family, command: Command) -> None:
    assert re.fullmatch(r"[a-z]+(_[a-z]+)*", command.name)
    assert family.commands[command.name] is command
    assert re.fullmatch(r"[A-Z]{1,3}", command.letters)
    assert command.access in ("r", "w", "rw")
    assert command.unit in UNITS
    assert re.search(r"\b00[0-4]\b", command.manual), "which manual, which section"
    assert len(command.manual) > 4
    assert isinstance(command.limits, Limits)
    assert command.answer_digits in (5, None)


@commands
def test_the_letters_leave_room_for_port_and_tool(family: Family, command: Command) -> None:
    """A code has three characters (seed 002, "Data Link Layer"), but for RTT (digest B-10)."""
    for code in codes_of(command):
        assert len(code) == 3 or command.name == "transformer_temperature"
        assert code.isascii()
        assert code.isalnum()


@commands
def test_what_is_written_has_limits_or_says_that_none_are_printed(family: Family, command: Command) -> None:
    limits = command.limits
    if command.writable and isinstance(command.quantity, Whole | Unsigned | Delay | AlarmDelay | AlarmLimit | Scaled):
        assert not limits.printed or limits.low is not None or limits.step is not None
        assert limits.low is None or limits.high is None or limits.low <= limits.high
    assert limits.off == (command.writable and isinstance(command.quantity, Delay | AlarmDelay))  # 99999: there and nowhere else


@commands
def test_what_acts_is_dangerous_or_harmless_and_never_readable(family: Family, command: Command) -> None:
    if command.effect in (Effect.MOVES, Effect.ERASES):
        assert command.access == "w"
        assert command.dangerous
        assert command.asked_once
    if command.effect is Effect.CLEARS:
        assert command.access == "r"
        assert command.asked_once
    if command.effect in (Effect.NONE, Effect.STOPS):
        assert not command.asked_once


@families
def test_no_code_means_two_things(family: Family) -> None:
    """Each code on each port with each tool belongs to one command: reading and writing it concern the same value."""
    ports = family.ports or PORTS
    all_codes = [code for command in family.commands.values() for code in codes_of(command, ports)]
    assert [code for code, times in Tally(all_codes).items() if times > 1] == []


@families
def test_only_the_transformer_begins_another_code(family: Family) -> None:
    """``TT`` is a beginning of ``TT1``: the two are told apart by the length of the answer (digest B-10)."""
    known = codes(family)
    beginnings = {(one, other) for one in known for other in known if one != other and other.startswith(one)}
    has_transformer = "transformer_temperature" in family.commands
    assert beginnings == ({("TT", f"TT{port}") for port in family.ports or PORTS} if has_transformer else set())


@families
def test_a_code_is_refused_without_its_port_or_tool(family: Family) -> None:
    for command in family.commands.values():
        if command.scope is not Scope.STATION:
            for port in (None, 0, 5, -1):
                with pytest.raises(ValueError, match="port from 1 to 4"):
                    command.code(port, 2)
        if command.scope is Scope.TOOL:
            for tool in (None, 0, 10, -1):
                with pytest.raises(ValueError, match="tool from 1 to 9"):
                    command.code(1, tool)


# -- values there and back -------------------------------------------------------------------------------------------------


def _values(command: Command) -> st.SearchStrategy[Value]:
    """Any value that the command's own limits allow."""
    limits, quantity = command.limits, command.quantity
    low = int(limits.low or 0)
    step = int(limits.step) if limits.step and limits.step >= 1 else 1
    match quantity:
        case Word():
            return st.tuples(*(st.integers(0, top) for top in quantity.highest))
        case Choice():
            return st.sampled_from(quantity.names)
        case Text():
            return st.sampled_from(["DDE", "UCR245", "ALE", "DDR"])
        case AlarmDelay():
            return st.one_of(st.just(OFF), st.integers(0, 9999).map(lambda hundredths: hundredths / 100))
        case Scaled():
            return st.integers(0, 99999).map(lambda raw: raw / quantity.per_unit)
        case HexLength():
            return st.integers(0, 16**8).map(lambda raw: raw / 10)
        case Delay():
            return st.one_of(st.just(OFF), _steps(low, int(limits.high or 99998), step))
        case AlarmLimit():
            return _steps(low, HIGHEST_C, step)
        case Whole() | Unsigned() | Number():
            return _steps(low, 79_999 if limits.high is None else int(limits.high), step)  # 80000: digest B-28
    raise AssertionError(f"{quantity} is no kind of value that this test knows")


def _steps(low: int, high: int, step: int) -> st.SearchStrategy[int]:
    return st.integers(-(-low // step), high // step).map(lambda count: count * step)


@distinct_commands
@settings(max_examples=40)
@given(data=st.data())
def test_encode_and_decode_undo_each_other(command: Command, data: st.DataObject) -> None:
    value = data.draw(_values(command))
    field = command.quantity.encode(value)
    assert command.quantity.decode(field) == value
    assert command.limits.problem(value) is None
    assert command.answer_digits in (None, len(field))
    assert field.isascii()


@commands
def test_off_is_99999_where_the_limits_say_so_and_nowhere_else(family: Family, command: Command) -> None:
    if command.limits.off:
        assert command.quantity.encode(OFF) == "99999"
        assert command.quantity.decode("99999") is OFF
        assert command.limits.problem(OFF) is None
    elif not isinstance(command.quantity, AlarmLimit):  # "not set" has no printed form (digest B-23)
        with pytest.raises(ValueError, match=r"off|OFF"):
            command.quantity.encode(OFF)
        assert command.limits.problem(OFF) == "cannot be switched off"


@pytest.mark.parametrize(
    ("name", "value", "problem"),
    [
        ("adjust", 51, "outside"),
        ("adjust", -51, "outside"),
        ("sleep_delay", 10, "outside"),
        ("sleep_delay", -1, "outside"),
        ("hibernation_delay", 61, "outside"),
        ("hibernation_delay", 12, "not a step of 5"),
        ("selected_temperature", 352, "not a step of 5"),
        ("sleep_temperature", 149, "not a step of 5"),
        ("alarm_high_limit", 0, "outside"),  # would be read back as "not set"
        ("alarm_low_limit", 301, "not a step of 5"),
        ("alarm_high_delay", 100.0, "outside"),
        ("alarm_low_delay", 1.005, "not a step of 0.01"),
    ],
)
def test_what_no_manual_allows(name: str, value: Value, problem: str) -> None:
    for family in FAMILIES.values():
        if family.status is SOLDERING_STATUS:
            assert problem in (family.commands[name].limits.problem(value) or "")


# -- families --------------------------------------------------------------------------------------------------------------


@families
def test_signals_fill_columns_from_readable_commands(family: Family) -> None:
    columns = [column for signal in family.signals for column in signal.columns]
    assert len(columns) == len(set(columns))
    for signal in family.signals:
        assert family.commands[signal.command].readable
        assert set(signal.columns) <= set(SIGNAL_COLUMNS)
        assert {SIGNAL_OF_COLUMN[column] for column in signal.columns} == {signal.name}
        assert signal.pace is not Pace.COUNTERS
    fast = ["temperature_c", "power_permille", "status", *(["external_c"] if family.name == "jtse" else [])]
    assert [signal.name for signal in family.signals if signal.pace is Pace.FAST] == fast


@families
def test_counters_are_readable_commands_in_their_unit(family: Family) -> None:
    for counter in family.counters:
        command = family.commands[counter.command]
        assert command.access == "r"
        assert command.unit == counter.unit
    assert len({counter.name for counter in family.counters}) == len(family.counters)


@families
def test_safe_states_and_run_statuses_are_orders_that_the_station_takes(family: Family) -> None:
    assert family.safe_states[0] == ("cooling" if family.name == "jtse" else "stand")
    for name in (*family.safe_states, *family.run_statuses):
        word = family.status.orders[name]
        assert family.commands["status"].quantity.decode(family.commands["status"].quantity.encode(word)) == word
    assert not any(family.status.is_working(family.status.orders[name]) for name in family.safe_states)


@families
def test_only_stations_with_a_feeder_feed(family: Family) -> None:
    moving = [command.name for command in family.commands.values() if command.effect is Effect.MOVES]
    assert moving == (["start_feeding"] if family.has_feeder else [])
    assert family.has_feeder == ("stop_feeding" in family.commands) == any(signal.name == "feeding" for signal in family.signals)


@families
def test_a_model_name_proves_its_own_family_and_no_other(family: Family) -> None:
    for model in family.models:
        assert family_of(model) is family
        assert family_of(model.lower() + "-2C") is family
        assert family.proves(model)


@pytest.mark.parametrize(
    ("model", "name"),
    [
        ("UCR245", "ucr"),
        ("UCR470", "ucr"),
        ("UCR24", "ucr"),  # what five characters leave of it (digest B-34)
        ("ALE", "ale"),
        ("NAE", "nae"),
        ("DDE", "dde"),
        ("DME", "dme"),
        ("HDE", "hde"),
        ("DDR", "soldering"),
        ("JTSE", "jtse"),
        ("", None),
        ("SDE", None),
        ("xDDE", None),
    ],
)
def test_the_models_that_the_manuals_name(model: str, name: str | None) -> None:
    found = family_of(model)
    assert (found.name if found else None) == name


@families
def test_numbers_that_no_table_has_are_kept(family: Family) -> None:
    assert family.tool_name(42) == "tool_42"
    assert family.port_errors.text(42) == "unknown port error 42"
    assert family.station_errors.text(42) == "unknown station error 42"


def test_words_of_status_and_errors() -> None:
    assert SOLDERING_STATUS.names == ("working", "stand", "sleep", "hibernation")
    assert SOLDERING_STATUS.orders == {"working": (0, 0, 0, 0, 0), "stand": (0, 0, 0, 0, 1), "extractor": (0, 0, 0, 1, 0)}
    assert AIR_STATUS.orders == {"on": (0, 0, 0, 0, 1), "off": (0, 0, 0, 0, 0), "cooling": (0, 0, 0, 1, 0)}  # seed 001, 4.6
    assert sorted(COMMUNICATION_ERRORS) == [1, 2, 3, 4, 5, 6, 99999]
