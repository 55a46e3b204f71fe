"""The last step of a run: everything that can be derived is derived, the manifest is written, the live store goes.

It can be done again after a crash at any point: what is there is derived anew, and nothing is removed before the
manifest that says ``sealed`` is on the disk.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, cast

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.durable_files import sync_folder
from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind, open_foreign
from jbclog.core.foreign.json_reader import Misfit, build, json_of
from jbclog.core.foreign.tables import metadata_of
from jbclog.core.locks import FolderLock, witness
from jbclog.core.rows import StationFacts
from jbclog.record import capture, damage, guard_actions, left_hot
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.ledger import ledger_of
from jbclog.record.manifest import NAME, Lost, Manifest, SealedFile, iso, write_manifest
from jbclog.record.parts import complete, part_paths, row_groups, through
from jbclog.record.schema import TABLES
from jbclog.record.store import companions, segments
from jbclog.record.store_reader import StoreReader
from jbclog.record.units import units_of

RUNNING: Final = "running"
NOT_KEPT: Final = "could not be kept while the disk did not take them"
OF_REPORT: Final = ("report.html", "report.pdf", "report.json", "joints.parquet")
LATER: Final = (NAME, ANNOTATIONS, guard_actions.LEASE, guard_actions.LOCK)
"""Files of the folder that are not the record: the manifest itself, what comes after sealing, and what says of tools left hot."""
MADE: Final = (("figures/", ".svg"), ("tables/", ".csv"))  # folders that a report makes, and what is in them

TAKEN_IN: Final = ("line.toml", "recipes", capture.FOLDER, guard_actions.DIARY, damage.NOTES, damage.REMAINS)


def conclude(folder: Path, manifest: Manifest, lock: FolderLock) -> Manifest:
    """Close a run whose rows are all sealed (`seal`): give the manifest as it was written, state ``sealed``.

    `manifest` brings what only the recorder knows: outcome, verdict, times. Stations, ledger, losses and files are put
    in here. The lock is given up and removed. Raises `RecordError`, and then nothing was removed.
    """
    lock.expect_ours()
    try:
        complete(folder)
        with StoreReader(folder) as stock:
            _refuse_unsealed(stock)
            damage.note(folder, stock.damage)
            stations = stations_of(folder, stock, manifest)
            stations = left_hot.with_unknown(stations, left_hot.unknown(folder, stations, manifest.guard))
            dropped = unkept_rows(stock)
        lost = manifest.lost or _lost(damage.read(folder), dropped)
        sealed = replace(manifest, state="sealed", stations=stations, lost=lost, ended=manifest.ended or last_time(folder))
        sealed.ledger = ledger_of(folder, stations)
        sealed.units = units_of(folder)
        _keep_damaged(folder)
        guard_actions.tidy(folder)
        sealed.files = list(files_of(folder))
    except (OSError, pa.ArrowException) as error:
        raise RecordError(f"{folder} cannot be sealed: {error}") from error
    write_manifest(folder, sealed)
    remove_live(folder, lock)
    return sealed


def _refuse_unsealed(stock: StoreReader) -> None:
    waiting = sum(len(stock.numbers_of(table, through(stock.folder, table))) for table in TABLES)
    if waiting:
        raise RecordError(f"{stock.folder}: {waiting} batches of the live store are not sealed yet")


def stations_of(folder: Path, stock: StoreReader, manifest: Manifest) -> list[StationFacts]:
    """The facts, with what a guard reached."""
    return guard_actions.with_guard(folder, known_stations(stock, manifest.stations))


def unkept_rows(stock: StoreReader) -> int:
    """How many rows the disk never took: as the store has it, or the recorder's last word where that did not come into it."""
    return max(stock.dropped_rows, witness(stock.folder).unkept)


def known_stations(stock: StoreReader, known: list[StationFacts]) -> list[StationFacts]:
    """The facts in the live store, in the order in which the manifest has the stations already.

    What the recorder itself says of a session that has ended is the last word: its store may not have taken that any more.
    """
    facts = {station.name: station for station in known}
    for name, text in stock.facts().items():
        if name in facts and facts[name].outcome != RUNNING:
            continue
        try:
            facts[name] = cast(StationFacts, build(StationFacts, json_of(text)))
        except (ValueError, Misfit) as error:
            raise RecordError(f"{stock.folder}: what is known of station {name} cannot be read: {error}") from error
    return list(facts.values())


def _lost(found: list[damage.Damage], dropped: int) -> Lost | None:
    parts = [str(one) for one in found]
    if dropped:
        parts.append(f"{dropped} rows {NOT_KEPT}")
    return Lost(None, "; ".join(parts)) if parts else None


def _keep_damaged(folder: Path) -> None:
    """A store that was found damaged is not removed; one whose end is missing has nothing more to show."""
    if any(one.seconds is None for one in damage.read(folder)):
        for path in segments(folder):
            beside = companions(path)
            damage.set_aside(folder, path)
            for each in beside:
                with contextlib.suppress(FileNotFoundError):  # a reader removes what SQLite made for it
                    damage.set_aside(folder, each)


def last_time(folder: Path) -> str | None:
    """The time of the last row that is sealed, as in the manifest; None where there is no row at all."""
    latest = last_micros(folder)
    return None if latest is None else iso(latest)


def last_micros(folder: Path) -> int | None:
    """The same in UTC microseconds."""
    latest = [
        pc.max(group["time"]).cast(pa.int64()).as_py()
        for table in TABLES
        for group in row_groups(folder, table, ["time"])
        if len(group)
    ]
    return max(latest, default=None)


def files_of(folder: Path) -> Iterator[SealedFile]:
    """Every file of the record with its rows, size and hash."""
    for table in TABLES:
        for path in part_paths(folder, table):
            yield sealed_file(folder, path, metadata_of(path).num_rows)
    for name in TAKEN_IN:
        there = folder / name
        for path in sorted(there.iterdir()) if there.is_dir() else [there] if there.exists() else []:
            yield sealed_file(folder, path, capture.count_rows(path) if name == capture.FOLDER else None)


def sealed_file(folder: Path, path: Path, rows: int | None) -> SealedFile:
    with open_foreign(path, Kind.RECORD) as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return SealedFile(path.relative_to(folder).as_posix(), rows, path.stat().st_size, digest)


def is_later(name: str) -> bool:
    """Whether what lies at `name` in the folder may come, change and go after sealing."""
    return name in LATER or is_of_report(name)


def is_of_report(name: str) -> bool:
    """Whether `report` writes a file of that name."""
    made = any(name.startswith(folder) and name.endswith(ending) for folder, ending in MADE)
    return name in OF_REPORT or (made and name.count("/") == 1)


def live_files(folder: Path) -> list[Path]:
    """What a recorder needs while it runs, and a sealed run does not have."""
    return sorted(folder.glob("live[.-]*"))


def remove_live(folder: Path, lock: FolderLock) -> None:
    """Remove the live store and the lock of a run that is sealed. Raises `RecordError`."""
    try:
        for path in live_files(folder):
            if path.name != lock.name:
                path.unlink(missing_ok=True)  # a reader removes what SQLite made for it
        lock.remove()
        sync_folder(folder)
    except OSError as error:
        raise RecordError(f"{folder}: the live store of a sealed run cannot be removed: {error}") from error
