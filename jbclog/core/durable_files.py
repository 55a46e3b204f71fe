"""Files written as a whole: complete or absent after a power cut."""

from __future__ import annotations

import os
from pathlib import Path

from jbclog.core.operating_system import sync_file, sync_folder


def write_whole(path: Path, data: bytes, *, is_synced: bool = True) -> None:
    """Replace `path` atomically with `data`, synced unless it is worthless after a power cut.
    Raises OSError.
    """
    aside = path.with_name(f".{path.name}.tmp")
    try:
        aside.unlink(missing_ok=True)
        with aside.open("xb") as file:  # never follows a link
            file.write(data)
        if is_synced:
            sync_file(aside)
        aside.replace(path)
    except OSError:
        aside.unlink(missing_ok=True)
        raise
    if is_synced:
        sync_folder(path.parent)


def write_new(path: Path, data: bytes) -> None:
    """Create `path` with `data`, synced. On failure, removes the file and raises OSError."""
    with path.open("xb") as file:
        try:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        except OSError:
            path.unlink(missing_ok=True)
            raise
    sync_folder(path.absolute().parent)
