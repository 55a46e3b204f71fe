"""Ports without a descriptor to watch (rfc2217, Windows): a thread reads and hands its bytes over; the session does not know."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

from jbclog.drive.blocking import Port
from jbclog.errors import LinkError

PUMP_S = 0.2  # how often a reading thread looks whether it is still wanted


class Pump:
    """A thread that reads a port without a descriptor and hands its bytes to the loop."""

    def __init__(self, loop: asyncio.AbstractEventLoop, port: Port, take: Callable[[Pump, bytes, LinkError | None], None]) -> None:
        self._loop = loop
        self._port = port
        self._take = take
        self._wanted = True
        threading.Thread(target=self._read, name="read-port", daemon=True).start()

    def stop(self) -> None:
        self._wanted = False

    def _read(self) -> None:
        while self._wanted:
            data, error = b"", None
            try:
                data = self._port.read(PUMP_S)
            except LinkError as broken:
                error = broken
            if (data or error) and self._wanted:
                self._hand_over(data, error)
            if error:
                return

    def _hand_over(self, data: bytes, error: LinkError | None) -> None:
        try:
            self._loop.call_soon_threadsafe(self._take, self, data, error)
        except RuntimeError:  # the loop is closed: the run is over
            self._wanted = False
