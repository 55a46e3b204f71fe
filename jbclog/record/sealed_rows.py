"""Sealed rows are shown only where their files are those that were sealed: nobody is to read a wrong value for a right one.

The check sums of Parquet cover its pages and not its footer, in which a flipped bit makes other times, types and counts;
the manifest's hashes cover all of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from jbclog.core.errors import RecordError
from jbclog.record.conclude import sealed_file
from jbclog.record.manifest import NAME, Manifest, wrong_digest


def expect_manifest_unchanged(folder: Path) -> None:
    """Raise `RecordError` where the manifest is not what its own digest says."""
    try:
        digest = wrong_digest(folder)
    except (OSError, ValueError) as error:
        raise RecordError(f"{folder / NAME} cannot be read: {error}") from error
    if digest:
        raise RecordError(f"{folder / NAME} {digest}, so nothing of it is shown; `jbclog check {folder}` says what else is wrong")


def expect_unchanged(folder: Path, manifest: Manifest, table: str, parts: Sequence[Path]) -> None:
    """Raise `RecordError` unless the parts of a sealed run's table are those that were sealed."""
    listed = {file.path: file.sha256 for file in manifest.files if file.path.startswith(f"{table}/")}
    there = {path.relative_to(folder).as_posix(): path for path in parts}
    for name in sorted(listed.keys() | there.keys()):
        trouble = _trouble(there.get(name), listed.get(name), folder)
        if trouble:
            raise RecordError(
                f"{folder / name} {trouble}, so {table} are not shown; `jbclog check {folder}` says what else is wrong"
            )


def _trouble(path: Path | None, sha256: str | None, folder: Path) -> str | None:
    if path is None:
        return "is missing"
    if sha256 is None:
        return "is not in the manifest"
    try:
        there = path.stat()
        found = _sha256(folder, path, there.st_mtime_ns, there.st_size)
    except OSError as error:
        return f"cannot be read: {error.strerror or error}"
    return None if found == sha256 else "was changed: its SHA-256 is not the manifest's"


@lru_cache(4096)
def _sha256(folder: Path, path: Path, _mtime_ns: int, _size: int) -> str:
    """Once for each file as long as nobody writes it."""
    return sealed_file(folder, path, None).sha256
