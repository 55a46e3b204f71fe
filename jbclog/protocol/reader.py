"""Finds frames in a stream of bytes, however it is cut into chunks.

The rules, in the order in which they are tried:

1. Bytes before an STX are garbage.
2. Between STX and ETX stand printable characters. An STX there begins anew; any other control character,
   or more than `LONGEST` characters, makes all of it garbage.
3. The one byte behind ETX is the check byte, whatever it is: STX, ETX, XON, XOFF and NUL all occur.
4. Where the check byte does not hold, the frame is reported as corrupt, and the search goes on at the
   first byte that could begin a frame: the check byte itself, when that is an STX.

Garbage is counted and dropped; the reader never holds more than one longest frame.
"""

from __future__ import annotations

from dataclasses import dataclass

from jbclog.protocol.frame import ETX, STX, Frame, check_byte, parse

LONGEST = 64  # characters between STX and ETX; the longest printed answer has 26 (R-DLx, seed 002)


@dataclass(frozen=True, slots=True)
class Corrupt:
    """Something framed like a frame whose check byte or shape does not hold; `raw` is all of it."""

    raw: bytes


class FrameReader:
    """Feed it bytes; it gives the frames in them. `garbage` counts the bytes that belonged to none."""

    def __init__(self) -> None:
        self._held = b""
        self.garbage = 0

    def reset(self) -> int:
        """Forget what is held, as after a drain; give how many bytes that were."""
        forgotten = len(self._held)
        self.garbage += forgotten
        self._held = b""
        return forgotten

    def feed(self, chunk: bytes) -> list[Frame | Corrupt]:
        """All frames, good and corrupt, that `chunk` completes, in order."""
        self._held += chunk
        found: list[Frame | Corrupt] = []
        while (frame := self._next()) is not None:
            found.append(frame)
        return found

    def _next(self) -> Frame | Corrupt | None:
        while True:
            self._drop_to_stx()
            end = self._end_of_content()
            if end is None:
                return None
            if end > 0:
                return self._take(end)

    def _drop_to_stx(self) -> None:
        start = self._held.find(STX)
        unwanted = len(self._held) if start < 0 else start
        self._drop(unwanted)

    def _drop(self, count: int) -> None:
        self.garbage += count
        self._held = self._held[count:]

    def _end_of_content(self) -> int | None:
        """Where ETX stands; None to wait for more bytes; 0 when what was held was garbage and is dropped."""
        for place in range(1, len(self._held)):
            byte = self._held[place]
            if byte == ETX:
                return place if place + 1 < len(self._held) else None
            if not 0x20 <= byte <= 0x7E:
                self._drop(place if byte == STX else place + 1)
                return 0
            if place > LONGEST:
                self._drop(place)
                return 0
        return None

    def _take(self, end: int) -> Frame | Corrupt:
        raw = self._held[: end + 2]
        good = check_byte(raw[:-1]) == raw[-1]
        frame = parse(raw[1:end]) if good else None
        again_at_check_byte = not good and raw[-1] == STX
        self._held = self._held[end + 1 if again_at_check_byte else end + 2 :]
        return frame if frame is not None else Corrupt(raw)
