"""One guard for a run's folder, and never a second: a lock of the system that ends with its holder."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from jbclog.errors import RecordError

NAME: Final = "guard.lock"


@contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """Hold the guard's lock of `folder`. Raises `RecordError` where another guard has it."""
    descriptor = os.open(folder / NAME, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise RecordError(f"{folder} has a guard already") from error
        yield
        (folder / NAME).unlink(missing_ok=True)
    finally:
        os.close(descriptor)
