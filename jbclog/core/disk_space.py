"""Say why a write failed: that the disk is full, or that it has no inodes left, each of which holds
a file; the system then says "no space" although `df` shows free space.
"""

from __future__ import annotations

import errno
import shutil
from pathlib import Path
from typing import Final

from jbclog.core.errors import cause
from jbclog.core.operating_system import inodes_left

FULL: Final = "the disk is full"
NO_INODES: Final = "no inodes left on the disk at {} (`df -i`); remove old files from it"
FEW_FILES: Final = 16  # fewer than a run needs; some become free when a failed attempt is removed
ENOUGH_BYTES: Final = 1 << 20  # with so many free, what failed did not lack bytes


def write_failure(error: BaseException, path: Path) -> str:
    """Return why a write at `path` failed: the text of `error`, or that the disk has no inodes."""
    text = getattr(error, "strerror", None) or cause(error)
    if not isinstance(error, OSError) or error.errno != errno.ENOSPC:
        return text
    folder = _existing(path)
    if lacks_inodes(folder):
        return NO_INODES.format(mount_point(folder))
    return f"{FULL}: {text}"


def write_failure_below(error: BaseException, folder: Path) -> str:
    """Return the same for a write below `folder`, with the name of the file if the error has it."""
    text = write_failure(error, folder)
    strerror = getattr(error, "strerror", None)
    return text.replace(strerror, cause(error)) if strerror else text


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


def _existing(path: Path) -> Path:
    """Return the nearest folder that exists."""
    above = (path.absolute(), *path.absolute().parents)
    return next(place for place in above if place.is_dir())
