"""What of the wires of a run is lost, or was changed since: by their own check sums, and by the manifest's hashes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from jbclog.core.errors import RecordError
from jbclog.record.capture import FOLDER, Head, holes, is_done, read_head, wire_paths
from jbclog.record.conclude import sealed_file
from jbclog.record.manifest import Manifest

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
