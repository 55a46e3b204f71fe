"""Pages of a SQLite database that another process writes, read without any lock.

A stopped follower that holds a lock of SQLite would keep the recorder's write-ahead log from being
reused, so that it grows without limit. So pages are read as "Database File Format" (sqlite.org,
sections 1.3 and 4) describes: the newest committed frame of the log, else the page of the database
file. This gives one consistent state unless the log was restarted meanwhile, because a checkpoint
changes only pages that the log holds. `snapshot` then reads again.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from io import BufferedReader
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

from jbclog.core.files import Kind, open_regular
from jbclog.core.operating_system import read_at

T = TypeVar("T")

# magic, version, page size, sequence, two salts, two checksums
LOG_HEADER: Final = struct.Struct(">8I")
# page, pages after a commit or 0, two salts, two checksums
FRAME_HEADER: Final = struct.Struct(">6I")
# magic of the log -> byte order of the checksums
ORDERS: Final = {0x377F0682: "<", 0x377F0683: ">"}
MAGIC: Final = b"SQLite format 3\0"
PAGE_SIZES: Final = tuple(1 << power for power in range(9, 17))
WORD: Final = 0xFFFFFFFF
TRIES: Final = 50


class Malformed(Exception):
    """The file is not a database, or is damaged."""


class Frame(NamedTuple):
    """A valid frame of a log: its place and header, the checksums up to its end."""

    at: int
    head: bytes
    page: int
    is_commit: bool
    sums: tuple[int, int]


class DatabasePages:
    """The pages of the database at `path`. Raises `OSError` if it cannot be opened."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = open_regular(path, Kind.STORE)
        self._log: BufferedReader | None = None
        self._begin_log(b"")
        self._from_file: set[int] = set()
        self._size = self._reserved = 0

    def close(self) -> None:
        self._file.close()
        self._close_log()

    def is_same_file(self) -> bool:
        """Whether the path still leads to the opened file."""
        return _is_same_file(self._file, self.path)

    def is_empty(self) -> bool:
        """Whether the file is empty: SQLite writes the first page with the first commit."""
        return os.fstat(self._file.fileno()).st_size == 0

    def snapshot(self, read: Callable[[DatabasePages], T]) -> T:
        """Return `read` of one committed state. Raises `Malformed`, `OSError`."""
        for _ in range(TRIES):
            self._refresh()
            try:
                self._read_page_size()
                found = read(self)
            except Malformed:
                if self._is_consistent():
                    raise
            else:
                if self._is_consistent():
                    return found
        raise Malformed(f"it changed {TRIES} times while it was read")

    @property
    def usable(self) -> int:
        """Bytes of a page available for content."""
        return self._size - self._reserved

    def page(self, number: int) -> bytes:
        """Return a page, numbered from 1. Raises `Malformed` if it is missing."""
        if number < 1:
            raise Malformed(f"page {number} cannot exist")
        at = self._frames.get(number)
        if at is None:
            self._from_file.add(number)
            data = read_at(self._file.fileno(), self._size, (number - 1) * self._size)
        else:
            data = read_at(self._log.fileno(), self._size, at) if self._log else b""
        if len(data) != self._size:
            raise Malformed(f"page {number} is missing")
        return data

    def _refresh(self) -> None:
        """Read new frames of the log."""
        self._from_file.clear()
        if self._log is None or not self._is_same_log():
            self._open_log()
        header = self._log_header()
        if header != self._header:
            self._begin_log(header)
        self._read_frames()

    def _is_consistent(self) -> bool:
        """Whether all pages read since `_refresh` are of one committed state."""
        added = self._read_frames()
        # after the frames: they were of this log
        is_same_log = self._is_same_log() and self._log_header() == self._header
        return is_same_log and self._from_file.isdisjoint(added)

    def _read_page_size(self) -> None:
        self._size, self._reserved = self._log_page_size or self._file_page_size(), 0
        if self._size not in PAGE_SIZES:
            raise Malformed(f"it has pages of {self._size} bytes")
        first = self.page(1)
        if not first.startswith(MAGIC):
            raise Malformed("it is no SQLite database")
        self._reserved = first[20]

    def _file_page_size(self) -> int:
        size = int.from_bytes(read_at(self._file.fileno(), 2, 16), "big")
        return 65_536 if size == 1 else size

    # -- the log -----------------------------------------------------------------------------------

    @property
    def _log_path(self) -> Path:
        return self.path.with_name(self.path.name + "-wal")

    def _open_log(self) -> None:
        self._close_log()
        try:
            self._log = open_regular(self._log_path, Kind.STORE)
        except FileNotFoundError:
            self._log = None

    def _close_log(self) -> None:
        if self._log is not None:
            self._log.close()
        self._log = None

    def _is_same_log(self) -> bool:
        return (
            _is_same_file(self._log, self._log_path)
            if self._log
            else not os.path.lexists(self._log_path)
        )

    def _log_header(self) -> bytes:
        return read_at(self._log.fileno(), LOG_HEADER.size, 0) if self._log else b""

    def _begin_log(self, header: bytes) -> None:
        """Start a new log without frames; an invalid header makes all its frames invalid."""
        self._header = header
        # page -> offset in the log of its newest committed content
        self._frames: dict[int, int] = {}
        self._waiting: list[Frame] = []  # behind the last commit
        self._order: str | None = None
        self._next, self._log_page_size = LOG_HEADER.size, 0
        if len(header) < LOG_HEADER.size:
            return
        magic, _, size, _, *self._salts, first, second = LOG_HEADER.unpack(header)
        order = ORDERS.get(magic)
        if (
            order
            and size in PAGE_SIZES
            and _check_sums(order, header[:24], (0, 0)) == (first, second)
        ):
            self._order, self._log_page_size, self._sums = order, size, (first, second)

    def _read_frames(self) -> set[int]:
        """Read the frames after the last commit; return the pages committed since.

        Each frame is read once: a commit of a gigabyte takes a while to be written.
        """
        added: set[int] = set()
        if self._order is None or self._log is None:
            return added
        self._drop_overwritten()
        while (frame := self._next_frame()) is not None:
            self._waiting.append(frame)
            if frame.is_commit:
                pages = {one.page: one.at + FRAME_HEADER.size for one in self._waiting}
                self._frames.update(pages)
                added.update(pages)
                self._next, self._sums = self._end_of(frame), frame.sums
                self._waiting.clear()
        return added

    def _drop_overwritten(self) -> None:
        """Drop the waiting frames from the first one that another commit has replaced."""
        assert self._log is not None
        for place, one in enumerate(self._waiting):
            if read_at(self._log.fileno(), FRAME_HEADER.size, one.at) != one.head:
                del self._waiting[place:]
                return

    def _end_of(self, frame: Frame) -> int:
        return frame.at + FRAME_HEADER.size + self._log_page_size

    def _next_frame(self) -> Frame | None:
        """Return the frame behind those that were read; None if it is not valid."""
        assert self._log is not None
        assert self._order is not None
        at, sums = self._next, self._sums
        if self._waiting:
            at, sums = self._end_of(self._waiting[-1]), self._waiting[-1].sums
        data = read_at(self._log.fileno(), FRAME_HEADER.size + self._log_page_size, at)
        if len(data) < FRAME_HEADER.size + self._log_page_size:
            return None
        head = data[: FRAME_HEADER.size]
        page, pages_after, *salts, first, second = FRAME_HEADER.unpack(head)
        if salts != self._salts or page < 1:
            return None
        sums = _check_sums(self._order, data[:8], sums)
        sums = _check_sums(self._order, data[FRAME_HEADER.size :], sums)
        return Frame(at, head, page, pages_after > 0, sums) if sums == (first, second) else None


def _check_sums(order: str, data: bytes, sums: tuple[int, int]) -> tuple[int, int]:
    """Continue the checksums of a log over `data` ("Database File Format", section 4.2)."""
    first, second = sums
    words = struct.unpack(f"{order}{len(data) // 4}I", data)
    for even, odd in zip(words[::2], words[1::2], strict=True):
        first = (first + even + second) & WORD
        second = (second + odd + first) & WORD
    return first, second


def _is_same_file(file: BufferedReader, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.lstat())
    except OSError:
        return False
