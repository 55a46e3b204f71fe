"""Manual 003, Apollo Seiko OMEGA, page 5 of 60, chapter 11: every example. One page is all that
there is of it here.

A frame is STX, text, ETX, and the sum of the text's characters as two capital hexadecimal digits.
The frames of `BY_HAND` are printed nowhere here: their texts come from docs/reference/protocol.md,
OMEGA (the manual's pages 6 to 10), and their sums were added up by hand.
"""

from typing import NamedTuple


class OmegaGolden(NamedTuple):
    """A frame of the OMEGA's protocol with its text."""

    where: str
    page: int | None
    printed: str
    wire: bytes
    text: str


FRAMES = [
    OmegaGolden(
        "003 11.2", 5, "75(4Bh) + 49(31h) + 50(32h) + 67(43h) = 241(F1h)", b"\x02K12C\x03F1", "K12C"
    ),
    OmegaGolden("003 11.2", 5, "STX ‘K’ ‘1’ ‘2’ ‘C’ ETX ‘F’ ‘1’", b"\x02K12C\x03F1", "K12C"),
    OmegaGolden(
        "003 11.2",
        5,
        "02h 4Bh 31h 32h 43h 03h 46h 31h",
        bytes.fromhex("02 4B 31 32 43 03 46 31"),
        "K12C",
    ),
    OmegaGolden(
        "003 11.3.1",
        5,
        "A : Soldering Controller Information Request ... Code 41H",
        b"\x02A\x0341",
        "A",
    ),
]

SUMS = [
    (
        "003 11.2",
        5,
        "if SUM is 1526 equaling to 5F6h in hexadecimal which exceeds the 8-bit limit",
        1526,
        b"F6",
    ),
    ("003 11.2", 5, "241(F1h)", 241, b"F1"),
]
"""A sum and the two characters that stand for it."""

BY_HAND = [
    OmegaGolden(
        "docs/reference/protocol.md, Example frames", None, "`a0`→SUM 91", b"\x02a0\x0391", "a0"
    ),
    OmegaGolden("docs/reference/protocol.md, OMEGA", None, "3 both", b"\x02a3\x0394", "a3"),
    OmegaGolden("docs/reference/protocol.md, Example frames", None, "`B` 42", b"\x02B\x0342", "B"),
    OmegaGolden("docs/reference/protocol.md, OMEGA", None, "`b`+1", b"\x02b1\x0393", "b1"),
    OmegaGolden(
        "docs/reference/protocol.md, Example frames",
        None,
        "`C007C`→1D",
        b"\x02C007C\x031D",
        "C007C",
    ),
    OmegaGolden(
        "docs/reference/protocol.md, OMEGA", None, "`d` only on success", b"\x02d\x0364", "d"
    ),
    OmegaGolden("docs/reference/protocol.md, OMEGA", None, "F → f", b"\x02F\x0346", "F"),
    OmegaGolden("docs/reference/protocol.md, OMEGA", None, "`f`+1", b"\x02f0\x0396", "f0"),
    OmegaGolden("docs/reference/protocol.md, OMEGA", None, "G → g", b"\x02G\x0347", "G"),
    OmegaGolden(
        "docs/reference/protocol.md, Example frames",
        None,
        "`H0065`→13",
        b"\x02H0065\x0313",
        "H0065",
    ),
    OmegaGolden(
        "docs/reference/protocol.md, OMEGA", None, "`h` when point soldering", b"\x02h\x0368", "h"
    ),
    OmegaGolden(
        "docs/reference/protocol.md, OMEGA", None, "`i` after the first stage", b"\x02i\x0369", "i"
    ),
]
