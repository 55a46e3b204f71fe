"""Uncompressed size of a Parquet file, from its footer and page headers, for files that a library
reads by itself.

`sizes_of` measures; the limit depends on the table. Sizes are upper bounds: a text in a dictionary
counts in full at each place that can use it.
"""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import BinaryIO, Final

from jbclog.analysis.store.parquet_footer import TEXT, TEXTS, ColumnChunk, RowGroup, groups_in
from jbclog.analysis.store.parquet_pages import (
    CODES,
    IN_FULL,
    Page,
    PageReader,
    footer_of,
)
from jbclog.core.files import MIB, NotReadable

COLUMNS: Final = 1000
SMALL: Final = 256 << 10  # read at once
A_VALUE: Final = 8  # bytes of a number, or of a text's index
BATCH_ROWS: Final = 32_768
PLAIN_ENOUGH: Final = MIB  # a smaller dictionary is not decompressed
DICTIONARY_BYTES: Final = 64 * MIB
CODECS: Final = {0: None, 1: "snappy", 2: "gzip", 4: "brotli", 6: "zstd", 7: "lz4_raw"}
LENGTH: Final = struct.Struct("<I")


@dataclass(frozen=True, slots=True)
class ColumnSize:
    """Column of a row group: its values, its total bytes, the bytes needed at once to read
    `BATCH_ROWS` rows, and its largest page.
    """

    values: int
    written: int
    at_once: int
    page: int

    def plus(self, other: ColumnSize) -> ColumnSize:
        """Return the sizes of two parts of a nested column."""
        return ColumnSize(
            max(self.values, other.values),
            self.written + other.written,
            self.at_once + other.at_once,
            self.page + other.page,
        )


@dataclass(frozen=True, slots=True)
class GroupSize:
    """A row group: its number of rows, and the sizes of its columns by name."""

    rows: int
    columns: Mapping[str, ColumnSize]

    def written(self, columns: Collection[str] | None) -> int:
        """Return the total bytes of these columns, or of all."""
        return sum(one.written for one in self._chosen(columns))

    def at_once(self, columns: Collection[str] | None) -> int:
        """Return the bytes needed at once to read these columns, or all, in batches."""
        return sum(one.at_once for one in self._chosen(columns))

    def _chosen(self, columns: Collection[str] | None) -> list[ColumnSize]:
        return [one for name, one in self.columns.items() if columns is None or name in columns]


@dataclass(frozen=True, slots=True)
class FileSize:
    size: int
    groups: tuple[GroupSize, ...]

    @property
    def rows(self) -> int:
        return sum(one.rows for one in self.groups)

    def written(self, columns: Collection[str] | None = None) -> int:
        """Return the total bytes of these columns, or of all."""
        return sum(one.written(columns) for one in self.groups)


def sizes_of(data: BinaryIO) -> FileSize:
    """Measure an open Parquet file. Raises OSError (`NotReadable`)."""
    size = data.seek(0, os.SEEK_END)
    if size <= SMALL:
        data.seek(0)
        data = io.BytesIO(data.read(size))
    groups = groups_in(footer_of(data))
    pages = PageReader(data, groups)
    return FileSize(
        size, tuple(_group(data, pages, group, number) for number, group in enumerate(groups))
    )


def _group(data: BinaryIO, pages: PageReader, group: RowGroup, number: int) -> GroupSize:
    if group.rows < 0 or len(group.chunks) > COLUMNS:
        raise NotReadable("has a footer that contradicts itself")
    columns: dict[str, ColumnSize] = {}
    for chunk in group.chunks:
        name, dot, _ = chunk.name.partition(".")
        if chunk.values < 0 or (not dot and chunk.values != group.rows):
            raise NotReadable(f"row group {number}: {chunk.name} has {chunk.values} values")
        found, before = _chunk(data, chunk, pages.of(chunk), group.rows), columns.get(name)
        columns[name] = found if before is None else before.plus(found)
    return GroupSize(group.rows, columns)


def _chunk(data: BinaryIO, chunk: ColumnChunk, pages: list[Page], rows: int) -> ColumnSize:
    data_pages = [page for page in pages if page.encoding is not None]
    largest = max((page.unpacked for page in pages), default=0)
    if chunk.kind not in TEXTS:
        at_once = largest + min(chunk.values, BATCH_ROWS) * A_VALUE
        return ColumnSize(chunk.values, chunk.values * A_VALUE, at_once, largest)
    longest = _longest(data, chunk, pages)
    written = [page.values * A_VALUE + _texts(page, longest) for page in data_pages]
    # a nested column has any number of values in a row
    of_batch = _of_a_batch(data_pages, written) if chunk.values == rows else sum(written)
    return ColumnSize(chunk.values, sum(written), largest + of_batch, largest)


def _texts(page: Page, longest: int) -> int:
    """Return the bytes of a page's texts in full."""
    if page.encoding in CODES:
        return page.values * longest
    return page.unpacked * (1 if page.encoding in IN_FULL else page.values)


def _of_a_batch(pages: list[Page], written: list[int]) -> int:
    """Return the most bytes that `BATCH_ROWS` consecutive values take, in whole pages."""
    most = now = values = first = 0
    for page, size in zip(pages, written, strict=True):
        now, values = now + size, values + page.values
        while first < len(pages) and values - pages[first].values > BATCH_ROWS:
            now, values, first = now - written[first], values - pages[first].values, first + 1
        most = max(most, now)
    return most


def _longest(data: BinaryIO, chunk: ColumnChunk, pages: list[Page]) -> int:
    """Return the length of the longest text in a column's dictionary, or an upper bound."""
    longest = max((page.unpacked for page in pages if page.encoding is None), default=0)
    if longest * chunk.values <= PLAIN_ENOUGH or chunk.codec not in CODECS:
        return longest
    if longest > DICTIONARY_BYTES or chunk.kind != TEXT:
        return longest
    dictionary = next(page for page in pages if page.encoding is None)
    data.seek(dictionary.at)
    return min(longest, _longest_in(_unpacked(data.read(dictionary.packed), dictionary, chunk)))


def _unpacked(packed: bytes, page: Page, chunk: ColumnChunk) -> bytes:
    import pyarrow as pa

    codec = CODECS[chunk.codec]
    if codec is None or not page.unpacked:
        return packed
    try:
        return bytes(pa.Codec(codec).decompress(packed, page.unpacked, asbytes=True))
    except (pa.ArrowException, OSError, ValueError) as error:
        raise NotReadable(f"{chunk.name} cannot be unpacked") from error


def _longest_in(texts: bytes) -> int:
    """Return the length of the longest text of a dictionary; each text follows its length."""
    longest = at = 0
    while at + LENGTH.size <= len(texts):
        (length,) = LENGTH.unpack_from(texts, at)
        at += LENGTH.size + length
        if length > longest:
            longest = length
    return longest
