"""Events that people have not been shown yet: they wait until the disk has been asked to keep them.

What a person has read must be in the record, also when the recorder is killed the moment after.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from jbclog.core.rows import EventRow

OnEvent = Callable[[EventRow], None]


class PendingEvents:
    """Holds events in their order; `show` is given each once. Callers may be in any thread."""

    def __init__(self, show: OnEvent | None) -> None:
        self._show = show
        self._waiting: deque[EventRow] = deque()
        self._lock = threading.Lock()
        self._shown = 0

    def add(self, event: EventRow) -> None:
        with self._lock:
            self._waiting.append(event)

    @property
    def count(self) -> int:
        """How many there have been so far."""
        with self._lock:
            return self._shown + len(self._waiting)

    def show_first(self, count: int) -> None:
        """Show what of the first `count` has not been shown. An observer that fails must not become a fault of the record."""
        with self._lock:
            while self._waiting and self._shown < count:
                event = self._waiting.popleft()
                self._shown += 1
                if self._show is not None:
                    with suppress(Exception):
                        self._show(event)
