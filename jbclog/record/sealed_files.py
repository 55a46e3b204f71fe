"""Compare sealed files with the manifest before they are shown or replayed. Parts are compared by
their footers when they are opened (`part_file`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from jbclog.core.errors import RecordError
from jbclog.core.text import clean
from jbclog.record.capture import FOLDER, Head, Hole, holes, is_done, read_head, wire_paths
from jbclog.record.conclude import sealed_file
from jbclog.record.manifest import NAME, Manifest, SealedFile, wrong_digest
from jbclog.record.part_file import CHANGED


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


def seals_of(
    folder: Path, manifest: Manifest, table: str, parts: Sequence[Path]
) -> dict[Path, SealedFile]:
    """Return the entry of each part of a table in the manifest of a sealed run. Raises
    `RecordError` if a part is missing or not listed.
    """
    listed = {
        folder / file.path: file for file in manifest.files if file.path.startswith(f"{table}/")
    }
    for path in sorted({*listed, *parts}):
        if path not in parts:
            trouble = "is missing"
        elif path not in listed:
            trouble = "is not in the manifest"
        else:
            continue
        raise RecordError(
            f"{path} {trouble}, so {table} are not shown; `jbclog check {folder}` lists all"
            " findings"
        )
    return listed


PLAYED: Final = (f"{FOLDER}/", "recipes/", "line.toml")  # files that a replay reads
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
