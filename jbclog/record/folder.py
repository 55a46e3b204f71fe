"""A run's folder: made once; the recipes in it, and what they say of joints."""

from __future__ import annotations

import re
import secrets
import shutil
import tomllib
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from jbclog.core.durable_files import sync_folder, write_whole
from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind, NotReadable, expect_answer, read_foreign
from jbclog.core.rows import StationFacts

# -- recipe copies ------------------------------------------------------------------------------------------------------------
# The copies of its recipes in a run's folder. A link in the place of their folder is not followed.

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


# -- joint settings -----------------------------------------------------------------------------------------------------------
# What the copies of a run's recipes say of joints: their `[joints]` tables, as they were checked when the run began.


def joints_asked(folder: Path, facts: StationFacts) -> Mapping[str, object]:
    """The keys of a station's `[joints]`; none where its recipe has none or cannot be read."""
    if facts.recipe is None:
        return {}
    try:
        data = read_foreign(recipe_copy(folder, facts.recipe), Kind.SETTINGS)
        table = tomllib.loads(data.decode()).get("joints")
    except (OSError, ValueError):
        return {}
    return table if isinstance(table, dict) else {}


# -- folder -------------------------------------------------------------------------------------------------------------------

LETTERS: Final = "abcdefghijklmnopqrstuvwxyz23456789"
LINE_NAME: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,63}")
RUN_NAME: Final = re.compile(rf"\d{{8}}T\d{{6}}Z-{LINE_NAME.pattern}-[{LETTERS}]{{4}}")
TRIES = 20


def create_run(out: Path, line_name: str, utc_s: float) -> Path:
    """Make the folder of a new run below `out` and prove that files in it last; give its path.

    `utc_s` is the run's start in seconds since 1970 UTC. Nothing of any station has been touched when this fails.
    Raises `RecordError`.
    """
    if not LINE_NAME.fullmatch(line_name):
        raise RecordError(f"{line_name!r} cannot be part of a folder's name")
    start = datetime.fromtimestamp(utc_s, UTC).strftime("%Y%m%dT%H%M%SZ")
    expect_answer(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        folder = _make(out, f"{start}-{line_name}")
        _prove(folder)
        sync_folder(out)
    except OSError as error:
        raise RecordError(f"{out} cannot hold a record: {error.strerror or error}. No station was touched.") from error
    return folder


def _make(out: Path, beginning: str) -> Path:
    for _ in range(TRIES):
        folder = out / f"{beginning}-{''.join(secrets.choice(LETTERS) for _ in range(4))}"
        try:
            folder.mkdir()  # fails where it is there already: two runs never share a folder
        except FileExistsError:
            continue
        return folder
    raise FileExistsError(f"no free name that begins with {beginning}")


def _prove(folder: Path) -> None:
    """Write, sync, rename and remove a file, as sealing will."""
    probe = folder / "probe"
    try:
        write_whole(probe, b"\0" * 4096)
        probe.unlink()
    except OSError:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def keep_text(folder: Path, name: str, text: str) -> None:
    """Keep `text`, exactly, as the file `name` of the run: the line file, a recipe. Raises `RecordError`."""
    path = folder / name
    try:
        path.parent.mkdir(exist_ok=True)
        write_whole(path, text.encode())
    except OSError as error:
        raise RecordError(f"{path} cannot be written: {error.strerror or error}") from error


def expect_no_links(folder: Path) -> None:
    """Raise `RecordError` where the folder holds a link: no recorder makes one, and what is written through it lands elsewhere."""
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            raise RecordError(f"{path} is a link; a run's folder holds none. Nothing was changed")
