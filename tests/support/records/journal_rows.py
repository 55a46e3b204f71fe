"""What the files of a journal hold, read without the package's reader of journals."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pyarrow as pa

from jbclog.core.rows import TABLES
from jbclog.record.frames import Commit, Frame, FrameKind, Mark, read_items
from jbclog.record.row_batches import decode, schema_of, table_of
from jbclog.record.schema import TIME
from jbclog.record.segments import segments


@dataclass
class JournalRows:
    """Rows by table and `seq` (times in µs), the last facts of each station, the notes, and the
    numbers of whole commits.
    """

    rows: dict[str, dict[int, dict[str, object]]] = field(
        default_factory=lambda: {table: {} for table in TABLES}
    )
    facts: dict[str, dict[str, object]] = field(default_factory=dict)
    notes: dict[str, object] = field(default_factory=dict)
    commits: list[int] = field(default_factory=list)
    marked: int = 0
    marked_us: int = 0

    def column(self, table: str, name: str) -> list[object]:
        """Return a column in the order of `seq`."""
        rows = self.rows[table]
        return [rows[seq][name] for seq in sorted(rows)]


def read_journal(folder: Path) -> JournalRows:
    """Read all segments of a run in progress."""
    return read_files({path.name: path.read_bytes() for path in segments(folder)})


def read_files(files: Mapping[str, bytes], run: str = "run") -> JournalRows:
    """Read segments; a row that is there twice must be the same."""
    journal = JournalRows()
    for name in sorted(files):
        schemas: dict[int, pa.Schema] = {}
        for item in read_items(io.BytesIO(files[name])):
            if isinstance(item, Mark):
                journal.marked = max(journal.marked, item.number)
                journal.marked_us = max(journal.marked_us, item.utc_us)
            elif isinstance(item, Commit):
                journal.commits.append(item.number)
                for frame in item.frames:
                    _read_frame(journal, schemas, frame, run)
    return journal


def _read_frame(
    journal: JournalRows, schemas: dict[int, pa.Schema], frame: Frame, run: str
) -> None:
    if frame.kind is FrameKind.SCHEMA:
        schemas[frame.table] = schema_of(frame)
    elif frame.kind is FrameKind.ROWS:
        schema = schemas[frame.table]
        table = decode(frame, schema, run)
        for place, column in enumerate(table.schema):
            if column.type == TIME:
                table = table.set_column(place, column.name, table[place].cast(pa.int64()))
        for row in table.to_pylist():
            rows = journal.rows[table_of(schema)]
            assert rows.setdefault(row["seq"], row) == row
    elif frame.kind is FrameKind.FACTS:
        journal.facts.update(json.loads(frame.payload()))
    else:
        journal.notes.update(json.loads(frame.payload()))
