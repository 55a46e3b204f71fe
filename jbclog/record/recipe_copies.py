"""The copies of its recipes in a run's folder. A link in the place of their folder is not followed."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from jbclog.core.foreign.files import Kind, NotReadable, read_foreign

FOLDER: Final = "recipes"


def recipe_copy(folder: Path, file: str) -> Path:
    """The copy of the recipe that was `file`. Raises `NotReadable` where their folder is not one."""
    return _copies(folder) / Path(file).name


def recipe_texts(folder: Path) -> list[bytes]:
    """The bytes of each copy. Raises OSError where one cannot be read."""
    return [read_foreign(path, Kind.SETTINGS) for path in sorted(_copies(folder).glob("*.toml"))]


def _copies(folder: Path) -> Path:
    copies = folder / FOLDER
    if copies.is_symlink():
        raise NotReadable(f"{FOLDER}/ is a link, not a folder")
    return copies
