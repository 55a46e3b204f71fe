"""Five characters on the wire and what they mean: every kind of value in both directions, and what
is none.
"""

from __future__ import annotations

import contextlib
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.campaigns.each_row import each_row
from support.product import (
    OFF,
    AlarmDelay,
    AlarmLimit,
    Choice,
    Delay,
    DigitWord,
    Flags,
    HexLength,
    Number,
    Quantity,
    Scaled,
    Text,
    Unsigned,
    Value,
    Whole,
    text_of,
)

CELSIUS = Whole("°C")
OFFSET = Whole("°C", minus="-.")
HOURS = Unsigned("h")
MINUTES = Delay("min")
SECONDS = AlarmDelay()
LIMIT = AlarmLimit()
LENGTH = Scaled("mm", 10)
DIAMETER = Scaled("mm", 100)
DISPENSED = HexLength()
NAME = Text()
MODE = Choice(("continuous", "discontinuous", "program", "reload"))
CODE = Number()
FLAGS = Flags((0, 0, 0, 1, 1))
STATUS = DigitWord((0, 2, 1, 1, 3))

OF_DIGITS = (
    CELSIUS,
    OFFSET,
    HOURS,
    MINUTES,
    SECONDS,
    LIMIT,
    LENGTH,
    DIAMETER,
    MODE,
    CODE,
    FLAGS,
    STATUS,
)

NEVER_FIVE_DIGITS = [
    "",
    "0",
    "0350",
    "000350",
    "     ",
    " 0350",
    "0350 ",
    "  350",
    "+0350",
    "--050",
    "0-050",
    "0050-",
    "-",
    "-    ",
    "0_350",
    "3_5_0",
    "1e100",
    "0x015",
    "00a35",
    "003,5",
    "350.0",
    "0035\n",
    "00\x0035",
    "٠٠٣٥٠",  # Arabic-Indic digits: str.isdigit() takes them
    "00³50",
    "００３５０",  # full-width
    "०००५०",
    "nan  ",
    "  inf",
]


@each_row(
    (f"{quantity!r} {field!r}", (quantity, field))
    for quantity in OF_DIGITS
    for field in NEVER_FIVE_DIGITS
)
def test_what_is_never_a_value(quantity: Quantity, field: str) -> None:
    with pytest.raises(ValueError, match=re.escape(repr(field))):  # the message shows what came
        quantity.decode(field)


@each_row(
    (f"{row}", row)
    for row in [
        (CELSIUS, "00350", 350),
        (CELSIUS, "-0050", -50),
        (CELSIUS, "-9999", -9999),  # "-9999" to "99999" (manual 002, "Data Link Layer")
        (CELSIUS, "99999", 99999),  # means "off" only where the manual says so
        (CELSIUS, "00000", 0),
        (OFFSET, "-0050", -50),
        (OFFSET, ".0050", -50),  # the sign as manual 000, 3.1 prints it
        (HOURS, "99999", 99999),
        (CODE, "99999", 99999),
        (CODE, "00042", 42),
        (Number(printed_for=((80000, 8),)), "80000", 8),  # manual 002, "Port Errors"
        (Number(printed_for=((80000, 8),)), "00008", 8),
        (MINUTES, "00000", 0),
        (MINUTES, "00060", 60),
        (MINUTES, "99999", OFF),
        (MINUTES, "99998", 99998),
        (SECONDS, "01.60", 1.6),
        (SECONDS, "00.00", 0.0),
        (SECONDS, "00.10", 0.1),
        (SECONDS, "99.99", 99.99),
        (SECONDS, "99999", OFF),
        (SECONDS, "00160", 1.6),  # without a dot (docs/reference/contradictions.md, B-22)
        (SECONDS, "09999", 99.99),
        (LIMIT, "00380", 380),
        (LIMIT, "00600", 600),
        (LIMIT, "00601", OFF),  # no station gets there
        # "not set" has no printed form (docs/reference/contradictions.md, B-23)
        (LIMIT, "99999", OFF),
        (LIMIT, "00000", OFF),
        (LENGTH, "01000", 100.0),
        (LENGTH, "00001", 0.1),
        (DIAMETER, "00100", 1.0),
        (DISPENSED, "003E8", 100.0),
        (DISPENSED, "003e8", 100.0),
        (DISPENSED, "0x000000003E8", 100.0),
        (DISPENSED, "0X3E8", 100.0),
        (DISPENSED, "01000", 409.6),  # digits only, and hexadecimal still
        (DISPENSED, "FFFFF", 104857.5),
        (DISPENSED, "0", 0.0),
        (NAME, "  DDR", "DDR"),
        (NAME, "UCR245", "UCR245"),
        (NAME, "DDE  ", "DDE"),
        (NAME, "v 1.2", "v 1.2"),
        (MODE, "00000", "continuous"),
        (MODE, "00003", "reload"),
        (FLAGS, "00011", (0, 0, 0, 1, 1)),
        # any digit but 0 is set (docs/reference/contradictions.md, B-24)
        (FLAGS, "00090", (0, 0, 0, 1, 0)),
        (STATUS, "02113", (0, 2, 1, 1, 3)),
    ]
)
def test_what_is_read(quantity: Quantity, field: str, value: Value) -> None:
    read = quantity.decode(field)
    assert read == value
    assert type(read) is type(value)


@each_row(
    (f"{row}", row)
    for row in [
        (CELSIUS, ".0050"),  # a dot is a sign in the offset only
        (OFFSET, "0.050"),
        (OFFSET, ".-050"),
        (OFFSET, "..050"),
        (HOURS, "-0001"),
        (HOURS, ".0001"),
        (CODE, "-0001"),
        (MINUTES, "-0001"),
        (MINUTES, "01.60"),
        (LENGTH, "-0001"),
        (SECONDS, "99998"),  # no hundredths of a second that a delay can have
        (SECONDS, "10160"),
        (SECONDS, "0016"),
        (SECONDS, "9999."),
        (SECONDS, "1.600"),
        (SECONDS, "01,60"),
        (SECONDS, "-1.60"),
        (SECONDS, "01.6"),
        (SECONDS, "01.6 "),
        (SECONDS, "01.600"),
        (SECONDS, "٠١.٦٠"),
        (DISPENSED, ""),
        (DISPENSED, "0x"),
        (DISPENSED, "x03E8"),
        (DISPENSED, "0x0x1"),
        (DISPENSED, "-03E8"),
        (DISPENSED, " 03E8"),
        (DISPENSED, "03_E8"),
        (DISPENSED, "003G8"),
        (DISPENSED, "３E8"),
        (DISPENSED, "0" * 17),
        (NAME, ""),
        (NAME, "     "),
        (NAME, "DD\x07"),
        (NAME, "DDÉ"),
        (MODE, "00004"),
        (MODE, "-0001"),
        (FLAGS, "0001x"),
        (FLAGS, "0001²"),
        (FLAGS, "00101"),
        (FLAGS, "20000"),
        (FLAGS, "-0011"),
        (STATUS, "00004"),
        (STATUS, "00020"),
        (STATUS, "00200"),
        (STATUS, "03000"),
        (STATUS, "10000"),
    ]
)
def test_what_is_not_read(quantity: Quantity, field: str) -> None:
    with pytest.raises(ValueError, match=re.escape(repr(field))):  # the message shows what came
        quantity.decode(field)


@each_row(
    (f"{row}", row)
    for row in [
        (CELSIUS, 350, "00350"),
        (CELSIUS, -50, "-0050"),
        (OFFSET, -50, "-0050"),  # never with a dot
        (MINUTES, OFF, "99999"),
        (SECONDS, OFF, "99999"),
        (SECONDS, 1.6, "01.60"),
        (SECONDS, 2, "02.00"),
        (SECONDS, 0.29, "00.29"),  # 0.29 * 100 is 28.999999999999996
        (LIMIT, 380, "00380"),
        (LENGTH, 100, "01000"),
        (LENGTH, 0.3, "00003"),
        (DIAMETER, 0.56, "00056"),
        (DISPENSED, 100.0, "003E8"),
        (DISPENSED, 0.0, "00000"),
        (DISPENSED, 104857.6, "100000"),
        (NAME, "DDE", "  DDE"),
        (NAME, "UCR245", "UCR245"),
        (MODE, "program", "00002"),
        (STATUS, (0, 0, 0, 0, 1), "00001"),
    ]
)
def test_what_is_written(quantity: Quantity, value: Value, field: str) -> None:
    assert quantity.encode(value) == field


@each_row(
    (f"{row}", row)
    for row in [
        *(
            (quantity, value)
            for quantity in (CELSIUS, HOURS, CODE)
            for value in (OFF, 350.0, "350", True, None, 100_000)
        ),
        (CELSIUS, -10_000),
        (HOURS, -1),
        (CODE, -1),
        *((MINUTES, value) for value in (-1, 5.0, "off", None, False)),
        *(
            (SECONDS, value)
            for value in (-0.01, 100.0, 1.605, "1.60", None, True, math.nan, math.inf)
        ),
        # no manual prints how to clear a limit
        *((LIMIT, value) for value in (OFF, -5, 380.0, None)),
        *((LENGTH, value) for value in (OFF, 0.05, -1.0, 10_000.0, None, True, math.nan, math.inf)),
        *((DISPENSED, value) for value in (-0.1, "3E8", None, True, math.nan, math.inf)),
        *((NAME, value) for value in (5, None)),
        *((MODE, value) for value in ("backward", 0, None, OFF)),
        *(
            (FLAGS, value)
            for value in (
                (0, 0, 0, 0, 2),
                (0, 0, 0, 1),
                11,
                "00011",
                (0, 0, 0, 0, -1),
                (0, 0, 0, 0, 10),
            )
        ),
    ]
)
def test_what_is_not_written(quantity: Quantity, value: Value) -> None:
    with pytest.raises(ValueError, match=r"\bno|negative"):
        quantity.encode(value)


@given(st.integers(-9999, 99999))
def test_whole_numbers_there_and_back(number: int) -> None:
    assert CELSIUS.decode(CELSIUS.encode(number)) == number
    assert OFFSET.decode(OFFSET.encode(number)) == number


@given(st.integers(0, 99999))
def test_positive_numbers_there_and_back(number: int) -> None:
    assert HOURS.decode(HOURS.encode(number)) == CODE.decode(CODE.encode(number)) == number
    assert LENGTH.encode(LENGTH.decode(f"{number:05d}")) == f"{number:05d}"
    assert DIAMETER.encode(DIAMETER.decode(f"{number:05d}")) == f"{number:05d}"


@given(st.integers(0, 99998))
def test_delays_there_and_back(number: int) -> None:
    assert MINUTES.decode(MINUTES.encode(number)) == number


def test_every_alarm_delay_there_and_back() -> None:
    fields = [f"{hundredths // 100:02d}.{hundredths % 100:02d}" for hundredths in range(10_000)]
    assert [SECONDS.encode(SECONDS.decode(field)) for field in fields] == fields
    assert [text_of(SECONDS.decode(field)) for field in fields[:1000:7]] == [
        f"{n / 100:.2f}" for n in range(0, 1000, 7)
    ]


@given(st.integers(0, 16**16 - 1), st.booleans(), st.booleans())
def test_dispensed_lengths_of_any_width(tenths: int, prefix: bool, small: bool) -> None:
    digits = f"{tenths:x}" if small else f"{tenths:X}"
    assert DISPENSED.decode(("0x" if prefix else "") + digits) == tenths / 10


@given(st.integers(0, 2**40))
def test_dispensed_lengths_there_and_back(tenths: int) -> None:
    assert DISPENSED.decode(DISPENSED.encode(tenths / 10)) == tenths / 10


@given(st.text(max_size=8))
def test_any_field_is_a_value_or_a_value_error(field: str) -> None:
    for quantity in (*OF_DIGITS, DISPENSED, NAME):
        with contextlib.suppress(ValueError):
            assert quantity.decode(field) is not None
            assert field.isascii()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (350, "350"),
        (-50, "-50"),
        (1.6, "1.60"),
        (OFF, "off"),
        ((0, 0, 0, 0, 1), "00001"),
        ("reload", "reload"),
    ],
)
def test_values_as_people_see_them(value: Value, text: str) -> None:
    assert text_of(value) == text
