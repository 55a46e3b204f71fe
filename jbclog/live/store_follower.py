"""Reads new rows of a run's live store, without locks or writes."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.core.errors import RecordError
from jbclog.core.locks import commit_status
from jbclog.core.rows import SCHEMA_VERSION, TABLES
from jbclog.live.sqlite_pages import DatabasePages, Malformed
from jbclog.live.sqlite_rows import Row, Value, roots, row, rows
from jbclog.record.batches import Batch, Damaged, decode
from jbclog.record.store import FACTS, META, MOST_NOTES_BYTES, segments

MOST_DAMAGE: Final = 100  # entries kept
# batches read at once: a recorder adds some 7000 in an hour, and then seals them
MOST_BATCHES: Final = 100_000
MOST_NOTES: Final = 10_000


class Sealed(Exception):
    """A batch has moved from the live store to a sealed part."""


@dataclass(slots=True)
class _Segment:
    pages: DatabasePages
    trouble: str | None = None  # why it cannot be read now
    tables: dict[str, int] = field(default_factory=dict)  # name -> first page


class StoreFollower:
    """The live store of the run in `folder`. `last` is the newest batch that `refresh` has
    returned.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.last = 0
        self._damage: list[str] = []
        self.notes: dict[str, str] = {}
        self._segments: dict[Path, _Segment] = {}
        self._where: dict[int, Path] = {}
        self._seen_notes: dict[tuple[str, str], Value] = {}
        self._changed_facts: dict[str, str] = {}

    def close(self) -> None:
        for segment in self._segments.values():
            segment.pages.close()
        self._segments.clear()

    @property
    def damage(self) -> list[str]:
        """A sentence for each part that could not be read; a file drops out once it was read."""
        return [*filter(None, (one.trouble for one in self._segments.values())), *self._damage]

    @property
    def exists(self) -> bool:
        """Whether a file of the store existed at the last `refresh`."""
        return bool(self._segments)

    @property
    def is_closed(self) -> bool:
        """Whether the recorder committed everything and closed the store."""
        return self.notes.get("closed") == "1"

    @property
    def dropped_rows(self) -> int:
        return self._number("dropped")

    @property
    def sealed_through(self) -> int:
        """The last batch that was removed because it is in a part."""
        return self._number("sealed")

    def refresh(self, through: int | None) -> list[tuple[int, str]]:
        """Return number and table of each batch since the last call, ascending, up to `through`.

        Raises `RecordError` if the store cannot be read now, or a newer jbclog wrote it.
        """
        self._open_segments()
        found: dict[int, str] = {}
        for path, segment in self._segments.items():
            segment.trouble = None
            try:
                for number, table in self._read(segment):
                    if number not in found and (through is None or number <= through):
                        found[number], self._where[number] = table, path
            except Malformed as error:
                if not (segment.pages.is_empty() and not commit_status(self.folder).last):
                    segment.trouble = f"{path.name}: {error}"
            except OSError as error:
                raise RecordError(
                    f"{path} cannot be read now: {error.strerror or error}"
                ) from error
        self._expect_known_schema()
        self.last = max(found, default=self.last)
        return sorted(found.items())

    def changed_facts(self) -> dict[str, str]:
        """Return the facts of stations that changed since the last call, as JSON."""
        changed, self._changed_facts = self._changed_facts, {}
        return changed

    def table(self, number: int) -> pa.Table | None:
        """Return the rows of a batch from `refresh`, or None if it is damaged.

        Raises `Sealed`, `RecordError`.
        """
        path = self._where[number]
        segment = self._segments.get(path)
        if segment is None:
            raise Sealed
        try:
            values = segment.pages.snapshot(
                lambda pages: _values(pages, row(pages, segment.tables["batch"], number))
            )
            return None if values is None else self._decoded(number, values)
        except OSError as error:
            raise RecordError(f"{path} cannot be read now: {error.strerror or error}") from error
        except Malformed as error:
            self._add_damage(f"{path.name}, batch {number}: {error}")
            return None
        finally:
            del self._where[number]

    def _decoded(self, number: int, values: list[Value]) -> pa.Table | None:
        match values:
            case [_, str(table), int(count), int(crc), bytes(data)]:
                try:
                    return decode(Batch(number, table, count, data), crc)
                except Damaged as error:
                    self._add_damage(f"batch {number} ({table}): {error}")
            case _:
                self._add_damage(f"batch {number}: it holds what no recorder writes")
        return None

    def _open_segments(self) -> None:
        """Open new files of the store and close removed ones."""
        try:
            there = segments(self.folder)
        except OSError:  # the folder was removed
            there = []
        for path, segment in list(self._segments.items()):
            if path not in there or not segment.pages.is_same_file():
                segment.pages.close()
                del self._segments[path]
        for path in there:
            if path not in self._segments:
                try:
                    self._segments[path] = _Segment(DatabasePages(path))
                except FileNotFoundError:
                    continue  # sealed meanwhile
                except OSError as error:
                    raise RecordError(
                        f"{path} cannot be read: {error.strerror or error}"
                    ) from error

    def _read(self, segment: _Segment) -> list[tuple[int, str]]:
        def read(
            pages: DatabasePages,
        ) -> tuple[dict[str, int], list[tuple[int, Value]], list[list[Value]]]:
            tables = segment.tables or roots(pages)
            if not {"batch", "note"} <= tables.keys():
                # the recorder may die between creating the file and creating its tables
                return {}, [], []
            batches = [
                (one.number, one.first_values(2)[1])
                for one in rows(pages, tables["batch"], self.last, most_rows=MOST_BATCHES)
            ]
            notes = rows(pages, tables["note"], most_bytes=MOST_NOTES_BYTES, most_rows=MOST_NOTES)
            return tables, batches, [one.values(pages) for one in notes]

        segment.tables, batches, notes = segment.pages.snapshot(read)
        for note in notes:
            self._take_note(note)
        for number, table in batches:
            if table not in TABLES:
                self._add_damage(f"batch {number}: it belongs to no table")
        return [
            (number, table)
            for number, table in batches
            if isinstance(table, str) and table in TABLES
        ]

    def _take_note(self, note: list[Value]) -> None:
        match note:
            case [str(kind), str(key), str(text), crc]:
                if self._seen_notes.get((kind, key)) == crc:
                    return
                if zlib.crc32(f"{kind} {key} {text}".encode()) != crc:
                    self._add_damage(f"note {key!r:.60}: its check sum does not match")
                    return
                self._seen_notes[kind, key] = crc
                if kind == META:
                    self.notes[key] = text
                elif kind == FACTS:
                    self._changed_facts[key] = text
            case _:
                self._add_damage("a note holds what no recorder writes")

    def _expect_known_schema(self) -> None:
        if self._number("schema") > SCHEMA_VERSION:
            raise RecordError(
                f"{self.folder}: written with schema {self._number('schema')}; this jbclog knows"
                f" {SCHEMA_VERSION}. Use a newer jbclog."
            )

    def _number(self, key: str) -> int:
        text = self.notes.get(key, "")
        return int(text) if text.isdigit() and len(text) < 20 else 0

    def _add_damage(self, text: str) -> None:
        if text not in self._damage and len(self._damage) < MOST_DAMAGE:
            self._damage.append(text)


def _values(pages: DatabasePages, found: Row | None) -> list[Value]:
    if found is None:
        raise Sealed
    return found.values(pages)
