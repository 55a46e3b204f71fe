"""Locks that end with their holder: on a file, and on a run's folder. Start with `lock_of` and `FolderLock`."""

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
from jbclog.core.foreign.files import Kind, expect_regular
from jbclog.core.foreign.json_reader import read_json

# -- file lock ----------------------------------------------------------------------------------------------------------------
# A lock of the system on a file that goes when its holder has done: it ends with its holder, however that ends.


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


# -- folder lock --------------------------------------------------------------------------------------------------------------
# One writer to a run's folder: the recorder, the child that seals for it, or who recovers it.
#
# A lock of the system (flock) on `live.lock` in the folder: it ends with its holder, however that ends, and is handed to
# a child by handing over the open file. Who holds it stands inside, for the message that the next one gets, and what the
# recorder says of its commits (`Witness`). This is a witness apart from the store: SQLite takes a damaged end of its log for
# one that was never written, and would lose acknowledged rows without a word.

NAME = "live.lock"
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
WIDTH = 200  # what is written over is always written over as a whole, and so needs no room on a full disk


@dataclass(frozen=True, slots=True)
class Witness:
    """What a recorder says of its commits.

    `last` is the number of the last batch committed; `since` when the last good commit began (seconds since 1970 UTC): what was
    handed over before is safe; `risk_s` the longest that anything has had to wait to be safe; `unkept` how many rows are in no
    commit, because the disk did not take them.
    """

    last: int = 0
    since: float | None = None
    risk_s: float = 0.0
    unkept: int = 0


class FolderLock:
    """The lock of one folder, held. `descriptor` can be inherited by a child, which then holds it too."""

    def __init__(self, folder: Path, descriptor: int) -> None:
        self.folder = folder
        self.descriptor = descriptor

    @classmethod
    def take(cls, folder: Path, patience_s: float = 0.5) -> FolderLock:
        """Take the lock.

        Raises `RecordError` naming the holder where it is held for longer than `patience_s`, or where the disk has none to give.
        """
        end = time.monotonic() + patience_s
        while True:
            descriptor = _opened(folder / NAME)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                os.close(descriptor)
                if time.monotonic() >= end:
                    raise RecordError(f"{folder} is being written by {holder(folder)}; nothing was changed") from None
                time.sleep(0.05)
                continue
            if _is_same_file(descriptor, folder / NAME):  # the last holder may have removed it meanwhile
                return cls._signed(folder, descriptor)
            os.close(descriptor)

    @classmethod
    def _signed(cls, folder: Path, descriptor: int) -> FolderLock:
        lock = cls(folder, descriptor)
        lock.testify(witness(folder))
        return lock

    @property
    def name(self) -> str:
        return NAME

    def testify(self, said: Witness) -> None:
        """Note it. Not synced: it outlives a kill, and may lag after a power cut."""
        text = json.dumps({"pid": os.getpid(), "boot": boot_id(), **asdict(said)})
        with contextlib.suppress(OSError):  # a disk that fails has been told of already
            os.pwrite(self.descriptor, text.ljust(WIDTH).encode(), 0)

    @property
    def is_ours(self) -> bool:
        """Whether the folder's path leads to it still, and not elsewhere or nowhere."""
        return not self.folder.is_symlink() and _is_same_file(self.descriptor, self.folder / NAME)

    def expect_ours(self) -> None:
        """Raise `RecordError` where the folder's path leads elsewhere by now: through a link, or to another folder."""
        if self.is_ours:
            return
        if not os.path.lexists(self.folder):
            raise RecordError(f"{self.folder} is not there any more: it was removed while the run went on")
        raise RecordError(f"{self.folder} was replaced while the run went on; nothing is written where it leads now")

    def remove(self) -> None:
        """Give the lock up for good: the run is finished, its folder needs none any more."""
        (self.folder / NAME).unlink(missing_ok=True)
        self.release()

    def release(self) -> None:
        """Give the lock up. A child that inherited it goes on holding it."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


def _opened(path: Path) -> int:
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        raise RecordError(f"{path} cannot be opened: {error.strerror or error}; nothing was changed") from error


@cache
def boot_id() -> str:
    """What tells one start of this machine from the next, or nothing where the system does not say."""
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def holder(folder: Path) -> str:
    """Who holds the folder's lock, in words."""
    pid = recorder(folder)
    return f"process {pid} or its sealing child" if pid else "another process"


def recorder(folder: Path) -> int:
    """The number of the process that took the folder's lock last; 0 where none says so."""
    return int(_inside(folder, "pid"))


def witness(folder: Path) -> Witness:
    """What the last recorder said of its commits; nothing where none did, or where it cannot be read."""
    since, risk_s = _inside(folder, "since"), _inside(folder, "risk_s")
    return Witness(int(_inside(folder, "last")), since or None, risk_s, int(_inside(folder, "unkept")))


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
