"""Waits for many descriptors, exactly: epoll counts whole milliseconds, and a paced wire needs less than one.

Where the selector is epoll, the last word has select(), which counts microseconds and can watch one
descriptor: epoll's own. A question that comes meanwhile is heard at once. Where the system lets it, timers
are exact to the nanosecond instead of 50 µs, and a long wait aims `LEAD_S` before its end, because a processor
that has slept for long needs about as much to wake.
"""

from __future__ import annotations

import ctypes
import os
import select
import selectors
import sys
from collections.abc import Callable
from time import monotonic

Ready = Callable[[float], None]
"""Called with the moment (monotonic seconds) at which there was something to read."""

MOST_FOR_SELECT = 1024  # a selector that is made first has a low number
LEAD_S = 40e-6
LONG_S = 1e-3
PR_SET_TIMERSLACK = 29


def exact_timers() -> None:
    """Ask Linux to end this thread's waits when they end, and not up to 50 µs later."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)


class Waiter:
    """Descriptors, and what to call when there is something to read on each."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        epoll = isinstance(self._selector, getattr(selectors, "EpollSelector", ()))
        self._coarse = epoll and self._selector.fileno() < MOST_FOR_SELECT
        self._wake_read, self._wake_write = os.pipe()
        os.set_blocking(self._wake_write, False)
        self.add(self._wake_read, self._awake)

    def add(self, descriptor: int, ready: Ready) -> None:
        self._selector.register(descriptor, selectors.EVENT_READ, ready)

    def remove(self, descriptor: int) -> None:
        self._selector.unregister(descriptor)

    def wait(self, seconds: float | None) -> None:
        """Wait until something can be read or `seconds` have nearly gone by, and call whoever is concerned.

        Who is called removes no descriptor but its own.
        """
        if self._coarse and seconds is not None:
            aim = seconds - LEAD_S if seconds > LONG_S else max(seconds, 0.0)
            if not select.select([self._selector], [], [], aim)[0]:
                return
            seconds = 0.0
        found = self._selector.select(seconds)
        now = monotonic()
        for key, _ in found:
            key.data(now)

    def wake(self) -> None:
        """End a wait, from a signal handler or another thread."""
        os.write(self._wake_write, b".")

    def close(self) -> None:
        self._selector.close()
        os.close(self._wake_read)
        os.close(self._wake_write)

    def _awake(self, _now: float) -> None:
        os.read(self._wake_read, 4096)
