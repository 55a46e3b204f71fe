"""Reads each row of a run once, from the journal while it is written and from sealed parts.

A row is known by its table and `seq`. When the segment that was read is gone, its rows are in
parts: those above the greatest `seq` are read there, and reading continues in the next segment. So
it does not matter how long nobody looked.
"""

from __future__ import annotations

import errno
import json
from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Final, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.errors import RecordError
from jbclog.core.json_files import json_of
from jbclog.core.rows import TABLES, StationFacts
from jbclog.core.text import count_text
from jbclog.live.segment_cursor import SegmentCursor, first_mark
from jbclog.record.frames import Commit, Frame, FrameKind, Mark
from jbclog.record.manifest import Manifest, SealedFile, facts_in
from jbclog.record.part_chain import PartChain
from jbclog.record.part_file import PartFile, open_part
from jbclog.record.parts import group_of
from jbclog.record.row_batches import BARE, Damaged, decode, schema_of, table_of
from jbclog.record.schema import SEQ
from jbclog.record.segments import segments

TRIES: Final = 5
ROWS_AT_ONCE: Final = 32_768
MOST_DAMAGE: Final = 100  # entries kept
REMOVED: Final = (errno.ENOENT, errno.ESTALE)

# of a segment that has lost its first commit
_SCHEMAS: Final = {number: BARE[table] for number, table in enumerate(TABLES)}

Take = Callable[[str, pa.Table], None]
"""Takes a table's name and rows."""


class _Part(NamedTuple):
    file: SealedFile
    last_seq: int | None  # None: no rows, or not numbered, or not known before it is opened

    @property
    def table(self) -> str:
        return _table(self.file)


class _Group(NamedTuple):
    """A row group of samples that is still to be read, of which the rows above `after` are new."""

    file: SealedFile
    number: int
    after: int


class RecordFollower:
    """The rows of the run in `folder`. Gives each to `take`: events, settings and counters in
    order, samples of sealed parts only by `read_earlier`, newest part first.
    """

    def __init__(self, folder: Path, take: Take) -> None:
        self.folder = folder
        self.notes: dict[str, object] = {}
        self.facts: dict[str, StationFacts] = {}
        self.mark: Mark | None = None
        self._take = take
        self._cursor: SegmentCursor | None = None
        self._closed: Path | None = None  # the segment before, if its end is to be compared
        self._last_commit = 0
        self._schemas = dict(_SCHEMAS)
        self._last_seq = dict.fromkeys(TABLES, -1)
        self._parts_read: set[str] = set()
        self._earlier: deque[_Group] = deque()
        self._damage: dict[str, None] = {}

    @property
    def is_whole(self) -> bool:
        """Whether all rows were read that are there."""
        return not self._earlier and (self._cursor is None or not self._cursor.is_doubtful)

    @property
    def damage(self) -> list[str]:
        """A sentence for each place that cannot be read."""
        return list(self._damage)

    def read(self, manifest: Manifest | None) -> None:
        """Read what is new. Raises OSError, and `RecordError` for a part that is not readable."""
        for _ in range(TRIES):
            try:
                self._read_journal(manifest)
            except OSError as error:
                if error.errno not in REMOVED:
                    raise
            else:
                return

    def read_earlier(self) -> bool:
        """Read a row group of sealed samples; return whether there was one. Raises
        `RecordError`.
        """
        if not self._earlier:
            return False
        group = self._earlier.popleft()
        with self._opened(group.file) as opened:
            self._read_group(opened, group)
        return True

    def _read_journal(self, manifest: Manifest | None) -> None:
        """Read on in the segments that are there. Raises OSError if one was removed meanwhile."""
        there = segments(self.folder)
        if self._cursor is None or self._cursor.path not in there:
            self._read_parts(manifest)
            if not there:
                return
            self._begin_segment(there[0])
            self._closed = None
        assert self._cursor is not None
        for place in range(there.index(self._cursor.path), len(there)):
            if self._cursor.path != there[place]:
                self._begin_segment(there[place])
            through = _first_mark_in(there[place + 1 :])
            self._read_segment(self._cursor, through)
            if not through or self._cursor.is_doubtful:
                return

    def _begin_segment(self, path: Path) -> None:
        self._closed = None if self._cursor is None else self._cursor.path
        self._cursor = SegmentCursor(path)
        self._schemas = dict(_SCHEMAS)

    def _read_segment(self, cursor: SegmentCursor, through: int) -> None:
        commits = cursor.read(through)
        self.mark = cursor.mark or self.mark
        for gap in cursor.damage:
            size = gap.end - gap.start
            self._add_damage(f"{cursor.path.name}: {size} bytes at {gap.start} cannot be read")
        if commits:
            self._compare_end(commits[0])
            self._last_commit = max(commit.number for commit in commits)
        self._take_commits(commits)

    def _compare_end(self, commit: Commit) -> None:
        """Note a segment whose last commits are missing, by the first `commit` of the next one."""
        begins = any(frame.kind is FrameKind.SCHEMA for frame in commit.frames)
        if self._closed is not None and begins and commit.number > self._last_commit + 1:
            missing = commit.number - self._last_commit - 1
            self._add_damage(
                f"{self._closed.name}: its end cannot be read, {count_text(missing, 'commit')}"
            )
        self._closed = None

    def _take_commits(self, commits: Sequence[Commit]) -> None:
        pieces: dict[str, list[pa.Table]] = defaultdict(list)
        for commit in commits:
            for frame in commit.frames:
                try:
                    self._take_frame(frame, pieces)
                except (Damaged, OSError, ValueError, KeyError) as error:
                    self._add_damage(f"commit {commit.number}: {error}")
        for table, rows in pieces.items():
            self._take_new(table, rows)

    def _take_frame(self, frame: Frame, pieces: dict[str, list[pa.Table]]) -> None:
        """Take what a frame holds; rows wait in `pieces` to be taken together."""
        if frame.kind is FrameKind.SCHEMA:
            self._schemas[frame.table] = schema_of(frame)
        elif frame.kind is FrameKind.NOTES:
            self.notes.update(json_of(frame.payload()))
        elif frame.kind is FrameKind.FACTS:
            facts = json_of(frame.payload())
            texts = {station: json.dumps(entry) for station, entry in facts.items()}
            self.facts.update(facts_in(self.folder, texts))
        else:
            schema = self._schemas[frame.table]
            table = table_of(schema)
            waiting = pieces[table]
            waiting.append(decode(frame, schema, str(self.notes.get("run", self.folder.name))))
            if sum(map(len, waiting)) >= ROWS_AT_ONCE:
                self._take_new(table, pieces.pop(table))

    def _take_new(self, table: str, pieces: Sequence[pa.Table]) -> None:
        """Take those of the rows that were not read before."""
        rows = pa.concat_tables(pieces)
        after = self._last_seq[table]
        last_seq = pc.max(rows[SEQ]).as_py()
        if last_seq is not None and last_seq > after:
            self._last_seq[table] = last_seq
            self._take_above(table, rows, after)

    def _take_above(self, table: str, rows: pa.Table, after: int) -> None:
        numbers = rows[SEQ]
        if after >= 0 and (pc.min(numbers).as_py() or 0) <= after:
            rows = rows.filter(pc.greater(numbers, after))
        if len(rows):
            self._take(table, rows)

    def _add_damage(self, text: str) -> None:
        if len(self._damage) < MOST_DAMAGE:
            self._damage[text] = None

    # -- sealed parts ------------------------------------------------------------------------------

    def _read_parts(self, manifest: Manifest | None) -> None:
        """Read the rows of parts that were not read before."""
        after = dict(self._last_seq)
        for part in self._parts(manifest):
            if part.file.path in self._parts_read:
                continue
            if part.last_seq is None or part.last_seq > after[part.table]:
                self._read_part(part, after[part.table])
            self._parts_read.add(part.file.path)

    def _parts(self, manifest: Manifest | None) -> list[_Part]:
        if manifest is None or not manifest.is_sealed:
            return [_Part(part.file, part.last_seq) for part in PartChain(self.folder).parts]
        files = [file for file in manifest.files if _table(file) in TABLES]
        return [_Part(file, None) for file in sorted(files, key=_order)]

    def _read_part(self, part: _Part, after: int) -> None:
        with self._opened(part.file) as opened:
            last_seq = part.last_seq
            if last_seq is None:
                last_seq = _last_seq(opened)
            if last_seq is not None and last_seq <= after:
                return
            groups = [_Group(part.file, number, after) for number in range(opened.num_row_groups)]
            if part.table == "samples":
                self._earlier.extendleft(reversed(groups))
            else:
                for group in groups:
                    self._read_group(opened, group)
            if last_seq is not None:
                self._last_seq[part.table] = last_seq

    def _read_group(self, opened: PartFile, group: _Group) -> None:
        table = _table(group.file)
        try:
            rows = group_of(opened, table, group.number)
        except RecordError as error:
            self._add_damage(str(error))
        else:
            self._take_above(table, rows, group.after)

    def _opened(self, file: SealedFile) -> AbstractContextManager[PartFile]:
        return open_part(self.folder / file.path, file)


def _first_mark_in(paths: Sequence[Path]) -> int:
    """Return the number of the first commit of these segments that is marked as on the disk; 0 if
    none is yet. Raises OSError.
    """
    for path in paths:
        mark = first_mark(path)
        if mark is not None:
            return mark.number
    return 0


def _table(file: SealedFile) -> str:
    return file.path.partition("/")[0]


def _order(file: SealedFile) -> tuple[int, str]:
    """Order part 10000 behind part 9999."""
    return len(file.path), file.path


def _last_seq(part: PartFile) -> int | None:
    """Return the greatest number of a sealed part's rows; None if they are not numbered."""
    bounds = [bound for bound in part.bounds(SEQ) if bound is not None]
    return max((last for _, last in bounds), default=None)
