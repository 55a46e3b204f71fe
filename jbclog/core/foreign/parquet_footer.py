"""What a Parquet file declares of itself, read without the library. Start with `groups_in`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from jbclog.core.foreign.files import NotReadable

# -- compact ------------------------------------------------------------------------------------------------------------------
# Thrift's compact protocol, so far as Parquet's footer and page heads need it.
#
# Its description: https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md; Parquet's structures:
# https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift.
#
# The library reads the same bytes after this. Where it could take them otherwise than this does, a value is refused: a field that
# stands twice, a number that is too large for its kind, a field's number beyond 16 bits.

YES, NO, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, STRUCT = 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12
BITS: Final = {I16: 16, I32: 32, I64: 64}
SIGN: Final = 1
DEPTH: Final = 8
LONG_LIST: Final = 15
KEPT, KEPT_BYTES = 16, 64 << 10  # footers, and the size of each


class Compact:
    """Bytes, read from the beginning. All raise IndexError or ValueError where they are no such thing."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.at = 0

    def heads(self) -> Iterator[tuple[int, int]]:
        """Number and kind of each field of a struct. Whoever asks reads its value before the next."""
        number, seen = 0, set()
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._signed(16)
            if number in seen or number >> 15:
                raise ValueError(f"field {number} stands twice, or has no such number")
            seen.add(number)
            yield number, head & 0xF

    def integer(self, kind: int) -> int | None:
        """A value of `kind`: a whole number, or None for one that is none."""
        if kind in BITS:
            return self._signed(BITS[kind])
        self.skip(kind)
        return None

    def binary(self, kind: int) -> bytes | None:
        """A value of `kind`: its bytes, or None for one that has none."""
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
        """The members of a list of `of`, each to be read before the next; of any other value none."""
        if kind != LIST:
            self.skip(kind)
            return
        count, found = self._list()
        if count and found != of:
            raise ValueError(f"a list of kind {found}")
        for _ in range(count):
            yield

    def skip(self, kind: int, depth: int = 0) -> None:
        """Go past a value of `kind`."""
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
            for _, each in self.heads():
                self.skip(each, depth + 1)
        elif kind in (LIST, SET):
            count, each = self._list()
            for _ in range(count):
                self.skip(BYTE if each in (YES, NO) else each, depth + 1)
        elif kind not in (YES, NO):  # a flag of a struct is its kind
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


# -- footer -------------------------------------------------------------------------------------------------------------------
# What a Parquet file's footer says of its row groups, read without the library.
#
# The library's own view of a column ends the whole process where a footer contradicts itself (an exception that its binding for
# Python does not catch, as pyarrow 26 has it), and one altered byte is enough for that.

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
    """The row groups of a footer. Raises `NotReadable`.

    A report opens each part several times for each station, and most footers are small: the last few are kept.
    """
    return _kept(footer) if len(footer) <= KEPT_BYTES else _groups_in(footer)


def _groups_in(footer: bytes) -> tuple[Group, ...]:
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


_kept = lru_cache(maxsize=KEPT)(_groups_in)


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
