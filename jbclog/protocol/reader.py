"""Finds frames in a stream of bytes, however it is cut into chunks.

The rules:

1. A frame is STX, `SHORTEST` to `LONGEST` printable characters, ETX, and one byte of any value: the check byte can be
   STX, ETX, XON, XOFF or NUL. All else is garbage, an STX without such an end included.
2. Where the check byte or the shape does not hold, the frame is given as corrupt, and the search goes on behind it.
3. Where the check byte is an STX, the search goes on with it: it may begin the next frame, whose STX stands for a check
   byte that was lost. That holds for good frames too: their own check byte may be an STX, and be lost.
4. A frame is given with its last byte. Garbage is counted and dropped, and what is held for the next chunk can only be
   the beginning of a frame: `MOST_HELD` bytes at most.

So the first good frame behind any garbage is given, whatever the garbage was.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from jbclog.protocol.frame import STX, Frame, check_byte, parse

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
