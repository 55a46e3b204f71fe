"""Where leases are open: a link to each such run's folder in the user's state folder.

So whoever makes tools safe finds what was left, wherever the run's folder is (`--out`). It is a help and no proof: without
a home, or with another user's, there is none, and what counts is the lease in the folder itself.
"""

from __future__ import annotations

import os
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Final

FOLDER: Final = "jbclog/open-leases"


def place() -> Path | None:
    """The folder of the links, whether it is there or not; None where this user has none."""
    state = os.environ.get("XDG_STATE_HOME", "")
    try:
        return (Path(state) if Path(state).is_absolute() else Path.home() / ".local" / "state") / FOLDER
    except RuntimeError:
        return None


def note(folder: Path) -> None:
    """A lease is open in `folder` from now on. Raises nothing."""
    where = place()
    if where is None:
        return
    with suppress(OSError):
        where.mkdir(parents=True, exist_ok=True, mode=0o700)
        _link(where, folder).symlink_to(os.path.realpath(folder))


def forget(folder: Path) -> None:
    """None is open there any more. Raises nothing."""
    where = place()
    if where is not None:
        with suppress(OSError):
            _link(where, folder).unlink(missing_ok=True)


def known() -> list[Path]:
    """The folders that were noted; those that are gone are forgotten."""
    where = place()
    found = []
    with suppress(OSError):
        for link in sorted(where.iterdir()) if where is not None else []:
            target = link.readlink() if link.is_symlink() else None
            if target is not None and target.is_dir():
                found.append(target)
            elif target is not None:
                link.unlink(missing_ok=True)
    return found


def _link(where: Path, folder: Path) -> Path:
    """Two runs of one name lie in two folders."""
    path = os.path.realpath(folder)
    return where / f"{folder.name}-{zlib.crc32(os.fsencode(path)):08x}"
