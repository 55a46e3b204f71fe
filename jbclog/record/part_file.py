"""Read a Parquet part through its footer.

1. The manifest of a sealed run has the length and the SHA-256 of each part's footer. A reader
   compares these few kB and gives exactly these bytes to pyarrow: one flipped bit of a footer
   changes times, types and counts.
2. Every page has a checksum, which pyarrow verifies: damage is an error of one row group.
3. Manifests of 0.1.0 have no footers. The SHA-256 of the whole part is compared instead, once for
   each time and size of the file.
4. A part of a run that is not sealed is in no manifest. It is read by the footer that it has.
5. Columns of schema 1 are read by their names of today, in the reasons of samples, too.

Whatever the library raises becomes `RecordError`: one sentence with the file.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO, Final

import pyarrow as pa
import pyarrow.parquet as pq

from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, NotReadable, open_regular
from jbclog.core.operating_system import opened_again
from jbclog.record.manifest import SealedFile
from jbclog.record.old_names import OLD_COLUMNS
from jbclog.record.schema import named_now, renamed

MOST_FOOTERS: Final = 16  # kept as read; one of 64 ports takes some 2 MB
MAGIC: Final = b"PAR1"
END: Final = struct.Struct("<I4s")
"""The end of a Parquet file: the length of the metadata before it, and `MAGIC`."""
THREADED_ROWS: Final = 4096  # threads are slower for fewer
CHANGED: Final = "was changed: its SHA-256 is not the manifest's"
Bounds = tuple[Any, Any]
"""Least and greatest value of a column."""
UNREADABLE: Final = (pa.ArrowException, OSError, ValueError, KeyError)
"""What pyarrow raises for a damaged file."""


class Footer:
    """What a footer says: the columns, and the row groups with their statistics."""

    def __init__(self, data: bytes) -> None:
        self.metadata: pq.FileMetaData = pq.read_metadata(pa.BufferReader(data))
        self.names: list[str] = self.metadata.schema.names
        self._bounds: dict[str, list[Bounds | None]] = {}

    def bounds(self, column: str) -> list[Bounds | None]:
        """Return minimum and maximum of a column in each row group, None where they are not known:
        texts and integers, times in the unit in which they are stored.
        """
        if column not in self._bounds:
            self._bounds[column] = [
                self._bounds_in(group, column) for group in range(self.metadata.num_row_groups)
            ]
        return self._bounds[column]

    def _bounds_in(self, group: int, column: str) -> Bounds | None:
        if column not in self.names:
            return None
        statistics = self.metadata.row_group(group).column(self.names.index(column)).statistics
        if statistics is None or not statistics.has_min_max:
            return None
        least, most = statistics.min_raw, statistics.max_raw
        if isinstance(least, bytes):
            least, most = statistics.min, statistics.max
        return least, most


@lru_cache(MOST_FOOTERS)
def _read_footer_of(data: bytes) -> Footer:
    """Return a footer as read. The last ones are kept: reading one takes longer than reading the
    rows of a port, and whoever reads port by port needs the same ones again.
    """
    return Footer(data)


class PartFile:
    """An open part: its footer, and its row groups. `run` is the name of its run. Methods raise
    `RecordError`.
    """

    def __init__(
        self,
        source: str | pa.NativeFile,
        footer: bytes,
        name: str,
        *,
        table: str = "",
        run: str = "",
    ) -> None:
        """`source` is a path or an open file, `footer` is as `read_footer` returns it, `name` is
        for messages.
        """
        self.footer = footer
        self.run = run
        self._name = name
        self._table = table
        try:
            self._footer = _read_footer_of(footer)
            self.metadata = self._footer.metadata
            self._stored_names = {
                now: name
                for name, now in OLD_COLUMNS.get(table, {}).items()
                if name in self._footer.names
            }
            self._file = pq.ParquetFile(
                source,
                metadata=self.metadata,
                page_checksum_verification=True,
                pre_buffer=isinstance(source, pa.NativeFile),  # few requests
            )
            # as stored; the file's own `schema_arrow` has the types after reading
            self.schema: pa.Schema = renamed(self.metadata.schema.to_arrow_schema(), table)
        except UNREADABLE as error:
            raise RecordError(f"{name} is no readable part: {error}") from error

    def _as_stored(self, columns: Iterable[str]) -> list[str]:
        return [self._stored_names.get(name, name) for name in columns]

    @property
    def num_row_groups(self) -> int:
        return int(self.metadata.num_row_groups)

    @property
    def num_rows(self) -> int:
        return int(self.metadata.num_rows)

    def group(self, index: int, columns: Sequence[str] | None = None) -> pa.Table:
        """Read one row group."""
        names = None if columns is None else self._as_stored(columns)
        is_large = self.num_rows > THREADED_ROWS * self.num_row_groups
        try:
            rows = self._file.read_row_group(index, names, use_threads=is_large)
            return named_now(rows, self._table) if self._stored_names else rows
        except UNREADABLE as error:
            raise RecordError(f"{self._name}, row group {index}: {error}") from error

    def groups(self, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        """Read all rows, one row group at a time."""
        return (self.group(index, columns) for index in range(self.num_row_groups))

    def batches(self, rows: int, columns: Sequence[str] | None = None) -> Iterator[pa.RecordBatch]:
        """Read all rows in batches of at most `rows`."""
        names = None if columns is None else self._as_stored(columns)
        for index in range(self.num_row_groups):  # one call for all groups would read ahead
            try:
                for batch in self._file.iter_batches(rows, [index], names, use_threads=False):
                    if self._stored_names:
                        of_now = named_now(pa.Table.from_batches([batch]), self._table)
                        yield from of_now.to_batches()
                    else:
                        yield batch
            except UNREADABLE as error:
                raise RecordError(f"{self._name}, row group {index}: {error}") from error

    def bounds(self, column: str) -> list[Bounds | None]:
        """Return `Footer.bounds` of a column.

        Call it for a sealed part only: pyarrow 26 aborts the process where a footer contradicts
        itself.
        """
        return self._footer.bounds(column)

    def may_have(self, index: int, station: str | None, port: int | None) -> bool:
        """Return False if a row group has no row of a station and port (None: of any), by the
        footer's statistics. Call it for a sealed part only, as `bounds`.
        """
        for column, value in (("station", station), ("port", port)):
            if value is None:
                continue
            bounds = self.bounds(column)[index]
            if bounds is not None and not bounds[0] <= value <= bounds[1]:
                return False
        return True

    def close(self) -> None:
        self._file.close()


@contextmanager
def open_part(path: Path, seal: SealedFile | None = None) -> Iterator[PartFile]:
    """Open the part at `path`. `seal` is its entry in the manifest of a sealed run, with which it
    must agree. Raises `RecordError`.
    """
    try:
        file = open_regular(path, Kind.PART)
    except OSError as error:
        raise RecordError(f"{path} is no readable part: {error}") from error
    with file:
        footer = _footer(path, file, seal)
        table, run = path.parent.name, path.parent.parent.name
        part = PartFile(opened_again(file), footer, str(path), table=table, run=run)
        try:
            yield part
        finally:
            part.close()


def _footer(path: Path, file: BinaryIO, seal: SealedFile | None) -> bytes:
    try:
        return read_footer(file) if seal is None else sealed_footer(path, file, seal)
    except NotReadable as error:
        if seal is None:
            raise RecordError(f"{path} is no readable part: it {error}") from error
        table, folder = path.parent.name, path.parent.parent
        raise RecordError(
            f"{path} {error}, so {table} are not shown; `jbclog check {folder}` lists all findings"
        ) from error
    except OSError as error:
        raise RecordError(f"{path} is no readable part: {error}") from error


def sealed_footer(path: Path, file: BinaryIO, seal: SealedFile) -> bytes:
    """Return the footer of a part, which must be the one that was sealed. Raises OSError,
    `NotReadable` if it is another.
    """
    size = file.seek(0, 2)
    if size != seal.bytes:
        raise NotReadable(f"has {size} bytes, the manifest says {seal.bytes}")
    if seal.footer_bytes is None:
        _expect_whole(path, file, seal)
        return read_footer(file)
    file.seek(max(size - seal.footer_bytes, 0))
    footer = file.read(seal.footer_bytes)
    if hashlib.sha256(footer).hexdigest() != seal.footer_sha256:
        raise NotReadable("was changed: the SHA-256 of its footer is not the manifest's")
    return footer


def _expect_whole(path: Path, file: BinaryIO, seal: SealedFile) -> None:
    """Compare the whole file with a manifest of 0.1.0; in S3 its length alone is compared."""
    if not path.is_file():
        return
    time_ns = path.stat().st_mtime_ns
    if _whole_sha256(path, time_ns, seal.bytes) != seal.sha256:
        raise NotReadable(CHANGED)


@lru_cache(4096)
def _whole_sha256(path: Path, _mtime_ns: int, _size: int) -> str:
    with open_regular(path, Kind.PART) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_footer(file: BinaryIO) -> bytes:
    """Return the footer of a Parquet file: its metadata, their length, and the last four bytes.
    Raises OSError, `NotReadable` if there is none.
    """
    size = file.seek(0, 2)
    file.seek(max(size - END.size, 0))
    end = file.read(END.size)
    if len(end) < END.size or not end.endswith(MAGIC):
        raise NotReadable("has no footer of Parquet; it was cut off, or is another file")
    length = END.unpack(end)[0] + END.size
    if length + len(MAGIC) > size:
        raise NotReadable(f"has a footer of {length} bytes in a file of {size}")
    file.seek(size - length)
    return file.read(length)


def read_parquet(path: Path, kind: Kind) -> pa.Table:
    """Read a whole Parquet file that is no part of a run's tables. Raises `RecordError`."""
    try:
        with open_regular(path, kind) as file:
            return pq.ParquetFile(pa.BufferReader(file.read())).read(use_threads=False)
    except UNREADABLE as error:
        raise RecordError(f"{path} cannot be read: {error}") from error
