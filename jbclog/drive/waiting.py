"""Waits that end when they should: epoll counts whole milliseconds and rounds up, which is late by half of one each time.

Where the selector is epoll, the rest of a wait has select(), which counts microseconds and can watch one descriptor:
epoll's own.
"""

from __future__ import annotations

import select
import selectors
import sys

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
