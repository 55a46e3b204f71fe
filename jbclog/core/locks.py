"""Locks on a file and on a run's folder, which the system releases when their holder ends.

Start with `try_lock` and `FolderLock`.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from pathlib import Path

from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, NotReadable, open_regular
from jbclog.core.json_files import read_json
from jbclog.core.operating_system import (
    NO_LINK,
    NO_WAIT,
    PLAIN,
    boot_id,
    lock_exclusive,
    lock_shared,
    write_at,
)


def try_lock(path: Path) -> int | None:
    """Lock the file at `path`; return its descriptor, or None if another process holds it or has
    just removed it.

    The caller removes the file and closes the descriptor. Raises OSError if the file cannot be
    opened.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | PLAIN | NO_LINK | NO_WAIT, 0o644)
    try:
        lock_exclusive(descriptor)
        if os.path.samestat(os.fstat(descriptor), path.stat()):
            return descriptor
    except OSError:
        pass
    os.close(descriptor)
    return None


def is_locked(path: Path) -> bool:
    """Return True if a process holds the lock at `path`. A pipe, a folder or a long file of that
    name is no lock of jbclog: nobody holds it. Creates nothing. Raises OSError.
    """
    try:
        file = open_regular(path, Kind.LOCK)
    except (FileNotFoundError, NotReadable):
        return False
    with file:
        try:
            lock_shared(file.fileno())
        except OSError:
            return True
    return False


# A run's folder has one writer: the recorder, its sealing child, or `recover`. The lock is an flock
# on `live.lock`; a child inherits it with the descriptor. The file contains the holder's process
# id, for messages, the computer's boot, and the number of rows that a full disk did not take: the
# journal cannot hold that number then.
NAME = "live.lock"
WIDTH = 200  # bytes; always overwritten as a whole, so a full disk does not matter


class FolderLock:
    """A folder's lock, held. A child that inherits `descriptor` holds it too."""

    def __init__(self, folder: Path, descriptor: int) -> None:
        self.folder = folder
        self.descriptor = descriptor

    @classmethod
    def take(cls, folder: Path, patience_s: float = 0.5) -> FolderLock:
        """Take the lock.

        Raises `RecordError`, naming the holder, if it stays held for `patience_s` or cannot be
        created.
        """
        end = time.monotonic() + patience_s
        while True:
            descriptor = _opened(folder / NAME)
            try:
                lock_exclusive(descriptor)
            except OSError:
                os.close(descriptor)
                if time.monotonic() >= end:
                    raise RecordError(
                        f"{folder} is being written by {holder_text(folder)}; nothing was changed"
                    ) from None
                time.sleep(0.05)
                continue
            # the last holder may have removed it meanwhile
            if _is_same_file(descriptor, folder / NAME):
                return cls._signed(folder, descriptor)
            os.close(descriptor)

    @classmethod
    def _signed(cls, folder: Path, descriptor: int) -> FolderLock:
        lock = cls(folder, descriptor)
        lock.write_unkept(unkept_rows(folder))
        return lock

    @property
    def name(self) -> str:
        return NAME

    def write_unkept(self, rows: int) -> None:
        """Write how many rows the recorder could not keep, without syncing: it survives a kill."""
        text = json.dumps({"pid": os.getpid(), "boot": boot_id(), "unkept": rows})
        with contextlib.suppress(OSError):  # the commits report a failing disk
            write_at(self.descriptor, text.ljust(WIDTH).encode(), 0)

    @property
    def is_ours(self) -> bool:
        """True if the folder's path still leads to the locked file."""
        return not self.folder.is_symlink() and _is_same_file(self.descriptor, self.folder / NAME)

    def expect_ours(self) -> None:
        """Raise `RecordError` if the folder was removed or replaced."""
        if self.is_ours:
            return
        if not os.path.lexists(self.folder):
            raise RecordError(f"{self.folder} was removed during the run")
        raise RecordError(
            f"{self.folder} was replaced during the run; nothing is written to the new folder"
        )

    def remove(self) -> None:
        """Remove the lock file and release the lock."""
        (self.folder / NAME).unlink(missing_ok=True)
        self.release()

    def release(self) -> None:
        """Release the lock. A child that inherited it still holds it."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


def _opened(path: Path) -> int:
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | PLAIN | NO_LINK, 0o644)
    except OSError as error:
        raise RecordError(
            f"{path} cannot be opened: {write_failure(error, path)}; nothing was changed"
        ) from error


def holder_text(folder: Path) -> str:
    """Describe the process that holds the folder's lock."""
    pid = holder_pid(folder)
    return f"process {pid} or its sealing child" if pid else "another process"


def holder_pid(folder: Path) -> int:
    """Return the id of the process that last took the folder's lock; 0 if unknown."""
    return _number(folder, "pid")


def unkept_rows(folder: Path) -> int:
    """Return how many rows the last recorder could not keep; 0 if unknown."""
    return _number(folder, "unkept")


def _number(folder: Path, key: str) -> int:
    with contextlib.suppress(OSError, ValueError, AttributeError):
        value = read_json(folder / NAME, Kind.LOCK).get(key)
        return value if isinstance(value, int) else 0
    return 0


def is_held(folder: Path) -> bool:
    """Return True if a process is writing to the folder. Raises OSError."""
    return is_locked(folder / NAME)


def _is_same_file(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False
