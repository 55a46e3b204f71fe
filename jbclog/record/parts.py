"""Parquet parts of a run's tables, and notes of damage.

A part is written to a temporary file, synced, read back, compared with its source, and only then
renamed. Its metadata holds the number of its last batch (`jbclog.through`), which separates its
rows from those of a live store.

Encodings (an hour of 32 stations, zstd 3: 5.4 bytes a row, 10 with Arrow's defaults): times and
ticks as differences, noisy integers with split bytes, the rest by dictionary.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from types import MappingProxyType
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from jbclog.core.durable_files import write_whole
from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, is_plain_folder, read_regular
from jbclog.core.json_files import builder, json_of
from jbclog.core.operating_system import sync_file, sync_folder
from jbclog.core.rows import TABLES
from jbclog.core.text import count_text
from jbclog.record.manifest import SealedFile
from jbclog.record.part_file import PartFile, open_part
from jbclog.record.schema import SCHEMAS, TEXT, lacking_in, with_columns

# Damage is noted as JSON lines in `damage.jsonl` before the work continues, and the manifest
# includes the notes. Damaged files are set aside in `damaged/`.

DAMAGE_NOTES: Final = "damage.jsonl"
REMAINS: Final = "damaged"


@dataclass(frozen=True, slots=True)
class Damage:
    """A loss: where, how many rows (None: unknown), why, and at most how many `seconds` of the
    run's end, if known.
    """

    place: str
    rows: int | None
    why: str
    seconds: float | None = None

    def __str__(self) -> str:
        return (
            f"{self.place}: {self.why}"
            if self.rows is None
            else f"{self.place}, {count_text(self.rows, 'row')}: {self.why}"
        )


MOST_SHOWN: Final = 5  # damages in a sentence; `DAMAGE_NOTES` has all


def summary_of(found: Sequence[Damage]) -> list[str]:
    """Return the first damages as text, and the number of the others."""
    more = len(found) - MOST_SHOWN
    return [str(one) for one in found[:MOST_SHOWN]] + [count_text(more, "more place")] * (more > 0)


_build_damage: Final = builder(Damage)


def note_damage(folder: Path, found: Iterable[Damage]) -> None:
    """Add damage to the notes, each once. Raises OSError."""
    known = read_damage(folder)
    new = [damage for damage in dict.fromkeys(found) if damage not in known]
    if new:
        write_whole(
            folder / DAMAGE_NOTES,
            "".join(json.dumps(asdict(damage)) + "\n" for damage in known + new).encode(),
        )


def read_damage(folder: Path) -> list[Damage]:
    try:
        lines = (
            read_regular(folder / DAMAGE_NOTES, Kind.DAMAGE).decode(errors="replace").split("\n")
        )
    except FileNotFoundError:
        return []
    return [_damage(line) for line in lines if line.strip()]


def _damage(line: str) -> Damage:
    """Parse a note; an unreadable one is damage itself."""
    try:
        return _build_damage(json_of(line))
    except ValueError:
        return Damage(DAMAGE_NOTES, None, f"a line of it cannot be read: {line!r:.60}")


def set_aside(folder: Path, path: Path) -> None:
    """Move a damaged file aside for inspection. Raises OSError."""
    home = folder / REMAINS
    home.mkdir(exist_ok=True)
    path.replace(home / path.relative_to(folder).as_posix().replace("/", "-"))
    sync_folder(home)
    sync_folder(path.parent)


# -- parts -----------------------------------------------------------------------------------------

ROWS_A_GROUP: Final = 32_768  # some 8 MB in memory
BYTES_A_GROUP: Final = 32 << 20  # long texts; a reader takes four times that
SPLIT: Final = ("late_us", "scan_us", "temperature_c", "power_permille")
DIFFERENCES: Final = ("time", "tick", "seq")
THROUGH: Final = b"jbclog.through"
PART: Final = re.compile(r"part-[0-9]{1,9}\.parquet")
PROBE: Final = "probe"  # file name for testing a new folder
HALF_A_LEASE: Final = "lease.json.new"
PREPARING: Final = "."  # readers of Parquet folders ignore names that begin with a dot

Groups = Callable[[], Iterable[pa.Table]]
"""Returns the rows of a part, a row group at a time; the same ones on each call."""
Wanted = Callable[[int], bool]
"""Returns True if a row group of a table is to be read, by its number from 0 over all parts."""
Seals = Mapping[Path, SealedFile]
"""Entries of parts in the manifest of a sealed run."""
NO_SEALS: Final[Seals] = MappingProxyType({})


def part_paths(folder: Path, table: str) -> list[Path]:
    """Return the existing parts of a table, in order."""
    if not is_plain_folder(folder / table):
        return []
    return sorted(
        (path for path in (folder / table).glob("part-*.parquet") if PART.fullmatch(path.name)),
        key=_index,
    )


def through(folder: Path, table: str) -> int:
    """Return the number of the last batch in the table's parts; 0 if there is none."""
    return parts_through(part_paths(folder, table))


def parts_through(parts: list[Path], seals: Seals = NO_SEALS) -> int:
    """As `through`, for parts listed before."""
    return part_through(parts[-1], seals.get(parts[-1])) if parts else 0


def part_through(path: Path, seal: SealedFile | None = None) -> int:
    """Return the number of the last batch in a part. Raises `RecordError` if it is not readable."""
    with open_part(path, seal) as part:
        last = (part.metadata.metadata or {}).get(THROUGH, b"")
    if not re.fullmatch(rb"[0-9]{1,19}", last):
        problem = f"is {last!r:.40}, no number" if last else "is missing"
        raise RecordError(
            f"{path} was not written by jbclog, or by other software since: its metadata"
            f" {THROUGH.decode()} (number of the last batch) {problem}"
        )
    return int(last)


def write_part(folder: Path, table: str, groups: Groups, last: int) -> Path:
    """Write the next part of `table`, with batches up to `last`. Raises OSError, RecordError."""
    home = folder / table
    home.mkdir(exist_ok=True)
    parts = part_paths(folder, table)
    path = home / f"part-{_index(parts[-1]) + 1 if parts else 0:04d}.parquet"
    aside = home / f"{PREPARING}{path.name}"
    try:
        _write(aside, table, groups, last)
        sync_file(aside)
        _compare(aside, groups)
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)
    sync_folder(home)
    sync_folder(folder)
    return path


def complete(folder: Path) -> None:
    """Write an empty part for every table without one, so that all tables are readable."""
    for table in TABLES:
        if not part_paths(folder, table):
            write_part(folder, table, lambda: (), 0)


def _index(part: Path) -> int:
    return int(part.stem.removeprefix("part-"))


def _write(path: Path, table: str, groups: Groups, last: int) -> None:
    schema = SCHEMAS[table]
    encoded = dict.fromkeys(SPLIT, "BYTE_STREAM_SPLIT") | dict.fromkeys(
        DIFFERENCES, "DELTA_BINARY_PACKED"
    )
    plain = {name: encoding for name, encoding in encoded.items() if name in schema.names}
    with pq.ParquetWriter(
        path,
        schema,
        compression="zstd",
        compression_level=3,
        use_dictionary=[name for name in schema.names if name not in plain],
        column_encoding=plain,
        write_page_checksum=True,
    ) as writer:
        for group in groups():
            writer.write_table(group, row_group_size=max(group.num_rows, 1))
        writer.add_key_value_metadata({THROUGH: str(last)})


def _compare(path: Path, groups: Groups) -> None:
    """Raise RecordError unless the file, as read back, equals `groups`: jbclog must be able to read
    what it writes.
    """
    with open_part(path) as part:
        written = 0
        for group in groups():
            if written >= part.num_row_groups or not part.group(written).equals(group):
                raise RecordError(f"{path}: row group {written} is not what was written")
            written += 1
        if written != part.num_row_groups:
            raise RecordError(f"{path}: {part.num_row_groups} row groups instead of {written}")


def regroup(tables: Iterable[pa.Table]) -> Iterator[pa.Table]:
    """Yield small tables joined to groups of at least `ROWS_A_GROUP` rows or `BYTES_A_GROUP`."""
    held: list[pa.Table] = []
    count = size = 0
    for table in tables:
        held.append(table)
        count, size = count + table.num_rows, size + table.nbytes
        if count >= ROWS_A_GROUP or size >= BYTES_A_GROUP:
            yield pa.concat_tables(held).combine_chunks()
            held, count, size = [], 0, 0
    if count:
        yield pa.concat_tables(held).combine_chunks()


def row_groups(
    folder: Path, table: str, columns: list[str] | None = None, *, coded: bool = False
) -> Iterator[pa.Table]:
    """Yield the sealed rows of a table by row groups; `coded`: with dictionaries for texts."""
    return groups_of(part_paths(folder, table), columns, coded=coded)


def groups_of(
    parts: Iterable[Path],
    columns: list[str] | None = None,
    *,
    coded: bool = False,
    wanted: Wanted | None = None,
    seals: Seals = NO_SEALS,
    on_damage: Callable[[str], None] | None = None,
) -> Iterator[pa.Table]:
    """Yield the rows of these parts by row groups, all or only those `wanted`; `coded`: with
    dictionaries for texts. A part with an entry in `seals` must agree with it.

    A damaged row group is left out and reported to `on_damage`; without that it is an error.
    """
    numbers = count()
    for path in parts:
        with _opened(path, seals.get(path), coded=coded) as part:
            for index in range(part.num_row_groups):
                number = next(numbers)
                if wanted is not None and not wanted(number):
                    continue
                try:
                    group = group_of(part, path.parent.name, index, columns)
                except RecordError as error:
                    if on_damage is None:
                        raise
                    on_damage(str(error))
                    continue
                yield group


def group_of(
    file: PartFile, table: str, index: int, columns: Sequence[str] | None = None
) -> pa.Table:
    """Return a row group of a part; columns that the part lacks are null."""
    lacking = lacking_in(table, file.schema.names)
    if not lacking:
        return file.group(index, columns)
    asked = SCHEMAS[table].names if columns is None else columns
    # without any column a file returns no rows
    there = [name for name in asked if name not in lacking] or file.schema.names[:1]
    rows = with_columns(file.group(index, there), table, [one for one in lacking if one in asked])
    return rows.select([name for name in rows.column_names if name in asked])


@contextmanager
def _opened(path: Path, seal: SealedFile | None, *, coded: bool) -> Iterator[PartFile]:
    """Open a part and check that it has the columns of its table. Raises RecordError."""
    table = path.parent.name
    schema = SCHEMAS[table]
    texts = [one.name for one in schema if one.type == TEXT]
    with open_part(path, seal, texts if coded else ()) as part:
        lacking = lacking_in(table, part.schema.names)
        if not part.schema.equals(pa.schema([one for one in schema if one.name not in lacking])):
            raise RecordError(f"{path} is no part of {table}: its columns are others")
        yield part


def remove_leavings(folder: Path) -> None:
    """Remove half-written files of a crash from the tables' folders."""
    for table in TABLES:
        for path in (folder / table).glob(f"{PREPARING}part-*.parquet"):
            path.unlink()


def remove_unfinished(folder: Path) -> None:
    """Remove temporary files of a crash: those of small files, of the guard's lease, and of the
    folder's test.
    """
    for path in [
        *folder.glob(".*.tmp"),
        *folder.glob("recipes/.*.tmp"),
        folder / PROBE,
        folder / HALF_A_LEASE,
    ]:
        path.unlink(missing_ok=True)


def read_through(path: Path) -> None:
    """Read a part to its end, verifying the checksums of its pages. Raises `RecordError`."""
    part_through(path)
    with open_part(path) as part:
        declared = part.num_rows
    rows = sum(len(group) for group in groups_of([path]))
    if rows != declared:
        raise RecordError(f"{path} holds {rows} rows, its footer says {declared}")
