"""An observer told in a thread of its own: a terminal that is held (Ctrl-S), or a pipe that nobody reads, must not hold the run.

A run that stands still for two seconds is ended by its guard; so nothing that people are told may make it wait.
"""

from __future__ import annotations

import select
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import Full, Queue
from typing import TYPE_CHECKING, Final

from jbclog.core.rows import EventRow

if TYPE_CHECKING:
    from jbclog.cli.progress import Lines, Screen
    from jbclog.session.run.context import SessionContext

STDERR: Final = 2
WAITING_MOST: Final = 1000  # what is told while nobody listens; the record has it all
LOOK_S: Final = 0.2
CLOSE_S: Final = 2.0

Told = Callable[[], None]


class BackgroundObserver:
    """Tells `observer` what a run tells, as soon as stderr takes it. Ends with `close`."""

    def __init__(self, observer: Lines | Screen) -> None:
        self._observer = observer
        self._waiting: Queue[Told | None] = Queue(WAITING_MOST)
        self._is_closing = False
        self._is_held = False
        self._dropped = 0
        self._thread = threading.Thread(target=self._tell_on, name="observer", daemon=True)
        self._thread.start()

    def begun(self, folder: Path) -> None:
        self._tell(lambda: self._observer.begun(folder))

    def happened(self, event: EventRow) -> None:
        self._tell(lambda: self._observer.happened(event))

    def second(self, contexts: list[SessionContext]) -> None:
        if self._waiting.empty():  # a table that is not seen need not be made
            self._tell(lambda: self._observer.second(contexts))

    def sealing(self) -> None:
        self._tell(self._observer.sealing)

    def missed(self) -> int:
        """How many of the things that it was told it could not show so far."""
        return self._dropped + (self._waiting.qsize() + 1 if self._is_held else 0)

    def close(self) -> None:
        """Let what waits be told, if it can be; then no more."""
        end = time.monotonic() + CLOSE_S
        for last in (self._observer.close, None):
            with suppress(Full):
                self._waiting.put(last, timeout=max(end - time.monotonic(), 0.0))
        self._thread.join(max(end - time.monotonic(), 0.0))
        self._is_closing = True

    def _tell(self, told: Told) -> None:
        try:
            self._waiting.put_nowait(told)
        except Full:
            self._dropped += 1

    def _tell_on(self) -> None:
        while (told := self._waiting.get()) is not None:
            while not _takes_text() and not self._is_closing:
                self._is_held = True
            self._is_held = False
            if self._is_closing:
                continue
            try:
                told()
            except Exception:  # a terminal that is gone must not become a fault of the run
                self._dropped += 1


def _takes_text() -> bool:
    """Whether stderr takes some text within `LOOK_S`; one that is closed takes any."""
    watched = select.poll()
    watched.register(STDERR, select.POLLOUT)
    return bool(watched.poll(LOOK_S * 1000))
