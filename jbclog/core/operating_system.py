"""What differs between operating systems: locks, syncs, limits, priorities and processes.

jbclog records on Linux and reads on any system. Only this module, `transport`, `guard`, `sim` and
the parts of `app` that record use what Windows lacks; import-linter and tests/unit/test_layers.py
hold all others to that. On Windows locks are those of `msvcrt`, and a limit, a priority or a sync
that the system does not have is left out.

A lock excludes the processes of one computer. A recorder's lock on a share is not seen from another
computer.
"""

from __future__ import annotations

import os
import select
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from io import BufferedReader
from pathlib import Path
from typing import Any, Final

from jbclog.core.errors import UsageError

try:
    import fcntl
    import resource
except ImportError:  # Windows
    import msvcrt

    IS_POSIX = False
else:
    IS_POSIX = True

NO_RECORDING: Final = (
    "recording, and talking to stations, need a POSIX system such as Linux; here jbclog reads what"
    " was recorded"
)


def expect_posix() -> None:
    """Raise `UsageError` where stations may not be driven: the guard, and every way out that leaves
    a tool in its safe state, need POSIX.
    """
    if not IS_POSIX:
        raise UsageError(NO_RECORDING)


NO_EPOLL: Final = (
    "recording needs epoll, which Linux has; here jbclog reads what was recorded, and talks to"
    " stations by hand"
)


def expect_epoll() -> None:
    """Raise `UsageError` where the recorder's event loop cannot run."""
    if not hasattr(select, "epoll"):
        raise UsageError(NO_EPOLL)


# -- files -----------------------------------------------------------------------------------------

_system: Any = os  # of which each system has other parts
PLAIN: Final[int] = getattr(_system, "O_CLOEXEC", 0) | getattr(_system, "O_BINARY", 0)
"""Flags of `os.open`: bytes as they are, not for child processes."""
NO_LINK: Final[int] = getattr(_system, "O_NOFOLLOW", 0)
"""Flag of `os.open`: refuse a link."""
NO_WAIT: Final[int] = getattr(_system, "O_NONBLOCK", 0) | getattr(_system, "O_NOCTTY", 0)
"""Flags of `os.open`: a pipe or a terminal that took the file's name does not block."""


def read_at(descriptor: int, size: int, start: int) -> bytes:
    """Read at most `size` bytes from `start`; the file's position stays."""
    if IS_POSIX:
        return os.pread(descriptor, size, start)
    with _position(descriptor, start):
        return os.read(descriptor, size)


def write_at(descriptor: int, data: bytes, start: int) -> int:
    """Write `data` at `start` and return how much of it was written; the file's position stays."""
    if IS_POSIX:
        return os.pwrite(descriptor, data, start)
    with _position(descriptor, start):
        return os.write(descriptor, data)


@contextmanager
def _position(descriptor: int, start: int) -> Iterator[None]:
    before = os.lseek(descriptor, 0, os.SEEK_CUR)
    os.lseek(descriptor, start, os.SEEK_SET)
    try:
        yield
    finally:
        os.lseek(descriptor, before, os.SEEK_SET)


def set_blocking(descriptor: int, *, blocks: bool) -> None:
    """Let reads and writes of an open file or pipe wait, or not; Windows has no such choice."""
    if IS_POSIX:
        os.set_blocking(descriptor, blocks)


def takes_text(descriptor: int, patience_s: float) -> bool:
    """Return whether a stream accepts text within `patience_s`; a closed one does, and Windows does
    not say.
    """
    if not IS_POSIX:
        return True
    watched = select.poll()
    watched.register(descriptor, select.POLLOUT)
    return bool(watched.poll(patience_s * 1000))


def sync_folder(folder: Path) -> None:
    """Sync `folder`, so that creations, renames and removals in it survive a power cut. Raises
    OSError. Windows cannot open a folder, and its file system keeps a log of such changes.
    """
    if not IS_POSIX:
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_file(path: Path) -> None:
    """Sync the contents of `path`. After an OSError, do not trust the file."""
    flags = os.O_RDONLY if IS_POSIX else os.O_RDWR | PLAIN  # Windows syncs what may be written
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_data(descriptor: int) -> None:
    """Sync the contents of an open file and its size. After an OSError, do not trust the file."""
    if hasattr(fcntl, "F_FULLFSYNC"):  # macOS: to the disk, not to its cache
        fcntl.fcntl(descriptor, fcntl.F_FULLFSYNC)
    else:
        os.fdatasync(descriptor)


def opened_again(file: BufferedReader) -> str | BufferedReader:
    """Return what a library opens to read this open file: another one may have its name by now."""
    return f"/dev/fd/{file.fileno()}" if IS_POSIX else file


# -- locks -----------------------------------------------------------------------------------------

LOCK_AT: Final = 1 << 30
"""The byte that a lock of Windows covers, which nobody could read or write: behind all content."""
LOOK_S: Final = 0.05


def lock_exclusive(descriptor: int) -> None:
    """Lock the open file for this process and its children. Raises OSError if it is locked."""
    if IS_POSIX:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    else:
        _lock_windows(descriptor)


def wait_for_lock(descriptor: int) -> None:
    """Lock the open file as soon as no other process does. Raises OSError."""
    if IS_POSIX:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        return
    while True:
        try:
            _lock_windows(descriptor)
        except PermissionError:
            time.sleep(LOOK_S)
        else:
            return


def lock_shared(descriptor: int) -> None:
    """Lock the open file beside others who only look. Raises OSError if it is locked. Windows has
    no such lock here: of two who look at once, one sees the other.
    """
    if IS_POSIX:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    else:
        _lock_windows(descriptor)


def _lock_windows(descriptor: int) -> None:
    windows: Any = msvcrt
    with _position(descriptor, LOCK_AT):
        windows.locking(descriptor, windows.LK_NBLCK, 1)


# -- limits and priorities -------------------------------------------------------------------------

LEAST_BYTES: Final = 4 << 30  # libraries reserve more address space than they use


def limit_bytes() -> int | None:
    """Return the limit of address space: the size of the memory, at least `LEAST_BYTES`, at most
    what the system allows. None if the system has no such limit.
    """
    if not IS_POSIX:
        return None
    try:
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    except (AttributeError, OSError, ValueError):
        return None
    allowed = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    return min([max(memory, LEAST_BYTES), *allowed])


def limit_memory() -> None:
    """Limit the address space of this process to `limit_bytes`, where the system has a limit: a
    damaged file may ask for any amount, and should end its command, not the recorder beside it.

    Only a command that reads records calls it: never the library, a recorder, or what follows a
    run.
    """
    limit = limit_bytes()
    if limit is None:
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    try:
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    except (OSError, ValueError):  # a system that has the limit in name only
        return


def inodes_left(folder: Path) -> int | None:
    """Return how many files may still be made on the disk of `folder`; None without a limit, as on
    Windows, btrfs and others.
    """
    statvfs = getattr(os, "statvfs", None)
    if statvfs is None:
        return None
    try:
        disk = statvfs(folder)
    except OSError:
        return None
    return int(disk.f_favail) if disk.f_files > 0 else None


def lower_priority(niceness: int) -> None:
    """Leave the processor to others, the recorder first."""
    if IS_POSIX:
        os.nice(niceness)


# -- time -----------------------------------------------------------------------------------------


def boot_clock() -> Callable[[], float]:
    """Return the boot-time clock if there is one: on Linux `time.monotonic` excludes suspension."""
    try:
        boot: int = time.CLOCK_BOOTTIME
        time.clock_gettime(boot)
    except (AttributeError, OSError):
        return time.monotonic
    return partial(time.clock_gettime, boot)


# -- processes -------------------------------------------------------------------------------------

BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")


@cache
def boot_id() -> str:
    """Return an id of this boot; "" if the system has none."""
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def processes() -> list[int]:
    """Return the ids of all processes of this computer; empty without /proc."""
    with suppress(OSError):
        return [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()]
    return []


def open_files(process: int) -> Iterator[str]:
    """Yield the paths of the files that a process has open; none without /proc, or if this user may
    not know.
    """
    with suppress(OSError), os.scandir(f"/proc/{process}/fd") as descriptors:
        for descriptor in descriptors:
            with suppress(OSError):
                yield os.readlink(descriptor.path)  # noqa: PTH115  # scandir gives no Path
