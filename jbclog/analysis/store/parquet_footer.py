"""Parse a Parquet file's footer without pyarrow. Start with `groups_in`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from jbclog.core.files import NotReadable

# Thrift's compact protocol, as far as Parquet's footer and page headers need it:
# https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md, and
# https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift.
#
# pyarrow parses the same bytes afterwards. Refused is what it could read differently: a duplicate
# field, a number too large for its type, a field id beyond 16 bits.

YES, NO, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, STRUCT = 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12
BITS: Final = {I16: 16, I32: 32, I64: 64}
SIGN: Final = 1
DEPTH: Final = 8
LONGEST_VARINT: Final = 10  # bytes of 64 bits
# of each list: pyarrow builds a schema's tree by recursion, one call a level
MOST_ITEMS: Final = 8192
NESTED: Final = 32  # depth of groups in a schema
LONG_LIST: Final = 15
# cached footers (a week has 168 parts a table), and the maximum size of each
KEPT, KEPT_BYTES = 256, 64 << 10


class ThriftReader:
    """Reads Thrift values from bytes. Raises IndexError or ValueError for invalid data."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def fields(self) -> Iterator[tuple[int, int]]:
        """Return id and type of each field of a struct. The caller reads each value in turn."""
        data, number, seen = self.data, 0, set()
        while head := data[self.at]:
            self.at += 1
            number = number + (head >> 4) if head >> 4 else self._signed(16)
            if number in seen or number >> 15:
                raise ValueError(f"field {number} is duplicate or out of range")
            seen.add(number)
            yield number, head & 0xF
        self.at += 1

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
        found = self.data[self.at : self.at + length]
        self.at += length
        if len(found) != length:
            raise ValueError("bytes beyond the end")
        return found

    def items(self, kind: int, of: int) -> Iterator[None]:
        """Iterate over a list of type `of`; the caller reads each item before the next. A list of
        another type yields nothing.
        """
        if kind != LIST:
            self.skip(kind)
            return
        count, found = self._list()
        if count and found != of:
            raise ValueError(f"a list of kind {found}")
        for _ in range(count):
            yield

    def skip(self, kind: int) -> None:
        self.at = _end_of(self.data, self.at, kind)
        if self.at > len(self.data):
            raise ValueError("bytes beyond the end")

    def _list(self) -> tuple[int, int]:
        head = self._byte()
        count = head >> 4 if head >> 4 < LONG_LIST else self._varint()
        if count > MOST_ITEMS:
            raise ValueError("too long a list")
        return count, head & 0xF

    def _byte(self) -> int:
        self.at += 1
        return self.data[self.at - 1]

    def _varint(self) -> int:
        value, self.at = _varint(self.data, self.at)
        return value

    def _signed(self, bits: int) -> int:
        value = self._varint()
        if value >> bits:
            raise ValueError(f"a number of more than {bits} bits")
        return (value >> SIGN) ^ -(value & SIGN)


def _end_of(data: bytes, at: int, kind: int, depth: int = 0) -> int:
    """Return the end of a value of type `kind` that begins at `at`. Most of a footer is skipped
    this way.
    """
    if kind in BITS:
        begin = at
        while data[at] & 0x80:
            at += 1
        if at - begin >= LONGEST_VARINT:
            raise ValueError("too large a number")
        return at + 1
    if kind == BINARY:
        length, at = _varint(data, at)
        return at + length
    if kind == STRUCT:
        return _end_of_struct(data, at, depth)
    if kind in (LIST, SET):
        return _end_of_list(data, at, depth)
    if kind in (YES, NO):  # a struct's flag has its value in the type
        return at
    if kind not in (BYTE, DOUBLE):
        raise ValueError(f"a value of kind {kind}")
    return at + (1 if kind == BYTE else 8)


def _end_of_struct(data: bytes, at: int, depth: int) -> int:
    if depth > DEPTH:
        raise ValueError("nested too deeply")
    while head := data[at]:
        at += 1
        if head >> 4 == 0:  # the field id follows as a number of its own
            at = _end_of(data, at, I16)
        at = _end_of(data, at, head & 0xF, depth + 1)
    return at + 1


def _end_of_list(data: bytes, at: int, depth: int) -> int:
    if depth > DEPTH:
        raise ValueError("nested too deeply")
    head = data[at]
    count, at = (head >> 4, at + 1) if head >> 4 < LONG_LIST else _varint(data, at + 1)
    if count > MOST_ITEMS:
        raise ValueError("too long a list")
    kind = head & 0xF
    for _ in range(count):
        at = _end_of(data, at, BYTE if kind in (YES, NO) else kind, depth + 1)
    return at


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """Return the number that begins at `at`, and its end."""
    one = data[at]
    if one < 0x80:
        return one, at + 1
    value = shift = 0
    while True:
        value |= (one & 0x7F) << shift
        shift += 7
        at += 1
        if one < 0x80:
            return value, at
        if shift > 63:
            raise ValueError("too large a number")
        one = data[at]


# pyarrow's own metadata view aborts the process (pyarrow 26: an exception that its Python binding
# does not catch) if a footer contradicts itself; one altered byte is enough.
SCHEMA, GROUPS = 2, 4  # fields of FileMetaData,
ELEMENT_KIND, ELEMENT_NAME, CHILDREN = 1, 4, 5  # of SchemaElement,
COLUMNS, ROWS = 1, 3  # of RowGroup,
ABOUT, SECRET, SECRET_ABOUT = 3, 8, 9  # of ColumnChunk,
# of ColumnMetaData,
KIND, PATH, CODEC, VALUES, UNPACKED, PACKED = 1, 3, 4, 5, 6, 7
DATA_AT, DICTIONARY_AT, STATISTICS = 9, 11, 12
NUMBERS: Final = (KIND, CODEC, VALUES, UNPACKED, PACKED, DATA_AT, DICTIONARY_AT)
TEXT: Final = 6  # physical types: bytes, and bytes of one length
TEXTS: Final = (TEXT, 7)
GREATEST, LEAST = 5, 6  # of Statistics


@dataclass(frozen=True, slots=True)
class ColumnChunk:
    """Column of a row group: name, number of values, sizes, offsets, statistics, physical type and
    codec.
    """

    name: str
    values: int
    unpacked: int
    packed: int
    data_at: int
    dictionary_at: int | None
    statistics: bytes | None
    kind: int
    codec: int

    @property
    def bounds(self) -> tuple[bytes | None, bytes | None]:
        """Minimum and maximum; None if the footer has none. Raises `NotReadable`."""
        try:
            return _bounds(ThriftReader(self.statistics or b"\0"))
        except (IndexError, ValueError):
            raise NotReadable("has an unreadable footer") from None


@dataclass(frozen=True, slots=True)
class RowGroup:
    rows: int
    chunks: tuple[ColumnChunk, ...]


def groups_in(footer: bytes) -> tuple[RowGroup, ...]:
    """Parse the row groups of a footer. Raises `NotReadable`, also if their columns differ from
    those of the schema, by which pyarrow reads them.

    A report opens each part several times for each station, so the last few small footers and the
    last large one are cached.
    """
    return _kept(footer) if len(footer) <= KEPT_BYTES else _last_large(footer)


def _groups_in(footer: bytes) -> tuple[RowGroup, ...]:
    reader = ThriftReader(footer)
    elements: list[Element] = []
    found: list[RowGroup] = []
    try:
        for number, kind in reader.fields():
            if number == SCHEMA:
                elements += [_element(reader) for _ in reader.items(kind, STRUCT)]
            elif number == GROUPS:
                found += [_group(reader) for _ in reader.items(kind, STRUCT)]
            else:
                reader.skip(kind)
        leaves = _leaves(elements)
        if any([(one.name, one.kind) for one in group.chunks] != leaves for group in found):
            raise ValueError("columns that are not those of the schema")
    except (IndexError, ValueError):
        raise NotReadable("has an unreadable footer") from None
    return tuple(found)


_kept, _last_large = lru_cache(maxsize=KEPT)(_groups_in), lru_cache(maxsize=1)(_groups_in)


Element = tuple[str, int, int]
"""Element of a schema: its name, number of children and physical type."""


def _element(reader: ThriftReader) -> Element:
    name, numbers = "", {ELEMENT_KIND: 0, CHILDREN: 0}
    for number, kind in reader.fields():
        if number in numbers:
            numbers[number] = reader.integer(kind) or 0
        elif number == ELEMENT_NAME:
            name = (reader.binary(kind) or b"").decode()  # or ValueError
        else:
            reader.skip(kind)
    return name, numbers[CHILDREN], numbers[ELEMENT_KIND]


def _leaves(elements: Sequence[Element]) -> list[tuple[str, int]]:
    """Return the columns of a schema in order, as path and type. Raises ValueError."""
    found: list[tuple[str, int]] = []
    prefixes, left = [""], [elements[0][1] if elements else 0]  # of the groups above
    for name, children, kind in elements[1:]:
        while left and not left[-1]:
            prefixes.pop()
            left.pop()
        if not left or len(left) > NESTED or children < 0:
            raise ValueError("a schema that is none")
        left[-1] -= 1
        path = f"{prefixes[-1]}{name}"
        if children:
            prefixes.append(f"{path}.")
            left.append(children)
        else:
            found.append((path, kind))
    if any(left) or len({path for path, _ in found}) < len(found):
        raise ValueError("a schema without all of its columns, or with two of one name")
    return found


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
    """Parse a column's metadata without a call for each field: it is most of a footer."""
    data, at, number = reader.data, reader.at, 0
    numbers: dict[int, int] = {}
    name, statistics = "", None
    while head := data[at]:
        kind, before = head & 0xF, number
        if head >> 4:
            number, at = number + (head >> 4), at + 1
        else:
            value, at = _varint(data, at + 1)
            number = (value >> SIGN) ^ -(value & SIGN)
        if not before < number < 1 << 15:  # in another order, fields could be duplicates
            raise ValueError(f"field {number} is out of order")
        if number in NUMBERS and kind in BITS:
            value, at = _varint(data, at)
            if value >> BITS[kind]:
                raise ValueError(f"a number of more than {BITS[kind]} bits")
            numbers[number] = (value >> SIGN) ^ -(value & SIGN)
        elif number == PATH:
            reader.at = at
            parts = [reader.binary(BINARY) or b"" for _ in reader.items(kind, BINARY)]
            name, at = ".".join(part.decode() for part in parts), reader.at  # or ValueError
        else:
            begin, at = at, _end_of(data, at, kind)
            if number == STATISTICS and kind == STRUCT:
                statistics = data[begin:at]
    reader.at = at + 1
    if not {KIND, CODEC, VALUES, UNPACKED, PACKED, DATA_AT} <= numbers.keys():
        raise ValueError("a column without its type, codec, number of values or lengths")
    return ColumnChunk(
        name,
        numbers[VALUES],
        numbers[UNPACKED],
        numbers[PACKED],
        numbers[DATA_AT],
        numbers.get(DICTIONARY_AT),
        statistics,
        numbers[KIND],
        numbers[CODEC],
    )


def _bounds(reader: ThriftReader) -> tuple[bytes | None, bytes | None]:
    found: dict[int, bytes | None] = {}
    for number, kind in reader.fields():
        if number in (GREATEST, LEAST):
            found[number] = reader.binary(kind)
        else:
            reader.skip(kind)
    return found.get(LEAST), found.get(GREATEST)
