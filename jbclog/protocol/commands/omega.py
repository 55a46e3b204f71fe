"""Apollo Seiko OMEGA: its commands, and the values in its answers.

Manual 003 has the frame, the sum and A. Sections 11.3.2 to 11.3.13 are cited from the public copy
of the same manual, pages 5 to 10 (docs/reference/manuals.md). It draws the digit of "a"; the page
of manual 003 does not, so a controller that answers A with "a" and nothing else is driven too.

OMEGA reports no temperature, no model and no error number, and refuses by silence.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Final

from jbclog.core.quantities import CompoundValue, Quantity, Value
from jbclog.protocol.commands.command import Command, Effect, Limits, Scope
from jbclog.protocol.commands.error_tables import ErrorTable
from jbclog.protocol.commands.signals import ReadInterval, Signal

# A condition is stored in the controller under its number and describes one joint: rise, three
# feeds of solder wire, each with a way back, and the times between them. On the serial line
# (docs/reference/protocol.md, Condition record; 003 11.3.6)::
#
#     0065  0  023  01E 032 005 032  00A  014 ...
#     │     │  │    └─ fourteen more fields of three hexadecimal digits, each ten times the value
#     │     │  └────── 3.5 s: rise
#     │     └───────── mode, one digit
#     └─────────────── the number, 101, in four hexadecimal digits

MODES: Final = (
    "special point",
    "special slide",
    "special point without iron up",
    "special easy slide",
    "pre-solder",
    "set temperature",
)
SET_TEMPERATURE: Final = 5
CLEANING: Final = 0
HUNDREDS: Final = (1, 2, 3)
CONDITIONS: Final = "101 to 199, 201 to 299 or 301 to 399"
# seconds stand in the manual's examples; mm and mm/s are assumed: it names no unit of its feeds
UNITS: Final = (("_mm_s", "mm/s"), ("_mm", "mm"), ("_s", "s"))
MOST: Final = 0xFFF
WITHOUT_DIGIT: Final = "answered without a digit"


@dataclass(frozen=True, slots=True)
class Digit:
    """One digit that stands for a word. `may_lack`: an answer without it is accepted as
    `WITHOUT_DIGIT`.
    """

    names: tuple[str, ...]
    unit: str = ""
    may_lack: bool = False

    def decode(self, data: str) -> str:
        if self.may_lack and not data:
            return WITHOUT_DIGIT
        if len(data) != 1 or data not in "0123456789"[: len(self.names)]:
            raise ValueError(f"{data!r} is no digit from 0 to {len(self.names) - 1}")
        return self.names[int(data)]

    def encode(self, value: Value) -> str:
        if not isinstance(value, str) or value not in self.names:
            raise ValueError(f"{value!r} is none of {', '.join(self.names)}")
        return str(self.names.index(value))


def is_condition(number: int) -> bool:
    """Return True if a solder condition can have this number; 0, the cleaning, is excluded."""
    return number // 100 in HUNDREDS and number % 100 != 0


@dataclass(frozen=True, slots=True)
class ConditionNumber:
    """The number of a solder condition, four hexadecimal digits: 101-199, 201-299, 301-399."""

    unit: str = ""

    def decode(self, data: str) -> int:
        number = _hexadecimal(data, 4)
        if not is_condition(number):
            raise ValueError(f"{number} is no number of a solder condition")
        return number

    def encode(self, value: Value) -> str:
        if isinstance(value, bool) or not isinstance(value, int) or not is_condition(value):
            raise ValueError(f"{value!r} is no number of a solder condition; {CONDITIONS}")
        return f"{value:04X}"


class StoredRecord(CompoundValue):
    """The record under one number. Fields whose names end in a unit are sent as tenths of it."""

    __slots__ = ()
    condition: int
    mode: int

    def values(self) -> Iterator[tuple[str, str, str]]:
        """Yield name, unit and value as text of every field but the number."""
        for column in fields(self):  # type: ignore[arg-type]  # each class below is a dataclass
            if column.name != "condition":
                value = getattr(self, column.name)
                text = f"{value:.1f}" if isinstance(value, float) else str(value)
                yield column.name, _unit(column.name), text

    def __str__(self) -> str:
        values = ", ".join(f"{name} {text}" for name, _, text in self.values())
        return f"condition {self.condition}: {values}"


@dataclass(frozen=True, slots=True)
class ConditionRecord(StoredRecord):
    """One joint: modes 0 to 4. The fields have the names of a recipe's `[omega]`."""

    condition: int
    mode: int
    rise_s: float
    feed1_mm: float
    feed1_mm_s: float
    reverse1_mm: float
    reverse1_mm_s: float
    preheat_s: float
    feed2_mm: float
    feed2_mm_s: float
    reverse2_mm: float
    reverse2_mm_s: float
    heating_s: float
    feed3_mm: float
    feed3_mm_s: float
    reverse3_mm: float
    reverse3_mm_s: float


@dataclass(frozen=True, slots=True)
class SetTemperature(StoredRecord):
    """Mode 5 (003 11.3.6, 11.3.7): a set temperature and the "process of set temperature".

    The manual says both that a decimal point is left out and that the value is a tenth of the
    number; a temperature has no point, so its scale is not known and the numbers stay raw
    (docs/reference/contradictions.md, B-51).
    """

    condition: int
    set_temperature_raw: int
    process_raw: int
    mode: int = SET_TEMPERATURE


@dataclass(frozen=True, slots=True)
class Cleaning(StoredRecord):
    """Condition 0: how long air is blown, in s. Its record is drawn without a digit for the mode,
    in c and in D (003 11.3.6, 11.3.7).
    """

    air_blow_s: float
    condition: int = CLEANING
    mode: int = 0


@dataclass(frozen=True, slots=True)
class StoredCondition:
    """The record of C, c and D. When read, condition 0 may have a mode; when written, it has none,
    as the manual draws it.
    """

    unit: str = ""

    def decode(self, data: str) -> StoredRecord:
        number, rest = _hexadecimal(data[:4], 4), data[4:]
        if number == CLEANING:
            return Cleaning(_tenths(_parts(rest[1:] if len(rest) == 4 else rest, 1))[0])
        if not is_condition(number):
            raise ValueError(
                f"{data!r} begins with {number}, which is no number of a solder condition"
            )
        mode = _hexadecimal(rest[:1], 1)
        if mode == SET_TEMPERATURE:
            return SetTemperature(number, *_parts(rest[1:], 2))
        if mode >= len(MODES):
            raise ValueError(f"{data!r} has the mode {mode}, which no document describes")
        return ConditionRecord(number, mode, *_tenths(_parts(rest[1:], FIELDS)))

    def encode(self, value: Value) -> str:
        match value:
            case Cleaning():
                return f"{CLEANING:04X}" + _raw(value.air_blow_s)
            case SetTemperature():
                return _head(value) + _field(value.set_temperature_raw) + _field(value.process_raw)
            case ConditionRecord() if 0 <= value.mode < SET_TEMPERATURE:
                return _head(value) + "".join(
                    _raw(getattr(value, column.name)) for column in fields(value)[2:]
                )
        raise ValueError(f"{value} is no solder condition of a known mode")


FIELDS: Final = len(fields(ConditionRecord)) - 2


def _unit(name: str) -> str:
    return next((unit for ending, unit in UNITS if name.endswith(ending)), "")


def _head(value: StoredRecord) -> str:
    return f"{ConditionNumber().encode(value.condition)}{value.mode:X}"


def _hexadecimal(data: str, digits: int) -> int:
    if len(data) != digits or any(c not in "0123456789ABCDEFabcdef" for c in data):
        raise ValueError(f"{data!r} is not {digits} hexadecimal digits")
    return int(data, 16)


def _parts(data: str, count: int) -> list[int]:
    """Split into exactly `count` fields of three hexadecimal digits."""
    if len(data) != 3 * count:
        raise ValueError(f"{data!r} is not {count} fields of three digits")
    return [_hexadecimal(data[place : place + 3], 3) for place in range(0, len(data), 3)]


def _tenths(raw: list[int]) -> list[float]:
    return [number / 10 for number in raw]


def _raw(value: float) -> str:
    exact = value * 10
    if abs(exact - round(exact)) > 1e-6:
        raise ValueError(f"{value} is not a step of 0.1")
    if not 0 <= exact <= MOST:
        raise ValueError(f"{value} is not within 0 to {MOST / 10}")
    return _field(round(exact))


def _field(raw: int) -> str:
    if not 0 <= raw <= MOST:
        raise ValueError(f"{raw} does not fit in three hexadecimal digits")
    return f"{raw:03X}"


def differing(asked: StoredRecord, found: StoredRecord) -> list[tuple[str, str, str]]:
    """List the differences of two records of one number: the field's name and both values as text;
    only the mode if their kinds differ.
    """
    values = {name: text for name, _, text in found.values()}
    return [
        (name, text, values[name])
        for name, _, text in asked.values()
        if values.get(name, text) != text
    ]


def difference(asked: StoredRecord, found: StoredRecord) -> str:
    """Describe the differences: ``feed1_mm 2.0 instead of 3.0``."""
    return ", ".join(
        f"{name} {there} instead of {wanted}" for name, wanted, there in differing(asked, found)
    )


INFORMATION = Digit(
    ("normal", "solder shortage", "solder clogged", "solder shortage and clogged"), may_lack=True
)
CONTROL = Digit(("ready or normal", "preparing or error"))
AT_TEMPERATURE = Digit(("in range", "out of range"))

TRUE_ANSWERS = MappingProxyType(
    {
        "solder_shortage": frozenset((INFORMATION.names[1], INFORMATION.names[3])),
        "clogged": frozenset(INFORMATION.names[2:]),
        "preparing": frozenset(CONTROL.names[1:]),
        "in_range": frozenset(AT_TEMPERATURE.names[:1]),
    }
)
"""Answers that make a column true."""


def _state(name: str, letters: str, quantity: Quantity, manual: str, note: str = "") -> Command:
    return Command(name, letters, Scope.STATION, quantity, "r", manual, answer_digits=1, note=note)


def _order(
    name: str, letters: str, quantity: Quantity, manual: str, limits: Limits, note: str
) -> Command:
    return Command(
        name,
        letters,
        Scope.STATION,
        quantity,
        "w",
        manual,
        limits,
        Effect.MOVES,
        True,
        0,
        note,
    )


OMEGA = (
    _state(
        "information",
        "A",
        INFORMATION,
        "003 11.3.1, 11.3.2",
        "B-48: printed as 41H(''), and answered by a; its digit is drawn in 11.3.2",
    ),
    _state(
        "temperature_control",
        "B",
        CONTROL,
        "003 11.3.3, 11.3.4",
        "0: the output READY is high; one digit for preparing and for errors",
    ),
    Command(
        "condition",
        "C",
        Scope.CONDITION,
        StoredCondition(),
        "r",
        "003 11.3.5, 11.3.6",
        answer_digits=None,
        note="B-49, B-50, B-51; an unknown number is ignored",
    ),
    _order(
        "store_condition",
        "D",
        StoredCondition(),
        "003 11.3.7, 11.3.8",
        Limits(),
        "B-50, B-52; d only when it was taken; an unknown number or mode, or a field out of its"
        " range (printed nowhere), is ignored",
    ),
    _state(
        "set_temperature_state",
        "F",
        AT_TEMPERATURE,
        "003 11.3.9, 11.3.10",
        "B-55: within the alarm limits, or judged optimal, by a setting that cannot be read",
    ),
    _state("mode", "G", Digit(MODES), "003 11.3.11, 11.3.12", "of the conditions 301 to 399"),
    _order(
        "run_condition",
        "H",
        ConditionNumber(),
        "003 11.3.13",
        Limits(101, 399, 1),
        "B-52; h when a point is done, i after the first stage of a slide, late; an unknown number"
        " is ignored",
    ),
)

OMEGA_SIGNALS = (
    Signal("information", ("solder_shortage", "clogged"), ReadInterval.FAST),
    Signal("temperature_control", ("preparing",), ReadInterval.FAST),
    Signal("set_temperature_state", ("in_range",), ReadInterval.FAST),
)

COMPLETION_MESSAGES = MappingProxyType(
    {"h": "soldering a point is completed", "i": "the first stage of slide soldering is over"}
)
"""Unsolicited messages of the controller, long after H."""

NO_ERRORS = ErrorTable("OMEGA", MappingProxyType({}))
