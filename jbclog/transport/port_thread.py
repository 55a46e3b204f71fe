"""Read ports without a descriptor to watch (rfc2217, Windows) in a thread."""

from __future__ import annotations

import threading
from collections.abc import Callable

from jbclog.core.errors import LinkError
from jbclog.transport.event_loop import EventLoop
from jbclog.transport.port import Port

PUMP_S = 0.2  # interval at which the thread checks whether to stop


class Pump:
    """A thread that reads a port and passes its bytes to the loop, one piece at a time.

    It reads the next piece once the loop has taken the last one and `rest` has not paused it.
    """

    def __init__(
        self, loop: EventLoop, port: Port, take: Callable[[Pump, bytes, LinkError | None], None]
    ) -> None:
        self._loop = loop
        self._port = port
        self._take = take
        self._wanted = True
        self._rests = False
        self._may_read = threading.Event()
        threading.Thread(target=self._read, name="read-port", daemon=True).start()

    def stop(self) -> None:
        self._wanted = False
        self._may_read.set()

    def rest(self) -> None:
        """Pause reading until `resume`; call this while taking a piece."""
        self._rests = True

    def resume(self) -> None:
        self._rests = False
        self._may_read.set()

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

    def _taken(self, data: bytes, error: LinkError | None) -> None:
        self._take(self, data, error)
        if not self._rests:
            self._may_read.set()

    def _hand_over(self, data: bytes, error: LinkError | None) -> None:
        self._may_read.clear()
        try:
            self._loop.call_soon_threadsafe(self._taken, data, error)
        except RuntimeError:  # the loop is closed: the run is over
            self._wanted = False
        while self._wanted and not self._may_read.wait(PUMP_S):
            pass  # a stopped loop takes nothing
