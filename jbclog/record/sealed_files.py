"""Compare sealed files with the manifest before they are shown. Parts are compared by their footers
when they are opened (`part_file`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jbclog.core.errors import RecordError
from jbclog.core.text import clean
from jbclog.record.manifest import NAME, Manifest, SealedFile, wrong_digest


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


def portable(error: Exception, path: Path) -> str:
    """Return the error's text without the folder of `path`, which may be moved."""
    return clean(str(error)).replace(clean(str(path)), path.name)
