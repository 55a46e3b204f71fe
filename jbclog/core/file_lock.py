"""A lock of the system on a file that goes when its holder has done: it ends with its holder, however that ends."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from jbclog.core.foreign.files import Kind, expect_regular


def lock_of(path: Path) -> int | None:
    """The lock at `path`, taken; None where another holds it, or took it away with its file while it was being taken.

    Whoever is given the descriptor removes the file and closes it. Raises OSError where no file can be opened there.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(descriptor), path.stat()):
            return descriptor
    except OSError:
        pass
    os.close(descriptor)
    return None


def is_locked(path: Path) -> bool:
    """Whether a process holds the lock at `path` now; not where there is no such file. Takes nothing, changes nothing.

    Raises OSError where there is one that cannot be opened.
    """
    try:
        expect_regular(path, Kind.LOCK)
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False
