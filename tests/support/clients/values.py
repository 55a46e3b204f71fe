"""Every code of a family, what can stand on the wire behind it and what can be written: for walks
over every command.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

from support.product import (
    HIGHEST_C,
    OFF,
    OFF_ON_WIRE,
    AlarmDelay,
    AlarmLimit,
    Command,
    Family,
    Flags,
    HexLength,
    Number,
    Quantity,
    Scope,
    Text,
    Value,
)

NAMES = ("  DDE", "  DDR", " JTSE", "UCR245", "UCR470", "UCR24", "1.00a")
LONG_HEX = ("186A0", "FFFFF", "100000", "FFFFFFFF")
RECORDS = (
    "00650" + 15 * "023",
    "018F4" + 5 * "00001EFFF",
    "0191500A00B",
    "00C95FFFFFF",
    "0000000",
    "0000FFF",
)
"""Solder conditions: modes 0, 4 and 5, and the cleaning."""


def every_text() -> Iterator[str]:
    """Every data field of five characters that a manual lets one expect, every ss.cc, and some that
    are longer.
    """
    numbers = (f"{number:05d}" for number in range(100_000))
    negative = (f"-{number:04d}" for number in range(10_000))
    delays = (f"{number // 100:02d}.{number % 100:02d}" for number in range(10_000))
    digits = (f"{number:X}" for number in range(16))
    conditions = (f"{number:04X}" for number in range(512))
    return chain(numbers, negative, delays, NAMES, LONG_HEX, digits, conditions, RECORDS)


def meant(quantity: Quantity, text: str) -> Value | None:
    """What the text means, None where it means nothing."""
    try:
        return quantity.decode(text)
    except ValueError:
        return None


def as_written(quantity: Quantity, text: str) -> str | None:
    """How what `text` means is written: the same, but for the few that are read for tolerance'
    sake. None: no manual says.
    """
    match quantity:
        case AlarmLimit() if quantity.decode(text) is OFF or text.startswith("-"):
            return None  # "not set" has no printed form (docs/reference/contradictions.md, B-23)
        case AlarmDelay() if "." not in text and text != OFF_ON_WIRE:
            # digits without a dot (docs/reference/contradictions.md, B-22)
            return f"{text[1:3]}.{text[3:]}"
        case Flags():
            # any digit but 0 is a flag (docs/reference/contradictions.md, B-24)
            return "".join("0" if digit == "0" else "1" for digit in text)
        case Number(printed_for=misprints) if text.isdigit():
            # docs/reference/contradictions.md, B-28
            return f"{dict(misprints).get(int(text), int(text)):05d}"
        case Text():
            return text.rjust(5)
        case HexLength():
            return text.lstrip("0").zfill(5)
    return {"-0000": "00000"}.get(text, text)


def values_to_write(family: Family, command: Command, held: Value | None = None) -> list[Value]:
    """The borders of what may be written, and what lies a step beside `held`."""
    names = getattr(command.quantity, "names", None)
    if names is not None:
        return list(names)
    if command.name == "status":
        return list(family.status.orders.values())
    numbers = [
        value
        for value in dict.fromkeys(_numbers(command, held))
        if command.limits.problem(value) is None
    ]
    return numbers or [
        value for text in RECORDS if (value := meant(command.quantity, text)) is not None
    ]


def _numbers(command: Command, held: Value | None) -> Iterator[Value]:
    if isinstance(command.quantity, AlarmLimit):
        yield from (5, 300, HIGHEST_C)  # beyond these it would be read back as not set
    limits, step = command.limits, command.limits.step or resolution(command.quantity)
    for number in (limits.low, limits.high):
        if number is not None:
            yield as_held(command, number)
    if limits.off:
        yield OFF
    if limits.low is not None and limits.high is None:
        yield as_held(command, limits.low + step)
    if isinstance(held, int | float):
        yield from (as_held(command, held + step), as_held(command, held - step), held)


def resolution(quantity: Quantity) -> float:
    """The least step that the wire can carry."""
    less, more = (meant(quantity, text) for text in ("00001", "00002"))
    return more - less if isinstance(less, int | float) and isinstance(more, int | float) else 0.01


def as_held(command: Command, number: float) -> Value:
    """The number as it will be read back."""
    whole = round(number)
    return command.quantity.decode(
        command.quantity.encode(whole if whole == number else round(number, 3))
    )


PORTS = (1, 2, 3, 4)
TOOLS = range(1, 10)
CONDITIONS = (0, *range(101, 200), *range(201, 300), *range(301, 400))


def codes_of(command: Command, ports: tuple[int, ...] = PORTS) -> Iterator[str]:
    """The control commands on the wire: ``SMN``, ``TT1``…``TT4``, ``A11``…``A49``."""
    if command.scope is Scope.STATION:
        yield command.code()
    elif command.scope is Scope.CONDITION:
        yield from (command.numbered(number).code() for number in CONDITIONS)
    elif command.scope is Scope.PORT:
        yield from (command.code(port) for port in ports)
    else:
        yield from (command.code(port, tool) for port in ports for tool in TOOLS)


def codes(family: Family) -> dict[str, Command]:
    """Every code of a family with its command."""
    ports = family.ports or PORTS
    return {
        code: command for command in family.commands.values() for code in codes_of(command, ports)
    }
