"""One guard for a run's folder, and never a second: a lock of the system that ends with its holder."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from jbclog.core.errors import RecordError
from jbclog.core.locks import try_lock

NAME: Final = "guard.lock"
AGAIN_S: Final = 0.02


@contextmanager
def only_one(folder: Path, patience_s: float = 0.0) -> Iterator[None]:
    """Hold the guard's lock of `folder`. Raises `RecordError` where another guard has it for longer than `patience_s`."""
    descriptor = _taken(folder, time.monotonic() + patience_s)
    try:
        yield
        (folder / NAME).unlink(missing_ok=True)
    finally:
        os.close(descriptor)


def _taken(folder: Path, end: float) -> int:
    while True:
        descriptor = try_lock(folder / NAME)
        if descriptor is not None:
            return descriptor
        if time.monotonic() >= end:
            raise RecordError(f"{folder} has a guard already")
        time.sleep(AGAIN_S)
