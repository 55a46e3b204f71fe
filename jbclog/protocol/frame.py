"""Frames of JBC's robot protocol, and a reader that finds them in a stream of bytes.

::

    ┌─────┬────────┬────────┬───┬─────────┬──────────┬─────┬─────┐
    │ STX │ source │ target │ H │ control │   data   │ ETX │ BCC │
    │ 02h │ "00".. │ "00".. │   │ command │          │ 03h │     │
    └─────┴────────┴────────┴───┴─────────┴──────────┴─────┴─────┘
      1      2        2       1   3 (TT: 2)  0, 5 or more  1     1

Addresses are optional, by the line's configuration. H is R (read), W (write), A (answer) or N
(refusal). BCC is the XOR of every byte from STX to ETX, one raw byte: it can be STX, ETX, XON, XOFF
or NUL. Only the request shows where the command ends and its data begins, so `text` has both.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import reduce
from operator import xor

STX = 0x02
ETX = 0x03
HEADERS = "RWAN"


def check_byte(covered: bytes) -> int:
    """Return the XOR of all bytes of `covered`, from STX to ETX."""
    return reduce(xor, covered)


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame with a correct check byte. Without addresses `source` and `target` are None."""

    header: str
    text: str
    source: int | None = None
    target: int | None = None

    def encode(self) -> bytes:
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
            raise ValueError(
                f"an address lies between 0 and 99, not {self.source} to {self.target}"
            )
        return b"%02d%02d" % (self.source, self.target)


def parse(content: bytes) -> Frame | None:
    """Parse the bytes between STX and ETX; None if they are not a frame.

    A digit after STX means addresses, a header means none (docs/reference/contradictions.md, B-7).
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
    """Return True if `data` is exactly one complete read: header R and a correct check byte."""
    if len(data) < 4 or data[0] != STX or data[-2] != ETX or check_byte(data[:-1]) != data[-1]:
        return False
    content = data[1:-2]
    frame = parse(content) if all(0x20 <= byte <= 0x7E for byte in content) else None
    return frame is not None and frame.header == "R"


# The reader's rules (`FrameReader`):
#
# 1. A frame is STX, `SHORTEST` to `LONGEST` printable characters, ETX, and one byte of any value:
#    the check byte can be STX, ETX, XON, XOFF or NUL. Everything else is garbage, including an STX
#    without such an end.
# 2. A frame with a wrong check byte or shape is returned as corrupt, and the search continues after
#    it.
# 3. If the check byte is an STX, the search continues with it: it may begin the next frame, and the
#    check byte may be lost. That holds for correct frames too, because their own check byte may be
#    an STX.
# 4. A frame is returned with its last byte. Garbage is counted and dropped; only the possible
#    beginning of a frame is kept for the next chunk, at most `MOST_HELD` bytes.
#
# So the reader finds the first correct frame after any garbage.

# characters between STX and ETX: RTT, the transformer's temperature (manual 000, 4.8.34)
SHORTEST = 3
# the longest printed text has 21: addresses, A, DL1 and 0x000000003E8 (manual 002, R-DLx)
LONGEST = 64
MOST_HELD = 1 + LONGEST + 1

_FRAME = re.compile(rb"\x02([ -~]{%d,%d})\x03([\x00-\xff])" % (SHORTEST, LONGEST))
_BEGUN = re.compile(rb"\x02(?:[ -~]{0,%d}|[ -~]{%d,%d}\x03)\Z" % (LONGEST, SHORTEST, LONGEST))


@dataclass(frozen=True, slots=True)
class CorruptFrame:
    """A frame with a wrong check byte or shape; `raw` is all of it, check byte included."""

    raw: bytes


class FrameReader:
    """Finds frames in chunks of bytes. `garbage` counts the bytes outside of any frame; `held` are
    the bytes kept for the next chunk.
    """

    def __init__(self) -> None:
        self.held = b""
        self._lent = 0  # 1 if the kept bytes begin with the check byte of a correct frame
        self.garbage = 0

    def reset(self) -> int:
        """Drop the kept bytes and return their number."""
        forgotten = len(self.held) - self._lent
        self.garbage += forgotten
        self.forget()
        return forgotten

    def forget(self) -> None:
        """Drop the kept bytes: with what followed they were a frame."""
        self.held = b""
        self._lent = 0

    def feed(self, chunk: bytes) -> list[Frame | CorruptFrame]:
        """Return the frames, correct and corrupt, that `chunk` completes."""
        stream = self.held + chunk
        frames: list[Frame | CorruptFrame] = []
        end = 0  # of the last frame
        while match := _FRAME.search(stream, end):
            self._drop(match.start() - end)
            frame = _checked(match)
            is_stx = match[2][0] == STX
            end = match.end() - is_stx  # rule 3
            self._lent = int(is_stx and frame is not None)
            frames.append(frame or CorruptFrame(match[0]))
        begun = _BEGUN.search(stream, end)
        kept = begun.start() if begun else len(stream)
        self._drop(kept - end)
        self.held = stream[kept:]
        return frames

    def _drop(self, count: int) -> None:
        if count:
            self.garbage += count - self._lent
            self._lent = 0


def _checked(match: re.Match[bytes]) -> Frame | None:
    """Return the frame if check byte and shape are correct, else None."""
    raw = match[0]
    return parse(match[1]) if check_byte(raw[:-1]) == raw[-1] else None
