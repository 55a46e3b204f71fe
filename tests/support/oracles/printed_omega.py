"""An OMEGA that knows no more than manual 003, 11 prints: A, which it answers with a. Written from
that page alone.

It reads byte by byte: STX, the main text, ETX, then two characters of SUM, whatever they are. So
the end of a JBC frame, which has one character there, takes the STX of the next frame for its
second, and that frame is lost.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from support.links.far_ends import Terminal, terminal
from support.product import Reply

STX, ETX = 0x02, 0x03
CHARACTER_S = 10 / 9600


class PageOmega:
    """`answer` is the main text of its answers; `delay_s` is what it takes before one. `texts` is
    what it took as frames.
    """

    def __init__(self, answer: str = "a", delay_s: float = 0.02) -> None:
        self.answer = answer
        self.delay_s = delay_s
        self.heard = b""
        self.texts: list[str] = []
        self._text: bytearray | None = None
        self._sum: bytearray | None = None
        self.is_gone = False

    def receive(self, data: bytes, now: float) -> list[Reply]:
        """What it says to these bytes, and when that is whole."""
        self.heard += data
        at = now + len(data) * CHARACTER_S + self.delay_s
        answer = self._framed()
        return [
            Reply(at + len(answer) * CHARACTER_S, answer)
            for byte in data
            if self._takes(byte) and not self.is_gone
        ]

    def is_unplugged(self, now: float) -> bool:
        return False

    def _framed(self) -> bytes:
        text = self.answer.encode()
        return b"\x02" + text + b"\x03" + f"{sum(text) % 256:02X}".encode()

    def _takes(self, byte: int) -> bool:
        """Whether this byte completes a question that it answers."""
        if self._sum is not None:
            self._sum.append(byte)
            return len(self._sum) == 2 and self._ends()
        if byte == STX:
            self._text = bytearray()
        elif byte == ETX and self._text is not None:
            self._sum = bytearray()
        elif self._text is not None:
            self._text.append(byte)
        return False

    def _ends(self) -> bool:
        assert self._text is not None
        assert self._sum is not None
        text, told = bytes(self._text), bytes(self._sum)
        self._text = self._sum = None
        if told != f"{sum(text) % 256:02X}".encode():
            return False
        self.texts.append(text.decode("ascii", "replace"))
        return text == b"A"


@contextmanager
def served(controller: PageOmega) -> Iterator[Terminal]:
    """The controller behind a real pseudo-terminal."""
    over = threading.Event()

    def serve(far: Terminal) -> None:
        while not over.is_set():
            if not select.select([far.far], [], [], 0.05)[0]:
                continue
            try:
                data = os.read(far.far, 4096)
            except OSError:  # no client just now
                over.wait(0.01)
                continue
            for at, answer in controller.receive(data, time.monotonic()):
                over.wait(max(at - time.monotonic(), 0))
                os.write(far.far, answer)

    with terminal() as far:
        os.set_blocking(far.far, False)
        thread = threading.Thread(target=serve, args=(far,))
        thread.start()
        try:
            yield far
        finally:
            over.set()
            thread.join()
