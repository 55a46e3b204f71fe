"""The store's file in use, and what is done when it fails: room from the reserve, or a new file."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.core.durable_files import sync_file, sync_folder
from jbclog.record.batches import Batch
from jbclog.record.store import Notes, Segment, companions, segment_name

RESERVE: Final = "live.reserve"
RESERVE_BYTES: Final = 4 << 20
NEW_FILE_ON: Final = (sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)


@dataclass(frozen=True, slots=True)
class Kept:
    """What came of storing: whether it is safe, and what went wrong on the way, if anything.

    `moved_to` names the new file in which recording goes on. Trouble without it means that the disk does not take what
    the run brings, even where it took this.
    """

    safe: bool
    trouble: str | None = None
    moved_to: str | None = None


KEPT: Final = Kept(True)  # there already: what is stored must not fail to be known as stored for want of memory


class StoreWriter:
    """Stores batches in `folder`. Used by one thread at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._segment: Segment | None = None
        self._index = 0
        self._home = folder.lstat()  # a link, or another folder, in its place is not where a run may write

    def begin(self, notes: Notes) -> None:
        """Take the reserve and make the first file. Raises OSError or sqlite3.Error; then nothing is left open."""
        self._take_reserve()
        segment = Segment.create(self.folder / segment_name(0))
        try:
            segment.add([], notes)
            sync_folder(self.folder)
        except BaseException:
            segment.close()
            raise
        self._segment = segment

    def add(self, batches: Sequence[Batch], fresh: Notes, everything: Notes) -> Kept:
        """Store `batches` and the `fresh` notes in one transaction; a new file gets `everything` that is to be noted."""
        if self._segment is None:
            return Kept(False, "the store is not open")
        if not self._is_there(self._segment.path):  # SQLite would go on writing to a file that nobody can open any more
            return Kept(False, f"{self._segment.path} was removed while the run went on")
        try:
            self._segment.add(batches, fresh)
        except sqlite3.Error as error:
            return self._again(error, batches, everything)
        return KEPT

    def _is_there(self, path: Path) -> bool:
        try:
            return os.path.samestat(self.folder.lstat(), self._home) and path.exists()
        except OSError:
            return False

    def give_for_the_end(self) -> None:
        """Give the rows that are still waiting half of what of the reserve is left; the rest is for sealing."""
        with contextlib.suppress(OSError):
            self._shrink(RESERVE_BYTES // 4)

    def close(self) -> None:
        """Close the file and give the reserve up: its room belongs to the sealing."""
        if self._segment is not None:
            with contextlib.suppress(sqlite3.Error):
                self._segment.close()
            self._segment = None
        with contextlib.suppress(OSError):  # a disk that fails has been told of; `conclude` removes it, or `recover`
            (self.folder / RESERVE).unlink(missing_ok=True)

    # -- when it fails -------------------------------------------------------------------------------------------------

    def _again(self, error: sqlite3.Error, batches: Sequence[Batch], everything: Notes) -> Kept:
        """Once more where there is hope: in the same file with the reserve's room, or in a new file."""
        full, trouble = _code(error) == sqlite3.SQLITE_FULL, f"writing failed: {error}"
        try:
            if full and self._segment is not None and self._give_half():
                self._segment.add(batches, everything)
                return Kept(True, trouble)
            if _code(error) in NEW_FILE_ON:
                return Kept(True, trouble, self._move(batches, everything))
        except (sqlite3.Error, OSError) as second:
            return Kept(False, f"{trouble}; then {second}")
        return Kept(False, trouble)

    def _move(self, batches: Sequence[Batch], everything: Notes) -> str:
        """Store them in a new file and go on in that; give its name."""
        path = self.folder / segment_name(self._index + 1)
        for leaving in (path, *companions(path)):
            leaving.unlink(missing_ok=True)  # of a try that failed
        segment = Segment.create(path)
        try:
            segment.add(batches, everything)
            sync_folder(self.folder)
        except BaseException:
            segment.close()
            raise
        if self._segment is not None:
            with contextlib.suppress(sqlite3.Error):
                self._segment.close()
        self._segment, self._index = segment, self._index + 1
        return path.name

    # -- the reserve ---------------------------------------------------------------------------------------------------

    def _take_reserve(self) -> None:
        """Take room that is given back when the disk is full: half of it for the last rows, half for sealing them."""
        (self.folder / RESERVE).write_bytes(bytes(RESERVE_BYTES))
        sync_file(self.folder / RESERVE)  # some disks give out room only then

    def _give_half(self) -> bool:
        """Give half of it back; False where that was done before."""
        return self._shrink(RESERVE_BYTES // 2)

    def _shrink(self, size: int) -> bool:
        reserve = self.folder / RESERVE
        if not reserve.exists() or reserve.stat().st_size <= size:
            return False
        os.truncate(reserve, size)
        return True


def _code(error: sqlite3.Error) -> int:
    """SQLite's primary result code, or 0 where the error carries none."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF
