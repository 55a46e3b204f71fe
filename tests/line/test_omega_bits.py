"""Flipped bits in answers of OMEGA: one is always noticed; two are not if text and sum change
alike.

The sum is arithmetic, so a bit of a digit and an equal step in the last character of the sum pass
together: ``a0 91`` and ``a2 93``. These tests count what passes; an error is read twice before it
is believed (`tests/line/test_omega.py`).
"""

from __future__ import annotations

import pytest

from support.clients.corrupted import flipped
from support.clients.omega_talk import framed
from support.product import (
    FAMILIES,
    Command,
    IoResult,
    LineFormat,
    OmegaReader,
    OmegaStation,
    StationError,
    Value,
    pull,
    send,
)

COMMANDS = FAMILIES["omega"].commands
A, B, F, G = (
    COMMANDS[name]
    for name in ("information", "temperature_control", "set_temperature_state", "mode")
)
C124 = COMMANDS["condition"].numbered(124)
RECORD = "c" + "007C" + "1" + "00A01401E02803203C04605005A06406E07808208C096"
ANSWERS = [
    *((A, f"a{digit}") for digit in range(4)),
    *(
        (command, f"{letter}{digit}")
        for command, letter in ((B, "b"), (F, "f"))
        for digit in range(2)
    ),
    *((G, f"g{digit}") for digit in range(6)),
    (C124, RECORD),
]
LINE = LineFormat(9600)


def taken(command: Command, wire: bytes) -> Value | None:
    """Return the value that a client reads from `wire` after its question; None if it still waits
    or asks again.
    """
    station = OmegaStation(LINE)
    asking = station.ask(station.question(command))
    pull(asking)
    try:
        send(asking, IoResult(0.02, wire, 0.0))
    except StopIteration as done:
        return done.value  # type: ignore[no-any-return]  # what the generator returns
    except StationError:
        return None
    asking.close()
    return None


@pytest.mark.parametrize(("command", "text"), ANSWERS, ids=[text[:6] for _, text in ANSWERS])
def test_no_single_flipped_bit_is_taken(command: Command, text: str) -> None:
    wire = framed(text)
    assert taken(command, wire) is not None
    assert [sent for sent in flipped(wire, 1) if taken(command, sent) is not None] == []


def others(command: Command, text: str) -> list[Value]:
    """Return the wrong values that a client reads from corruptions of two bits."""
    said = taken(command, framed(text))
    framed_well = (
        sent
        for sent in flipped(framed(text), 2)
        if any(isinstance(one, str) for one in OmegaReader().feed(sent))
    )
    return [value for sent in framed_well if (value := taken(command, sent)) not in (None, said)]


@pytest.mark.parametrize(
    ("command", "text", "passing"),
    [
        (A, "a0", ["solder clogged"]),  # 91 and 93 differ in one bit, as 0 and 2 do
        (A, "a1", []),
        (A, "a2", ["normal"]),
        (A, "a3", []),
        (B, "b0", ["preparing or error"]),
        (B, "b1", ["ready or normal"]),
        (F, "f0", ["out of range"]),
        (F, "f1", ["in range"]),
    ],
)
def test_which_of_the_1128_corruptions_of_two_bits_pass(
    command: Command, text: str, passing: list[Value]
) -> None:
    assert others(command, text) == passing


def test_of_a_condition_one_in_eighty_passes_and_two_answers_are_wanted_of_it() -> None:
    """`desk.agreed` reads it twice; two equal corruptions are not to be expected."""
    assert len(others(C124, RECORD)) == 1159
    assert len(list(flipped(framed(RECORD), 2))) == 96_580
