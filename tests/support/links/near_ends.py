"""Ports for tests of drivers, that answer at once: real descriptors, or none, and no device behind
them.
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable

from support.product import MOST_AT_ONCE, LinkError

Reply = Callable[[bytes], bytes]


class PairPort:
    """One end of a pair of sockets. What is written is answered by `reply` at once; `far` is the
    other end.
    """

    def __init__(
        self, reply: Reply = lambda question: question[::-1], *, close_s: float = 0.0
    ) -> None:
        self.near, self.far = socket.socketpair()
        self.near.setblocking(False)
        self.written: list[bytes] = []
        self.is_closed = False
        self._reply = reply
        self._close_s = close_s

    def fileno(self) -> int | None:
        return self.near.fileno()

    def write(self, data: bytes) -> None:
        self.written.append(data)
        try:
            answer = self._reply(data)
            if answer:
                self.far.send(answer)
            self.near.send(b"")
        except OSError as error:
            raise LinkError("gone") from error

    def read_now(self) -> bytes:
        try:
            data = self.near.recv(MOST_AT_ONCE)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise LinkError("gone") from error
        if not data:
            raise LinkError("hung up")
        return data

    def read(self, timeout_s: float) -> bytes:
        if self.is_closed:
            raise LinkError("closed")
        try:
            came = select.select([self.near], [], [], timeout_s)[0]
        except (OSError, ValueError) as error:  # another thread has closed it meanwhile
            raise LinkError("closed") from error
        return self.read_now() if came else b""

    def close(self) -> None:
        time.sleep(self._close_s)
        self.is_closed = True
        self.near.close()
        self.far.close()

    def unplug(self) -> None:
        self.far.close()


class ThreadedPort(PairPort):
    """The same without a descriptor that could be watched, as on Windows or behind rfc2217."""

    def fileno(self) -> int | None:
        return None
