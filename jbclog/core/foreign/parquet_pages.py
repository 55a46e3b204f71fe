"""Read a Parquet file's footer and page headers without the library, which allocates what they
declare.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from functools import lru_cache
from typing import BinaryIO, Final, NamedTuple

from jbclog.core.foreign.files import MIB, NotReadable
from jbclog.core.foreign.parquet_footer import STRUCT, ColumnChunk, ThriftReader

MAGIC: Final = b"PAR1"
TAIL: Final = struct.Struct("<I4s")
FOOTER_BYTES: Final = 4 * MIB  # an hour of 256 ports at 10 Hz takes 1.4 MB
PAGES: Final = 4096  # of one column of a row group

# Page headers: struct PageHeader of
# https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift.
HEAD_BYTES: Final = 16 << 10
USUAL_HEAD_BYTES: Final = 256
KEPT_HEADS: Final = 4096  # cached page headers: those of a week's samples of a few columns
UNPACKED, PACKED, DATA, DICTIONARY, DATA_2 = 2, 3, 5, 7, 8  # fields of a page header
VALUES: Final = 1  # of each of the three kinds of page
ENCODING: Final = {DATA: 2, DATA_2: 4}
# encodings of texts: each in full (PLAIN, DELTA_LENGTH_BYTE_ARRAY), and places in the dictionary.
# In another, DELTA_BYTE_ARRAY, a text repeats the beginning of the one before
IN_FULL: Final = (0, 6)
CODES: Final = (2, 8)
UNKNOWN: Final = -1


class Page(NamedTuple):
    """A page by its header: sizes, number of values, encoding (None: a dictionary), and where its
    data are.
    """

    packed: int
    unpacked: int
    values: int
    encoding: int | None
    at: int


def footer_of(data: BinaryIO) -> bytes:
    """Return the footer's bytes. Raises `NotReadable` where it is missing or too long."""
    size = data.seek(0, 2)
    if size < TAIL.size + len(MAGIC):
        raise NotReadable("is not a Parquet file: it is too short")
    data.seek(size - TAIL.size)
    length, magic = TAIL.unpack(data.read(TAIL.size))
    if magic != MAGIC:
        raise NotReadable("is not a Parquet file: its end is wrong")
    if length > FOOTER_BYTES:
        raise NotReadable(f"has a footer of {length} bytes; at most {FOOTER_BYTES} are read")
    if length > size - TAIL.size - len(MAGIC):
        raise NotReadable("is not a Parquet file: its footer is longer than the file")
    data.seek(size - TAIL.size - length)
    return data.read(length)


def pages_of(data: BinaryIO, chunk: ColumnChunk) -> Iterator[Page]:
    """Yield a column's pages. Raises `NotReadable`."""
    if not chunk.packed:
        return
    at = min((start for start in (chunk.data_at, chunk.dictionary_at) if start), default=0)
    end = at + chunk.packed
    if not len(MAGIC) <= at <= end <= data.seek(0, 2):
        raise NotReadable(f"{chunk.name} lies outside the file")
    for _ in range(PAGES):
        if at >= end:
            return
        data.seek(at)
        page = _head(data.read(min(HEAD_BYTES, end - at)))
        if page is None:
            raise NotReadable(f"{chunk.name} has a page without a size")
        yield page._replace(at=at + page.at)
        at += page.at + page.packed
    raise NotReadable(f"{chunk.name} has more than {PAGES} pages")


def _head(data: bytes) -> Page | None:
    """Parse a page header; its data begin where it ends.

    A run's pages are read several times by whatever looks at it. A header that ends within its
    first bytes is the same whatever follows.
    """
    try:
        return _usual_head(data[:USUAL_HEAD_BYTES])
    except NotReadable:
        return _parsed_head(data)


def _parsed_head(data: bytes) -> Page | None:
    reader = ThriftReader(data)
    sizes: dict[int, int | None] = {}
    values, encoding = 0, None
    try:
        for number, kind in reader.fields():
            if number in (UNPACKED, PACKED):
                sizes[number] = reader.integer(kind)
            elif number in (DATA, DICTIONARY, DATA_2) and kind == STRUCT:
                values, encoding = _about(reader, ENCODING.get(number))
            else:
                reader.skip(kind)
    except (IndexError, ValueError):
        raise NotReadable("has an unreadable page header") from None
    packed, unpacked = sizes.get(PACKED), sizes.get(UNPACKED)
    if packed is None or unpacked is None or min(packed, unpacked, values) < 0:
        return None
    return Page(packed, unpacked, values, encoding, reader.at)


_usual_head = lru_cache(maxsize=KEPT_HEADS)(_parsed_head)


def _about(reader: ThriftReader, encoding_field: int | None) -> tuple[int, int | None]:
    found: dict[int, int | None] = {}
    for number, kind in reader.fields():
        if number in (VALUES, encoding_field):
            found[number] = reader.integer(kind)
        else:
            reader.skip(kind)
    encoding = None if encoding_field is None else found.get(encoding_field)
    is_unknown = encoding is None and encoding_field is not None
    return found.get(VALUES) or 0, UNKNOWN if is_unknown else encoding
