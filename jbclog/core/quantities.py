"""Values and their five characters on the serial line.

`Quantity.decode` converts the data field to a typed value or raises `ValueError`; `encode` does the
reverse. A value is an `int`, a `float`, a `str`, a tuple of digits, or `OFF` where the manual
prints 99999 for "disabled". An unknown value is `None` with a reason, never one of these.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final, Protocol


class Off(Enum):
    """Value of a disabled delay."""

    OFF = "off"

    def __str__(self) -> str:
        return "off"


OFF: Final = Off.OFF
OFF_ON_WIRE: Final = "99999"
MOST: Final = 99999  # largest number of five digits
# a higher alarm limit means "not set": no station heats above 500 (002, factory)
HIGHEST_C: Final = 600
# a number of a record is finite and at most `LARGEST`: an integer fits 64 bits, survives conversion
# to a float and back, and does not make later arithmetic fail
WHOLE: Final = 1 << 62
LARGEST: Final = float(WHOLE)


class CompoundValue:
    """Base class of values with several fields; `str` formats them for people."""

    __slots__ = ()


Value = int | float | str | Off | tuple[int, ...] | CompoundValue
"""A number, a name, off, the digits of a status word, or several fields."""


class Quantity(Protocol):
    """One kind of value: its unit, decoding and encoding."""

    @property
    def unit(self) -> str: ...

    def decode(self, data: str) -> Value: ...

    def encode(self, value: Value) -> str: ...


def _digits(data: str, minus: str = "-") -> int:
    """Parse a whole number: ASCII digits, sign only in the first place, no blank or underscore."""
    signed = data[:1] != "" and data[0] in minus
    body = data[1:] if signed else data
    if len(data) != 5 or not (body.isascii() and body.isdigit()):
        raise ValueError(f"{data!r} is not five digits")
    return -int(body) if signed else int(body)


def _number(value: Value) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is not a number")
    return value


def _whole(value: Value) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"{value!r} is not a whole number")
    if not -9999 <= value <= MOST:
        raise ValueError(f"{value} does not fit in five characters")
    return value


@dataclass(frozen=True, slots=True)
class Whole:
    """Whole number in `unit`, zero-filled, with the minus in the first place: ``-0050`` (manual
    002, "Frame Fields").

    `minus` lists the characters accepted as a minus; `encode` writes ``-``.
    """

    unit: str
    minus: str = "-"

    def decode(self, data: str) -> int:
        return _digits(data, self.minus)

    def encode(self, value: Value) -> str:
        return f"{_whole(value):05d}"


@dataclass(frozen=True, slots=True)
class Unsigned:
    """Whole number in `unit`, never negative: a count, an hour, a power."""

    unit: str

    def decode(self, data: str) -> int:
        number = _digits(data)
        if data[0] == "-":
            raise ValueError(f"{data!r} is negative")
        return number

    def encode(self, value: Value) -> str:
        if _whole(value) < 0:
            raise ValueError(f"{value} {self.unit}".rstrip() + " is negative")
        return f"{value:05d}"


@dataclass(frozen=True, slots=True)
class Delay:
    """Delay in whole `unit`; 99999 means off (manual 002, W-Dxy and W-Hxy)."""

    unit: str

    def decode(self, data: str) -> int | Off:
        return OFF if data == OFF_ON_WIRE else Unsigned(self.unit).decode(data)

    def encode(self, value: Value) -> str:
        if value is OFF:
            return OFF_ON_WIRE
        digits = Unsigned(self.unit).encode(value)
        if digits == OFF_ON_WIRE:
            raise ValueError(f"{value} {self.unit} would be read as off")
        return digits


@dataclass(frozen=True, slots=True)
class AlarmDelay:
    """Seconds as ``ss.cc``: ``01.60`` is 1.6 s; 99999 means that the alarm is off (manual 002,
    W-HDx).

    Up to 99.99 s, digits without a dot are hundredths (docs/reference/contradictions.md, B-22).
    """

    unit: str = "s"

    def decode(self, data: str) -> float | Off:
        if data == OFF_ON_WIRE:
            return OFF
        digits = data[:2] + data[3:] if data[2:3] == "." else data.removeprefix("0")
        if len(data) != 5 or len(digits) != 4 or not (digits.isascii() and digits.isdigit()):
            raise ValueError(f"{data!r} is not a delay of the form ss.cc")
        return int(digits) / 100

    def encode(self, value: Value) -> str:
        if value is OFF:
            return OFF_ON_WIRE
        seconds = _number(value)
        hundredths = round(seconds * 100)
        if not 0 <= hundredths <= 9999 or abs(hundredths - seconds * 100) > 1e-6:
            raise ValueError(f"{value} s is not within 0.00 to 99.99 s in steps of 0.01")
        return f"{hundredths // 100:02d}.{hundredths % 100:02d}"


@dataclass(frozen=True, slots=True)
class AlarmLimit:
    """Limit in °C. No manual prints a value for "not set": 00000 and unreachable limits decode as
    OFF.

    See docs/reference/contradictions.md, B-23. A value outside the station's own limits is kept:
    only the station knows them.
    """

    unit: str = "°C"

    def decode(self, data: str) -> int | Off:
        number = _digits(data)
        return number if number <= HIGHEST_C and number else OFF

    def encode(self, value: Value) -> str:
        if value is OFF:
            raise ValueError("no manual prints how to clear a limit; switch its delay off instead")
        if not 0 < _whole(value) <= HIGHEST_C:
            raise ValueError(
                f"{value} {self.unit} would be read back as not set; 1 to {HIGHEST_C} {self.unit}"
            )
        return f"{value:05d}"


@dataclass(frozen=True, slots=True)
class Scaled:
    """Length or speed in whole `1/per_unit` (manual 002, R-LEN: 01000 dmm = 100 mm)."""

    unit: str
    per_unit: int

    def decode(self, data: str) -> float:
        return Unsigned(self.unit).decode(data) / self.per_unit

    def encode(self, value: Value) -> str:
        exact = _number(value) * self.per_unit
        raw = round(exact)
        if abs(raw - exact) > 1e-6:
            raise ValueError(
                f"{value} {self.unit} is not a multiple of {1 / self.per_unit} {self.unit}"
            )
        if not 0 <= raw <= MOST:
            raise ValueError(
                f"{value} {self.unit} is not within 0 to {MOST / self.per_unit} {self.unit}, as far"
                " as five digits go"
            )
        return f"{raw:05d}"


@dataclass(frozen=True, slots=True)
class HexLength:
    """Dispensed length in 0.1 mm, hexadecimal, with or without ``0x``, of any width (manual 002,
    R-DLx).

    A field of decimal digits is hexadecimal too: ``01000`` is 4096 dmm.
    """

    unit: str = "mm"

    def decode(self, data: str) -> float:
        digits = data[2:] if data[:2] in ("0x", "0X") else data
        if not 1 <= len(digits) <= 16 or any(c not in "0123456789abcdefABCDEF" for c in digits):
            raise ValueError(f"{data!r} is not hexadecimal")
        return int(digits, 16) / 10

    def encode(self, value: Value) -> str:
        tenths = round(_number(value) * 10)
        if tenths < 0:
            raise ValueError(f"{value} is not a length")
        return f"{tenths:05X}"


@dataclass(frozen=True, slots=True)
class Text:
    """Printable characters, padded on the left to five (manual 000, 4.8.28)."""

    unit: str = ""

    def decode(self, data: str) -> str:
        name = data.strip(" ")
        if not name or not name.isascii() or not name.isprintable():
            raise ValueError(f"{data!r} is not a name")
        return name

    def encode(self, value: Value) -> str:
        if not isinstance(value, str):
            raise ValueError(f"{value!r} is not a name")
        return value.rjust(5)


@dataclass(frozen=True, slots=True)
class Choice:
    """A number that selects a mode. Only named numbers can be written."""

    names: tuple[str, ...]
    unit: str = ""

    def decode(self, data: str) -> str:
        number = _digits(data)
        if not 0 <= number < len(self.names):
            raise ValueError(f"{data!r} is none of {', '.join(self.names)}")
        return self.names[number]

    def encode(self, value: Value) -> str:
        if value not in self.names:
            raise ValueError(f"{value!r} is none of {', '.join(self.names)}")
        return f"{self.names.index(str(value)):05d}"


@dataclass(frozen=True, slots=True)
class Number:
    """A code that a table of the family explains, such as an error or a tool. Unknown codes are
    kept.

    `printed_for` pairs a number that a manual misprints with the intended one. `most` is the
    highest possible code.
    """

    unit: str = ""
    printed_for: tuple[tuple[int, int], ...] = ()
    most: int = 99999

    def decode(self, data: str) -> int:
        number = Unsigned("").decode(data)
        if number > self.most:
            raise ValueError(f"{data!r} is above {self.most}")
        return dict(self.printed_for).get(number, number) if self.printed_for else number

    def encode(self, value: Value) -> str:
        return Unsigned("").encode(value)


@dataclass(frozen=True, slots=True)
class DigitWord:
    """Five decimal digits, each with its own meaning; `highest` has the maximum of each
    (docs/reference/protocol.md, Status word).

    The value is the tuple of digits, most significant first.
    """

    highest: tuple[int, int, int, int, int]
    unit: str = ""

    def decode(self, data: str) -> tuple[int, ...]:
        if len(data) != 5 or not (data.isascii() and data.isdigit()):
            raise ValueError(f"{data!r} is not five digits")
        digits = tuple(map(int, data))
        if any(digit > top for digit, top in zip(digits, self.highest, strict=True)):
            raise ValueError(f"{data!r} has a digit that no manual describes")
        return digits

    def encode(self, value: Value) -> str:
        if not isinstance(value, tuple) or len(value) != 5:
            raise ValueError(f"{value!r} is not five digits")
        text = "".join(map(str, value))
        DigitWord.decode(self, text)
        return text


class Flags(DigitWord):
    """Digits in which any value but 0 sets the flag, where `highest` defines one
    (docs/reference/contradictions.md, B-24).
    """

    __slots__ = ()

    def decode(self, data: str) -> tuple[int, ...]:
        if len(data) == 5 and data.isascii() and data.isdigit():
            data = "".join(
                str(min(int(digit), top)) if top else digit
                for digit, top in zip(data, self.highest, strict=True)
            )
        return DigitWord.decode(self, data)


def raw_share(permille: int, whole: int) -> int:
    """Convert `permille` of `whole` to the value on the serial line
    (docs/reference/configuration.md).
    """
    return round(permille * whole / 1000)


def permille_of(raw: int, whole: int) -> int:
    """Return `raw` as a share of `whole` in permille."""
    return round(1000 * raw / whole)


def text_of(value: Value) -> str:
    """Format a value for the table `settings` and for messages: ``350``, ``1.60``, ``off``,
    ``00001``.
    """
    if isinstance(value, tuple):
        return "".join(map(str, value))
    if isinstance(value, float):
        return f"{value:.2f}"
    return str(value)
