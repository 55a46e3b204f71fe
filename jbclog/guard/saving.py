"""One station's rescue, by a thread of its own; where none begins, by whoever asked for it.

`threading.Thread.start` waits until the thread has begun, for ever where the thread was refused memory before it could say so.
"""

from __future__ import annotations

import _thread
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final

BEGUN_S: Final = 0.5  # that a thread may take to begin on a busy machine; both may begin, one does it
LOOK_S: Final = 0.005


class Saving:
    """`save`, done once."""

    def __init__(self, save: Callable[[], None]) -> None:
        self._save = save
        self._taken = _thread.allocate_lock()
        self._going_on = _thread.allocate_lock()
        self._going_on.acquire()

    def begin(self) -> None:
        """Have it done in a thread; does not wait for that."""
        with suppress(RuntimeError, MemoryError):
            _thread.start_new_thread(self._do, ())

    def do_unless_begun(self) -> None:
        """Do it here where no thread has begun within `BEGUN_S`."""
        end = time.monotonic() + BEGUN_S
        while not self._taken.locked() and time.monotonic() < end:
            time.sleep(LOOK_S)
        self._do()

    def await_done(self, seconds: float) -> None:
        """Wait until it is done, or time is up."""
        self._going_on.acquire(timeout=seconds)

    def _do(self) -> None:
        if self._taken.acquire(blocking=False):
            try:
                self._save()
            finally:
                self._going_on.release()
