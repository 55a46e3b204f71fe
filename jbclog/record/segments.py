"""The segments of a run's journal, `live-0000.journal` and so on, and who writes them.

1. A commit is one write and one sync; then its mark is written, which is not synced.
2. A write that fails before its sync is cut off again. If the disk is full, space from the reserve
   serves the next attempt.
3. After a sync that failed, or an input/output error anywhere, it is not known what the disk
   holds: nothing is written to that file any more. A new segment follows.
4. A segment begins with all that its reader needs: the tables' schemas, the notes of the run, and
   what is known of each station. A segment before it may be sealed and removed only when that is
   on the disk.
5. A commit that failed is written again by its caller, with the same rows under the same `seq` and
   the same number, so it may be there twice.
"""

from __future__ import annotations

import errno
import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.core.disk_space import write_failure
from jbclog.core.operating_system import NO_LINK, PLAIN, sync_data, sync_file, sync_folder
from jbclog.core.rows import TABLES
from jbclog.record.frames import Frame, FrameKind, commit_bytes, mark_bytes
from jbclog.record.row_batches import schema_frame

_NAME: Final = re.compile(r"live-(\d{4,})\.journal")
RESERVE: Final = "live.reserve"
"""File that keeps space for the end of a run on a full disk: half for its last rows, half for
sealing them.
"""
RESERVE_BYTES: Final = 4 << 20
FRAMES_A_COMMIT: Final = 32_768
MOST_FAILED: Final = 16
"""Segments that may fail before the record counts as failed."""
FULL: Final = (errno.ENOSPC, errno.EDQUOT)


def segment_name(number: int) -> str:
    return f"live-{number:04d}.journal"


def segment_number(path: Path) -> int | None:
    """Return the number in a segment's name; None for another file."""
    match = _NAME.fullmatch(path.name)
    return int(match[1]) if match else None


def segments(folder: Path) -> list[Path]:
    """Return the journal's files, oldest first. Raises OSError."""
    numbered = []
    for path in folder.iterdir():
        number = segment_number(path)
        if number is not None:
            numbered.append((number, path))
    return [path for _, path in sorted(numbered)]


class Disk:
    """What the writer asks of the system; each call raises OSError. A test has a model of it."""

    def create(self, path: Path) -> int:
        """Create a file and open it, to write at its end."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | PLAIN | NO_LINK
        return os.open(path, flags, 0o644)

    def write(self, file: int, data: memoryview) -> int:
        """Return how many bytes were written."""
        return os.write(file, data)

    def sync(self, file: int) -> None:
        sync_data(file)

    def truncate(self, file: int, size: int) -> None:
        os.ftruncate(file, size)

    def close(self, file: int) -> None:
        os.close(file)

    def remove(self, path: Path) -> None:
        path.unlink()

    def sync_folder(self, folder: Path) -> None:
        sync_folder(folder)

    def is_at(self, file: int, path: Path) -> bool:
        """Return True if `path` still leads to the open file."""
        try:
            return os.path.samestat(os.fstat(file), path.lstat())
        except OSError:
            return False

    def reserve(self, path: Path, size: int) -> None:
        """Create a file of `size` bytes for which the disk has space."""
        path.write_bytes(bytes(size))
        sync_file(path)  # some file systems allocate only now

    def release(self, path: Path, size: int) -> bool:
        """Leave `size` bytes of a reserve; return False if it has no more than that."""
        with suppress(FileNotFoundError):
            if path.stat().st_size > size:
                os.truncate(path, size)
                return True
        return False


@dataclass(frozen=True, slots=True)
class Kept:
    """Result of a commit: whether it is on the disk, and any trouble.

    `moved_to` names a new segment in which recording continues. Trouble without it means that the
    disk is failing or full, even if it accepted this.
    """

    is_safe: bool
    trouble: str | None = None
    moved_to: str | None = None


# created beforehand: refused memory must not hide that something is on the disk
KEPT: Final = Kept(True)


class SegmentWriter:
    """Writes the journal in `folder`. Used by one thread at a time.

    `commits` is the number of the last commit that is on the disk; `rows` are those of the present
    segment.
    """

    def __init__(self, folder: Path, disk: Disk | None = None) -> None:
        self.folder = folder
        self.commits = 0
        self.rows = 0
        self._disk = disk or Disk()
        self._schemas = [schema_frame(table, number) for number, table in enumerate(TABLES)]
        self._facts: dict[str, str] = {}
        self._notes: dict[str, object] = {}
        self._file: int | None = None
        self.path = folder / segment_name(0)
        self._end = 0  # of the last commit and its mark
        self._is_failed = False  # nothing is written to this segment any more
        self._begun = 0  # segments
        self._failed = 0  # segments

    def begin(self, notes: Mapping[str, object], utc_us: int) -> None:
        """Allocate the reserve and write the first segment. Raises OSError, leaving nothing
        open.
        """
        self._disk.reserve(self.folder / RESERVE, RESERVE_BYTES)
        self._notes.update(notes)
        self._begin_segment(())
        self.mark(utc_us)

    def commit(
        self,
        rows: Sequence[Frame],
        facts: Mapping[str, str],
        notes: Mapping[str, object],
        utc_us: int,
    ) -> Kept:
        """Write rows, stations' `facts` as JSON, and notes, and sync them. What was recorded before
        `utc_us` is among them, or was before.
        """
        if self._file is None:
            return Kept(False, "the journal is not open")
        if not self._disk.is_at(self._file, self.path):
            return Kept(False, f"{self.path} was removed during the run")
        self._facts.update(facts)
        self._notes.update(notes)
        frames = [*rows, *_facts_frames(facts), *_notes_frames(notes)]
        try:
            self._store(rows, frames)
            kept = KEPT
        except OSError as error:
            kept = self._retry(rows, frames, error)
        if kept.is_safe:
            self.mark(utc_us)
        return kept

    def mark(self, utc_us: int) -> None:
        """Say that all commits are on the disk, and all that was recorded before `utc_us`."""
        if self._file is None or self._is_failed:
            return
        with suppress(OSError):  # the next commit reports a failing disk
            self._append(mark_bytes(self.commits, utc_us))

    def rotate(self, utc_us: int) -> None:
        """Begin a new segment; then the ones before may be sealed. Raises OSError: then they may
        not.
        """
        if self._file is not None and not self._disk.is_at(self._file, self.path):
            raise FileNotFoundError(errno.ENOENT, "it was removed during the run", self.path)
        self._begin_segment(())
        self.mark(utc_us)

    def release_reserve(self) -> None:
        """Release half of the remaining reserve for the last rows; sealing needs the rest."""
        with suppress(OSError):
            self._disk.release(self.folder / RESERVE, RESERVE_BYTES // 4)

    def close(self) -> None:
        """Close the file and release the reserve for sealing."""
        if self._file is not None:
            with suppress(OSError):
                self._disk.close(self._file)
            self._file = None
        with suppress(OSError):  # already reported; `conclude` or `recover` removes it
            self._disk.remove(self.folder / RESERVE)

    def _store(self, rows: Sequence[Frame], frames: Sequence[Frame]) -> None:
        if self._is_failed or self._file is None:
            self._begin_segment(rows)
            return
        data, commits = self._commit_bytes(frames)
        following = self.rows + _count_rows(rows)
        self._append(data)
        try:
            self._disk.sync(self._file)
        except BaseException:
            self._is_failed = True
            raise
        self.commits = commits
        self.rows = following

    def _retry(self, rows: Sequence[Frame], frames: Sequence[Frame], error: OSError) -> Kept:
        """Try once more: with space from the reserve, or in a new segment."""
        trouble = f"writing failed: {write_failure(error, self.folder)}"
        is_full = error.errno in FULL
        try:
            if is_full:
                if not self._disk.release(self.folder / RESERVE, RESERVE_BYTES // 2):
                    return Kept(False, trouble)
            else:
                self._is_failed = True
            self._store(rows, frames)
        except OSError as second:
            return Kept(False, f"{trouble}; then {write_failure(second, self.folder)}")
        if is_full:
            return Kept(True, trouble)
        self._failed += 1
        if self._failed > MOST_FAILED:
            return Kept(True, f"{trouble}, in {self._failed} files")
        return Kept(True, trouble, self.path.name)

    def _begin_segment(self, rows: Sequence[Frame]) -> None:
        """Begin a segment with what its reader needs and with `rows`."""
        facts = _facts_frames(self._facts)
        notes = _notes_frames(self._notes)
        data, commits = self._commit_bytes([*self._schemas, *rows, *facts, *notes])
        path = self.folder / segment_name(self._begun)
        self._begun += 1  # a name is not used again: its file may be there after a crash
        file = self._disk.create(path)
        is_written = False
        try:
            self._write(file, data)
            is_written = True
            self._disk.sync(file)
            self._disk.sync_folder(self.folder)
        except BaseException:
            # a crash may bring it back: later commits must stand in a segment after it
            self._is_failed = self._is_failed or is_written
            with suppress(OSError):
                self._disk.close(file)
            with suppress(OSError):
                self._disk.remove(path)
            raise
        if self._file is not None:
            with suppress(OSError):
                self._disk.close(self._file)
        self._file = file
        self.path = path
        self._end = len(data)
        self._is_failed = False
        self.commits = commits
        self.rows = _count_rows(rows)

    def _commit_bytes(self, frames: Sequence[Frame]) -> tuple[bytes, int]:
        """Return the bytes of the next commit and its number; of several if a commit cannot hold
        all, and the number of the last.
        """
        pieces = []
        number = self.commits
        for start in range(0, len(frames), FRAMES_A_COMMIT):
            number += 1
            pieces.append(commit_bytes(number, frames[start : start + FRAMES_A_COMMIT]))
        return b"".join(pieces), number

    def _append(self, data: bytes) -> None:
        """Write at the end of the segment; cut off what a write that fails may have left."""
        assert self._file is not None
        end = self._end + len(data)
        try:
            self._write(self._file, data)
        except BaseException as error:
            self._is_failed = True  # unless it can be cut off
            if getattr(error, "errno", None) != errno.EIO:
                with suppress(OSError):
                    self._disk.truncate(self._file, self._end)
                    self._is_failed = False
            raise
        self._end = end

    def _write(self, file: int, data: bytes) -> None:
        view = memoryview(data)
        while view:
            written = self._disk.write(file, view)
            view = view[written:]


def _facts_frames(facts: Mapping[str, str]) -> list[Frame]:
    if not facts:
        return []
    entries = [f"{json.dumps(station)}:{text}" for station, text in facts.items()]
    payload = "{" + ",".join(entries) + "}"
    return [Frame.of(FrameKind.FACTS, payload.encode())]


def _notes_frames(notes: Mapping[str, object]) -> list[Frame]:
    if not notes:
        return []
    return [Frame.of(FrameKind.NOTES, json.dumps(notes).encode())]


def _count_rows(frames: Iterable[Frame]) -> int:
    return sum(frame.rows for frame in frames)
