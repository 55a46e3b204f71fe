"""Files of lines that are only ever added to.

1. A line is on disk when `append_line` returns. A crash may leave the beginning of a line: it
   stays, and the next line starts behind it.
2. Writers exclude each other by a lock on the file. Readers take none.
3. Blank lines at the end are reserved space: the next lines are written over them, so a full disk
   takes these, too.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from jbclog.core.files import Kind, open_regular, open_to_write
from jbclog.core.operating_system import read_at, sync_folder, wait_for_lock, write_at

END: Final = b"\n"
BLOCK: Final = 1 << 16
PAGE: Final = 4 << 20  # bytes that a follower has in memory at once; a line is shorter


class LineFile:
    """The file of lines at `path`, created by the first line unless `creates` is False. Methods
    raise OSError, `NotReadable` for a link, a pipe or a file beyond the limit of its `kind`.
    """

    def __init__(self, path: Path, kind: Kind, *, creates: bool = True) -> None:
        self.path = path
        self.kind = kind
        self._creates = creates

    def append_line(self, line: bytes, *, is_synced: bool = True) -> None:
        """Append a line. After an OSError it may be there, whole or in part."""
        with self._opened(creates=self._creates) as descriptor:
            self._add(descriptor, content_end(descriptor), line, is_synced=is_synced)

    def reserve(self, size: int) -> None:
        """Reserve space on the disk for `size` bytes of further lines."""
        with self._opened(creates=self._creates) as descriptor:
            written = os.fstat(descriptor).st_size
            missing = content_end(descriptor) + size - written
            if missing > 0:
                self._write(descriptor, END * missing, written)

    def release(self) -> None:
        """Give reserved space back; remove a file without lines. What takes the file's name
        meanwhile is not changed.
        """
        with self._opened(creates=False) as descriptor:
            end = content_end(descriptor)
            if not end:
                self.path.unlink()
            elif os.fstat(descriptor).st_size > end + len(END):
                os.ftruncate(descriptor, end + len(END))
                os.fsync(descriptor)

    def lines_since(self, start: int, most: int = PAGE) -> tuple[list[bytes], int]:
        """Return the whole lines from byte `start` on, `most` bytes at most, and where the next
        line starts; none without a file. Not for files with reserved space.
        """
        try:
            with open_regular(self.path, self.kind) as file:
                file.seek(start)
                data = file.read(most)
        except FileNotFoundError:
            return [], start
        whole = data[: data.rfind(END) + 1]
        return whole.split(END)[:-1], start + len(whole)

    @contextmanager
    def _opened(self, *, creates: bool) -> Iterator[int]:
        """Open the file and lock it for one writer."""
        descriptor = open_to_write(self.path, self.kind, makes=creates)
        try:
            wait_for_lock(descriptor)
            yield descriptor
        finally:
            os.close(descriptor)

    def _add(self, descriptor: int, end: int, text: bytes, *, is_synced: bool = True) -> None:
        """Write one or more lines behind the content, which ends at `end`."""
        data = (END if end else b"") + text + END
        self._write(descriptor, data, end, is_synced=is_synced)

    def _write(self, descriptor: int, data: bytes, start: int, *, is_synced: bool = True) -> None:
        """Write all of `data` at `start`."""
        is_new = os.fstat(descriptor).st_size == 0
        while data:
            size = write_at(descriptor, data, start)
            data = data[size:]
            start += size
        if is_synced:
            os.fsync(descriptor)
            if is_new:
                sync_folder(self.path.absolute().parent)


def content_end(descriptor: int) -> int:
    """Return where the last line ends, without its line end; 0 without lines."""
    end = os.fstat(descriptor).st_size
    while end:
        start = max(end - BLOCK, 0)
        block = read_at(descriptor, end - start, start).rstrip(END)
        if block:
            return start + len(block)
        end = start
    return 0
