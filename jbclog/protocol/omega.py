"""One frame of Apollo Seiko's OMEGA and the reader that finds them in a stream (manual 003, 11.2).

::

    ┌─────┬──────────────────┬─────┬──────┬──────┐
    │ STX │    main text     │ ETX │ SUM  │ SUM  │
    │ 02h │ "A", "a0", "H…"  │ 03h │ high │ low  │
    └─────┴──────────────────┴─────┴──────┴──────┘
       1         1 to 64        1      1      1

SUM is the low eight bits of the sum of the text's characters, without STX and ETX, as two hexadecimal digits in capitals.
The controller drops a frame whose SUM is wrong without a word.

The reader's rules are those of JBC's (`frame.py`): what is not framed is garbage, what is framed and does not hold is given as
corrupt, and an STX where a digit of the SUM belongs begins the next frame.
"""

from __future__ import annotations

import re

from jbclog.protocol.frame import Corrupt

LONGEST = 64  # the longest that is known has 51: D or c and a condition record (docs/reference/protocol.md)
MOST_HELD = 1 + LONGEST + 2
ASKING = "ABCFG"  # the first letters of texts that ask and change nothing; D writes a condition, H runs one

_FRAME = re.compile(rb"\x02([ -~]{1,%d})\x03([^\x02][^\x02]|[^\x02]?(?=\x02))" % LONGEST, re.DOTALL)
_BEGUN = re.compile(rb"\x02(?:[ -~]{0,%d}|[ -~]{1,%d}\x03[^\x02]?)\Z" % (LONGEST, LONGEST), re.DOTALL)


def sum_of(text: bytes) -> bytes:
    """The two characters behind ETX: ``F1`` for ``K12C``."""
    return b"%02X" % (sum(text) & 0xFF)


def encode(text: str) -> bytes:
    """The bytes on the wire of a frame with this main text. Raises `ValueError` where it can be none."""
    if not 1 <= len(text) <= LONGEST or not all(" " <= c <= "~" for c in text):
        raise ValueError(f"{text!r} is not 1 to {LONGEST} characters of printable ASCII")
    content = text.encode()
    return b"\x02%s\x03%s" % (content, sum_of(content))


def only_reads(data: bytes) -> bool:
    """Whether `data` is one whole frame that asks, its SUM good, and nothing before or behind it."""
    match = _FRAME.fullmatch(data)
    return match is not None and match[2] == sum_of(match[1]) and chr(match[1][0]) in ASKING


class OmegaReader:
    """Feed it bytes; it gives the main texts of the frames in them.

    `corrupt` counts the frames whose SUM does not hold, `garbage` the bytes that belonged to no frame, good or corrupt.
    """

    def __init__(self) -> None:
        self._held = b""
        self.corrupt = 0
        self.garbage = 0

    def reset(self) -> int:
        """Forget what is held, as after a drain; give how many bytes that were."""
        forgotten = len(self._held)
        self.garbage += forgotten
        self._held = b""
        return forgotten

    def feed(self, chunk: bytes) -> list[str | Corrupt]:
        """What `chunk` completes, in order: texts of frames, and what was framed like one and does not hold."""
        stream = self._held + chunk
        found: list[str | Corrupt] = []
        place = 0
        while match := _FRAME.search(stream, place):
            self.garbage += match.start() - place
            place = match.end()
            found.append(self._checked(match))
        begun = _BEGUN.search(stream, place)
        kept = begun.start() if begun else len(stream)
        self.garbage += kept - place
        self._held = stream[kept:]
        return found

    def _checked(self, match: re.Match[bytes]) -> str | Corrupt:
        if match[2] == sum_of(match[1]):
            return match[1].decode("ascii")
        self.corrupt += 1
        return Corrupt(match[0])
