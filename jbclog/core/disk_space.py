"""Say why a write failed on a disk that has no inodes left, each of which holds a file: the system
says "no space" although `df` shows free space, and SQLite "unable to open database file".
"""

from __future__ import annotations

import errno
import shutil
from pathlib import Path
from typing import Final

from jbclog.core.errors import cause
from jbclog.core.operating_system import inodes_left

NO_INODES: Final = "no inodes left on the disk at {} (`df -i`); remove old files from it"
FEW_FILES: Final = 16  # fewer than a run needs; some become free when a failed attempt is removed
ENOUGH_BYTES: Final = 1 << 20  # with so many free, what failed did not lack bytes
# primary result codes of SQLite: SQLITE_FULL, SQLITE_CANTOPEN
SQLITE_CODES: Final = (13, 14)


def write_failure(error: BaseException, path: Path) -> str:
    """Return why a write at `path` failed: the text of `error`, or that the disk has no inodes."""
    if _may_lack_inodes(error):
        folder = _existing(path)
        if lacks_inodes(folder):
            return NO_INODES.format(mount_point(folder))
    return getattr(error, "strerror", None) or cause(error)


def write_failure_below(error: BaseException, folder: Path) -> str:
    """Return the same for a write below `folder`, with the name of the file if the error has it."""
    text = write_failure(error, folder)
    return cause(error) if text == getattr(error, "strerror", None) else text


def lacks_inodes(folder: Path) -> bool:
    """Return True if the disk of `folder` has free space, and too few inodes for a run's files."""
    left = inodes_left(folder)
    if left is None or left >= FEW_FILES:
        return False
    return shutil.disk_usage(folder).free > ENOUGH_BYTES


def mount_point(folder: Path) -> Path:
    """Return where the disk of `folder` is mounted."""
    return next(
        place for place in (folder.absolute(), *folder.absolute().parents) if place.is_mount()
    )


def _may_lack_inodes(error: BaseException) -> bool:
    if isinstance(error, OSError):
        return error.errno == errno.ENOSPC
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in SQLITE_CODES


def _existing(path: Path) -> Path:
    """Return the nearest folder that exists."""
    above = (path.absolute(), *path.absolute().parents)
    return next(place for place in above if place.is_dir())
