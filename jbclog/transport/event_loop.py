"""What the reactor adds to asyncio's loop: exact waits, and cheap watching of many ports.

Waits that end when they should: epoll counts whole milliseconds and rounds up, which is late by half of one each time.

Where the selector is epoll, the rest of a wait has select(), which counts microseconds and can watch one descriptor:
epoll's own.
"""

from __future__ import annotations

import asyncio
import select
import selectors
import sys
from collections.abc import Callable

WATCHED_BY_SELECT = 1024  # descriptors from here on select() cannot watch

if sys.platform == "linux":

    class _ExactEpoll(selectors.EpollSelector):
        def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
            """What is ready, or nothing at the end of `timeout` seconds, or nothing before: asyncio asks again for the rest."""
            if timeout is None or timeout <= 0 or self.fileno() >= WATCHED_BY_SELECT:
                return super().select(timeout)
            whole_ms = int(timeout * 1000)
            if whole_ms:
                return super().select((whole_ms - 0.5) / 1000)  # which it rounds up
            return super().select(0) if select.select([self], [], [], timeout)[0] else []


def exact_selector() -> selectors.BaseSelector | None:
    """A selector for asyncio's loop; None for the loop's own where that is exact enough."""
    return _ExactEpoll() if sys.platform == "linux" else None


class Readers:
    """Calls back for every descriptor that has something to read.

    Where there is epoll, asyncio watches one descriptor only: an epoll of ours with all the others in it. A handle, a
    context and a list entry for each answer would cost as much as reading it.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._ready: dict[int, Callable[[], None]] = {}
        self._epoll = select.epoll() if sys.platform == "linux" else None
        if self._epoll is not None:
            loop.add_reader(self._epoll.fileno(), self._call_ready)

    def add(self, descriptor: int, ready: Callable[[], None]) -> None:
        """Call `ready` in the loop's thread whenever `descriptor` can be read, or is broken."""
        if self._epoll is None:
            self._loop.add_reader(descriptor, ready)
            return
        self._epoll.register(descriptor, select.EPOLLIN)
        self._ready[descriptor] = ready

    def remove(self, descriptor: int) -> None:
        """Before it is closed."""
        if self._epoll is None:
            self._loop.remove_reader(descriptor)
            return
        del self._ready[descriptor]
        self._epoll.unregister(descriptor)

    def close(self) -> None:
        """Before the loop is closed."""
        if self._epoll is not None:
            self._loop.remove_reader(self._epoll.fileno())
            self._epoll.close()

    def _call_ready(self) -> None:
        if self._epoll is None:
            return
        for descriptor, _ in self._epoll.poll(0):
            ready = self._ready.get(descriptor)  # one of those called before may have taken it out
            if ready is not None:
                ready()
