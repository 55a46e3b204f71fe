"""Open files and folders without blocking.

Opens only regular files, up to the size limit of their kind. A pipe, a socket or a device is
refused before it is opened, because opening it can block or have side effects. Inside a run's
folder no link is followed; a path that the user names may be a link.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import suppress
from enum import StrEnum
from io import BufferedReader
from pathlib import Path
from types import MappingProxyType
from typing import Final

from jbclog.core.operating_system import NO_LINK, NO_WAIT, PLAIN, set_blocking

KIB, MIB, GIB = 1 << 10, 1 << 20, 1 << 30


class Kind(StrEnum):
    """What a file is meant to be, as messages name it."""

    MANIFEST = "a manifest"
    ANNOTATIONS = "a file of annotations"
    VERIFICATIONS = "a file of verifications"
    REPORT = "a report's data"
    OF_REPORT = "a file of a report"
    LEASE = "a lease"
    ACTION_LOG = "a guard's action log"
    LOCK = "a lock"
    DAMAGE = "a list of damage"
    SETTINGS = "a line, recipe or jobs file"
    JOURNAL = "a batch's journal"
    JOB = "a job's state"
    LEDGER = "a ledger"
    WIRE = "a serial capture"
    PART = "a part of a table"
    STORE = "a journal"
    RECORD = "a file of a record"
    DERIVED = "a derived table"
    CHECKPOINT_HINT = "a hint at a checkpoint"


LIMITS: Final[Mapping[Kind, int]] = MappingProxyType(
    {
        Kind.MANIFEST: 16 * MIB,  # a run with 90 000 units takes 11 MB
        Kind.ANNOTATIONS: 16 * MIB,
        Kind.VERIFICATIONS: 16 * MIB,
        Kind.REPORT: 32 * MIB,
        Kind.OF_REPORT: 256 * MIB,
        Kind.LEASE: MIB,
        Kind.ACTION_LOG: 4 * MIB,
        Kind.LOCK: 64 * KIB,
        Kind.DAMAGE: 4 * MIB,
        Kind.SETTINGS: 64 * KIB,
        Kind.JOURNAL: 64 * MIB,
        Kind.JOB: 64 * MIB,  # an event takes some 300 bytes
        Kind.LEDGER: 256 * MIB,  # 250 stations, audited daily, take 90 MB a year
        Kind.WIRE: 4 * GIB,  # a station's month takes some 500 MB
        Kind.PART: 4 * GIB,  # an hour of 256 ports at 10 Hz takes 50 MB
        Kind.STORE: 16 * GIB,  # an hour of rows, or the whole disk if sealing fails
        Kind.RECORD: 16 * GIB,
        Kind.DERIVED: 256 * MIB,  # half a million joints, a day of 32 ports, take 30 MB
        Kind.CHECKPOINT_HINT: MIB,  # takes 10 kB
    }
)
"""Maximum size of each kind in bytes. Text kinds are read whole, a ledger by lines, others in
pieces.
"""

LINES: Final[Mapping[Kind, int]] = MappingProxyType(
    {Kind.ANNOTATIONS: 20_000}
    | dict.fromkeys((Kind.VERIFICATIONS, Kind.DAMAGE, Kind.LEASE), 100_000)
)
"""Maximum number of lines of a kind: each is parsed."""

_WHAT: Final = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISLNK, "a link"),
)


class NotReadable(OSError):
    """A file that is not opened, or not read to its end. The text says why; there is no errno."""

    def __init__(self, why: str) -> None:
        super().__init__(errno.EINVAL, why)

    def __str__(self) -> str:
        return str(self.strerror)


def expect_regular(path: Path, kind: Kind, *, links: bool = False) -> int:
    """Return the size of the regular file at `path`. Raises OSError if it is missing, `NotReadable`
    if it is another kind.

    `links`: the user named the path, so it may be a link to a regular file.
    """
    return _size(path.stat() if links else path.lstat(), kind)


def _size(there: os.stat_result, kind: Kind) -> int:
    if not stat.S_ISREG(there.st_mode):
        raise NotReadable(f"is {what_is(there)}, not a file")
    if there.st_size > LIMITS[kind]:
        raise NotReadable(f"has {there.st_size} bytes; {kind} has at most {LIMITS[kind]}")
    return there.st_size


def what_is(there: os.stat_result) -> str:
    return next((name for fits, name in _WHAT if fits(there.st_mode)), "no file")


def expect_opened(descriptor: int, kind: Kind) -> int:
    """Return the size of a file open for writing; raises as `expect_regular` does."""
    return _size(os.fstat(descriptor), kind)


def open_regular(path: Path, kind: Kind, *, links: bool = False) -> BufferedReader:
    """Open the regular file at `path` for reading. Raises OSError as `expect_regular` does.

    Checks the file before and after opening, because it may be replaced in between.
    """
    expect_regular(path, kind, links=links)
    flags = os.O_RDONLY | PLAIN | NO_WAIT
    if not links:
        flags |= NO_LINK
    descriptor = os.open(path, flags)
    try:
        expect_opened(descriptor, kind)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def open_to_write(path: Path, kind: Kind, *, appends: bool = False, makes: bool = True) -> int:
    """Open the regular file at `path`, made if missing (`makes`), and return its descriptor. Raises
    OSError as `expect_regular` does: in a folder of others' even a file of our own may be a pipe or
    a link.
    """
    if not makes:
        expect_regular(path, kind)
    how = os.O_WRONLY | os.O_APPEND if appends else os.O_RDWR
    how |= os.O_CREAT if makes else 0
    descriptor = os.open(path, how | PLAIN | NO_LINK | NO_WAIT, 0o666)
    try:
        expect_opened(descriptor, kind)
        set_blocking(descriptor, blocks=True)  # a child may inherit it
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def read_regular(path: Path, kind: Kind, *, links: bool = False) -> bytes:
    """Read the regular file at `path`. Raises OSError as `expect_regular` does, also if the file
    grows beyond its limit.
    """
    with open_regular(path, kind, links=links) as file:
        size = os.fstat(file.fileno()).st_size
        data = file.read(size + 1)  # a buffer of the limit's size would take longer than the file
        if len(data) > size:
            data += file.read(LIMITS[kind] + 1 - len(data))
    if len(data) > LIMITS[kind]:
        raise NotReadable(f"grows while it is read; {kind} has at most {LIMITS[kind]} bytes")
    if kind in LINES and data.count(b"\n") > LINES[kind]:
        raise NotReadable(f"has {data.count(10)} lines; {kind} has at most {LINES[kind]}")
    return data


DEEPEST: Final = 4
"""Maximum depth of folders below a run's folder; a recorder makes one."""


def entries_below(folder: Path) -> Iterator[os.DirEntry[str]]:
    """Yield all entries below a run's folder; follows no link. Raises OSError, `NotReadable` for
    folders deeper than `DEEPEST`.
    """
    folders = [(os.fspath(folder), 0)]
    while folders:
        here, depth = folders.pop()
        with (
            suppress(PermissionError, FileNotFoundError, NotADirectoryError),
            os.scandir(here) as entries,
        ):
            for entry in entries:
                yield entry
                if entry.is_dir(follow_symlinks=False):
                    if depth == DEEPEST:
                        raise NotReadable("it has more folders in one another than any run")
                    folders.append((entry.path, depth + 1))


def is_plain_folder(path: Path) -> bool:
    """Return True if `path` itself is a folder, not a link to one; False if it cannot be
    examined.
    """
    try:
        return stat.S_ISDIR(path.lstat().st_mode)
    except (OSError, ValueError):
        return False
