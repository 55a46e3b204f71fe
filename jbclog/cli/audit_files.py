"""Before an audit asks anything: the files that it will write can be where they are wanted, and take the place of nothing else."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from jbclog.core.errors import UsageError


def check_files(made: Mapping[str, Path | None], kept: Sequence[Path]) -> None:
    """`made` are the files that are written as a whole, by their options; `kept` those that nothing may be written over.

    Raises `UsageError`.
    """
    known = {os.path.realpath(path): str(path) for path in kept}
    for option, path in made.items():
        if path is not None:
            _check(option, path)
            if os.path.realpath(path) in known:
                raise UsageError(f"{option} {path}: that is {known[os.path.realpath(path)]}, which it would take the place of")
            known[os.path.realpath(path)] = option


def _check(option: str, path: Path) -> None:
    if str(path) == "-":
        raise UsageError(f"{option} -: give a file; --json writes everything to stdout")
    if not path.absolute().parent.is_dir():
        raise UsageError(f"{option} {path}: there is no folder {path.absolute().parent}")
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise UsageError(f"{option} {path}: that is a folder, a device or a link, and no plain file to be written anew")
