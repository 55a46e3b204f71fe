"""One frame of JBC's robot protocol (manual 002, "Data Link Layer"; manuals 000 and 001 agree).

::

    ┌─────┬────────┬────────┬───┬─────────┬──────────┬─────┬─────┐
    │ STX │ source │ target │ H │ control │   data   │ ETX │ BCC │
    │ 02h │ "00".. │ "00".. │   │ command │          │ 03h │     │
    └─────┴────────┴────────┴───┴─────────┴──────────┴─────┴─────┘
      1      2        2       1   3 (TT: 2)  0, 5 or more  1     1

The addresses are there on a line with addresses and not there on one without. H is R (read), W (write),
A (answer) or N (refusal). BCC is the XOR of every byte from STX to ETX, one raw byte: it can be STX, ETX,
XON, XOFF or NUL. Where the command ends and its data begins only the question tells, so `text` holds both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import xor

STX = 0x02
ETX = 0x03
HEADERS = "RWAN"


def check_byte(covered: bytes) -> int:
    """XOR of all bytes of `covered`, which starts at STX and ends with ETX."""
    return reduce(xor, covered)


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame whose check byte holds. `source` and `target` are None on a line without addresses."""

    header: str
    text: str
    source: int | None = None
    target: int | None = None

    def encode(self) -> bytes:
        """The bytes on the wire, check byte included."""
        if self.header not in HEADERS or len(self.header) != 1:
            raise ValueError(f"{self.header!r} is not one of R, W, A, N")
        if not all(" " <= c <= "~" for c in self.text):
            raise ValueError(f"{self.text!r} has characters that are not printable ASCII")
        covered = b"\x02%s%s%s\x03" % (self._addresses(), self.header.encode(), self.text.encode())
        return covered + bytes([check_byte(covered)])

    def _addresses(self) -> bytes:
        if self.source is None and self.target is None:
            return b""
        if self.source is None or self.target is None:
            raise ValueError("a frame has both addresses or none")
        if not (0 <= self.source <= 99 and 0 <= self.target <= 99):
            raise ValueError(f"an address lies between 0 and 99, not {self.source} to {self.target}")
        return b"%02d%02d" % (self.source, self.target)


def parse(content: bytes) -> Frame | None:
    """The frame whose bytes between STX and ETX are `content`; None where they cannot be one.

    A digit after STX means a frame with addresses, a header one without (docs/reference/contradictions.md, B-7).
    """
    if not content.isascii():
        return None
    text = content.decode("ascii")
    if text and text[0] in HEADERS:
        return Frame(text[0], text[1:])
    addresses, header, rest = text[:4], text[4:5], text[5:]
    if not addresses.isdigit() or not header or header not in HEADERS:
        return None
    return Frame(header, rest, int(addresses[:2]), int(addresses[2:]))


def only_reads(data: bytes) -> bool:
    """Whether `data` is one whole frame with header R, its check byte good, and nothing before or behind it."""
    if len(data) < 4 or data[0] != STX or data[-2] != ETX or check_byte(data[:-1]) != data[-1]:
        return False
    content = data[1:-2]
    frame = parse(content) if all(0x20 <= byte <= 0x7E for byte in content) else None
    return frame is not None and frame.header == "R"
