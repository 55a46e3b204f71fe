"""Every command of every family is reached by its name through what `read` and `write` do. No list
of exceptions.

A family that joins `FAMILIES` is walked like the others, against its own virtual station.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from support.campaigns.each_row import each_row
from support.product import (
    COMMAND_OF,
    FAMILIES,
    WHOLE_STATION,
    Command,
    Contact,
    Effect,
    Family,
    Place,
    ReadResult,
    Scope,
    Snapshot,
    WriteOutcome,
    WriteRequest,
    WriteResult,
    ask_station,
    check_place,
    find_command,
    is_order,
    only_by_name,
    patch,
    read_all,
    read_value,
    readable_commands,
    shared_commands,
    shown_value,
    value_in,
    values_text,
    what_it_does,
    words_for,
    writable_commands,
    write_value,
)
from support.virtual.manual import Bench, station_text

EVERY = [(family, command) for family in FAMILIES.values() for command in family.commands.values()]


def _walk(
    *chosen: tuple[Family, Command],
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    return each_row(
        (f"{family.name}-{command.name}", (family, command)) for family, command in chosen
    )


Make = Callable[[Family], Bench]


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Makes a station of a family on a wire without time, its tools cold; it has been on a
    while.
    """
    patch(monkeypatch, "connection.run_that_holds", lambda url: None)
    return lambda family: Bench(tmp_path, station_text("it", family.name, sim="wire = false"))


def place_of(command: Command) -> Place:
    return Place(condition=101) if command.scope is Scope.CONDITION else WHOLE_STATION


def readings(
    bench: Bench, name: str, place: Place = WHOLE_STATION
) -> list[tuple[Contact, ReadResult]]:
    found: list[tuple[Contact, ReadResult]] = []
    target = bench.target("it")
    ask_station(
        target,
        read_value(target, name, place, lambda contact, reading: found.append((contact, reading))),
        bench.access,
    )
    return found


@_walk(*((family, command) for family, command in EVERY if command.readable))
def test_it_is_read_by_name_at_every_place(family: Family, command: Command, make: Make) -> None:
    bench = make(family)
    found = readings(bench, command.name, place_of(command))
    ports = 1
    if command.scope in (Scope.PORT, Scope.TOOL):
        ports = len(getattr(bench.wires["it"].station, "device").face.ports)  # noqa: B009
    assert len(found) == ports
    for contact, reading in found:
        assert reading.value is not None, reading.problem
        assert reading.data
        text = shown_value(reading.value, command, contact.family)
        assert text.strip() == text != ""
        assert (
            not command.unit
            or command.unit in (*text.split(), "count")
            or text == "off"
            or "not " in text
        )
    assert bench.wires["it"].writes == []


@pytest.mark.parametrize("family", FAMILIES.values(), ids=lambda family: family.name)
def test_all_of_it_is_read_at_once_but_what_that_would_clear(family: Family, make: Make) -> None:
    found: list[ReadResult] = []
    bench = make(family)
    target = bench.target("it")
    ask_station(
        target, read_all(target, lambda contact, reading: found.append(reading)), bench.access
    )
    assert [reading.problem for reading in found if reading.value is None] == []
    left_out = {command.name for command in only_by_name(family)}
    assert {reading.command.name for reading in found} | left_out == {
        c.name for c in family.commands.values() if c.readable
    }
    assert not [text for text in bench.wires["it"].texts if text.startswith("RTA")]  # alarm flags
    assert bench.wires["it"].writes == []


@_walk(*((family, command) for family, command in EVERY if command.writable))
def test_it_is_written_by_name_once_and_read_back(
    family: Family, command: Command, make: Make
) -> None:
    bench = make(family)
    text = new_value(bench, family, command)
    port = None if command.scope is Scope.STATION else 1
    kept: list[Snapshot] = []
    target, written = bench.target("it"), WriteResult()
    before = len(bench.wires["it"].writes)
    change = WriteRequest(command.name, text, Place(port))
    ask_station(
        target, write_value(target, change, kept.append, written), bench.access, may_write=True
    )
    assert written.outcome in (WriteOutcome.CONFIRMED, WriteOutcome.SENT), written.problem
    sent = bench.wires["it"].writes[before:]
    assert len(sent) == 1
    assert sent[0].removeprefix("W" if family.models else "").startswith(command.letters)
    assert bool(kept) == command.dangerous
    if (
        written.outcome == WriteOutcome.CONFIRMED
        and written.readback is not None
        and command.readable
        and command.name != "status"
    ):
        assert written.readback == written.value != written.before


def new_value(bench: Bench, family: Family, command: Command) -> str | None:
    """A text that the command takes, for another value than the one that the station has."""
    if is_order(command):
        return None
    if command.scope is Scope.STATION and not command.readable:
        return _for_its_own_kind(bench, command)
    (_, reading), *_ = readings(bench, command.name)
    words = [word for word, value in words_for(command, family).items() if value != reading.value]
    if words:
        return words[0]
    if not isinstance(reading.value, int | float):  # off, or not set
        return f"{command.limits.high or 300:g}"
    step = -5 if command.name.startswith("maximum") else command.limits.step or 5
    return f"{reading.value + step:g}"


def _for_its_own_kind(bench: Bench, command: Command) -> str:
    if command.name == "store_condition":
        ((_, reading),) = readings(bench, "condition", Place(condition=101))
        return re.sub(r"preheat_s [0-9.]+", "preheat_s 1.2", str(reading.value))
    return "101" if command.name == "run_condition" else "7"


# -- names -----------------------------------------------------------------------------------------


@_walk(*EVERY)
def test_its_name_is_found_and_its_values_are_told(family: Family, command: Command) -> None:
    for kind in (readable_commands, writable_commands):
        if kind(command):
            assert find_command(command.name, family, kind) is command
            assert find_command(command.name.replace("_", " ").upper(), family, kind) is command
            assert command.name in [
                name
                for families, names in shared_commands(kind)
                if family.name in families
                for name in names
            ]
    if command.writable:
        assert values_text(command, family)
        for word in words_for(command, family):
            assert value_in(word, command, family) == words_for(command, family)[word]
    check_place(command, family, family.ports, place_of(command))


@_walk(*((family, command) for family, command in EVERY if command.dangerous))
def test_what_is_dangerous_says_what_it_does(family: Family, command: Command) -> None:
    assert command.writable
    assert len(what_it_does(command)) > len(Effect.MOVES.value)


def test_what_cannot_be_taken_back_is_dangerous_everywhere() -> None:
    # docs/reference/faults.md, S-5, and the limits of manual 001
    letters = {"RST", "RSP", "SAD", "NVS", "IFE", "MAT", "MIT", "STR", "MAF", "MIF", "MAE", "MIE"}
    found = {
        (family.name, command.letters)
        for family, command in EVERY
        if command.writable and command.letters in letters
    }
    assert found == {
        (family.name, command.letters)
        for family, command in EVERY
        if command.dangerous and len(command.letters) == 3
    }
    assert {
        command.letters for command in FAMILIES["omega"].commands.values() if command.dangerous
    } == {"D", "H"}


@pytest.mark.parametrize("family", FAMILIES.values(), ids=lambda family: family.name)
def test_nothing_dangerous_is_reached_from_a_recipe(family: Family) -> None:
    """Settings by the table of keys, tools by their status, the feeder to be stopped: a recipe and
    a run write nothing else.
    """
    reached = {*COMMAND_OF.values(), "status", "stop_feeding"}
    assert [
        command.name
        for command in family.commands.values()
        if command.name in reached and command.dangerous
    ] == []


def test_what_is_called_a_restart_resets_the_settings_of_hot_air() -> None:
    """Manual 001, 4.8: "Write reset station settings" (docs/reference/contradictions.md, B-40)."""
    assert "reset station settings" in what_it_does(FAMILIES["jtse"].commands["restart"])
    assert "reset station settings" not in what_it_does(FAMILIES["dde"].commands["restart"])
