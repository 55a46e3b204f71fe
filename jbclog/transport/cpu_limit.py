"""End a process whose interpreter is stuck.

If CPython gets no memory while it handles an exception, it may loop in C forever: no Python code,
thread or signal handler runs. So the system ends the process (SIGPROF) after a limit of CPU time
without any Python code. Its parent notices; a guard takes over a recorder's stations, and another
guard replaces a guard.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock, Thread
from typing import Final

LIMIT_S: Final = 10.0  # of CPU time, all threads together
RENEW_S: Final = 1.0


@contextmanager
def cpu_limit(seconds: float = LIMIT_S, every_s: float = RENEW_S) -> Iterator[None]:
    """Enforce the limit inside the ``with``; a thread renews it as long as Python code runs."""
    # no `Event`: if its `wait` is refused memory, its own lock stays held forever
    ending = Lock()
    ending.acquire()

    def renew() -> None:
        is_over = False
        while not is_over:
            try:
                signal.setitimer(signal.ITIMER_PROF, seconds)
                is_over = ending.acquire(timeout=every_s)
            except MemoryError:
                time.sleep(every_s)  # needs no memory

    thread = Thread(target=renew, name="jbclog-cpu-limit", daemon=True)
    with suppress(RuntimeError, MemoryError):  # no thread available: run without a limit
        thread.start()
    try:
        yield
    finally:
        ending.release()
        if thread.ident is not None:
            thread.join()
        signal.setitimer(signal.ITIMER_PROF, 0.0)
