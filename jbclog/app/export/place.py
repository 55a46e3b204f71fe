"""Where to write an export: whole or not at all, never into a run, over an existing one only with
`force`.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.operating_system import sync_file, sync_folder

OURS: Final = (".csv", ".dfq", ".json")  # files that a folder replaced by `force` may hold


def expect_place(out: Path, run: Path, *, is_folder: bool, force: bool) -> None:
    """Raise `UsageError` if `out` cannot or must not be written, before anything is written."""
    real, real_run = Path(os.path.realpath(out)), Path(os.path.realpath(run))
    if real.is_relative_to(real_run):
        raise UsageError(
            f"--out {out}: inside the run's folder, which never changes; give a place outside of it"
        )
    if not real.parent.is_dir():
        raise UsageError(f"--out {out}: {real.parent} is not a folder; create it first")
    if real == real.parent or real_run.is_relative_to(real):
        raise UsageError(f"--out {out}: holds the run itself; give a place of its own")
    if out.exists() and out.is_dir() != is_folder:
        raise UsageError(f"--out {out}: must be a {'folder' if is_folder else 'file'}")
    if is_folder and out.exists():
        _expect_replaceable(out, force=force)
    elif out.exists() and not (force and out.is_file()):
        raise UsageError(
            f"--out {out}: exists; --force replaces it"
            if out.is_file()
            else f"--out {out}: is not a regular file"
        )


def _expect_replaceable(out: Path, *, force: bool) -> None:
    held = sorted(out.iterdir())
    foreign = [path.name for path in held if path.suffix not in OURS or not path.is_file()]
    if foreign:
        raise UsageError(
            f"--out {out}: holds {foreign[0]}, which is not an export; give another folder"
        )
    if held and not force:
        raise UsageError(f"--out {out}: is not empty; --force replaces it")


@contextmanager
def written(out: Path) -> Iterator[Path]:
    """Yield a path beside `out` for a file or folder that replaces `out`, synced, if the `with`
    block succeeds.

    After a failure nothing new is left. Raises `RecordError` if the disk refuses it.
    """
    real = Path(os.path.realpath(out))
    aside: Path | None = None
    try:
        aside = Path(
            tempfile.mkdtemp(prefix=f".{real.name[:100]}.", suffix=".tmp", dir=real.parent)
        )
        yield aside / real.name
        _replace(aside / real.name, real, aside)
    except OSError as error:
        raise RecordError(
            f"{out}: cannot be written: {write_failure(error, out)}; nothing of it is left"
        ) from error
    finally:
        if aside is not None:
            shutil.rmtree(aside, ignore_errors=True)


def _replace(new: Path, real: Path, aside: Path) -> None:
    for path in [*new.iterdir()] if new.is_dir() else [new]:
        sync_file(path)
    if new.is_dir():
        sync_folder(new)
        if real.exists():
            real.rename(aside / "replaced")  # a rename replaces an empty folder only
    try:
        new.replace(real)
    except OSError:
        if (aside / "replaced").exists():
            (aside / "replaced").rename(real)
        raise
    sync_folder(real.parent)
