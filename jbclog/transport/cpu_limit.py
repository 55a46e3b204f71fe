"""An end for a process whose interpreter can do nothing any more.

CPython that is refused all memory while it handles an exception may repeat one step without end: no line of this program runs then,
no other thread, no handler of a signal. So such a process is ended by the system (SIGPROF) once it has used so much processor
time without a line of Python: whoever waits for it sees that it has died. A guard takes its lines over, or another guard its place.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Event, Thread
from typing import Final

LIMIT_S: Final = 10.0  # of processor time, all threads together
RENEW_S: Final = 1.0


@contextmanager
def cpu_limit(seconds: float = LIMIT_S, every_s: float = RENEW_S) -> Iterator[None]:
    """Within it the limit holds, and is set anew while lines of Python run, in whichever thread; afterwards there is none."""
    over = Event()

    def go_on() -> None:
        is_over = False
        while not is_over:
            try:
                signal.setitimer(signal.ITIMER_PROF, seconds)
                is_over = over.wait(every_s)
            except MemoryError:
                time.sleep(every_s)  # which needs none

    thread = Thread(target=go_on, name="jbclog-cpu-limit", daemon=True)
    with suppress(RuntimeError, MemoryError):  # no thread to be had: then without a limit
        thread.start()
    try:
        yield
    finally:
        over.set()
        if thread.ident is not None:
            thread.join()
        signal.setitimer(signal.ITIMER_PROF, 0.0)
