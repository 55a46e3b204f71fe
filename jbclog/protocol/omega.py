"""Frames of Apollo Seiko's OMEGA, and a reader that finds them in a stream (manual 003, 11.2).

::

    ┌─────┬──────────────────┬─────┬──────┬──────┐
    │ STX │    main text     │ ETX │ SUM  │ SUM  │
    │ 02h │ "A", "a0", "H…"  │ 03h │ high │ low  │
    └─────┴──────────────────┴─────┴──────┴──────┘
       1         1 to 64        1      1      1

SUM is the low eight bits of the sum of the text's characters, without STX and ETX, as two capital
hexadecimal digits. The controller ignores a frame with a wrong SUM.

The reader's rules are those of JBC's (`frame.py`); an STX in place of a digit of the SUM begins the
next frame.
"""

from __future__ import annotations

import re

from jbclog.protocol.frame import CorruptFrame

# the longest known text has 51 characters: D or c and a condition record
# (docs/reference/protocol.md)
LONGEST = 64
MOST_HELD = 1 + LONGEST + 2
ASKING = "ABCFG"  # first letters of texts that only read; D writes a condition, H runs one

_FRAME = re.compile(rb"\x02([ -~]{1,%d})\x03([^\x02][^\x02]|[^\x02]?(?=\x02))" % LONGEST, re.DOTALL)
_BEGUN = re.compile(
    rb"\x02(?:[ -~]{0,%d}|[ -~]{1,%d}\x03[^\x02]?)\Z" % (LONGEST, LONGEST), re.DOTALL
)


def sum_of(text: bytes) -> bytes:
    """Return the two characters after ETX: ``F1`` for ``K12C``."""
    return b"%02X" % (sum(text) & 0xFF)


def encode(text: str) -> bytes:
    """Encode a frame with this main text. Raises `ValueError` if it is not allowed."""
    if not 1 <= len(text) <= LONGEST or not all(" " <= c <= "~" for c in text):
        raise ValueError(f"{text!r} is not 1 to {LONGEST} characters of printable ASCII")
    content = text.encode()
    return b"\x02%s\x03%s" % (content, sum_of(content))


def only_reads(data: bytes) -> bool:
    """Return True if `data` is exactly one complete read with a correct SUM."""
    match = _FRAME.fullmatch(data)
    return match is not None and match[2] == sum_of(match[1]) and chr(match[1][0]) in ASKING


class OmegaReader:
    """Finds frames in chunks of bytes and returns their main texts.

    `corrupt` counts the frames with a wrong SUM, `garbage` the bytes outside of any frame.
    """

    def __init__(self) -> None:
        self._held = b""
        self.corrupt = 0
        self.garbage = 0

    def reset(self) -> int:
        """Drop the kept bytes and return their number."""
        forgotten = len(self._held)
        self.garbage += forgotten
        self._held = b""
        return forgotten

    def feed(self, chunk: bytes) -> list[str | CorruptFrame]:
        """Return the texts of frames, and the corrupt frames, that `chunk` completes, in order."""
        stream = self._held + chunk
        texts: list[str | CorruptFrame] = []
        end = 0  # of the last frame
        while match := _FRAME.search(stream, end):
            self.garbage += match.start() - end
            end = match.end()
            texts.append(self._checked(match))
        begun = _BEGUN.search(stream, end)
        kept = begun.start() if begun else len(stream)
        self.garbage += kept - end
        self._held = stream[kept:]
        return texts

    def _checked(self, match: re.Match[bytes]) -> str | CorruptFrame:
        if match[2] == sum_of(match[1]):
            return match[1].decode("ascii")
        self.corrupt += 1
        return CorruptFrame(match[0])
