"""Compare sealed files with the manifest before they are shown or replayed.

Parquet's checksums do not cover its footer, where one flipped bit changes times, types and counts;
the manifest's hashes do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Final

from jbclog.core.errors import RecordError
from jbclog.core.text import clean
from jbclog.record.capture import FOLDER, Head, Hole, holes, is_done, read_head, wire_paths
from jbclog.record.conclude import sealed_file
from jbclog.record.manifest import NAME, Manifest, wrong_digest


def expect_manifest_unchanged(folder: Path) -> None:
    """Raise `RecordError` if the manifest's digest does not match."""
    try:
        digest = wrong_digest(folder)
    except (OSError, ValueError) as error:
        raise RecordError(f"{folder / NAME} cannot be read: {error}") from error
    if digest:
        raise RecordError(
            f"{folder / NAME} {digest}, so the run is not shown; `jbclog check {folder}` lists all"
            " findings"
        )


def expect_unchanged(folder: Path, manifest: Manifest, table: str, parts: Sequence[Path]) -> None:
    """Raise `RecordError` unless the parts of a sealed run's table are the sealed ones."""
    listed = {
        file.path: file.sha256 for file in manifest.files if file.path.startswith(f"{table}/")
    }
    there = {path.relative_to(folder).as_posix(): path for path in parts}
    for name in sorted(listed.keys() | there.keys()):
        trouble = _trouble(there.get(name), listed.get(name), folder)
        if trouble:
            raise RecordError(
                f"{folder / name} {trouble}, so {table} are not shown; `jbclog check {folder}`"
                " lists all findings"
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
    """Return the SHA-256 of a file, computed again only if its time or size changes."""
    return sealed_file(folder, path, None).sha256


PLAYED: Final = (f"{FOLDER}/", "recipes/", "line.toml")  # files that a replay reads
CHANGED: Final = "was changed: its SHA-256 is not the manifest's"
MOST_LOSSES: Final = 100  # of a capture, reported one by one


def losses(path: Path) -> Iterator[str]:
    """Yield a sentence for each stretch of a capture file that is damaged or unreadable, up to
    `MOST_LOSSES`, and how many more there are.
    """
    head, why, found = None, "", list[Hole]()
    try:
        head = read_head(path)
    except RecordError as error:
        why = portable(error, path)
    try:
        found = holes(path)
    except RecordError as error:
        yield why or portable(error, path)
        return
    if why and not any(hole.gap.is_refused for hole in found):
        yield why
    yield from (hole.describe(head) for hole in found[:MOST_LOSSES])
    if len(found) > MOST_LOSSES:
        yield f"{len(found) - MOST_LOSSES} more stretches are damaged or missing"


def portable(error: Exception, path: Path) -> str:
    """Return the error's text without the folder of `path`, which may be moved."""
    return clean(str(error)).replace(clean(str(path)), path.name)


def ends_early(path: Path) -> bool:
    """Return True if a capture file lacks its session's end."""
    return path.stat().st_size > 0 and not is_done(path)


def readable_heads(paths: Sequence[Path]) -> list[Head]:
    """Return the readable heads of capture files. Raises `RecordError` if there is none."""
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
    """Yield a sentence for each file that a replay reads and that differs from the manifest. Raises
    OSError.
    """
    for listed in manifest.files:
        if not listed.path.startswith(PLAYED) or ".." in Path(listed.path).parts:
            continue
        path = folder / listed.path
        if not path.is_file():
            yield f"{listed.path}: is missing"
        elif sealed_file(folder, path, None).sha256 != listed.sha256:
            yield f"{listed.path}: {CHANGED}"


def doubts(folder: Path, manifest: Manifest | None) -> list[str]:
    """Return all damage to files that a replay reads. Raises `RecordError`."""
    try:
        changed = (
            [*changed_since(folder, manifest)]
            if manifest is not None and manifest.is_sealed
            else []
        )
    except OSError as error:
        raise RecordError(f"{folder}: {error}") from error
    return changed + [
        f"{FOLDER}/{path.name}: {text}" for path in wire_paths(folder) for text in losses(path)
    ]
