"""Values that were read or written, as lines for people and as JSON."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, is_dataclass

from jbclog.core.quantities import OFF, Value
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import Family
from jbclog.session.manual.contact import Contact, Place
from jbclog.session.manual.names import Entry, Kind, entries
from jbclog.session.manual.read import Reading
from jbclog.session.manual.values import shown


def plain(value: Value | None, command: Command, family: Family) -> object:
    """The value as JSON has it: a number in the command's unit, or words."""
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if value is OFF or isinstance(value, tuple):
        return shown(value, command, family)
    return value


def reading_facts(contact: Contact, reading: Reading, time: str) -> dict[str, object]:
    """One reading as JSON; `value` is null where it was not read, and `reason` says why."""
    command, place, value = reading.command, reading.place, reading.value
    facts: dict[str, object] = {"station": contact.name, "command": command.name, **place_facts(place)}
    facts |= {
        "value": plain(value, command, contact.family),
        "unit": command.unit,
        "text": None if value is None else shown(value, command, contact.family),
        "raw": reading.data,
        "manual": command.manual,
        "time": time,
    }
    return facts if value is not None else facts | {"reason": reading.reason, "problem": reading.problem}


def place_facts(place: Place) -> dict[str, object]:
    facts: dict[str, object] = {"port": place.port, "tool": place.tool}
    return facts if place.condition is None else facts | {"condition": place.condition}


def table(rows: Iterable[tuple[str, ...]]) -> list[str]:
    """Columns one under the other, two blanks between them."""
    lines = list(rows)
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines]


def list_lines(family: Family, kind: Kind) -> list[str]:
    """The names of a family with unit, what may be written, where they belong, and the manual."""
    return table(
        (entry.name, entry.unit or "-", entry.scope, "; ".join(filter(None, (entry.values, entry.remark))) or "-", entry.manual)
        for entry in entries(family, kind)
    )


def list_facts(name: str, family: Family, kind: Kind) -> dict[str, object]:
    """The same as JSON."""
    return {"station": name, "family": family.name, "names": [_entry_facts(entry) for entry in entries(family, kind)]}


def _entry_facts(entry: Entry) -> dict[str, object]:
    return dict(entry._asdict())
