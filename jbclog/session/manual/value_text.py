"""Convert values between text for people and the commands' types."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import fields

from jbclog.core.errors import UsageError
from jbclog.core.quantities import OFF, AlarmLimit, Choice, DigitWord, Value, text_of
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.omega import (
    CLEANING,
    SET_TEMPERATURE,
    Cleaning,
    ConditionRecord,
    SetTemperature,
    StoredCondition,
    StoredRecord,
)
from jbclog.protocol.commands.ranges import NO_COUNTDOWN, allowed, range_problem

# An OMEGA solder condition as text: `read` shows it, `write` takes it back with changed numbers.
_PART = re.compile(r"\s*([a-z0-9_]+)[\s=]+(\d+(?:\.\d+)?)\s*", re.ASCII)


def condition_in(text: str, command: Command) -> StoredRecord:
    """Parse ``condition 101: mode 0, rise_s 3.5, ...`` with every field. Raises `UsageError` naming
    missing and unknown fields.
    """
    given = dict(_part(part, command) for part in re.split(r"[:,;]", text.strip()) if part.strip())
    kind = _kind(given)
    names = [one.name for one in fields(kind)]
    optional = {"mode"} if kind is not ConditionRecord else set()
    missing = [name for name in names if name not in given and name not in optional]
    foreign = [name for name in given if name not in names]
    if missing or foreign:
        parts = [
            f"{word} {', '.join(found)}"
            for word, found in (("missing:", missing), ("not known:", foreign))
            if found
        ]
        raise UsageError(
            f"{command.name}: {'; '.join(parts)}. `jbclog read` shows a condition in the form"
            " accepted here"
        )
    return _checked(kind, given, command)


def _part(part: str, command: Command) -> tuple[str, float]:
    found = _PART.fullmatch(part)
    if found is None:
        raise UsageError(
            f"{command.name}: must be names with numbers, such as rise_s 3.5 (got {part.strip()!r})"
        )
    return found[1], float(found[2])


def _kind(given: dict[str, float]) -> type[Cleaning] | type[SetTemperature] | type[ConditionRecord]:
    if given.get("condition") == CLEANING:
        return Cleaning
    return SetTemperature if given.get("mode") == SET_TEMPERATURE else ConditionRecord


def _checked(
    kind: type[Cleaning] | type[SetTemperature] | type[ConditionRecord],
    given: dict[str, float],
    command: Command,
) -> StoredRecord:
    """Return the condition in the form the controller reports it."""
    whole = {one.name for one in fields(kind) if one.type == "int"}
    broken = [name for name in whole if not given.get(name, 0.0).is_integer()]
    if broken:
        raise UsageError(f"{command.name}: {broken[0]} must be a whole number")
    values = {name: int(value) if name in whole else value for name, value in given.items()}
    try:
        record = kind(**values)  # type: ignore[arg-type]  # all numbers
        found = command.quantity.decode(command.quantity.encode(record))
    except ValueError as error:
        raise UsageError(f"{command.name}: {error}") from error
    assert isinstance(found, StoredRecord)
    return found


_NUMBER = re.compile(r"[+-]?(\d+)(\.\d+)?", re.ASCII)
NOT_COUNTED = ("count", "")  # units that are not shown
SUCTION = "suction"
MOST_SHOWN = 40  # characters of an invalid text in messages


def words_for(command: Command, family: Family) -> dict[str, Value]:
    """Return the words allowed in place of a number: a mode's names, the states of a tool, off."""
    quantity = command.quantity
    if isinstance(quantity, Choice):
        return {name: name for name in quantity.names}
    if isinstance(quantity, DigitWord):
        orders = family.status.orders
        names = [
            name
            for name in dict.fromkeys((*family.run_statuses, *family.safe_states))
            if name in orders
        ]
        return {name: orders[name] for name in names} | _words_with_suction(family, names)
    return {"off": OFF} if command.limits.off else {}


def _words_with_suction(family: Family, names: Iterable[str]) -> dict[str, Value]:
    """Return ``on+suction`` and ``on-suction`` if the status also orders suction; the bare word
    leaves it unchanged.
    """
    status = family.status
    signs = {"+": True, "-": False} if status.has_suction else {}
    words = {f"{name}{sign}{SUCTION}": (name, on) for name in names for sign, on in signs.items()}
    return {
        word: status.with_suction(status.orders[name], on=on) for word, (name, on) in words.items()
    }


def names_suction(text: str | None) -> bool:
    """Return True if a word for a status includes suction."""
    return text is not None and text.strip().lower().endswith(SUCTION)


def value_in(text: str, command: Command, family: Family) -> Value:
    """Parse the value in the form the station reports it. Raises `UsageError` with what is
    allowed.
    """
    if isinstance(command.quantity, StoredCondition):
        return condition_in(text, command)
    words = words_for(command, family)
    value: Value | None = words.get(text.strip().lower())
    if value is None:
        value = _number(text, command, words)
    problem = range_problem(command, value)
    if problem is not None:
        raise UsageError(f"{command.name}: {problem}")
    return command.quantity.decode(command.quantity.encode(value))


def _number(text: str, command: Command, words: Mapping[str, Value]) -> Value:
    """Parse a number; rejects one for a command that only takes words."""
    found = _NUMBER.fullmatch(text.strip())
    if found is None or isinstance(command.quantity, Choice | DigitWord):
        raise UsageError(_no_value(text, command, words))
    number = float(text)
    return int(number) if number.is_integer() else number


def _no_value(text: str, command: Command, words: Mapping[str, Value]) -> str:
    shown = text if len(text) <= MOST_SHOWN else text[:MOST_SHOWN] + "..."
    if isinstance(command.quantity, Choice | DigitWord):
        return f"{command.name}: must be one of {', '.join(words)} (got {shown!r})"
    if isinstance(command.quantity, AlarmLimit) and text == "off":
        return (
            f"{command.name}: no manual prints how to clear a limit; switch its delay off instead"
        )
    hint = "; write the decimal point as a dot" if re.fullmatch(r"[+-]?\d+,\d+", shown) else ""
    return (
        f"{command.name}: {shown!r} is not a number{' or off' if words else ''};"
        f" {allowed(command)}{hint}"
    )


def shown(value: Value, command: Command, family: Family) -> str:
    """Format the value with its unit or meaning: ``348 °C``, ``stand``, ``4: no tool``, ``off``."""
    if isinstance(value, tuple):
        return _word(value, command, family)
    if isinstance(value, int) and (meaning := _meaning(value, command, family)) is not None:
        return f"{value}: {meaning}"
    if value is OFF and isinstance(command.quantity, AlarmLimit):
        return "not set"  # docs/reference/contradictions.md, B-23
    if command is family.command_of("delay_s") and value in NO_COUNTDOWN:
        return f"not counting ({value})"
    if value is OFF or command.unit in NOT_COUNTED:
        return text_of(value)
    return command.shown(value)


def _word(word: tuple[int, ...], command: Command, family: Family) -> str:
    if command is family.command_of("status"):
        has_word = family.status.has_suction
        # digits without words
        other = f" ({text_of(word)})" if any(word[: 2 if has_word else 3]) else ""
        return family.status.shown(word) + other
    if command is family.command_of("alarm_high"):
        return (
            " and ".join(name for name, digit in (("high", word[4]), ("low", word[3])) if digit)
            or "none"
        )
    return text_of(word)


def _meaning(value: int, command: Command, family: Family) -> str | None:
    """Return the meaning of a number from the family's tables."""
    if command is family.command_of("tool"):
        return family.tool_name(value)
    if command is family.command_of("port_error"):
        return family.port_errors.text(value)
    if command is family.command_of("station_error"):
        return family.station_errors.text(value)
    return None
