"""Whether a folder that was named is a run's, and a file that was named one that can be written."""

from __future__ import annotations

import os
from pathlib import Path

from jbclog.core.errors import RecordError, UsageError


def is_folder(path: Path) -> bool:
    """Whether there is a folder; a name that no file can have is none. Raises `RecordError` where its network mount hangs."""
    from jbclog.core.foreign.files import expect_answer  # here, so that help does not load it

    expect_answer(path)
    try:
        return path.is_dir()
    except OSError:
        return False


def expect_file_place(option: str, path: Path | None) -> None:
    """Raise `UsageError` where something stands at `path` that is no file: a pipe waits for who reads it, maybe for ever."""
    if path is not None and path.exists() and not path.is_file():
        raise UsageError(f"{option} {path}: that is a folder, a pipe or a device, and no file to be written anew")


def expect_run(folder: Path) -> None:
    """Raise `UsageError` where `folder` is no run's, `RecordError` where a run was cut off before it had a manifest."""
    from jbclog.record.manifest import NAME
    from jbclog.record.recover import is_run

    if not is_folder(folder):
        raise UsageError(f"{folder}: there is no such folder; runs are in `runs/`, or where --out put them")
    if not is_run(Path(os.path.realpath(folder))):
        raise UsageError(f"{folder} is no run's folder; runs are in `runs/`, or where --out put them")
    if not (folder / NAME).exists():
        raise RecordError(f"{folder} has no manifest: it was cut off at its very start; `jbclog recover {folder}` finishes it")
