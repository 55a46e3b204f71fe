"""What could not be kept or read, noted where the manifest will find it: nothing is lost silently.

Notes are lines of JSON in `damage.jsonl`, written before anything goes on; files that can still be looked at are set
aside in `damaged/`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, cast

from jbclog.core.durable_files import sync_folder, write_whole
from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.foreign.json_reader import Misfit, build, json_of

NOTES: Final = "damage.jsonl"
REMAINS: Final = "damaged"


@dataclass(frozen=True, slots=True)
class Damage:
    """One thing that is gone: where it stood, how many rows it held (None: not known), why.

    `seconds` is how much of the run's end it is at the most, where that is known.
    """

    place: str
    rows: int | None
    why: str
    seconds: float | None = None

    def __str__(self) -> str:
        return f"{self.place}: {self.why}" if self.rows is None else f"{self.place}, {self.rows} rows: {self.why}"


def note(folder: Path, found: Iterable[Damage]) -> None:
    """Add to the notes, once each. Raises OSError."""
    known = read(folder)
    new = [damage for damage in dict.fromkeys(found) if damage not in known]
    if new:
        write_whole(folder / NOTES, "".join(json.dumps(asdict(damage)) + "\n" for damage in known + new).encode())


def read(folder: Path) -> list[Damage]:
    """The notes; none where nothing was ever damaged."""
    try:
        lines = read_foreign(folder / NOTES, Kind.DAMAGE).decode(errors="replace").split("\n")
    except FileNotFoundError:
        return []
    return [_damage(line) for line in lines if line.strip()]


def _damage(line: str) -> Damage:
    """A note; one that cannot be read is damage itself."""
    try:
        return cast(Damage, build(Damage, json_of(line)))
    except (ValueError, Misfit):
        return Damage(NOTES, None, f"a line of it cannot be read: {line!r:.60}")


def set_aside(folder: Path, path: Path) -> None:
    """Keep a damaged file, out of the way, for whoever wants to look at it. Raises OSError."""
    home = folder / REMAINS
    home.mkdir(exist_ok=True)
    path.replace(home / path.relative_to(folder).as_posix().replace("/", "-"))
    sync_folder(home)
    sync_folder(path.parent)
