"""Sealed files held against what was sealed: rows and captures that are lost or changed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Final

from jbclog.core.errors import RecordError
from jbclog.record.capture import FOLDER, Head, holes, is_done, read_head, wire_paths
from jbclog.record.conclude import sealed_file
from jbclog.record.manifest import NAME, Manifest, wrong_digest

# -- sealed rows --------------------------------------------------------------------------------------------------------------
# Sealed rows are shown only where their files are those that were sealed: nobody is to read a wrong value for a right one.
#
# The check sums of Parquet cover its pages and not its footer, in which a flipped bit makes other times, types and counts;
# the manifest's hashes cover all of it.


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


# -- capture check ------------------------------------------------------------------------------------------------------------
# What of the wires of a run is lost, or was changed since: by their own check sums, and by the manifest's hashes.

PLAYED: Final = (f"{FOLDER}/", "recipes/", "line.toml")  # what a replay reads of a run
CHANGED: Final = "was changed: its SHA-256 is not the manifest's"


def losses(path: Path) -> Iterator[str]:
    """What of one file cannot be proven or read, a sentence each; none where it is as it was written."""
    head = None
    try:
        head = read_head(path)
    except RecordError as error:
        yield _portable(error, path)
    try:
        for hole in holes(path):
            yield hole.told(head)
    except RecordError as error:
        yield _portable(error, path)


def _portable(error: RecordError, path: Path) -> str:
    """The sentence without the folders in which the run lies now."""
    return str(error).replace(str(path), path.name)


def ends_early(path: Path) -> bool:
    """Whether a file holds something, and not its session's end."""
    return path.stat().st_size > 0 and not is_done(path)


def readable_heads(paths: Sequence[Path]) -> list[Head]:
    """The heads of those files that have one. Raises `RecordError` where none has."""
    found, failures = [], []
    for path in paths:
        try:
            found.append(read_head(path))
        except RecordError as error:
            failures.append(error)
    if failures and not found:
        raise failures[0]
    return found


def changed_since(folder: Path, manifest: Manifest) -> Iterator[str]:
    """What a replay reads and is not what the manifest has, a sentence each. Raises OSError."""
    for listed in manifest.files:
        if not listed.path.startswith(PLAYED) or ".." in Path(listed.path).parts:
            continue
        path = folder / listed.path
        if not path.is_file():
            yield f"{listed.path}: is missing"
        elif sealed_file(folder, path, None).sha256 != listed.sha256:
            yield f"{listed.path}: {CHANGED}"


def doubts(folder: Path, manifest: Manifest | None) -> list[str]:
    """All that is not as it was recorded, of what a replay reads. Raises `RecordError`."""
    try:
        changed = [*changed_since(folder, manifest)] if manifest is not None and manifest.state == "sealed" else []
    except OSError as error:
        raise RecordError(f"{folder}: {error}") from error
    return changed + [f"{FOLDER}/{path.name}: {text}" for path in wire_paths(folder) for text in losses(path)]
