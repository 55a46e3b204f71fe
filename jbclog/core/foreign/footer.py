"""What a Parquet file's footer says of its row groups, read without the library.

The library's own view of a column ends the whole process where a footer contradicts itself (an exception that its binding for
Python does not catch, as pyarrow 26 has it), and one altered byte is enough for that.
"""

from __future__ import annotations

from dataclasses import dataclass

from jbclog.core.foreign.compact import BINARY, STRUCT, Compact
from jbclog.core.foreign.files import NotReadable

GROUPS = 4  # fields of FileMetaData,
COLUMNS, ROWS = 1, 3  # of RowGroup,
ABOUT, SECRET, SECRET_ABOUT = 3, 8, 9  # of ColumnChunk,
PATH, VALUES, UNPACKED, PACKED, DATA_AT, DICTIONARY_AT, STATISTICS = 3, 5, 6, 7, 9, 11, 12  # of ColumnMetaData,
GREATEST, LEAST = 5, 6  # of Statistics
MOST_GROUPS = 8192


@dataclass(frozen=True, slots=True)
class Chunk:
    """A column of a row group: its name, how many values it has, its bytes, where they begin, and its least and greatest value."""

    name: str
    values: int
    unpacked: int
    packed: int
    data_at: int
    dictionary_at: int | None
    least: bytes | None
    greatest: bytes | None


@dataclass(frozen=True, slots=True)
class Group:
    """A row group."""

    rows: int
    chunks: tuple[Chunk, ...]


def groups_in(footer: bytes) -> tuple[Group, ...]:
    """The row groups of a footer. Raises `NotReadable`."""
    reader, found = Compact(footer), []
    try:
        for number, kind in reader.heads():
            if number != GROUPS:
                reader.skip(kind)
                continue
            for _ in reader.items(kind, STRUCT):
                found.append(_group(reader))
                if len(found) > MOST_GROUPS:
                    raise NotReadable(f"has more than {MOST_GROUPS} row groups")
    except (IndexError, ValueError):
        raise NotReadable("has a footer that cannot be read") from None
    return tuple(found)


def _group(reader: Compact) -> Group:
    chunks: list[Chunk] = []
    rows = None
    for number, kind in reader.heads():
        if number == COLUMNS:
            chunks += [_chunk(reader) for _ in reader.items(kind, STRUCT)]
        elif number == ROWS:
            rows = reader.integer(kind)
        else:
            reader.skip(kind)
    if rows is None:
        raise ValueError("a row group without a number of rows")
    return Group(rows, tuple(chunks))


def _chunk(reader: Compact) -> Chunk:
    found = None
    for number, kind in reader.heads():
        if number == ABOUT and kind == STRUCT:
            found = _about(reader)
        elif number in (SECRET, SECRET_ABOUT):
            raise ValueError("an encrypted column")
        else:
            reader.skip(kind)
    if found is None:
        raise ValueError("a column of which nothing is said")
    return found


def _about(reader: Compact) -> Chunk:
    numbers: dict[int, int | None] = {}
    names: list[bytes | None] = []
    least = greatest = None
    for number, kind in reader.heads():
        if number in (VALUES, UNPACKED, PACKED, DATA_AT, DICTIONARY_AT):
            numbers[number] = reader.integer(kind)
        elif number == PATH:
            names = [reader.binary(BINARY) for _ in reader.items(kind, BINARY)]
        elif number == STATISTICS and kind == STRUCT:
            least, greatest = _bounds(reader)
        else:
            reader.skip(kind)
    values, unpacked, packed, data_at = (numbers.get(number) for number in (VALUES, UNPACKED, PACKED, DATA_AT))
    if values is None or unpacked is None or packed is None or data_at is None:
        raise ValueError("a column without its lengths")
    name = ".".join((part or b"").decode() for part in names)  # what is no text raises ValueError
    return Chunk(name, values, unpacked, packed, data_at, numbers.get(DICTIONARY_AT), least, greatest)


def _bounds(reader: Compact) -> tuple[bytes | None, bytes | None]:
    found: dict[int, bytes | None] = {}
    for number, kind in reader.heads():
        if number in (GREATEST, LEAST):
            found[number] = reader.binary(kind)
        else:
            reader.skip(kind)
    return found.get(LEAST), found.get(GREATEST)
