"""The recorder as its guard sees it: the process that started it, alive or gone."""

from __future__ import annotations

import os
import select
import signal
import time
from contextlib import suppress

LOOK_S = 0.01


class Recorder:
    """Process `pid`, which has to be this one's parent: what is not any more has died, and its number may be another's.

    Where the system has no descriptors of processes, the parent's number tells as much: it changes when the parent dies.
    """

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._descriptor: int | None = None
        with suppress(AttributeError, OSError):
            self._descriptor = os.pidfd_open(pid)
        self._is_gone = not self._is_parent  # asked after opening: from here on the descriptor is the recorder's

    def end(self, grace_s: float, patience_s: float) -> bool:
        """See that it is gone, so that it holds no port: killed where it still lives after `grace_s`. Whether it is gone."""
        if self.is_gone_within(grace_s):
            return True
        self._kill()
        return self.is_gone_within(patience_s)

    @property
    def _is_parent(self) -> bool:
        return os.getppid() == self._pid

    def is_gone_within(self, seconds: float) -> bool:
        if self._descriptor is not None and not self._is_gone:
            watched = select.poll()
            watched.register(self._descriptor, select.POLLIN)
            self._is_gone = bool(watched.poll(seconds * 1000))
        end = time.monotonic() + seconds
        while self._descriptor is None and not self._is_gone and time.monotonic() < end:
            time.sleep(LOOK_S)
            self._is_gone = not self._is_parent
        return self._is_gone

    def _kill(self) -> None:
        with suppress(OSError):
            if self._descriptor is not None:
                signal.pidfd_send_signal(self._descriptor, signal.SIGKILL)
            elif self._is_parent:
                os.kill(self._pid, signal.SIGKILL)
