"""Parse a Parquet file's footer without the library. Start with `groups_in`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from jbclog.core.foreign.files import NotReadable

# Thrift's compact protocol, as far as Parquet's footer and page headers need it:
# https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md, and
# https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift.
#
# The library parses the same bytes afterwards. Where it could read them differently, a value is
# refused: a duplicate field, a number too large for its type, a field id beyond 16 bits.

YES, NO, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, STRUCT = 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12
BITS: Final = {I16: 16, I32: 32, I64: 64}
SIGN: Final = 1
DEPTH: Final = 8
LONG_LIST: Final = 15
# cached footers (a week has 168 parts a table), and the maximum size of each
KEPT, KEPT_BYTES = 256, 64 << 10


class ThriftReader:
    """Reads Thrift values from bytes. Raises IndexError or ValueError for invalid data."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.at = 0

    def fields(self) -> Iterator[tuple[int, int]]:
        """Return id and type of each field of a struct. The caller reads each value in turn."""
        number, seen = 0, set()
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._signed(16)
            if number in seen or number >> 15:
                raise ValueError(f"field {number} is duplicate or out of range")
            seen.add(number)
            yield number, head & 0xF

    def integer(self, kind: int) -> int | None:
        """Read a value of type `kind`: a whole number, or None for another type."""
        if kind in BITS:
            return self._signed(BITS[kind])
        self.skip(kind)
        return None

    def binary(self, kind: int) -> bytes | None:
        """Read a value of type `kind`: bytes, or None for another type."""
        if kind != BINARY:
            self.skip(kind)
            return None
        length = self._varint()
        found = self._data[self.at : self.at + length]
        self.at += length
        if len(found) != length:
            raise ValueError("bytes beyond the end")
        return found

    def items(self, kind: int, of: int) -> Iterator[None]:
        """Iterate over a list of type `of`; the caller reads each item before the next. Another
        type has no items.
        """
        if kind != LIST:
            self.skip(kind)
            return
        count, found = self._list()
        if count and found != of:
            raise ValueError(f"a list of kind {found}")
        for _ in range(count):
            yield

    def skip(self, kind: int, depth: int = 0) -> None:
        """Skip a value of type `kind`."""
        if depth > DEPTH:
            raise ValueError("nested too deeply")
        if kind in BITS:
            self._varint()
        elif kind == BINARY:
            length = self._varint()
            self.at += length
        elif kind in (BYTE, DOUBLE):
            self.at += 1 if kind == BYTE else 8
        elif kind == STRUCT:
            for _, each in self.fields():
                self.skip(each, depth + 1)
        elif kind in (LIST, SET):
            count, each = self._list()
            for _ in range(count):
                self.skip(BYTE if each in (YES, NO) else each, depth + 1)
        elif kind not in (YES, NO):  # a struct's flag has its value in the type
            raise ValueError(f"a value of kind {kind}")
        if self.at > len(self._data):
            raise ValueError("bytes beyond the end")

    def _list(self) -> tuple[int, int]:
        head = self._byte()
        return (head >> 4 if head >> 4 < LONG_LIST else self._varint()), head & 0xF

    def _byte(self) -> int:
        self.at += 1
        return self._data[self.at - 1]

    def _varint(self) -> int:
        value = shift = 0
        while True:
            one = self._byte()
            value |= (one & 0x7F) << shift
            shift += 7
            if not one & 0x80:
                return value
            if shift > 63:
                raise ValueError("too large a number")

    def _signed(self, bits: int) -> int:
        value = self._varint()
        if value >> bits:
            raise ValueError(f"a number of more than {bits} bits")
        return (value >> SIGN) ^ -(value & SIGN)


# The library's own metadata view aborts the process (pyarrow 26: an exception that its Python
# binding does not catch) where a footer contradicts itself; one altered byte is enough.
GROUPS = 4  # fields of FileMetaData,
COLUMNS, ROWS = 1, 3  # of RowGroup,
ABOUT, SECRET, SECRET_ABOUT = 3, 8, 9  # of ColumnChunk,
# of ColumnMetaData,
PATH, VALUES, UNPACKED, PACKED, DATA_AT, DICTIONARY_AT, STATISTICS = 3, 5, 6, 7, 9, 11, 12
GREATEST, LEAST = 5, 6  # of Statistics
MOST_GROUPS = 8192


@dataclass(frozen=True, slots=True)
class ColumnChunk:
    """A column of a row group: name, number of values, sizes, offsets, minimum and maximum."""

    name: str
    values: int
    unpacked: int
    packed: int
    data_at: int
    dictionary_at: int | None
    least: bytes | None
    greatest: bytes | None


@dataclass(frozen=True, slots=True)
class RowGroup:
    """A row group: its number of rows and its columns."""

    rows: int
    chunks: tuple[ColumnChunk, ...]


def groups_in(footer: bytes) -> tuple[RowGroup, ...]:
    """Parse the row groups of a footer. Raises `NotReadable`.

    A report opens each part several times for each station, so the last few small footers are
    cached, and the last large one.
    """
    return _kept(footer) if len(footer) <= KEPT_BYTES else _last_large(footer)


def _groups_in(footer: bytes) -> tuple[RowGroup, ...]:
    reader, found = ThriftReader(footer), []
    try:
        for number, kind in reader.fields():
            if number != GROUPS:
                reader.skip(kind)
                continue
            for _ in reader.items(kind, STRUCT):
                found.append(_group(reader))
                if len(found) > MOST_GROUPS:
                    raise NotReadable(f"has more than {MOST_GROUPS} row groups")
    except (IndexError, ValueError):
        raise NotReadable("has an unreadable footer") from None
    return tuple(found)


_kept, _last_large = lru_cache(maxsize=KEPT)(_groups_in), lru_cache(maxsize=1)(_groups_in)


def _group(reader: ThriftReader) -> RowGroup:
    chunks: list[ColumnChunk] = []
    rows = None
    for number, kind in reader.fields():
        if number == COLUMNS:
            chunks += [_chunk(reader) for _ in reader.items(kind, STRUCT)]
        elif number == ROWS:
            rows = reader.integer(kind)
        else:
            reader.skip(kind)
    if rows is None:
        raise ValueError("a row group without a number of rows")
    return RowGroup(rows, tuple(chunks))


def _chunk(reader: ThriftReader) -> ColumnChunk:
    found = None
    for number, kind in reader.fields():
        if number == ABOUT and kind == STRUCT:
            found = _about(reader)
        elif number in (SECRET, SECRET_ABOUT):
            raise ValueError("an encrypted column")
        else:
            reader.skip(kind)
    if found is None:
        raise ValueError("a column without metadata")
    return found


def _about(reader: ThriftReader) -> ColumnChunk:
    numbers: dict[int, int | None] = {}
    names: list[bytes | None] = []
    least = greatest = None
    for number, kind in reader.fields():
        if number in (VALUES, UNPACKED, PACKED, DATA_AT, DICTIONARY_AT):
            numbers[number] = reader.integer(kind)
        elif number == PATH:
            names = [reader.binary(BINARY) for _ in reader.items(kind, BINARY)]
        elif number == STATISTICS and kind == STRUCT:
            least, greatest = _bounds(reader)
        else:
            reader.skip(kind)
    values, unpacked, packed, data_at = (
        numbers.get(number) for number in (VALUES, UNPACKED, PACKED, DATA_AT)
    )
    if values is None or unpacked is None or packed is None or data_at is None:
        raise ValueError("a column without its lengths")
    name = ".".join((part or b"").decode() for part in names)  # what is no text raises ValueError
    return ColumnChunk(
        name, values, unpacked, packed, data_at, numbers.get(DICTIONARY_AT), least, greatest
    )


def _bounds(reader: ThriftReader) -> tuple[bytes | None, bytes | None]:
    found: dict[int, bytes | None] = {}
    for number, kind in reader.fields():
        if number in (GREATEST, LEAST):
            found[number] = reader.binary(kind)
        else:
            reader.skip(kind)
    return found.get(LEAST), found.get(GREATEST)
