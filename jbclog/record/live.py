"""The live store: takes rows at once, keeps them within a second, and says so when it cannot.

The rules:

1. Handing a row over costs an append. Nothing here ever makes a caller wait for the disk, save `commit_now` and `close`.
2. One commit a second holds everything of all stations, in one transaction, synced (`store`); `at_once` brings it forward.
3. What is committed is safe from this process: a kill loses what came after the last commit, a second at the most.
4. When a commit fails the reserve is given back to the disk or a new file is begun, and it is tried again. When that
   fails too, `failure` is set, `on_failure` is called once, rows are held in memory up to `HELD_BYTES`, and every
   second it is tried again. Rows that memory could not hold are counted.
5. Every hour a child process of low priority seals what is there into Parquet (`seal`).
"""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

from jbclog.errors import RecordError
from jbclog.record.batches import BARE, Batch, NotRows, encode, keep_pandas_out
from jbclog.record.chain import Chain
from jbclog.record.durable import sync_folder
from jbclog.record.lock import FolderLock
from jbclog.record.schema import SCHEMA_VERSION, TABLES
from jbclog.record.seal import SealChild
from jbclog.record.store import FACTS, META, Segment, segment_name
from jbclog.rows import CounterRow, EventRow, SampleRow, SettingRow, Severity, StationFacts

COMMIT_S: Final = 1.0
SEAL_S: Final = 3600.0
HELD_BYTES: Final = 32 << 20
RESERVE: Final = "live.reserve"
RESERVE_BYTES: Final = 4 << 20
NEW_FILE_ON: Final = (sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)

OnFailure = Callable[[RecordError], None]


class LiveStore:
    """The journal of one run (`rows.Journal`), written to SQLite in `folder`. Callers may be in any thread.

    `on_failure` is called in the writer's thread, once. The folder's lock is held from `start` until `release`, so that
    sealing after `close` is still the only writer.
    """

    def __init__(self, folder: Path, on_failure: OnFailure | None = None, *, seal_every_s: float | None = SEAL_S) -> None:
        self.folder = folder
        self.failure: RecordError | None = None
        self.committed = 0  # batches, which is the number of the last one
        self.dropped_rows = 0  # that memory could not hold, or that were no rows
        self._on_failure = on_failure
        self._seal_every_s = seal_every_s
        self._lock: FolderLock | None = None
        self._segment: Segment | None = None
        self._segments = 0
        self._child: SealChild | None = None
        self._chain = Chain(folder.name)
        self._number = 0
        self._backlog: list[Batch] = []
        self._handing = threading.Lock()  # held for an append or a swap
        self._buffers: dict[str, list[object]] = {table: [] for table in TABLES}
        self._events: list[EventRow] = []
        self._facts: dict[str, dict[str, object]] = {}
        self._all_facts: dict[str, str] = {}
        self._committing = threading.Lock()  # held for a whole commit
        self._wake = threading.Event()
        self._ending = False
        self._thread = threading.Thread(target=self._write_on, name="jbclog-writer", daemon=True)

    # -- the journal -------------------------------------------------------------------------------------------------

    def sample(self, row: SampleRow) -> None:
        with self._handing:
            self._buffers["samples"].extend(row)

    def event(self, event: EventRow, *, at_once: bool = False) -> None:
        with self._handing:
            self._events.append(event)
        if at_once:
            self._wake.set()

    def setting(self, setting: SettingRow) -> None:
        with self._handing:
            self._buffers["settings"].extend(setting)

    def counter(self, counter: CounterRow) -> None:
        with self._handing:
            self._buffers["counters"].extend(counter)

    def facts(self, facts: StationFacts) -> None:
        copy = asdict(facts)
        with self._handing:
            self._facts[facts.name] = copy

    # -- its life ----------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Make the store and begin to commit. Raises `RecordError`; then nothing is left open."""
        keep_pandas_out()
        self._lock = FolderLock.take(self.folder)
        try:
            self._reserve()
            self._segment = Segment.create(self.folder / segment_name(0))
            self._segment.add([], self._notes())
            sync_folder(self.folder)
        except (OSError, sqlite3.Error) as error:
            self.release()
            raise RecordError(f"{self.folder}: no record can be written there: {error}") from error
        self._thread.start()

    def commit_now(self) -> None:
        """Commit all that was handed over before; when this returns it is safe. Raises `RecordError` where it is not."""
        with self._committing:
            self._commit()
            if self._backlog:
                raise self.failure or RecordError(f"{self.folder}: not committed")

    def seal_now(self) -> None:
        """Have the hourly sealing done now, in the child; does not wait for it."""
        with self._committing:
            if self._child is None and self._lock is not None:
                self._child = SealChild(self.folder, self._lock, part=True)

    @property
    def is_sealing(self) -> bool:
        return self._child is not None

    def close(self) -> None:
        """Commit the rest, end the thread, close the file. Does not raise: what could not be kept is in `failure`."""
        self._ending = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()
        with self._committing:
            self._commit(closing=True)
            if self._child is not None:
                self._child.wait()
                self._child = None
            if self._segment is not None:
                with contextlib.suppress(sqlite3.Error):
                    self._segment.close()
                self._segment = None
            (self.folder / RESERVE).unlink(missing_ok=True)  # its room belongs to the sealing now

    @property
    def lock(self) -> FolderLock:
        """The folder's lock, for whoever seals after `close`."""
        if self._lock is None:
            raise RecordError(f"{self.folder}: the store was not started")
        return self._lock

    def release(self) -> None:
        """Let others write to the folder. After `conclude` the lock is gone already, and this does nothing."""
        if self._lock is not None:
            self._lock.release()

    # -- the writer's thread -----------------------------------------------------------------------------------------

    def _write_on(self) -> None:
        next_seal = time.monotonic() + (self._seal_every_s or 0.0)
        while not self._ending:
            self._wake.wait(COMMIT_S)
            self._wake.clear()
            with self._committing:
                self._commit()
                self._reap()
            if self._seal_every_s is not None and time.monotonic() >= next_seal:
                next_seal += self._seal_every_s
                self.seal_now()

    def _commit(self, closing: bool = False) -> None:
        """Store everything handed over so far, or keep it for the next time."""
        try:
            self._take()
            fresh = self._changed_facts()
            if self._backlog or fresh or closing:
                self._store(fresh, closing)
        except Exception as error:  # whatever it is, the recorder must hear of it and the thread go on
            self._fail(error)

    def _take(self) -> None:
        """Turn what was handed over into batches."""
        with self._handing:
            taken, self._buffers = self._buffers, {table: [] for table in TABLES}
            events, self._events = self._events, []
        for event in events:
            self._link(event, taken["events"])
        for table, values in taken.items():
            if values:
                self._encode(table, values)
        self._bound()

    def _link(self, event: EventRow, values: list[object]) -> None:
        try:
            values.extend(self._chain.link(event))
        except (TypeError, ValueError) as error:
            self._not_rows("events", 1, error)

    def _encode(self, table: str, values: Sequence[object]) -> None:
        try:
            self._number += 1
            self._backlog.append(encode(self._number, table, values))
        except NotRows as error:
            self._number -= 1
            width = len(BARE[table])
            if len(values) <= width:
                self._not_rows(table, 1, error)
                return
            half = len(values) // width // 2 * width  # one wrong row must not take the others with it
            self._encode(table, values[:half])
            self._encode(table, values[half:])

    def _not_rows(self, table: str, rows: int, error: Exception) -> None:
        self.dropped_rows += rows
        self._fail(RecordError(f"{self.folder}: {rows} row of {table} could not be recorded: {error}"))

    def _bound(self) -> None:
        """Drop the oldest samples that memory cannot hold; their numbers stay, without rows."""
        excess = sum(len(batch.data) for batch in self._backlog) - HELD_BYTES
        for place, batch in enumerate(self._backlog):
            if excess <= 0:
                return
            if batch.table == "samples" and batch.rows:
                excess -= len(batch.data)
                self.dropped_rows += batch.rows
                self._backlog[place] = encode(batch.number, batch.table, ())

    def _changed_facts(self) -> dict[str, str]:
        with self._handing:
            changed, self._facts = self._facts, {}
        fresh = {name: json.dumps(facts) for name, facts in changed.items()}
        self._all_facts.update(fresh)
        return fresh

    def _notes(self, facts: dict[str, str] | None = None, closing: bool = False) -> dict[tuple[str, str], str]:
        meta = {"schema": SCHEMA_VERSION, "run": self.folder.name, "last": self._number, "dropped": self.dropped_rows}
        notes = {(META, key): str(value) for key, value in meta.items()}
        if closing:
            notes[META, "closed"] = "1"
        return notes | {(FACTS, name): text for name, text in (self._all_facts if facts is None else facts).items()}

    # -- storing, and when it fails ----------------------------------------------------------------------------------

    def _store(self, fresh: dict[str, str], closing: bool) -> None:
        try:
            if self._segment is None:
                raise RecordError("the store is not open")
            self._segment.add(self._backlog, self._notes(fresh, closing))
        except sqlite3.Error as error:
            if not self._second_try(error, closing):
                self._facts_again(fresh)
                self._fail(error)
                return
        self.committed = self._number
        self._backlog.clear()

    def _second_try(self, error: sqlite3.Error, closing: bool) -> bool:
        """Make room, or begin a new file, and store again; give whether that went well."""
        full = _code(error) == sqlite3.SQLITE_FULL
        if full:
            (self.folder / RESERVE).unlink(missing_ok=True)
            self._fail(error)  # kept for now, and the disk is full all the same
        elif _code(error) not in NEW_FILE_ON:
            return False
        try:
            segment = self._segment if full and self._segment is not None else self._new_segment()
            segment.add(self._backlog, self._notes(closing=closing))
        except (sqlite3.Error, OSError):
            return False
        if segment is not self._segment:
            self._move_to(segment, error)
        return True

    def _new_segment(self) -> Segment:
        path = self.folder / segment_name(self._segments + 1)
        for leftover in (path, path.with_name(path.name + "-wal"), path.with_name(path.name + "-shm")):
            leftover.unlink(missing_ok=True)  # of a try that failed
        segment = Segment.create(path)
        sync_folder(self.folder)
        return segment

    def _move_to(self, segment: Segment, error: sqlite3.Error) -> None:
        if self._segment is not None:
            with contextlib.suppress(sqlite3.Error):
                self._segment.close()
        self._segment = segment
        self._segments += 1
        self._tell("record.new_file", Severity.ERROR, f"Writing failed ({error}); recording goes on in {segment.path.name}.")

    def _facts_again(self, fresh: dict[str, str]) -> None:
        """Have facts that were not stored stored the next time, unless newer ones came."""
        with self._handing:
            for name, text in fresh.items():
                self._facts.setdefault(name, json.loads(text))

    def _fail(self, error: Exception) -> None:
        """Remember the first failure and tell who wants to know."""
        if self.failure is not None:
            return
        told = error if isinstance(error, RecordError) else RecordError(f"{self.folder}: the record cannot be written: {error}")
        self.failure = told
        self._tell("record.failed", Severity.CRITICAL, str(told))
        if self._on_failure is not None:
            self._on_failure(told)

    def _tell(self, kind: str, severity: Severity, text: str) -> None:
        with self._handing:
            self._events.append(EventRow(time.time_ns() // 1000, kind, severity, text))

    def _reserve(self) -> None:
        """Take room that is given back when the disk is full, so that the run can end in good order."""
        descriptor = os.open(self.folder / RESERVE, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, 0o644)
        try:
            os.posix_fallocate(descriptor, 0, RESERVE_BYTES)
        finally:
            os.close(descriptor)

    def _reap(self) -> None:
        """Look whether the sealing child has ended; what it could not seal is sealed later."""
        if self._child is not None and (problem := self._child.ended()) is not None:
            self._child = None
            if problem:
                self._tell("record.not_sealed", Severity.WARNING, f"The hourly sealing failed and will be done later: {problem}")


def _code(error: sqlite3.Error) -> int:
    """SQLite's primary result code, or 0 where the error carries none."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF
