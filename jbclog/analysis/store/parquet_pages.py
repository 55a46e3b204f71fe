"""Read a Parquet file's footer and page headers without pyarrow, which allocates whatever they
declare.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import islice
from typing import BinaryIO, Final, NamedTuple

from jbclog.analysis.store.parquet_footer import STRUCT, ColumnChunk, RowGroup, ThriftReader
from jbclog.core.files import MIB, NotReadable

MAGIC: Final = b"PAR1"
TAIL: Final = struct.Struct("<I4s")
FOOTER_BYTES: Final = 4 * MIB  # an hour of 256 ports at 10 Hz takes 1.4 MB
PAGES: Final = 4096  # limits: pages of one column of a row group,
FREE_PAGES: Final = 32_768  # pages read of a file,
BYTES_A_PAGE: Final = 512  # one more for so many bytes of it,
VALUES_A_PAGE: Final = 8192  # and one for so many values: pyarrow writes 20 000 to a page
ROWS_A_BYTE: Final = 16  # rows without any reading take a quarter of a byte each
FREE_ROWS: Final = 1_000_000  # whatever the file's size
COLUMNS: Final = 200

# Page headers: struct PageHeader of
# https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift.
HEAD_BYTES: Final = 16 << 10
USUAL_HEAD_BYTES: Final = 256
# cached page headers: the 17 columns that a report reads of a week's samples, several times in the
# same order, so that a smaller cache would never hit. Some 0.6 kB each
KEPT_HEADS: Final = 9216
TYPE, UNPACKED, PACKED, DATA, DICTIONARY, DATA_2 = 1, 2, 3, 5, 7, 8  # fields of a page header
ABOUT: Final = {0: DATA, 2: DICTIONARY, 3: DATA_2}  # the field that describes a page of a type
VALUES: Final = 1  # of each of the three kinds of page
WORDS: Final = 1 << 20  # of a dictionary, or one for each value; pyarrow allocates 16 bytes each
ENCODING: Final = {DATA: 2, DATA_2: 4}
# encodings of texts: each in full (PLAIN, DELTA_LENGTH_BYTE_ARRAY), and indices into the
# dictionary. In DELTA_BYTE_ARRAY a text repeats the beginning of the previous one
IN_FULL: Final = (0, 6)
CODES: Final = (2, 8)
UNKNOWN: Final = -1


class Page(NamedTuple):
    """A page by its header: sizes, number of values, encoding (None: a dictionary), and offset of
    its data.
    """

    packed: int
    unpacked: int
    values: int
    encoding: int | None
    at: int


def footer_of(data: BinaryIO) -> bytes:
    """Return the footer's bytes. Raises `NotReadable` if it is missing or too long."""
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
    for number in range(PAGES):
        if at >= end:
            return
        data.seek(at)
        page = _head(data.read(min(HEAD_BYTES, end - at)))
        if page is None:
            raise NotReadable(f"{chunk.name} has a page without a size")
        if page.encoding is None and (number or page.values > max(chunk.values, WORDS)):
            raise NotReadable(f"{chunk.name} has a second dictionary, or too many words in one")
        yield page._replace(at=at + page.at)
        at += page.at + page.packed
        if at > end:
            raise NotReadable(f"{chunk.name} has a page beyond its end")
    raise NotReadable(f"{chunk.name} has more than {PAGES} pages")


class PageReader:
    """Reads the page headers of an open file's columns. Limits their total by the file's size,
    because many columns and row groups can declare the same pages.
    """

    def __init__(self, data: BinaryIO, groups: Sequence[RowGroup]) -> None:
        self._data = data
        size = data.seek(0, os.SEEK_END)
        rows = min(sum(max(one.rows, 0) for one in groups), max(FREE_ROWS, size * ROWS_A_BYTE))
        columns = min(max((len(one.chunks) for one in groups), default=0), COLUMNS)
        self._left = FREE_PAGES + size // BYTES_A_PAGE + rows * columns // VALUES_A_PAGE

    def of(self, chunk: ColumnChunk) -> list[Page]:
        """Return a column's pages. Raises `NotReadable`."""
        pages = [*islice(pages_of(self._data, chunk), self._left + 1)]
        self._left -= len(pages)
        if self._left < 0:
            raise NotReadable(f"{chunk.name} is in too many pages for the file's size")
        if sum(page.values for page in pages if page.encoding is not None) != chunk.values:
            # pyarrow reads whole pages, whatever the footer counts
            raise NotReadable(f"{chunk.name} has pages of other than {chunk.values} values")
        return pages


def _head(data: bytes) -> Page | None:
    """Parse a page header; the data follow it.

    Cached, because several readers read a run's pages. A header that ends within its first bytes is
    the same whatever follows.
    """
    try:
        return _usual_head(data[:USUAL_HEAD_BYTES])
    except NotReadable:
        return _parsed_head(data)


def _parsed_head(data: bytes) -> Page | None:
    reader = ThriftReader(data)
    numbers: dict[int, int | None] = {}
    about: dict[int, tuple[int, int | None]] = {}
    try:
        for number, kind in reader.fields():
            if number in (TYPE, UNPACKED, PACKED):
                numbers[number] = reader.integer(kind)
            elif number in ABOUT.values() and kind == STRUCT:
                about[number] = _about(reader, ENCODING.get(number))
            else:
                reader.skip(kind)
    except (IndexError, ValueError):
        raise NotReadable("has an unreadable page header") from None
    page_type = numbers.get(TYPE)
    # pyarrow goes by the type; a description in another field would be believed here only
    if page_type is None or [*about] != [ABOUT.get(page_type)]:
        raise NotReadable("has a page header of another kind than its page")
    ((values, encoding),) = about.values()
    packed, unpacked = numbers.get(PACKED), numbers.get(UNPACKED)
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
