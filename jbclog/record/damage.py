"""Notes of damage: JSON lines in `damage.jsonl`, written before the work continues. The manifest
includes them. Damaged files are kept in `damaged/`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from jbclog.core.durable_files import write_whole
from jbclog.core.files import Kind, open_regular, read_regular
from jbclog.core.json_files import builder, json_of
from jbclog.core.operating_system import sync_folder
from jbclog.core.text import count_text
from jbclog.record.frames import readable_bytes

DAMAGE_NOTES: Final = "damage.jsonl"
REMAINS: Final = "damaged"


@dataclass(frozen=True, slots=True)
class Damage:
    """A loss: where, how many rows (None: unknown), and why."""

    place: str
    rows: int | None
    why: str

    def __str__(self) -> str:
        return (
            f"{self.place}: {self.why}"
            if self.rows is None
            else f"{self.place}, {count_text(self.rows, 'row')}: {self.why}"
        )


MOST_SHOWN: Final = 5  # damages in a sentence; `DAMAGE_NOTES` has all


def summary_of(damage: Sequence[Damage]) -> list[str]:
    """Return the first damages as text, and the number of the others."""
    texts = [str(entry) for entry in damage[:MOST_SHOWN]]
    more = len(damage) - MOST_SHOWN
    if more > 0:
        texts.append(count_text(more, "more place"))
    return texts


_build_damage: Final = builder(Damage)


def note_damage(folder: Path, damage: Iterable[Damage]) -> None:
    """Add damage to the notes, each once. Raises OSError."""
    known = read_damage(folder)
    added = [entry for entry in dict.fromkeys(damage) if entry not in known]
    if added:
        lines = [json.dumps(asdict(entry)) + "\n" for entry in known + added]
        write_whole(folder / DAMAGE_NOTES, "".join(lines).encode())


def read_damage(folder: Path) -> list[Damage]:
    """Return the notes of damage. Raises OSError."""
    try:
        data = read_regular(folder / DAMAGE_NOTES, Kind.DAMAGE)
    except FileNotFoundError:
        return []
    lines = data.decode(errors="replace").split("\n")
    return [_damage(line) for line in lines if line.strip()]


def _damage(line: str) -> Damage:
    """Parse a note; an unreadable one is damage itself."""
    try:
        return _build_damage(json_of(line))
    except ValueError:
        return Damage(DAMAGE_NOTES, None, f"a line of it cannot be read: {line!r:.60}")


def is_noted(folder: Path, path: Path) -> bool:
    """Return True if a note is about the file at `path`. Raises OSError."""
    return any(entry.place.startswith(path.name) for entry in read_damage(folder))


def _remains_path(folder: Path, path: Path) -> Path:
    home = folder / REMAINS
    home.mkdir(exist_ok=True)
    return home / path.relative_to(folder).as_posix().replace("/", "-")


def set_aside(folder: Path, path: Path) -> None:
    """Move a damaged file to `REMAINS`. Raises OSError."""
    remains = _remains_path(folder, path)
    path.replace(remains)
    sync_folder(remains.parent)
    sync_folder(path.parent)


def keep_copy(folder: Path, path: Path) -> None:
    """Copy a damaged segment, which is removed later, to `REMAINS`, with zeros for blocks that the
    disk cannot read. Raises OSError.
    """
    remains = _remains_path(folder, path)
    if not remains.exists():
        with open_regular(path, Kind.STORE) as file:
            write_whole(remains, readable_bytes(file))
