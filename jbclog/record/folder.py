"""Create a run's folder, and read the recipe copies in it."""

from __future__ import annotations

import re
import secrets
import shutil
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from jbclog.core.disk_space import write_failure
from jbclog.core.durable_files import write_whole
from jbclog.core.errors import Problems, RecordError
from jbclog.core.files import NotReadable, entries_below
from jbclog.core.operating_system import sync_folder
from jbclog.core.rows import StationFacts
from jbclog.core.toml import parse, read_text

FOLDER: Final = "recipes"
DERIVED: Final = "derived"
DERIVED_TABLES: Final = ("joints", "alarms", "units", "tips", "metrics", "accounting", "gaps")
"""Tables in `derived/`, each a file: added after sealing, never part of the record."""


def derived_file(table: str) -> str:
    """Return the name of a derived table's file within the run's folder."""
    return f"{DERIVED}/{table}.parquet"


def recipe_copy(folder: Path, file: str) -> Path:
    """Return the path of the copy of recipe `file`. Raises NotReadable if the folder is a link."""
    return _copies(folder) / Path(file).name


def recipe_copies(folder: Path) -> list[dict[str, object]]:
    """Return the tables of each recipe copy. Raises OSError or Problems."""
    return [_tables_in(path) for path in sorted(_copies(folder).glob("*.toml"))]


def _tables_in(copy: Path) -> dict[str, object]:
    return parse(read_text(copy, links=False), copy.name).tables


def _copies(folder: Path) -> Path:
    copies = folder / FOLDER
    if copies.is_symlink():
        raise NotReadable(f"{FOLDER}/ is a link, not a folder")
    return copies


def joints_asked(folder: Path, facts: StationFacts) -> Mapping[str, object]:
    """Return the table `[joints]` of a station's recipe, as checked at the start; empty if it is
    missing or unreadable.
    """
    return recipe_table(folder, facts, "joints")


def recipe_table(folder: Path, facts: StationFacts, name: str) -> Mapping[str, object]:
    """Return a table of a station's recipe, as checked at the start; empty if it is unreadable."""
    if facts.recipe is None:
        return {}
    try:
        table = _tables_in(recipe_copy(folder, facts.recipe)).get(name)
    except (OSError, ValueError, Problems):
        return {}
    return table if isinstance(table, dict) else {}


LETTERS: Final = "abcdefghijklmnopqrstuvwxyz23456789"
LINE_NAME: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,63}")
RUN_NAME: Final = re.compile(rf"\d{{8}}T\d{{6}}Z-{LINE_NAME.pattern}-[{LETTERS}]{{4}}")
TRIES = 20


def create_run(out: Path, line_name: str, utc_s: float) -> Path:
    """Create the folder of a new run below `out`, test that files in it are durable, and return its
    path. Raises RecordError.

    `utc_s`: the run's start in seconds since 1970 UTC.
    """
    if not LINE_NAME.fullmatch(line_name):
        raise RecordError(f"{line_name!r} cannot be part of a folder's name")
    start = datetime.fromtimestamp(utc_s, UTC).strftime("%Y%m%dT%H%M%SZ")
    try:
        out.mkdir(parents=True, exist_ok=True)
        folder = _make(out, f"{start}-{line_name}")
        _test_durability(folder)
        sync_folder(out)
    except OSError as error:
        raise RecordError(
            f"{out} cannot hold a record: {write_failure(error, out)}. No station was touched."
        ) from error
    return folder


def _make(out: Path, beginning: str) -> Path:
    for _ in range(TRIES):
        folder = out / f"{beginning}-{''.join(secrets.choice(LETTERS) for _ in range(4))}"
        try:
            folder.mkdir()  # fails if it exists: two runs never share a folder
        except FileExistsError:
            continue
        return folder
    raise FileExistsError(f"no free name that begins with {beginning}")


def _test_durability(folder: Path) -> None:
    """Write, sync, rename and remove a file, as sealing does."""
    probe = folder / "probe"
    try:
        write_whole(probe, b"\0" * 4096)
        probe.unlink()
    except OSError:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def keep_text(folder: Path, name: str, text: str) -> None:
    """Store `text` unchanged as the file `name`, such as the line file. Raises RecordError."""
    path = folder / name
    try:
        path.parent.mkdir(exist_ok=True)
        write_whole(path, text.encode())
    except OSError as error:
        raise RecordError(f"{path} cannot be written: {write_failure(error, folder)}") from error


def expect_no_links(folder: Path) -> None:
    """Raise RecordError if the folder contains a link: no recorder makes one, and writing through
    it would change other files.
    """
    try:
        links = sorted(entry.path for entry in entries_below(folder) if entry.is_symlink())
    except OSError as error:
        raise RecordError(
            f"{folder} cannot be read: {error.strerror or error}. Nothing was changed"
        ) from error
    if links:
        raise RecordError(f"{links[0]} is a link; a run's folder holds none. Nothing was changed")
