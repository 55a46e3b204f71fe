"""Locks that the system releases when their holder ends, on a file and on a run's folder. Start
with `try_lock`, `FolderLock`.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import time
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind, open_foreign
from jbclog.core.foreign.json_reader import read_json


def try_lock(path: Path) -> int | None:
    """Lock the file at `path`; return its descriptor, or None where another process holds or has
    just removed it.

    The caller removes the file and closes the descriptor. Raises OSError where the file cannot be
    opened.
    """
    descriptor = os.open(
        path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK, 0o644
    )
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(descriptor), path.stat()):
            return descriptor
    except OSError:
        pass
    os.close(descriptor)
    return None


def is_locked(path: Path) -> bool:
    """Whether a process holds the lock at `path`; changes nothing. Raises OSError."""
    try:
        file = open_foreign(path, Kind.LOCK)
    except FileNotFoundError:
        return False
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return True
    return False


# A run's folder has one writer: the recorder, its sealing child, or `recover`. The lock is an flock
# on `live.lock`, which a child inherits with the descriptor. The file contains the holder's process
# id, for messages, and `CommitStatus`: SQLite takes a damaged end of its log for one that was never
# written and would lose acknowledged rows silently.
NAME = "live.lock"
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
WIDTH = 200  # bytes; overwritten as a whole, so that a full disk does not matter


@dataclass(frozen=True, slots=True)
class CommitStatus:
    """What a recorder reports about its commits.

    `last` is the number of the last committed batch; `since` when the last good commit began
    (seconds since 1970 UTC): rows handed over before it are safe; `risk_s` the longest time that a
    row waited to be safe; `unkept` the number of rows without a commit; `took_s` how long the last
    good commit took.
    """

    last: int = 0
    since: float | None = None
    risk_s: float = 0.0
    unkept: int = 0
    took_s: float = 0.0


class FolderLock:
    """The held lock of a folder. A child that inherits `descriptor` holds it too."""

    def __init__(self, folder: Path, descriptor: int) -> None:
        self.folder = folder
        self.descriptor = descriptor

    @classmethod
    def take(cls, folder: Path, patience_s: float = 0.5) -> FolderLock:
        """Take the lock.

        Raises `RecordError`, which names the holder, where it is held for longer than `patience_s`
        or cannot be created.
        """
        end = time.monotonic() + patience_s
        while True:
            descriptor = _opened(folder / NAME)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
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
        lock.write_status(commit_status(folder))
        return lock

    @property
    def name(self) -> str:
        return NAME

    def write_status(self, status: CommitStatus) -> None:
        """Write the commit status. Not synced: survives a kill, may lag after a power cut."""
        text = json.dumps({"pid": os.getpid(), "boot": boot_id(), **asdict(status)})
        with contextlib.suppress(OSError):  # a failing disk is reported elsewhere
            os.pwrite(self.descriptor, text.ljust(WIDTH).encode(), 0)

    @property
    def is_ours(self) -> bool:
        """Whether the folder's path still leads to the locked file."""
        return not self.folder.is_symlink() and _is_same_file(self.descriptor, self.folder / NAME)

    def expect_ours(self) -> None:
        """Raise `RecordError` where the folder was removed or replaced."""
        if self.is_ours:
            return
        if not os.path.lexists(self.folder):
            raise RecordError(f"{self.folder} was removed during the run")
        raise RecordError(
            f"{self.folder} was replaced during the run; nothing is written to the new folder"
        )

    def remove(self) -> None:
        """Remove the lock file and release the lock: the run is finished."""
        (self.folder / NAME).unlink(missing_ok=True)
        self.release()

    def release(self) -> None:
        """Release the lock. A child that inherited it still holds it."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


def _opened(path: Path) -> int:
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        raise RecordError(
            f"{path} cannot be opened: {error.strerror or error}; nothing was changed"
        ) from error


@cache
def boot_id() -> str:
    """Return an id of this boot, or "" where the system has none."""
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def holder_text(folder: Path) -> str:
    """Describe the process that holds the folder's lock."""
    pid = holder_pid(folder)
    return f"process {pid} or its sealing child" if pid else "another process"


def holder_pid(folder: Path) -> int:
    """Return the id of the process that took the folder's lock last; 0 if unknown."""
    return int(_inside(folder, "pid"))


def processes() -> list[int]:
    """Return the ids of all processes of this computer; none without /proc."""
    with contextlib.suppress(OSError):
        return [int(place.name) for place in Path("/proc").iterdir() if place.name.isdigit()]
    return []


def commit_status(folder: Path) -> CommitStatus:
    """Return the commit status that the last recorder wrote; zeros where none is readable."""
    return CommitStatus(
        int(_inside(folder, "last")),
        _inside(folder, "since") or None,
        _inside(folder, "risk_s"),
        int(_inside(folder, "unkept")),
        _inside(folder, "took_s"),
    )


def _inside(folder: Path, key: str) -> float:
    with contextlib.suppress(OSError, ValueError, AttributeError):
        value = read_json(folder / NAME, Kind.LOCK).get(key)
        return value if isinstance(value, int | float) else 0
    return 0


def is_held(folder: Path) -> bool:
    """Whether a process is writing to the folder now."""
    return is_locked(folder / NAME)


def _is_same_file(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False
