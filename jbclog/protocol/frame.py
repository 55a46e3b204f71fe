"""Frames of JBC's robot protocol, and the reader that finds them in a stream of bytes.

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

import re
from dataclasses import dataclass
from functools import reduce
from operator import xor

# -- frame --------------------------------------------------------------------------------------------------------------------

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


# -- reader -------------------------------------------------------------------------------------------------------------------
# Finds frames in a stream of bytes, however it is cut into chunks.
#
# The rules:
#
# 1. A frame is STX, `SHORTEST` to `LONGEST` printable characters, ETX, and one byte of any value: the check byte can be
#    STX, ETX, XON, XOFF or NUL. All else is garbage, an STX without such an end included.
# 2. Where the check byte or the shape does not hold, the frame is given as corrupt, and the search goes on behind it.
# 3. Where the check byte is an STX, the search goes on with it: it may begin the next frame, whose STX stands for a check
#    byte that was lost. That holds for good frames too: their own check byte may be an STX, and be lost.
# 4. A frame is given with its last byte. Garbage is counted and dropped, and what is held for the next chunk can only be
#    the beginning of a frame: `MOST_HELD` bytes at most.
#
# So the first good frame behind any garbage is given, whatever the garbage was.

SHORTEST = 3  # characters between STX and ETX: the read of the transformer's temperature, RTT (manual 000, 4.8.34)
LONGEST = 64  # the longest that is printed has 21: addresses, A, DL1 and 0x000000003E8 (manual 002, R-DLx)
MOST_HELD = 1 + LONGEST + 1

_FRAME = re.compile(rb"\x02([ -~]{%d,%d})\x03([\x00-\xff])" % (SHORTEST, LONGEST))
_BEGUN = re.compile(rb"\x02(?:[ -~]{0,%d}|[ -~]{%d,%d}\x03)\Z" % (LONGEST, SHORTEST, LONGEST))


@dataclass(frozen=True, slots=True)
class Corrupt:
    """Something framed like a frame whose check byte or shape does not hold; `raw` is all of it, check byte included."""

    raw: bytes


class FrameReader:
    """Feed it bytes; it gives the frames in them. `garbage` counts the bytes that belonged to none, good or corrupt."""

    def __init__(self) -> None:
        self._held = b""
        self._lent = 0  # 1 where what is held begins with the check byte of a good frame
        self.garbage = 0

    def reset(self) -> int:
        """Forget what is held, as after a drain; give how many bytes that were."""
        forgotten = len(self._held) - self._lent
        self.garbage += forgotten
        self._held, self._lent = b"", 0
        return forgotten

    def feed(self, chunk: bytes) -> list[Frame | Corrupt]:
        """All frames, good and corrupt, that `chunk` completes, in order."""
        stream = self._held + chunk
        found: list[Frame | Corrupt] = []
        place = 0
        while match := _FRAME.search(stream, place):
            self._drop(match.start() - place)
            frame = _checked(match)
            is_stx = match[2][0] == STX
            place = match.end() - is_stx
            self._lent = int(is_stx and frame is not None)
            found.append(frame or Corrupt(match[0]))
        begun = _BEGUN.search(stream, place)
        kept = begun.start() if begun else len(stream)
        self._drop(kept - place)
        self._held = stream[kept:]
        return found

    def _drop(self, count: int) -> None:
        if count:
            self.garbage += count - self._lent
            self._lent = 0


def _checked(match: re.Match[bytes]) -> Frame | None:
    """The frame, if its check byte and its shape hold."""
    raw = match[0]
    return parse(match[1]) if check_byte(raw[:-1]) == raw[-1] else None
