"""jbclog on a disk that takes 1.5 s for each sync:
``python tests/support faults.slow_disk SECONDS run ...``.

For SECONDS from the first commit on each commit and each sync waits so long, as the writer's thread
would wait in fsync: without holding up any other thread by itself. Nothing of this is in the
product: what it calls is patched.
"""

from __future__ import annotations

import os
import sys
import time

from support.product import StoreWriter, command_main, put

STALL_S = 1.5


def make_slow(seconds: float) -> None:
    """Have this process wait for its disk."""
    add, fsync, end = StoreWriter.add, os.fsync, 0.0

    def wait() -> None:
        if time.monotonic() < end:
            time.sleep(STALL_S)

    def adding(self: StoreWriter, *arguments: object) -> object:
        nonlocal end
        end = end or time.monotonic() + seconds
        wait()
        return add(self, *arguments)  # type: ignore[arg-type]  # handed on as they are

    def syncing(descriptor: int) -> None:
        wait()
        fsync(descriptor)

    put("StoreWriter.add", adding)  # the same but for the wait
    os.fsync = syncing  # type: ignore[assignment]


if __name__ == "__main__":
    make_slow(float(sys.argv.pop(1)))
    command_main()
