"""Find commands by name, suggest similar names, and list them by family."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from typing import NamedTuple

from jbclog.core.errors import UsageError
from jbclog.core.quantities import OFF
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import FAMILIES, Family
from jbclog.protocol.commands.omega import StoredCondition
from jbclog.protocol.commands.ranges import allowed
from jbclog.session.manual.value_text import words_for

CommandFilter = Callable[[Command], bool]
"""Selects commands: `readable` or `writable`."""

MOST_NEAR = 3


def readable(command: Command) -> bool:
    return command.readable


def writable(command: Command) -> bool:
    return command.writable


def is_order(command: Command) -> bool:
    """Return True if the command has no value: a restart, a start of the feeder."""
    return not command.readable and command.limits.low == command.limits.high == 0


def find(name: str, family: Family | None, kind: CommandFilter) -> Command:
    """Return the command of that name; if the family is unknown, that of any family.

    Raises `UsageError` with similar names, or if the command cannot be read or written, whichever
    was asked.
    """
    commands = family.commands if family is not None else anywhere()
    command = commands.get(name) or commands.get(_normal(name))
    of = f"a station of family {family.name}" if family is not None else "no station"
    if command is None:
        raise UsageError(_unknown(name, of, [one.name for one in commands.values() if kind(one)]))
    if not kind(command):
        other = "written" if kind is readable else "read"
        verb = "write" if kind is readable else "read"
        raise UsageError(f"{command.name} can only be {other}: `jbclog {verb}` does that")
    return command


def _normal(name: str) -> str:
    """Normalize a name: the tables' spelling, "Tip temperature" and tip-temperature are all
    accepted.
    """
    return name.strip().lower().replace("-", "_").replace(" ", "_")


def _unknown(name: str, of: str, names: list[str]) -> str:
    typed = _normal(name)[:64]
    near = (
        difflib.get_close_matches(typed, names, n=MOST_NEAR)
        or [one for one in names if typed and typed in one][:MOST_NEAR]
    )
    has = f"{of} knows {name!r}" if of == "no station" else f"{of} has no {name!r}"
    meant = f"; did you mean {', '.join(near)}?" if near else "."
    return f"{has}{meant} Omit the name to list all"


def anywhere() -> Mapping[str, Command]:
    """Return every command of every family by name; the first family's if several have it."""
    found: dict[str, Command] = {}
    for family in FAMILIES.values():
        for command in family.commands.values():
            found.setdefault(command.name, command)
    return found


class NameEntry(NamedTuple):
    """A row of the list of names."""

    name: str
    uom: str
    values: str
    scope: str
    manual: str
    remark: str


def entries(family: Family, kind: CommandFilter) -> list[NameEntry]:
    """List everything to read from or write to a station of this family, in table order."""
    listed = []
    for command in filter(kind, family.commands.values()):
        values = values_text(command, family) if command.writable else ""
        remark = why_only_by_name(command)
        if kind is writable:
            remark = "dangerous" if command.dangerous else ""
        listed.append(
            NameEntry(
                command.name, command.unit, values, str(command.scope.value), command.manual, remark
            )
        )
    return listed


def values_text(command: Command, family: Family) -> str:
    """Describe the values that may be written: ``0 to 9 min, in steps of 1, or off``, or the words;
    if only the station knows the limits, the commands that read them.
    """
    if is_order(command):
        return "no value"
    if isinstance(command.quantity, StoredCondition):
        return "a condition, as `jbclog read` shows one"
    words = [word for word, value in words_for(command, family).items() if value is not OFF]
    if command.within is not None:
        lowest, highest = command.within
        steps = f"steps of {command.limits.step:g} {command.unit} " if command.limits.step else ""
        return f"{steps}up to {highest}" if lowest is None else f"{steps}from {lowest} to {highest}"
    return ", ".join(words) or allowed(command).replace('"off"', "off")  # quotes are for files


def why_only_by_name(command: Command) -> str:
    """Return why `read` without a name leaves this out; empty if it does not."""
    if command.sent_once:
        return "reading clears it"
    return "needs --condition" if command.scope is Scope.CONDITION else ""


def shared(kind: CommandFilter) -> list[tuple[tuple[str, ...], tuple[str, ...]]]:
    """List names with the families that have them, the most common first, for `--help`."""
    by_families: dict[tuple[str, ...], list[str]] = {}
    for name in anywhere():
        having = tuple(
            family.name
            for family in FAMILIES.values()
            if name in family.commands and kind(family.commands[name])
        )
        if having:
            by_families.setdefault(having, []).append(name)
    return sorted(
        ((families, tuple(names)) for families, names in by_families.items()),
        key=lambda one: -len(one[0]),
    )
