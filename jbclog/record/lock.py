"""One writer to a run's folder: the recorder, the child that seals for it, or who recovers it.

A lock of the system (flock) on `live.lock` in the folder: it ends with its holder, however that ends, and is handed to
a child by handing over the open file. Who holds it stands inside, for the message that the next one gets.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import time
from pathlib import Path

from jbclog.errors import RecordError

NAME = "live.lock"
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class FolderLock:
    """The lock of one folder, held. `descriptor` can be inherited by a child, which then holds it too."""

    def __init__(self, folder: Path, descriptor: int) -> None:
        self.folder = folder
        self.descriptor = descriptor

    @classmethod
    def take(cls, folder: Path, patience_s: float = 0.5) -> FolderLock:
        """Take the lock. Raises `RecordError` naming the holder where it is held for longer than `patience_s`."""
        end = time.monotonic() + patience_s
        while True:
            descriptor = os.open(folder / NAME, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
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
        text = json.dumps({"pid": os.getpid(), "boot": boot_id()}).encode()
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, text, 0)
        return cls(folder, descriptor)

    @property
    def name(self) -> str:
        return NAME

    def remove(self) -> None:
        """Give the lock up for good: the run is finished, its folder needs none any more."""
        (self.folder / NAME).unlink(missing_ok=True)
        self.release()

    def release(self) -> None:
        """Give the lock up. A child that inherited it goes on holding it."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


def boot_id() -> str:
    """What tells one start of this machine from the next, or nothing where the system does not say."""
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def holder(folder: Path) -> str:
    """Who holds the folder's lock, in words."""
    pid = None
    with contextlib.suppress(OSError, ValueError, AttributeError):
        pid = json.loads((folder / NAME).read_bytes()).get("pid")
    return f"process {pid} or its sealing child" if isinstance(pid, int) else "another process"


def is_held(folder: Path) -> bool:
    """Whether a process is writing to the folder now."""
    try:
        descriptor = os.open(folder / NAME, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False


def _is_same_file(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False
