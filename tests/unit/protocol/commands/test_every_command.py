"""Every command of every family. No list of exceptions: a family that joins `FAMILIES` is walked
like the others.

What a command must say of itself, that no other is meant by its code, that its values go there and
back, that a virtual station answers it to the client that a run uses, and that the page of commands
lists it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cache
from itertools import chain

import pytest

from support.campaigns.each_row import each_row
from support.clients.converse import Pair
from support.clients.values import PORTS, as_written, codes_of, every_text, meant, values_to_write
from support.pages.station_commands import printed_code
from support.product import (
    FAMILIES,
    OFF,
    AlarmDelay,
    Choice,
    Client,
    Command,
    ConditionNumber,
    Delay,
    Digit,
    DigitWord,
    Effect,
    Family,
    Limits,
    Number,
    OutOfRange,
    Quantity,
    Scope,
    Station,
    Steps,
    StoredCondition,
    Text,
    Value,
    change_address,
    range_problem,
    restart,
)
from support.readers.texts import ROOT

EVERY = [(family, command) for family in FAMILIES.values() for command in family.commands.values()]


def _walk(
    *chosen: tuple[Family, Command],
) -> Callable[[Callable[[Family, Command], None]], Callable[[], None]]:
    return each_row(
        (f"{family.name}-{command.name}", (family, command)) for family, command in chosen
    )


every_command = _walk(*EVERY)
every_reading = _walk(*((family, command) for family, command in EVERY if command.readable))
every_setting = _walk(*((family, command) for family, command in EVERY if command.access == "rw"))
every_order = _walk(*((family, command) for family, command in EVERY if command.access == "w"))

# -- what its row says -----------------------------------------------------------------------------

UNITS = {"°C", "‰", "h", "count", "s", "min", "mm", "mm/s", "raw"}
"""``raw`` says that no manual prints the unit (docs/reference/contradictions.md, B-33)."""
WITHOUT_UNIT = (Choice, ConditionNumber, Digit, Number, StoredCondition, Text, DigitWord)
"""Names, words and numbers that stand for something else: what they can be is their range."""

CITATION = re.compile(r"(00[0-4]) \S.*")
"""A manual's number, and its section or the name of its row."""


@every_command
def test_it_has_a_name_and_its_letters(family: Family, command: Command) -> None:
    assert re.fullmatch(r"[a-z]+(_[a-z]+)*", command.name)
    assert re.fullmatch(r"[A-Z]{1,3}", command.letters)
    assert command.access in ("r", "w", "rw")
    assert family.commands[command.name] is command


@every_command
def test_it_has_a_unit_or_needs_none(family: Family, command: Command) -> None:
    assert (
        command.unit in UNITS
        if not isinstance(command.quantity, WITHOUT_UNIT)
        else command.unit == ""
    )


@every_command
def test_its_range_and_step_are_printed_or_marked_as_not_printed(
    family: Family, command: Command
) -> None:
    limits = command.limits
    if not limits.printed:
        assert limits == Limits(printed=False, off=limits.off), (
            "a range that is not printed has no border"
        )
    elif not isinstance(command.quantity, WITHOUT_UNIT):
        assert limits != Limits(), "neither a border nor a step, and not marked as not printed"
    if limits.low is not None and limits.high is not None:
        assert limits.low <= limits.high


@every_command
def test_its_manual_and_section_are_named(family: Family, command: Command) -> None:
    citations = [CITATION.fullmatch(part.strip()) for part in command.manual.split(";")]
    assert all(citations), f"{command.manual!r} is not a manual's number and its section"
    assert {found[1] for found in citations if found} & set(family.manual.split(", ")), (
        "its family's own manual is cited"
    )


@every_command
def test_what_acts_is_dangerous_and_sent_once(family: Family, command: Command) -> None:
    if command.effect in (Effect.MOVES, Effect.ERASES):
        assert command.access == "w"
        assert command.dangerous
    if command.effect is Effect.CLEARS:
        assert command.access == "r"
    assert command.sent_once == (command.effect in (Effect.MOVES, Effect.ERASES, Effect.CLEARS))


# -- its code --------------------------------------------------------------------------------------


@cache
def _meanings(name: str) -> dict[str, set[str]]:
    """Header and code, at every port with every tool -> the commands that they mean. Looked up
    whole, never by beginning.
    """
    family, found = FAMILIES[name], dict[str, set[str]]()
    for command in family.commands.values():
        for code in codes_of(command, family.ports or PORTS):
            for header in command.access.upper():
                found.setdefault(header + code, set()).add(command.name)
    return found


@every_command
def test_its_letters_leave_room_for_port_and_tool(family: Family, command: Command) -> None:
    """A code of JBC has three characters (manual 002, "Data Link Layer"), but for RTT; OMEGA's has
    one letter.

    docs/reference/contradictions.md, B-10.
    """
    for code in codes_of(command):
        assert code.isascii()
        assert code.isalnum()
        assert (
            len(code) == 3
            or command.name == "transformer_temperature"
            or family.protocol == "omega"
        )


@every_command
def test_its_code_is_refused_without_port_or_tool(family: Family, command: Command) -> None:
    for nowhere in (None, 0, 5, -1):
        if command.scope in (Scope.PORT, Scope.TOOL):
            with pytest.raises(ValueError, match="port from 1 to 4"):
                command.code(nowhere, 2)
    for none in (None, 0, 10, -1):
        if command.scope is Scope.TOOL:
            with pytest.raises(ValueError, match="tool from 1 to 9"):
                command.code(1, none)


@every_command
def test_no_other_command_of_the_family_has_its_code(family: Family, command: Command) -> None:
    for code in codes_of(command, family.ports or PORTS):
        for header in ("R", "W"):  # reading and writing one code concern the same value
            assert _meanings(family.name).get(header + code, {command.name}) == {command.name}, code


@every_command
def test_no_code_begins_with_its_own_but_that_of_a_tip(family: Family, command: Command) -> None:
    """``TT`` is a beginning of ``TT1``: the answers differ in length
    (docs/reference/contradictions.md, B-10).
    """
    for code in codes_of(command, family.ports or PORTS):
        longer = {
            other[1:]
            for other in _meanings(family.name)
            if other[1:].startswith(code) and other[1:] != code
        }
        assert longer == (
            {f"TT{port}" for port in family.ports or PORTS} if code == "TT" else set()
        )


# -- the page lists it -----------------------------------------------------------------------------

STATION_COMMANDS = (ROOT / "docs" / "reference" / "station-commands.md").read_text(encoding="utf-8")
"""As it stands in the repository; that it is made from the tables is held by
tests/docs/test_pages.py.
"""


@every_command
def test_the_page_of_commands_lists_it(family: Family, command: Command) -> None:
    begin = f"| `{command.name}` | `{printed_code(command)}` | "
    (row,) = (
        line
        for line in STATION_COMMANDS.splitlines()
        if line.startswith(begin) and f"| {command.manual} |" in line
    )
    cells = [cell.strip() for cell in row.strip("|").split(" | ")]
    assert f"`{family.name}`" in cells[2] or cells[2] in ("all", "all soldering", "all of 002")
    assert cells[3].removesuffix(" *(inferred)*") == (command.unit or "–")
    assert ("(inferred)" in cells[3]) == (command.inferred is not None and command.inferred.unit)
    assert (command.inferred.source if command.inferred else "") in cells[5]
    assert bool(cells[5]) == (command.inferred is not None)
    assert ("dangerous" in cells[7]) == command.dangerous
    assert cells[9] == command.note


# -- its values there and back ---------------------------------------------------------------------


def _distinct() -> list[Quantity]:
    return list(dict.fromkeys(command.quantity for _, command in EVERY))


def _written() -> list[Quantity]:
    return list(dict.fromkeys(command.quantity for _, command in EVERY if command.writable))


def _read_back(quantity: Quantity, texts: Iterable[str]) -> int:
    """How many texts mean something; each value must be written as the text it was read from."""
    count = 0
    for text in texts:
        value = meant(quantity, text)
        if value is None:
            continue
        count += 1
        written = as_written(quantity, text)
        if written is not None:
            assert quantity.encode(value) == written, f"{text} is {value}"
            assert quantity.decode(written) == value
    return count


def _is_telling(value: Value) -> bool:
    """Whether it is a small number, or one beside a round one, or one of a few of the others (a
    multiple of 5, too).
    """
    if not isinstance(value, int | float) or abs(value) < 1_000:
        return True
    return round(value) % 35 == 0 or abs(value) % 1_000 <= 10 or abs(value) % 1_000 >= 990


@cache
def _telling_texts() -> list[str]:
    """Small numbers, those beside round ones and some of the others; every word of small digits;
    whatever is no number.
    """
    return [
        text
        for text in every_text()
        if not text.isdigit() or set(text) <= set("0123") or _is_telling(int(text))
    ]


@pytest.mark.parametrize("quantity", _distinct(), ids=repr)
def test_a_text_that_means_something_is_written_as_it_was_read(quantity: Quantity) -> None:
    assert _read_back(quantity, _telling_texts()) > 0


@pytest.mark.campaign
@pytest.mark.parametrize("quantity", _distinct(), ids=repr)
def test_each_text_that_means_something_is_written_as_it_was_read(
    quantity: Quantity, counted: Callable[..., None]
) -> None:
    counted(texts_that_mean_something=_read_back(quantity, every_text()))


@every_command
def test_what_its_limits_allow_can_be_written_and_what_they_forbid_cannot(
    family: Family, command: Command
) -> None:
    limits = command.limits
    for value in values_to_write(family, command):
        assert limits.problem(value) is None
        assert command.quantity.decode(command.quantity.encode(value)) == value
    assert (limits.problem(OFF) is None) == limits.off
    step = limits.step or 1
    if limits.low is not None:
        assert "outside" in (limits.problem(limits.low - step) or "")
    if limits.high is not None:
        assert "outside" in (limits.problem(limits.high + step) or "")
    if limits.step is not None:
        assert "not a step" in (limits.problem((limits.low or 0) + limits.step / 2) or "")


def _every_number() -> Iterator[Value]:
    """As far as the wire goes, and beyond."""
    tenths = (number / 10 for number in range(-200, 100_000) if number % 10)
    hundredths = (number / 100 for number in range(-10, 10_000) if number % 10)
    return chain(range(-10_001, 100_010), (1_000_000, 10**12), tenths, hundredths, (OFF,))


def _wrong(quantity: Quantity, numbers: Iterable[Value]) -> list[Value]:
    """Those that can be written, and are read back as another."""
    found: list[Value] = []
    for value in numbers:
        with suppress(ValueError):
            if quantity.decode(quantity.encode(value)) != value:
                found.append(value)
    return found


@cache
def _telling() -> list[Value]:
    return [value for value in _every_number() if _is_telling(value)]


@pytest.mark.parametrize("quantity", _written(), ids=repr)
def test_whatever_number_can_be_written_is_read_as_that_number(quantity: Quantity) -> None:
    """3800 °C once went out as an alarm limit and was read back as "not set"."""
    assert _wrong(quantity, _telling()) == []


@pytest.mark.campaign
@pytest.mark.parametrize("quantity", _written(), ids=repr)
def test_every_number_that_can_be_written_is_read_as_that_number(
    quantity: Quantity, counted: Callable[..., None]
) -> None:
    assert _wrong(quantity, _every_number()) == []
    counted(numbers=len(list(_every_number())))


@every_command
def test_what_a_person_may_write_can_be_written(family: Family, command: Command) -> None:
    """What the ranges let through the wire carries, and nothing raises behind them."""
    for value in (
        -99_995,
        -9_995,
        -5,
        0,
        5,
        600,
        605,
        700,
        3_800,
        9_995,
        99_995,
        99_999,
        100_000,
        1_000_000,
    ):
        if command.writable and range_problem(command, value) is None:
            assert command.quantity.decode(command.quantity.encode(value)) == value


@every_command
def test_off_is_99999_where_the_limits_say_so_and_nowhere_else(
    family: Family, command: Command
) -> None:
    if command.limits.off:
        assert command.writable
        assert isinstance(command.quantity, Delay | AlarmDelay)
        assert (command.quantity.encode(OFF), command.quantity.decode("99999")) == ("99999", OFF)
    else:
        with pytest.raises(ValueError, match=r"\boff\b|OFF|number|no solder condition"):
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
        ("alarm_low_limit", 301, "not a step of 5"),
        ("alarm_high_delay", 100.0, "outside"),
        ("alarm_low_delay", 1.005, "not a step of 0.01"),
    ],
)
def test_what_002_does_not_allow_is_refused_on_its_stations_and_what_000_does_not_print_is_not(
    name: str, value: Value, problem: str
) -> None:
    for family in FAMILIES.values():
        if "sleep_delay" in family.commands:
            command = family.commands[name]
            is_printed = (
                "002" in family.manual
                or (name.endswith("_delay") and name.startswith("alarm"))
                or value == -51
            )
            assert (
                problem in (command.limits.problem(value) or "")
                if is_printed
                else command.limits.problem(value) is None
            )
            if not is_printed:
                assert command.inferred is not None
                assert problem in (command.inferred.limits.problem(value) or "")


@pytest.mark.parametrize("value", [0, -5, 605, 3800, 99995])
def test_an_alarm_limit_that_would_be_read_back_as_not_set_is_refused_everywhere(
    value: Value,
) -> None:
    for family in FAMILIES.values():
        for name in ("alarm_high_limit", "alarm_low_limit"):
            if name in family.commands:
                assert "would be read back as not set" in (
                    range_problem(family.commands[name], value) or ""
                )


# -- a virtual station answers it ------------------------------------------------------------------


@every_reading
def test_a_virtual_station_tells_it_everywhere(family: Family, command: Command) -> None:
    pair = Pair(family.name)
    for place in pair.places(command):
        value = pair.read(*place)
        assert command.quantity.decode(pair.client.data) == value
    assert pair.station.log.refused == []


@every_setting
def test_a_virtual_station_takes_it_and_tells_it_again(family: Family, command: Command) -> None:
    for place in Pair(family.name).places(command):
        pair = Pair(family.name)
        held = pair.read(*place)
        values = values_to_write(family, command, held)
        taken = [value for value in values if _takes(pair, value, *place)]
        assert set(taken) - {held}, f"of {values} nothing was taken beside {held}"


def _takes(pair: Pair, value: Value, command: Command, port: int | None, tool: int | None) -> bool:
    """Whether the station takes the value; then it must tell the same."""
    try:
        pair.write(command, value, port, tool)
    except OutOfRange:
        return False
    found = pair.read(command, port, tool)
    assert found == value or _same_status(pair.family, found, value)
    assert pair.station.log.writes[-1][1:] == (command.name, port or 0, tool or 0, value)
    return True


def _same_status(family: Family, found: Value, ordered: Value) -> bool:
    """Whether a status word says that it was done: a tool that is cool already goes on by
    itself.
    """
    return (
        isinstance(found, tuple)
        and isinstance(ordered, tuple)
        and family.status.confirms(found, ordered)
    )


def _restart(client: Client, command: Command) -> Steps[object]:
    return restart(client, command)


def _move(client: Client, command: Command) -> Steps[object]:
    assert isinstance(client, Station)
    return change_address(client, command, 99)


ITS_OWN_WAY: dict[str, Callable[[Client, Command], Steps[object]]] = {
    "restart": _restart,
    "address": _move,
}
"""Orders after which the station is away for a while, or elsewhere."""


@every_order
def test_a_virtual_station_does_it_once(family: Family, command: Command) -> None:
    pair = Pair(family.name)
    (value,) = values_to_write(family, command)[-1:]
    pair.do(
        lambda client: ITS_OWN_WAY.get(command.name, lambda one, order: one.write(order, value))(
            client, command
        )
    )
    assert [(one.name, one.value) for one in pair.station.log.writes] == [(command.name, value)]
    pair.read(family.commands[family.harmless[0]])  # and is there again
