"""What the manuals print (`tests/support/golden`), held against the command tables and against what
the product writes.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from support.campaigns.each_row import each_row
from support.golden import FIELDS, FRAMES, LISTED, OFF, Field, Golden, Listed, letters
from support.product import FAMILIES, Command, Family, Frame, Scope
from support.product import OFF as PRODUCT_OFF

FAMILIES_OF = {
    "000": ("soldering",),
    "001": ("jtse",),
    "002": ("dde", "nae", "dme", "hde", "ucr", "ale"),
    "004": ("ucr",),
}

every = each_row((f"{golden.where} {golden.text}", (golden,)) for golden in FRAMES)
every_field = each_row(
    (f"{field.where} {field.text.decode('ascii')}", (field,)) for field in FIELDS
)
every_listed = each_row(
    (f"{listed.where} {listed.command} {listed.printed}", (listed,)) for listed in LISTED
)


def _families(manual: str) -> list[Family]:
    return [FAMILIES[name] for name in FAMILIES_OF[manual]]


def _commands(one: Golden | Listed) -> list[Command]:
    found = [
        family.commands[one.command]
        for family in _families(one.where[:3])
        if one.command in family.commands
    ]
    assert found, f"no family of manual {one.where[:3]} has {one.command}"
    return found


def _meaning(value: object) -> object:
    return PRODUCT_OFF if value is OFF else value


def _access(header: str, command: Command) -> bool:
    return {"R": command.readable, "W": command.writable, "A": True}[header]


@every
def test_it_is_written(golden: Golden) -> None:
    header, text = golden.text[0], golden.text[1:]
    pair = (0, 1) if header in "RW" else (1, 0)
    assert Frame(header, text).encode() == golden.bare
    assert Frame(header, text, *pair).encode() == golden.addressed


@every
def test_the_tables_know_it(golden: Golden) -> None:
    for command in _commands(golden):
        assert golden.text[1:].startswith(command.code(golden.port, golden.tool))
        assert _access(golden.text[0], command)


@every
def test_its_value_has_its_type(golden: Golden) -> None:
    for command in _commands(golden):
        data = golden.text[1 + len(command.code(golden.port, golden.tool)) :]
        if golden.value is None:
            assert data in ("", "00000")  # a question, an acknowledgement, an order
            continue
        value = command.quantity.decode(data)
        assert value == _meaning(golden.value)
        assert type(value) is type(_meaning(golden.value))
        if not golden.written_otherwise:
            assert command.quantity.encode(value) == data


@every
def test_what_is_printed_for_writing_is_within_the_limits(golden: Golden) -> None:
    for command in _commands(golden):
        if golden.text[0] == "W" and golden.value is not None:
            assert command.limits.problem(_meaning(golden.value)) is None  # type: ignore[arg-type]  # a value of ours


@every_listed
def test_a_listed_number_means_what_is_printed(listed: Listed) -> None:
    for command in _commands(listed):
        data = listed.data.decode("ascii")
        assert command.quantity.decode(data) == listed.value
        if not listed.written_otherwise:
            assert command.quantity.encode(listed.value) == data  # type: ignore[arg-type]  # a value of ours


@every_listed
def test_a_listed_number_has_a_name(listed: Listed) -> None:
    """A tool and an error that are printed must not come out as unknown."""
    assert not all("unknown" in name or "tool_" in name for name in _names(listed))


def _names(listed: Listed) -> Iterator[str]:
    """What the families of this manual call it; manual 002 lists tools that its UCR has not (manual
    004).
    """
    assert isinstance(listed.value, int | str | tuple)
    for family in _families(listed.where[:3]):
        if isinstance(listed.value, int) and listed.command == "tool":
            yield family.tool_name(listed.value)
        elif isinstance(listed.value, int) and listed.command in ("port_error", "station_error"):
            yield getattr(family, f"{listed.command}s").text(listed.value)
        else:
            yield "a value"


@every_field
def test_every_field_that_is_printed_is_in_the_tables(field: Field) -> None:
    text = field.text.decode("ascii")
    found = [
        command
        for family in _families(field.where[:3])
        for command in family.commands.values()
        if text[1:] in _codes(command)
    ]
    assert found
    assert all(_access(text[0], command) for command in found)


def _codes(command: Command) -> set[str]:
    """All codes of a command on the ports and tools that the examples use."""
    if command.scope is Scope.STATION:
        return {command.code()}
    return {command.code(port, tool) for port in (1, 3) for tool in (1, 2)}


@pytest.mark.parametrize("name", letters.FAMILIES)
def test_the_tables_have_the_letters_of_the_manuals_and_no_others(name: str) -> None:
    assert dict(_product_codes(FAMILIES[name])) == letters.codes_of(name)


def _product_codes(family: Family) -> Iterator[tuple[str, str]]:
    for command in family.commands.values():
        bare = command.access == "w" and command.limits.low == command.limits.high == 0
        access = "W0" if bare else command.access.upper()
        if command.scope is Scope.STATION:
            yield command.code(), access
        elif command.scope is Scope.PORT:
            yield from ((command.code(port), access) for port in range(1, 5))
        else:
            yield from (
                (command.code(port, tool), access) for port in range(1, 5) for tool in range(1, 10)
            )
