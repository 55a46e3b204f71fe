"""A port that keeps what passes through it: every byte with its moment and direction."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Literal, NamedTuple

from jbclog.transport.port import Port


class Moved(NamedTuple):
    """Bytes that went one way at once. `at_s` is monotonic: after they were handed over, or had come."""

    at_s: float
    direction: Literal["sent", "heard"]
    data: bytes


class Tee:
    """A `Port` around a port. `keep` is called with each `Moved`, in the reading thread: a bounded deque's `append`, a file."""

    def __init__(self, port: Port, keep: Callable[[Moved], object], now: Callable[[], float] = time.monotonic) -> None:
        self._port = port
        self._keep = keep
        self._now = now

    @property
    def url(self) -> str:
        return self._port.url

    def fileno(self) -> int | None:
        return self._port.fileno()

    def write(self, data: bytes) -> None:
        self._port.write(data)
        self._keep(Moved(self._now(), "sent", data))

    def read_now(self) -> bytes:
        return self._heard(self._port.read_now())

    def read(self, timeout_s: float) -> bytes:
        return self._heard(self._port.read(timeout_s))

    def close(self) -> None:
        self._port.close()

    def _heard(self, data: bytes) -> bytes:
        if data:
            self._keep(Moved(self._now(), "heard", data))
        return data
