"""A port that notes what passes through it: every byte with its moment and direction, and every change of the link."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Literal, Self

from jbclog.core.errors import LinkError
from jbclog.core.wire_capture import Passed
from jbclog.transport.port import Port, unread

Keep = Callable[[Passed], object]


class Tee:
    """A `Port` around a port. `keep` is called in the thread that moves the bytes: a bounded deque's `append`.

    A question is noted before it is handed over, so that it stands before its answer whoever reads that. What was read is noted
    to the byte; what had come and was not read when the port is closed is counted there.
    """

    def __init__(self, port: Port, keep: Keep, now: Callable[[], float] = time.monotonic) -> None:
        self._port = port
        self._keep = keep
        self._now = now
        self._is_there = True

    @classmethod
    def opened(cls, open_port: Callable[[], Port], keep: Keep, now: Callable[[], float] = time.monotonic) -> Self:
        """Open a port and note that, or why it could not be opened, which is raised as it came."""
        try:
            port = open_port()
        except LinkError as error:
            keep(Passed(now(), "failed", text=str(error)))
            raise
        keep(Passed(now(), "opened", text=port.url))
        return cls(port, keep, now)

    @property
    def url(self) -> str:
        return self._port.url

    def fileno(self) -> int | None:
        return self._port.fileno()

    def write(self, data: bytes) -> None:
        self._keep(Passed(self._now(), "sent", data))
        try:
            self._port.write(data)
        except LinkError as error:
            self._end("lost", str(error))
            raise

    def read_now(self) -> bytes:
        return self._heard(self._port.read_now)

    def read(self, timeout_s: float) -> bytes:
        return self._heard(lambda: self._port.read(timeout_s))

    def close(self) -> None:
        left = unread(self._port.fileno()) if self._is_there else 0
        self._end("closed", f"{left} bytes that had come were not read" if left else "")
        self._port.close()

    def _heard(self, read: Callable[[], bytes]) -> bytes:
        try:
            data = read()
        except LinkError as error:
            self._end("lost", str(error))
            raise
        if data:
            self._keep(Passed(self._now(), "heard", data))
        return data

    def _end(self, how: Literal["lost", "closed"], text: str = "") -> None:
        """Note the end of the link, once: a port that was lost is closed as well."""
        if self._is_there:
            self._is_there = False
            self._keep(Passed(self._now(), how, text=text))
