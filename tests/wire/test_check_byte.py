"""What the check byte proves and what it does not (digest A.2), and that it may look like any control character."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from functools import reduce
from operator import xor

import pytest
from codes import codes
from golden import with_check_byte

from jbclog.commands.family import FAMILIES
from jbclog.protocol.frame import Frame, check_byte
from jbclog.protocol.reader import FrameReader

ALL_CODES = {code: command for family in FAMILIES.values() for code, command in codes(family).items()}
CONTROL = {0x02: "STX", 0x03: "ETX", 0x11: "XON", 0x13: "XOFF", 0x00: "NUL"}

WITHOUT_ADDRESSES = {
    "STX": "AA12 AA21 AA47 AD17 AD24 AD35 AD42 AH28 AH39 RS13 RS31 RS46",
    "ETX": "AA13 AA31 AA46 AD16 AD25 AD34 AD43 AH29 AH38 RMIT RS12 RS21 RS47 RSMN RWCD WRST WSTR",
    "XON": "ARSP AS13 AS31 AS46 RA12 RA21 RA47 RD17 RD24 RD35 RD42 RH28 RH39",
    "XOFF": "AS11 AS22 AS33 AS44 RA23 RA32 RA45 RD15 RD26 RD37 RH19",
    "NUL": "AA23 AA32 AA45 AD15 AD26 AD37 AH19 RS11 RS22 RS33 RS44",
}
"""Questions (R), acknowledgements (A) and orders without data (W). In pencil: digest A.2 (4), here with all ports and tools."""
WITH_ADDRESSES = {
    "STX": WITHOUT_ADDRESSES["ETX"],  # the addresses 00 and 01 turn the lowest bit over
    "ETX": WITHOUT_ADDRESSES["STX"],
    "XON": "AMIT AS12 AS21 AS47 AWCD RA13 RA31 RA46 RD16 RD25 RD34 RD43 RH29 RH38",
    "XOFF": "AS23 AS32 AS45 RA11 RA22 RA33 RA44 RD14 RD27 RD36 RD41 RFST RH18",
    "NUL": "AA11 AA22 AA33 AA44 AD14 AD27 AD36 AD41 AH18 RS23 RS32 RS45 WSTP",
}


def _bare_texts() -> Iterator[str]:
    for code, command in ALL_CODES.items():
        if command.readable:
            yield "R" + code
        if command.writable:
            yield "A" + code
        if command.access == "w" and command.limits.low == command.limits.high == 0:
            yield "W" + code


def _on_control_characters(pair: bytes) -> dict[str, str]:
    found: dict[str, list[str]] = defaultdict(list)
    for text in _bare_texts():
        check = with_check_byte(b"\x02" + pair + text.encode() + b"\x03")[-1]
        if check in CONTROL:
            found[CONTROL[check]].append(text)
    return {name: " ".join(sorted(texts)) for name, texts in found.items()}


def test_check_bytes_that_are_control_characters_without_addresses() -> None:
    assert _on_control_characters(b"") == WITHOUT_ADDRESSES


def test_check_bytes_that_are_control_characters_with_addresses() -> None:
    assert _on_control_characters(b"0001") == WITH_ADDRESSES


@pytest.mark.parametrize(("pair", "addresses"), [(b"", (None, None)), (b"0001", (0, 1)), (b"0100", (1, 0))])
def test_none_of_them_fools_the_reader(pair: bytes, addresses: tuple[int | None, int | None]) -> None:
    reader = FrameReader()
    for text in _bare_texts():
        wire = with_check_byte(b"\x02" + pair + text.encode() + b"\x03")
        assert reader.feed(wire) == [Frame(text[0], text[1:], *addresses)]
        assert [found for byte in wire for found in reader.feed(bytes([byte]))] == [Frame(text[0], text[1:], *addresses)]
    assert reader.garbage == 0


FIVE_CHARACTERS = [
    *(f"{number:05d}" for number in range(100_000)),
    *(f"{number:05d}" for number in range(-9999, 0)),
    *(f"{number // 100:02d}.{number % 100:02d}" for number in range(10_000)),
]


def test_no_frame_with_five_digits_ends_in_a_control_character() -> None:
    """Exhaustive: every value of every command, in every direction. So a value is never cut short by its check byte."""
    of_data = {reduce(xor, data.encode()) for data in FIVE_CHARACTERS}
    for code in ALL_CODES:
        for header in "WAN":
            for pair in (b"", b"0001"):
                of_frame = with_check_byte(b"\x02" + pair + header.encode() + code.encode() + b"\x03")[-1]
                assert min(of_frame ^ one for one in of_data) >= 0x20


def test_stx_is_covered() -> None:
    """The printed 3E and 3F hold only with STX; without it they would be 3C and 3D."""
    assert check_byte(b"\x020001WMAT00375\x03") == 0x3E
    assert check_byte(b"0001WMAT00375\x03") == 0x3C
    assert check_byte(b"\x02WMAT00375\x03") == 0x3F
    assert check_byte(b"WMAT00375\x03") == 0x3D


def test_the_order_of_addresses_and_of_digits_is_not_proven() -> None:
    """Why an answer is matched by everything else too."""
    assert check_byte(b"\x020001ATT100183\x03") == check_byte(b"\x020100ATT100183\x03")
    assert check_byte(b"\x02ATT100183\x03") == check_byte(b"\x02ATT100138\x03") == 0x4B


@pytest.mark.parametrize("pair", [(0, 1), (1, 0), (0, 10), (99, 0), (0, 20)])
def test_it_agrees_with_the_long_way(pair: tuple[int, int]) -> None:
    for text in ("RSMN", "ATT100183", "NTT100004", "WHD101.60", "AA12-0050"):
        wire = Frame(text[0], text[1:], *pair).encode()
        assert with_check_byte(wire[:-1]) == wire
        assert wire[1:5] == b"%02d%02d" % pair
