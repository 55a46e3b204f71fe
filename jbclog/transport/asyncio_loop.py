"""asyncio's event loop for the reactor, where the system has no epoll."""

from __future__ import annotations

import asyncio

from jbclog.core import clock
from jbclog.transport.event_loop import Ring


class AsyncioLoop(asyncio.SelectorEventLoop):
    """An `EventLoop` (`event_loop.py`)."""

    def __init__(self) -> None:
        super().__init__()
        self._error: Exception | None = None
        self.set_exception_handler(self._on_error)

    def time(self) -> float:
        """Return monotonic seconds, including suspension of the machine."""
        return clock.elapsed()

    def wake_at(self, moment: float, ring: Ring) -> None:
        self.call_at(moment, ring, moment)

    def run_forever(self) -> None:
        super().run_forever()
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _on_error(self, _loop: asyncio.AbstractEventLoop, context: dict[str, object]) -> None:
        """Keep the exception of a callback and stop; asyncio would only log it."""
        error = context.get("exception")
        self._error = self._error or (
            error if isinstance(error, Exception) else RuntimeError(str(context.get("message")))
        )
        self.stop()
