"""`jbclog batch`, killed with SIGKILL at a chosen step: ``python tests/support faults.killed_batch
STEP batch ...``.

A step is what the executor leaves behind or does to others: a write, a sync, a new folder, a
rename, a process; it can be killed before each and after it. Nothing of this is in
the product, and the jobs, which are processes of their own, do not know of it.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


class Steps:
    """Counts, and kills this process when it is time."""

    def __init__(self, fatal: int) -> None:
        self._fatal = fatal
        self._done = 0

    def counted(self, call: Callable[P, R]) -> Callable[P, R]:
        def counting(*args: P.args, **kwargs: P.kwargs) -> R:
            self._step()
            result = call(*args, **kwargs)
            self._step()
            return result

        return counting

    def _step(self) -> None:
        self._done += 1
        if self._done == self._fatal:
            os.kill(os.getpid(), signal.SIGKILL)

    def arm(self) -> None:
        os.pwrite = self.counted(os.pwrite)
        os.fsync = self.counted(os.fsync)
        for name in ("mkdir", "replace"):
            setattr(Path, name, self.counted(getattr(Path, name)))
        subprocess.Popen.__init__ = self.counted(subprocess.Popen.__init__)  # type: ignore[method-assign]


def main() -> None:
    steps = Steps(int(sys.argv.pop(1)))
    from jbclog.cli import main as jbclog

    steps.arm()
    jbclog()


if __name__ == "__main__":
    main()
