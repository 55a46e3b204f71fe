"""Refuses memory once, at each request in turn, to a part of the guard that must outlive it:
``refused_once.py PART FOLDER``.

Runs below `failing_alloc.c`. Prints the requests after which the part did not do its work; a part
that waits for ever is ended by SIGALRM.
"""

from __future__ import annotations

import mmap
import os
import signal
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from support.product import ActionLog, LeaseWriter, StationLease, cpu_limit, read_leases

PATIENCE_S = 5
SOON_S = 0.5
EVERY_S = 0.002
# made before: a test that is refused memory proves nothing
NUMBERS = [struct.pack("q", number) for number in range(1000)]
LEASE = StationLease(
    "dde-1", "/dev/null", 9600, "8N1", None, "dde", "DDE", "1", "sleep", (1,), False
)


class Refusals:
    """The page that this process shares with the library."""

    def __init__(self, folder: Path) -> None:
        with (folder / str(os.getpid())).open("r+b") as file:
            self._page = mmap.mmap(file.fileno(), 32)

    def begin(self, nth: bytes) -> None:
        self._page[8:16] = NUMBERS[1]
        self._page[0:8] = nth

    def end(self) -> None:
        try:
            self._page[0:8] = NUMBERS[0]
        except MemoryError:  # it was due here
            self._page[0:8] = NUMBERS[0]


def lease_writer(refusals: Refusals, nth: int, folder: Path) -> bool:
    """Whether leases are still written after the refusal."""
    writer = LeaseWriter(folder, ActionLog(folder))
    refused, then = [replace(LEASE, model=f"refused-{nth}")], [replace(LEASE, model=f"then-{nth}")]
    try:
        refusals.begin(NUMBERS[nth])
        writer.put(refused)
        writer.settle(SOON_S)
    except Exception:  # the guard's main thread is replaced then; its writer is what is looked at
        pass
    refusals.end()
    writer.put(then)
    writer.settle(SOON_S)
    return read_leases(folder) == then


def limit(refusals: Refusals, nth: int, _: Path) -> bool:
    """Whether the limit ends."""
    with cpu_limit(every_s=EVERY_S):
        time.sleep(2 * EVERY_S)
        refusals.begin(NUMBERS[nth])
        time.sleep(5 * EVERY_S)
        refusals.end()
    return True


PARTS: dict[str, tuple[Callable[[Refusals, int, Path], bool], int]] = {
    "lease_writer": (lease_writer, 60),
    "limit": (limit, 40),
}


def main(part: str, folder: Path) -> None:
    works, most = PARTS[part]
    refusals = Refusals(folder)
    failed = []
    for nth in range(1, most):
        child = os.fork()
        if not child:
            signal.alarm(PATIENCE_S)
            os._exit(not works(refusals, nth, folder))
        if os.waitpid(child, 0)[1]:
            failed.append(nth)
        refusals.end()
    print(failed)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
