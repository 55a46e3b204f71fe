"""One of OMEGA's solder conditions as text: what `read` shows of one, `write` takes, with other numbers in it."""

from __future__ import annotations

import re
from dataclasses import fields

from jbclog.core.errors import UsageError
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.omega_values import CLEANING, SET_TEMPERATURE, Cleaning, ConditionRecord, SetTemperature, Stored

_PART = re.compile(r"\s*([a-z0-9_]+)[\s=]+(\d+(?:\.\d+)?)\s*", re.ASCII)


def condition_in(text: str, command: Command) -> Stored:
    """``condition 101: mode 0, rise_s 3.5, ...`` with every field. Raises `UsageError` naming what is missing or foreign."""
    given = dict(_part(part, command) for part in re.split(r"[:,;]", text.strip()) if part.strip())
    kind = _kind(given)
    names = [one.name for one in fields(kind)]
    optional = {"mode"} if kind is not ConditionRecord else set()
    missing = [name for name in names if name not in given and name not in optional]
    foreign = [name for name in given if name not in names]
    if missing or foreign:
        parts = [f"{word} {', '.join(found)}" for word, found in (("missing:", missing), ("not known:", foreign)) if found]
        raise UsageError(f"{command.name}: {'; '.join(parts)}. `jbclog read` shows a condition in the form that is taken here")
    return _checked(kind, given, command)


def _part(part: str, command: Command) -> tuple[str, float]:
    found = _PART.fullmatch(part)
    if found is None:
        raise UsageError(f"{command.name}: {part.strip()!r} is no name with a number, such as rise_s 3.5")
    return found[1], float(found[2])


def _kind(given: dict[str, float]) -> type[Cleaning] | type[SetTemperature] | type[ConditionRecord]:
    if given.get("condition") == CLEANING:
        return Cleaning
    return SetTemperature if given.get("mode") == SET_TEMPERATURE else ConditionRecord


def _checked(
    kind: type[Cleaning] | type[SetTemperature] | type[ConditionRecord], given: dict[str, float], command: Command
) -> Stored:
    """The condition, as the controller will tell it back."""
    whole = {one.name for one in fields(kind) if one.type == "int"}
    broken = [name for name in whole if not given.get(name, 0.0).is_integer()]
    if broken:
        raise UsageError(f"{command.name}: {broken[0]} is a whole number")
    values = {name: int(value) if name in whole else value for name, value in given.items()}
    try:
        record = kind(**values)  # type: ignore[arg-type]  # numbers all
        found = command.quantity.decode(command.quantity.encode(record))
    except ValueError as error:
        raise UsageError(f"{command.name}: {error}") from error
    assert isinstance(found, Stored)
    return found
