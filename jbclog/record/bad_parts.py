"""Parts that are not what was sealed, or cannot be read: found, noted, and set aside so that their rows can be sealed anew."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa

from jbclog.core.errors import RecordError
from jbclog.record import damage
from jbclog.record.conclude import sealed_file
from jbclog.record.manifest import Manifest, SealedFile
from jbclog.record.parts import part_paths, read_through
from jbclog.record.schema import TABLES


def changed(folder: Path, manifest: Manifest) -> dict[str, str]:
    """Parts that a manifest lists and that are not what was sealed, and why not."""
    found = {}
    for listed in manifest.files:
        if listed.path.partition("/")[0] in TABLES:
            why = _difference(folder, listed)
            if why:
                found[listed.path] = why
    return found


def _difference(folder: Path, listed: SealedFile) -> str | None:
    path = folder / listed.path
    try:
        if not path.is_file():
            return "is missing"
        return None if sealed_file(folder, path, None).sha256 == listed.sha256 else "was changed after it was sealed"
    except (OSError, ValueError) as error:  # not ours to read; a name that no file can have
        return f"cannot be read: {getattr(error, 'strerror', None) or error}"


def set_aside(folder: Path, manifest: Manifest) -> None:
    """Set parts aside that cannot be read or were changed; rows of theirs that the live store still has are sealed again."""
    wrong = changed(folder, manifest)
    for table in TABLES:
        for path in part_paths(folder, table):
            name = f"{table}/{path.name}"
            why = wrong.pop(name, None) or _unreadable(path)
            if why:
                damage.note(folder, [damage.Damage(name, None, why)])
                damage.set_aside(folder, path)
    damage.note(folder, [damage.Damage(name, None, why) for name, why in wrong.items()])


def _unreadable(path: Path) -> str | None:
    try:
        read_through(path)
    except (pa.ArrowException, OSError, RecordError) as error:
        return "cannot be read: " + str(error).replace(str(path), path.name)  # the folder may be moved
    return None
