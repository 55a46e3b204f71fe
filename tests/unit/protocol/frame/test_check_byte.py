"""What the check byte proves and what it does not, and that it may look like any control character.

docs/reference/protocol.md, Check byte.

The codes are those that `golden.letters` holds, typed by hand; the check bytes are worked out by
`golden.with_check_byte`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from functools import reduce
from operator import xor

import pytest

from support.golden import framed, letters, with_check_byte
from support.product import Frame, FrameReader

ALL_CODES = {
    code: access for family in letters.FAMILIES for code, access in letters.codes_of(family).items()
}
CONTROL = [*range(0x20), 0x7F]

WITHOUT_ADDRESSES = {
    0x02: "AA12 AA21 AA47 AD17 AD24 AD35 AD42 AH28 AH39 AMIF RS13 RS31 RS46",  # STX
    # ETX
    0x03: "AA13 AA31 AA46 AD16 AD25 AD34 AD43 AH29 AH38 RMIT RS12 RS21 RS47 RSMN RWCD WRST WSTR",
    0x11: "ARSP AS13 AS31 AS46 RA12 RA21 RA47 RD17 RD24 RD35 RD42 RH28 RH39 RMIF",  # XON
    0x13: "AS11 AS22 AS33 AS44 RA23 RA32 RA45 RD15 RD26 RD37 RH19",  # XOFF
    0x00: "AA23 AA32 AA45 AD15 AD26 AD37 AH19 RS11 RS22 RS33 RS44",  # NUL
    0x01: "AA11 AA22 AA33 AA44 AD14 AD27 AD36 AD41 AH18 AMIE RS23 RS32 RS45 WSTP",
    0x04: "AA14 AA27 AA36 AA41 AD11 AD22 AD33 AD44 AH48 RS15 RS26 RS37 RSVR",
    0x05: "AA15 AA26 AA37 AD23 AD32 AD45 AH49 RS14 RS27 RS36 RS41",
    0x06: "AA16 AA25 AA34 AA43 AD13 AD31 AD46 AMOD RS17 RS24 RS35 RS42",
    0x07: "AA17 AA24 AA35 AA42 AD12 AD21 AD47 ALEN ASPD RS16 RS25 RS34 RS43 WRSP",
    0x08: "AA18 AD48 AH11 AH22 AH33 AH44 RS19",
    0x09: "AA19 AD49 AH23 AH32 AH45 AMAE RS18",
    0x0A: "AA29 AA38 ABCK AH13 AH31 AH46 AIFE AMAF RS28 RS39",  # line feed
    0x0B: "AA28 AA39 AH12 AH21 AH47 ANVS RMAT RS29 RS38",
    0x0C: "AA49 AD19 ADIA AH15 AH26 AH37 RS48",
    0x0D: "AA48 AD18 AH14 AH27 AH36 AH41 RS49",  # carriage return
    0x0E: "AD28 AD39 AH17 AH24 AH35 AH42",
    0x0F: "AD29 AD38 AH16 AH25 AH34 AH43",
    0x10: "AMIT AS12 AS21 AS47 AWCD RA13 RA31 RA46 RD16 RD25 RD34 RD43 RH29 RH38",
    0x12: "AS23 AS32 AS45 RA11 RA22 RA33 RA44 RD14 RD27 RD36 RD41 RFST RH18 RMIE",
    0x14: "AS16 AS25 AS34 AS43 RA17 RA24 RA35 RA42 RD12 RD21 RD47 RLEN RSPD",
    0x15: "ARST AS17 AS24 AS35 AS42 ASTR RA16 RA25 RA34 RA43 RD13 RD31 RD46 RFEE RMOD",
    0x16: "AS14 AS27 AS36 AS41 ASAD RA15 RA26 RA37 RD23 RD32 RD45 RH49",
    0x17: "AS15 AS26 AS37 ASTP RA14 RA27 RA36 RA41 RD11 RD22 RD33 RD44 RH48 RSER",
    0x18: "AMAT AS29 AS38 RA28 RA39 RH12 RH21 RH47",
    0x19: "AS28 AS39 RA29 RA38 RBCK RH13 RH31 RH46 RMAF",
    0x1A: "AS18 RA19 RD49 RH23 RH32 RH45 RMAE",
    0x1B: "AS19 RA18 RD48 RH11 RH22 RH33 RH44",
    0x1C: "RD29 RD38 RH16 RH25 RH34 RH43 WIFE",
    0x1D: "RD28 RD39 RH17 RH24 RH35 RH42",
    0x1E: "AS49 RA48 RD18 RH14 RH27 RH36 RH41",
    0x1F: "AS48 RA49 RD19 RDIA RH15 RH26 RH37",
    0x7F: "AHD3 ALA2 RWH3",
}
"""Questions (R), acknowledgements (A) and orders without data (W) whose check byte is a control
character.
"""
WITH_ADDRESSES = {
    0x02: "AA13 AA31 AA46 AD16 AD25 AD34 AD43 AH29 AH38 RMIT RS12 RS21 RS47 RSMN RWCD WRST WSTR",
    0x03: "AA12 AA21 AA47 AD17 AD24 AD35 AD42 AH28 AH39 AMIF RS13 RS31 RS46",
    0x11: "AMIT AS12 AS21 AS47 AWCD RA13 RA31 RA46 RD16 RD25 RD34 RD43 RH29 RH38",
    0x13: "AS23 AS32 AS45 RA11 RA22 RA33 RA44 RD14 RD27 RD36 RD41 RFST RH18 RMIE",
    0x00: "AA11 AA22 AA33 AA44 AD14 AD27 AD36 AD41 AH18 AMIE RS23 RS32 RS45 WSTP",
}
"""The five that software for serial ports likes to swallow; all others are in the test."""


def _bare_texts() -> Iterator[str]:
    for code, access in ALL_CODES.items():
        if "R" in access:
            yield "R" + code
        if "W" in access:
            yield "A" + code
        if access == "W0" and code != "NVS":  # its five zeros are printed
            yield "W" + code


def _on_control_characters(pair: str) -> dict[int, str]:
    found: dict[int, list[str]] = defaultdict(list)
    for text in _bare_texts():
        check = framed(text, pair)[-1]
        if check in CONTROL:
            found[check].append(text)
    return {check: " ".join(sorted(texts)) for check, texts in found.items()}


def test_check_bytes_that_are_control_characters_without_addresses() -> None:
    assert _on_control_characters("") == WITHOUT_ADDRESSES


def test_check_bytes_that_are_control_characters_with_addresses() -> None:
    """The addresses 00 and 01 turn the lowest bit over, in either order; 00 and 10 do the same, 00
    and 20 the next one.
    """
    found = _on_control_characters("0001")
    assert {check: found[check] for check in WITH_ADDRESSES} == WITH_ADDRESSES
    assert found.keys() == set(CONTROL)
    assert {check: text for check, text in found.items() if check < 0x20} == {
        check ^ 0x01: text for check, text in WITHOUT_ADDRESSES.items() if check < 0x20
    }
    assert found[0x7F] == "AHD2 ALA3 RWH2"
    assert _on_control_characters("0100") == _on_control_characters("0010") == found


@pytest.mark.parametrize(
    ("pair", "addresses"),
    [("", (None, None)), ("0001", (0, 1)), ("0100", (1, 0)), ("0010", (0, 10))],
)
def test_none_of_them_fools_the_reader(pair: str, addresses: tuple[int | None, int | None]) -> None:
    reader = FrameReader()
    for text in _bare_texts():
        wire, frame = framed(text, pair), Frame(text[0], text[1:], *addresses)
        assert reader.feed(wire) == [frame]
        assert [found for byte in wire for found in reader.feed(bytes([byte]))] == [frame]
    assert reader.garbage == 0


FIVE_CHARACTERS = [
    *(f"{number:05d}" for number in range(100_000)),
    *(f"{number:05d}" for number in range(-9999, 0)),
    *(f"{number // 100:02d}.{number % 100:02d}" for number in range(10_000)),
]
CAPITALS, SMALL = "0123456789ABCDEF", "0123456789abcdef"


def _of_hexadecimal(digits: str, width: int) -> set[int]:
    """What all fields of so many hexadecimal digits can come to."""
    found = {0}
    for _ in range(width):
        found = {before ^ ord(digit) for before in found for digit in digits}
    return found


def test_no_frame_with_five_digits_ends_in_a_control_character() -> None:
    """Exhaustive: every value of every command, in every direction. So a value is never cut short
    by its check byte.
    """
    of_data = {reduce(xor, data.encode("ascii")) for data in FIVE_CHARACTERS}
    for code, access in ALL_CODES.items():
        for header in "WAN" if access != "R" else "AN":
            for pair in ("", "0001"):
                of_frame = framed(header + code, pair)[-1]
                assert min(of_frame ^ one for one in of_data) >= 0x20


def test_a_length_in_five_capital_hexadecimal_digits_does_not_either() -> None:
    """But one in small letters may, or a longer one: no manual prints its width. A version or a
    name may, too.
    """
    dispensed = [framed("ADL" + port, pair)[-1] for port in letters.PORTS for pair in ("", "0001")]
    assert all(
        of_frame ^ one >= 0x20 for of_frame in dispensed for one in _of_hexadecimal(CAPITALS, 5)
    )
    assert any(of_frame ^ one < 0x20 for of_frame in dispensed for one in _of_hexadecimal(SMALL, 5))
    assert any(
        of_frame ^ one < 0x20 for of_frame in dispensed for one in _of_hexadecimal(CAPITALS, 6)
    )


def test_stx_is_covered() -> None:
    """The printed 3E and 3F hold only with STX; without it they would be 3C and 3D."""
    assert with_check_byte(b"\x020001WMAT00375\x03")[-1] == 0x3E
    assert with_check_byte(b"0001WMAT00375\x03")[-1] == 0x3C
    assert with_check_byte(b"\x02WMAT00375\x03")[-1] == 0x3F
    assert with_check_byte(b"WMAT00375\x03")[-1] == 0x3D


def test_the_order_of_addresses_and_of_digits_is_not_proven() -> None:
    """Why an answer is matched by everything else too."""
    assert framed("ATT100183", "0001")[-1] == framed("ATT100183", "0100")[-1]
    assert framed("ATT100183")[-1] == framed("ATT100138")[-1] == 0x4B
