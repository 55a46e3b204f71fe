"""The live store: takes rows at once, commits them every second, then shows the events.

1. Adding a row costs an append (`RowBuffer`). Only `commit_now` and `close` wait for the disk.
2. One synced transaction a second holds everything of all stations (`StoreWriter`); `at_once`
   commits sooner.
3. A kill loses only rows after the last commit, at most a second.
4. A failed commit is retried with space from the reserve or in a new file. If that fails too, or
   the disk is full, `failure` is set, `on_failure` is called once, rows wait in memory up to
   `HELD_BYTES`, and the commit is retried every second. Dropped rows are counted.
5. Every hour a child process of low priority seals the committed rows into Parquet (`seal`).
6. `on_event` gets each event after its commit was tried, so that the record has what people read.
   A commit delayed by the disk holds events back for at most `WAITED_S`; after `STALLED_S` the
   disk counts as failed (`check_stall`).
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final

from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError, cause
from jbclog.core.locks import CommitStatus, FolderLock
from jbclog.core.rows import (
    SCHEMA_VERSION,
    TABLES,
    CounterRow,
    EventRow,
    SampleRow,
    SettingRow,
    Severity,
    StationFacts,
)
from jbclog.record.batches import BARE, ROWS_A_BATCH, Batch, NotRows, encode, prepare_arrow
from jbclog.record.chains import Chain
from jbclog.record.seal_child import SEAL_S, SealChild
from jbclog.record.store import FACTS, META, StoreWriter

OnEvent = Callable[[EventRow], None]


class PendingEvents:
    """Events that wait for their commit before people see them: an event that somebody has read
    must survive a kill.

    Calls `show` with each event once, in order. Callers may be in any thread.
    """

    def __init__(self, show: OnEvent | None) -> None:
        self._show = show
        self._waiting: deque[EventRow] = deque()
        self._lock = threading.Lock()
        self._shown = 0

    def add(self, event: EventRow) -> None:
        with self._lock:
            self._waiting.append(event)

    @property
    def count(self) -> int:
        """The number of events so far."""
        with self._lock:
            return self._shown + len(self._waiting)

    def show_first(self, count: int) -> None:
        """Show those of the first `count` events not shown yet; ignore an observer's error."""
        with self._lock:
            while self._waiting and self._shown < count:
                event = self._waiting.popleft()
                self._shown += 1
                if self._show is not None:
                    with suppress(Exception):
                        self._show(event)


HELD_BYTES: Final = 32 << 20  # a quarter of an hour of 64 stations

OnBadRow = Callable[[str, Exception], None]
"""Called with the table and the error if a row cannot be recorded."""


@dataclass(slots=True)
class _Rows:
    """The values of each table's rows end to end, events not linked yet, and stations' facts."""

    values: dict[str, list[object]] = field(default_factory=lambda: {table: [] for table in TABLES})
    # number of values already in batches
    done: dict[str, int] = field(default_factory=lambda: dict.fromkeys(TABLES, 0))
    events: list[EventRow] = field(default_factory=list)
    facts: dict[str, dict[str, object]] = field(default_factory=dict)


class RowBuffer:
    """Takes rows from any thread; `take` turns them into batches and facts, which stay here until
    they are stored.

    Memory may be refused at any step of `take`: its rows stay here and come first at the next call.
    `take` calls `on_bad_row` in its own thread. `dropped_rows` counts invalid rows and the oldest
    samples beyond `HELD_BYTES`.
    """

    def __init__(self, run: str, on_bad_row: OnBadRow) -> None:
        self.backlog: list[Batch] = []
        self.changed_facts: dict[str, str] = {}  # as JSON by station
        self.number = 0  # of the last batch
        self.dropped_rows = 0
        self._on_bad_row = on_bad_row
        self._chain = Chain(run)
        self._adding = threading.Lock()  # held for an append or a swap, never longer
        self._added = _Rows()
        self._in_work = _Rows()

    def sample(self, row: SampleRow) -> None:
        with self._adding:
            self._added.values["samples"].extend(row)

    def event(self, event: EventRow) -> None:
        with self._adding:
            self._added.events.append(event)

    def setting(self, setting: SettingRow) -> None:
        with self._adding:
            self._added.values["settings"].extend(setting)

    def counter(self, counter: CounterRow) -> None:
        with self._adding:
            self._added.values["counters"].extend(counter)

    def facts(self, facts: StationFacts) -> None:
        copy = asdict(facts)  # the session keeps changing it
        with self._adding:
            self._added.facts[facts.name] = copy

    def take(self) -> None:
        """Move all rows into `backlog` and `changed_facts`, those of a failed call first."""
        self._finish()
        with self._adding:
            self._in_work, self._added = self._added, _Rows()
        self._finish()

    def stored(self) -> None:
        """Clear `backlog` and `changed_facts`, which are stored."""
        self.backlog.clear()
        self.changed_facts.clear()

    def drop_oldest(self) -> None:
        """Drop the oldest samples beyond `HELD_BYTES`; their batches stay, without rows."""
        excess = sum(len(batch.data) for batch in self.backlog) - HELD_BYTES
        for place, batch in enumerate(self.backlog):
            if excess <= 0:
                return
            if batch.table == "samples" and batch.rows:
                excess -= len(batch.data)
                self.dropped_rows += batch.rows
                self.backlog[place] = encode(batch.number, batch.table, ())

    def _finish(self) -> None:
        """Move the rows on. Each step ends with one that cannot fail, so none is lost or
        duplicated.
        """
        rows = self._in_work
        while rows.events:
            self._link(rows.events[0], rows.values["events"])
            del rows.events[0]
        for table, values in rows.values.items():
            if values:
                self._encode(table, values)
        while rows.facts:
            station = next(iter(rows.facts))
            self.changed_facts[station] = json.dumps(rows.facts[station])
            del rows.facts[station]

    def _link(self, event: EventRow, values: list[object]) -> None:
        try:
            self._chain.link(event, values)
        except (TypeError, ValueError) as error:
            self._bad_row("events", error)

    def _encode(self, table: str, values: list[object]) -> None:
        """Move `values` into batches of the backlog, from where a failed call stopped."""
        done, most = self._in_work.done, ROWS_A_BATCH * len(BARE[table])
        while done[table] < len(values):
            count = min(len(values) - done[table], most)
            end = done[table] + count
            while not self._has_encoded(table, values[done[table] : end]):
                count = self._half(table, count)
                end = done[table] + count
            done[table] = end  # needs no memory, like `clear` below; deleting a slice may
        values.clear()
        done[table] = 0

    def _has_encoded(self, table: str, values: Sequence[object]) -> bool:
        """Add these rows to the backlog as a batch; False for several with an invalid one."""
        number = self.number + 1
        try:
            self.backlog.append(encode(number, table, values))
        except NotRows as error:
            if len(values) > len(BARE[table]):
                return False
            self._bad_row(table, error)
        else:
            self.number = number
        return True

    def _half(self, table: str, count: int) -> int:
        width = len(BARE[table])
        return max(count // width // 2, 1) * width

    def _bad_row(self, table: str, error: Exception) -> None:
        self.dropped_rows += 1
        self._on_bad_row(table, error)


COMMIT_S: Final = 0.8
# the most that a kill loses: the pause between two commits, and the commit itself
AT_RISK_S: Final = 1.0
WAITED_S: Final = 2.0
STALLED_S: Final = 10.0

OnFailure = Callable[[RecordError], None]


class LiveStore:
    """The journal of one run (`rows.Journal`), written to SQLite in `folder`. Callers may be in any
    thread.

    Calls `on_failure` once, and `on_event`, in the writer's thread or in that of `check_stall`.
    Holds the folder's lock from `start` until `release`, so that sealing after `close` is still the
    only writer.
    """

    def __init__(
        self,
        folder: Path,
        on_failure: OnFailure | None = None,
        *,
        seal_every_s: float | None = SEAL_S,
        on_event: OnEvent | None = None,
    ) -> None:
        self.folder = folder
        self.failure: RecordError | None = None
        # created while memory is available
        self._no_memory = RecordError(f"{folder}: the record is not whole: memory was refused")
        self._is_failure_reported = False
        self._on_failure = on_failure
        self._seal_every_s = seal_every_s
        self._lock: FolderLock | None = None
        self._buffer = RowBuffer(folder.name, self._bad_row)
        self._writer = StoreWriter(folder)
        self._child: SealChild | None = None
        self._facts: dict[str, str] = {}
        self._pending = PendingEvents(on_event)
        self._committing = threading.Lock()  # held for a whole commit
        self._commit_began: float | None = None  # monotonic seconds, during a commit
        self._commit_status = CommitStatus()
        self._safe_until = time.monotonic()  # rows added before this moment are stored
        self._wake = threading.Event()
        self._ending = False
        self._thread = threading.Thread(target=self._write_loop, name="jbclog-writer", daemon=True)

    def sample(self, row: SampleRow) -> None:
        self._buffer.sample(row)

    def event(self, event: EventRow, *, at_once: bool = False) -> None:
        self._buffer.event(event)
        self._pending.add(event)
        if at_once:
            self._wake.set()

    def setting(self, setting: SettingRow) -> None:
        self._buffer.setting(setting)

    def counter(self, counter: CounterRow) -> None:
        self._buffer.counter(counter)

    def facts(self, facts: StationFacts) -> None:
        self._buffer.facts(facts)

    @property
    def dropped_rows(self) -> int:
        """Rows that were dropped: invalid, or beyond the memory for waiting rows."""
        return self._buffer.dropped_rows

    @property
    def unkept_rows(self) -> int:
        """Rows in no commit; after `close` they are lost."""
        return self.dropped_rows + sum(batch.rows for batch in self._buffer.backlog)

    def start(self) -> None:
        """Create the store and start to commit. Raises `RecordError` and leaves nothing open."""
        prepare_arrow()
        self._lock = FolderLock.take(self.folder)
        try:
            self._writer.begin(self._meta())
        except (OSError, sqlite3.Error) as error:
            self._writer.close()
            self.release()
            why = write_failure(error, self.folder)
            raise RecordError(
                f"{self.folder}: no record can be written there: {why}. No station was touched."
            ) from error
        self._safe_until = time.monotonic()
        self._thread.start()

    def commit_now(self) -> None:
        """Commit all rows so far; on return they are stored. Raises `RecordError` otherwise."""
        with self._committing:
            if not self._commit():
                raise self.failure or RecordError(f"{self.folder}: not committed")

    def seal_now(self) -> None:
        """Start the hourly sealing now, in a child process, without waiting for it."""
        with self._committing:
            if self._child is None:
                try:
                    self._child = SealChild(self.folder, self.lock, part=True)
                except OSError as error:
                    self._not_sealed(str(error))

    def check_stall(self) -> None:
        """Report a commit that the disk delays. Call this about every second; it never waits."""
        began = self._commit_began
        waited = 0.0 if began is None else time.monotonic() - began
        if waited >= STALLED_S:
            self._fail(f"the disk has delayed a commit by {STALLED_S:g} s")
        if waited >= WAITED_S:
            self._pending.show_first(self._pending.count)

    def close(self) -> None:
        """Commit the rest, end the thread and close the file. Sets `failure` instead of raising."""
        self._ending = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()
        with self._committing:
            self._commit()
            if not self._commit(closing=True):  # with the events of the first one
                self._writer.release_reserve()
                self._commit(closing=True)
            if self._child is not None:
                self._child.wait()
                self._child = None
            self._writer.close()

    @property
    def lock(self) -> FolderLock:
        """The folder's lock, for sealing after `close`."""
        if self._lock is None:
            raise RecordError(f"{self.folder}: the store was not started")
        return self._lock

    def release(self) -> None:
        """Release the folder's lock. Does nothing after `conclude`, which removes it."""
        if self._lock is not None:
            self._lock.release()

    def _write_loop(self) -> None:
        next_seal = time.monotonic() + (self._seal_every_s or 0.0)
        while not self._ending:
            try:
                self._wake.wait(COMMIT_S)
                self._wake.clear()
                with self._committing:
                    self._commit()
                    self._reap()
                if self._seal_every_s is not None and time.monotonic() >= next_seal:
                    next_seal += self._seal_every_s
                    self.seal_now()
            except Exception as error:  # rows wait for the next turn
                with contextlib.suppress(Exception):
                    self._fail(cause(error))

    def _commit(self, *, closing: bool = False) -> bool:
        """Store all rows so far, or keep them; return True if all are stored. Then show events."""
        pending = self._pending.count
        self._commit_began = began = time.monotonic()
        try:
            is_safe = self._stored(closing)
            self._write_commit_status(began if is_safe else None)
            return is_safe
        finally:
            self._commit_began = None
            self._pending.show_first(pending)

    def _write_commit_status(self, began: float | None) -> None:
        """Write into the lock the number of the last stored batch. `began`: start of the commit."""
        now, before = time.monotonic(), self._commit_status
        waited = now - self._safe_until
        if began is None:
            self._commit_status = replace(before, unkept=self.unkept_rows)
        else:
            self._safe_until = began
            self._commit_status = CommitStatus(
                self._buffer.number,
                round(time.time() - (now - began), 3),
                max(before.risk_s, round(waited, 3)),
                self.dropped_rows,
                round(now - began, 3),
            )
        if self._lock is not None:
            self._lock.write_status(self._commit_status)

    def _stored(self, closing: bool) -> bool:
        try:
            self._report_failure()
            self._buffer.take()
            if self._buffer.backlog or self._buffer.changed_facts or closing:
                return self._store(closing)
        except Exception as error:  # any error must reach the recorder and keep the thread alive
            self._fail(cause(error))
            return False
        return True

    def _store(self, closing: bool) -> bool:
        meta = self._meta(closing)
        self._facts.update(self._buffer.changed_facts)
        fresh = meta | {
            (FACTS, station): text for station, text in self._buffer.changed_facts.items()
        }
        everything = meta | {(FACTS, station): text for station, text in self._facts.items()}
        kept = self._writer.add(self._buffer.backlog, fresh, everything)
        if kept.safe:
            self._buffer.stored()
        else:
            self._buffer.drop_oldest()
        if kept.moved_to:
            self._note(
                "record.new_file",
                Severity.ERROR,
                f"{kept.trouble}; recording continues in {kept.moved_to}.",
            )
        elif kept.trouble:
            self._fail(kept.trouble)
        return kept.safe

    def _meta(self, closing: bool = False) -> dict[tuple[str, str], str]:
        meta = {
            "schema": SCHEMA_VERSION,
            "run": self.folder.name,
            "last": self._buffer.number,
            "dropped": self.dropped_rows,
        }
        closed = {(META, "closed"): "1"} if closing else {}
        return {(META, key): str(value) for key, value in meta.items()} | closed

    def _reap(self) -> None:
        """Reap the sealing child if it has ended; rows that it could not seal are sealed later."""
        if self._child is not None and (problem := self._child.ended()) is not None:
            self._child = None
            if problem:
                self._not_sealed(problem)

    def _not_sealed(self, problem: str) -> None:
        self._note(
            "record.not_sealed",
            Severity.WARNING,
            f"The hourly sealing failed and will be done later: {problem}",
        )

    def _bad_row(self, table: str, error: Exception) -> None:
        self._fail(f"a row of {table} could not be recorded: {cause(error)}")

    def _fail(self, text: str) -> None:
        """Keep the first failure, even if memory is refused, and report it."""
        if self.failure is None:
            try:
                self.failure = RecordError(f"{self.folder}: the record is not whole: {text}")
            except MemoryError:
                self.failure = self._no_memory
        self._report_failure()

    def _report_failure(self) -> None:
        """Report the failure once; if that fails, again at the next commit."""
        if self.failure is None or self._is_failure_reported:
            return
        self._note("record.failed", Severity.CRITICAL, str(self.failure))
        self._is_failure_reported = True
        if self._on_failure is not None:
            with contextlib.suppress(Exception):  # an observer's error must not stop the recording
                self._on_failure(self.failure)

    def _note(self, kind: str, severity: Severity, text: str) -> None:
        self.event(EventRow(time.time_ns() // 1000, kind, severity, text))
