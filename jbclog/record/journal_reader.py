"""Read the journal of a run that is in progress, or that a crash left open.

1. `Journal` opens all segments, then reads the chain of parts: what moves from a segment to a part
   meanwhile is in both, and `seq` says which. A segment that vanishes before it is opened has been
   sealed: they are listed again.
2. A segment is read by whole commits (`frames`). It is in memory packed; of its rows only some of
   one table are unpacked at a time.
3. What damage took is known by the numbers of commits and by holes in `seq` (`losses`). The end of
   a segment that is no whole commit is none: that commit was never acknowledged, or its rows are in
   the next segment. What the disk cannot read is damage everywhere.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import BinaryIO, Final

import pyarrow as pa

from jbclog.core.clock import utc_of, utc_text
from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, open_regular
from jbclog.core.json_files import json_of
from jbclog.core.rows import SCHEMA_VERSION, TABLES
from jbclog.record.damage import Damage
from jbclog.record.frames import Commit, Frame, FrameKind, Gap, Mark, read_items
from jbclog.record.part_chain import PartChain
from jbclog.record.row_batches import BARE, NUMBERED, Damaged, decode, joined, schema_of, table_of
from jbclog.record.schema import SEQ
from jbclog.record.segments import segment_number, segments

OLD_STORE: Final = "live.sqlite"
"""Of an open run of jbclog 0.1.0."""


def refuse_old_store(folder: Path) -> None:
    """Raise `RecordError` for an open run of jbclog 0.1.0."""
    if (folder / OLD_STORE).exists():
        raise RecordError(
            f"{folder}: an open run of jbclog 0.1.0; finish it with `jbclog recover` of that"
            " version. Nothing was changed"
        )


class Segment:
    """A segment as far as it is written. `damage` lists whole frames that cannot be unpacked, as
    they are found.
    """

    def __init__(self, path: Path, file: BinaryIO, run: str, *, only_marked: bool = False) -> None:
        """`only_marked`: without commits that may not be on the disk yet. Raises OSError."""
        self.path = path
        self.number = segment_number(path) or 0
        self.items = [*read_items(file)]
        self.damage: list[Damage] = []
        self.notes: dict[str, object] = {}
        self.facts: dict[str, object] = {}
        # of a segment that has lost its first commit: a run is recovered by the jbclog that made it
        self._schemas = {number: BARE[table] for number, table in enumerate(TABLES)}
        if only_marked:
            while self.items and not isinstance(self.items[-1], Mark):
                del self.items[-1]
        for commit in self.commits:
            for frame in commit.frames:
                self._read_frame(commit, frame)
        self._run = str(self.notes.get("run", run))  # its folder may have been renamed since

    @property
    def commits(self) -> Iterator[Commit]:
        return (item for item in self.items if isinstance(item, Commit))

    def _read_frame(self, commit: Commit, frame: Frame) -> None:
        try:
            if frame.kind is FrameKind.SCHEMA:
                self._schemas[frame.table] = schema_of(frame)
            elif frame.kind is FrameKind.FACTS:
                self.facts.update(json_of(frame.payload()))
            elif frame.kind is FrameKind.NOTES:
                self.notes.update(json_of(frame.payload()))
        except (Damaged, OSError, ValueError) as error:
            self._note(commit, frame.kind.name.lower(), None, error)

    def table_of(self, frame: Frame) -> str | None:
        """Return the table of a frame's rows; None for a frame without rows."""
        if frame.kind is not FrameKind.ROWS:
            return None
        return table_of(self._schemas[frame.table])

    def last_seq(self, frame: Frame) -> int:
        """Return the `seq` of the last of a frame's rows."""
        if self.table_of(frame) == NUMBERED:
            with suppress(Damaged):
                return int(self._decoded(frame)[SEQ][-1].as_py())
        return frame.first + frame.rows - 1

    def rows(self, table: str, above: int = -1) -> Iterator[pa.Table]:
        """Yield the rows of a table `above` a `seq`, each once, a frame at a time."""
        for commit in self.commits:
            for frame in commit.frames:
                if self.table_of(frame) != table:
                    continue
                if table != NUMBERED and frame.first + frame.rows <= above + 1:
                    continue
                try:
                    rows = self._decoded(frame)
                except Damaged as error:
                    self._note(commit, table, frame.rows, error)
                    continue
                if rows[SEQ][0].as_py() <= above:
                    rows = rows.slice(bisect_right(rows[SEQ].to_pylist(), above))
                if rows.num_rows:
                    above = rows[SEQ][-1].as_py()
                    yield rows

    def _decoded(self, frame: Frame) -> pa.Table:
        return decode(frame, self._schemas[frame.table], self._run)

    def _note(self, commit: Commit, what: str, rows: int | None, error: Exception) -> None:
        place = f"{self.path.name}, commit {commit.number} ({what})"
        damage = Damage(place, rows, str(error))
        if damage not in self.damage:
            self.damage.append(damage)


class Journal:
    """The segments of a run, open for reading, and the chain of its parts. Raises `RecordError` for
    files that cannot be read.
    """

    def __init__(self, folder: Path, *, only_marked: bool = False) -> None:
        self.folder = folder
        self._only_marked = only_marked
        self._opened = ExitStack()
        self._damage: dict[Damage, None] = {}
        self._gapped: set[int] = set()  # segments with more than an unfinished end
        self._last_read: tuple[int, Segment] | None = None
        self._files: list[tuple[Path, BinaryIO]] = []
        try:
            while not self._open(segments(folder)):
                self.close()
            self.chain = PartChain(folder)
        except OSError as error:
            self.close()
            if not folder.exists():
                raise RecordError(f"{folder} was removed") from error
            raise RecordError(f"{folder}: its journal cannot be read: {error}") from error

    def _open(self, paths: Sequence[Path]) -> bool:
        """Open segments; return False if one was sealed meanwhile."""
        try:
            self._files = [
                (path, self._opened.enter_context(open_regular(path, Kind.STORE))) for path in paths
            ]
        except FileNotFoundError:
            return False
        return True

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._opened.close()

    @property
    def paths(self) -> list[Path]:
        """The segments, oldest first."""
        return [path for path, _ in self._files]

    def segments(self, start: int = 0) -> Iterator[Segment]:
        """Yield the segments from number `start` of `paths` on, each read when it is its turn; the
        last one stays in memory.
        """
        for place in range(start, len(self._files)):
            if self._last_read is None or self._last_read[0] != place:
                self._last_read = place, self._read_segment(place)
            yield self._last_read[1]

    def _read_segment(self, place: int) -> Segment:
        path, file = self._files[place]
        only_marked = self._only_marked and place == len(self._files) - 1
        try:
            segment = Segment(path, file, self.folder.name, only_marked=only_marked)
            lacks_end = self._lacks_end(place, segment)
        except OSError as error:
            raise RecordError(f"{path} cannot be read: {error}") from error
        if lacks_end:
            end = segment.items[-1].end
            segment.items.append(Gap(end, end, is_end=False))
        if not segment.items:  # never written, or lost: the rows behind it say which
            segment.items.append(Gap(0, 0, is_end=True))
        gaps = [item for item in segment.items if isinstance(item, Gap)]
        if any(not gap.is_end or gap.is_unreadable for gap in gaps):
            self._gapped.add(place)
        return segment

    def _lacks_end(self, place: int, segment: Segment) -> bool:
        """Return True if the segment ends with a whole item, and commits are missing between it and
        the next one.
        """
        numbers = [item.number for item in segment.items if not isinstance(item, Gap)]
        if place + 1 == len(self._files) or not numbers or isinstance(segment.items[-1], Gap):
            return False
        begin = next(read_items(self._files[place + 1][1]), None)
        return isinstance(begin, Commit) and begin.number > max(numbers) + 1

    def last_begun(self) -> int:
        """Return the place of the last segment that surely begins with the notes of the run and the
        facts of all stations: the ones before it are not needed for these, nor written any more.
        """
        for place in reversed(range(len(self._files))):
            begin = [*islice(read_items(self._files[place][1]), 2)]
            if [type(item) for item in begin] == [Commit, Mark]:
                return place
        return 0

    @cached_property
    def _latest(self) -> tuple[dict[str, object], dict[str, object], Mark | None]:
        """Latest notes of the run, facts of stations, and mark. A segment begins with all of them,
        so the last one is enough, unless it has lost its first commit.
        """
        notes: dict[str, object] = {}
        facts: dict[str, object] = {}
        mark: Mark | None = None
        for place in reversed(range(len(self._files))):
            segment = next(self.segments(place))
            facts = segment.facts | facts
            marks = [item for item in segment.items if isinstance(item, Mark)]
            if mark is None and marks:
                mark = marks[-1]
            is_whole = "run" in segment.notes
            notes = segment.notes | notes
            if is_whole:
                break
        return notes, facts, mark

    @property
    def notes(self) -> Mapping[str, object]:
        """What the recorder notes of the run, such as `closed` and `dropped`."""
        return self._latest[0]

    @property
    def facts(self) -> Mapping[str, object]:
        """The latest facts of each station."""
        return self._latest[1]

    @property
    def last_mark(self) -> Mark | None:
        """The last mark; None without one."""
        return self._latest[2]

    def rows(self, table: str) -> Iterator[pa.Table]:
        """Yield the rows of a table that no part of the chain has, in pieces of some size."""
        return joined(self._rows(table))

    def _rows(self, table: str) -> Iterator[pa.Table]:
        above = self.chain.last_seq(table)
        for segment in self.segments():
            for rows in segment.rows(table, above):
                above = rows[SEQ][-1].as_py()
                yield rows
            self._damage.update(dict.fromkeys(segment.damage))

    def damage(self) -> list[Damage]:
        """Return what damage took from the segments, as far as they were read."""
        for place in sorted(self._gapped):
            segment = next(self.segments(place))
            self._damage.update(dict.fromkeys(losses(self, place, segment)))
        return list(self._damage)


def refuse_newer(journal: Journal) -> None:
    """Raise `RecordError` for a journal of a newer jbclog."""
    version = journal.notes.get("schema", SCHEMA_VERSION)
    if isinstance(version, int) and version > SCHEMA_VERSION:
        raise RecordError(
            f"{journal.folder}: written with schema {version}; this jbclog knows {SCHEMA_VERSION}."
            " Nothing was changed; use a newer jbclog."
        )


@dataclass(slots=True)
class _Loss:
    """A gap in a segment, behind commit `after` and before commit `following`, and how many rows of
    each table are missing there. `since_us`: the time of the last mark before it.
    """

    gap: Gap
    after: int | None
    since_us: int | None
    following: int | None = None
    rows: dict[str, int] = field(default_factory=dict)
    is_counted: bool = False  # rows of some table follow

    @property
    def commits(self) -> str | None:
        """The missing commits; None if there are none."""
        if self.after is None:
            return "its first commits"
        first = self.after + 1
        last = first if self.following is None else self.following - 1
        if last < first:
            return None
        return f"commit {first}" if last == first else f"commits {first} to {last}"

    @property
    def is_damage(self) -> bool:
        """False for an unfinished commit at the end of a segment, and for a mark."""
        if self.rows or self.gap.is_unreadable:
            return True
        return not self.gap.is_end and self.commits is not None

    def damage(self, name: str) -> Damage:
        state = "cannot be read" if self.gap.is_unreadable else "are damaged"
        why = f"bytes {self.gap.start} to {self.gap.end} {state}"
        if self.gap.start == self.gap.end:
            why = f"its end is missing, from byte {self.gap.end} on"
        if self.since_us is not None:
            why += f", recorded after {utc_text(utc_of(self.since_us))}"
        if self.rows:
            missing = [f"{count} {table}" for table, count in self.rows.items()]
            why += f"; missing: {', '.join(missing)}"
        rows = sum(self.rows.values()) if self.is_counted else None
        return Damage(f"{name}, {self.commits or 'between two commits'}", rows, why)


class _LossFinder:
    """Finds the gaps of the first segment that it reads, and in later ones how many rows are
    missing there. `next_seq`: of each table, before the first segment.
    """

    def __init__(self, next_seq: dict[str, int]) -> None:
        self.losses: list[_Loss] = []
        self._next_seq = next_seq
        # losses behind the last row of a table
        self._uncounted: dict[str, list[_Loss]] = {table: [] for table in TABLES}
        self._last_commit: int | None = None
        self._since_us: int | None = None

    @property
    def is_done(self) -> bool:
        return not any(self._uncounted.values())

    def read(self, segment: Segment, *, is_first: bool) -> None:
        for item in segment.items:
            if isinstance(item, Mark):
                self._pass(item.number + 1)
                self._since_us = item.utc_us
            elif isinstance(item, Commit):
                self._pass(item.number)
                self._last_commit = item.number
                self._count(segment, item)
            elif is_first:
                loss = _Loss(item, self._last_commit, self._since_us)
                self.losses.append(loss)
                for losses in self._uncounted.values():
                    losses.append(loss)

    def _pass(self, following: int) -> None:
        for loss in reversed(self.losses):
            if loss.following is not None:
                break
            loss.following = following
        self._last_commit = following - 1

    def _count(self, segment: Segment, commit: Commit) -> None:
        for frame in commit.frames:
            table = segment.table_of(frame)
            if table is None:
                continue
            missing = frame.first - self._next_seq[table]
            uncounted = self._uncounted[table]
            if uncounted and missing > 0:
                uncounted[0].rows[table] = missing
            for loss in uncounted:
                loss.is_counted = True
            uncounted.clear()
            self._next_seq[table] = max(self._next_seq[table], segment.last_seq(frame) + 1)


def losses(journal: Journal, place: int, segment: Segment) -> list[Damage]:
    """Return what damage took from `segment`, which is at `place` of `paths`: its missing commits,
    and the rows missing up to the next ones of each table, which may be in later segments.

    It is the same before and after its rows are in parts.
    """
    if not any(isinstance(item, Gap) for item in segment.items):
        return []
    number = segment.number
    finder = _LossFinder(
        {table: journal.chain.last_seq(table, before=number) + 1 for table in TABLES}
    )
    finder.read(segment, is_first=True)
    for later in journal.segments(place + 1):
        if finder.is_done:
            break
        finder.read(later, is_first=False)
    return [loss.damage(segment.path.name) for loss in finder.losses if loss.is_damage]
