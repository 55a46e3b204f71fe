"""The journal of a run: takes rows at once, commits them every 0.6 s, then shows the events.

1. Adding a row costs an append (`RowBuffer`). Only `commit_now` and `close` wait for the disk.
2. One commit holds everything of all stations (`segments`); what must be seen at once (a critical
   event, a tool that is about to be hot) does not wait for the next one.
3. A kill loses only rows after the last commit, at most a second.
4. A failed commit is written again, with space from the reserve or in a new segment. If that fails
   too, or the disk is full, `failure` is set, `on_failure` is called once, rows wait in memory up
   to `WAITING_BYTES`, and every commit tries again. Dropped rows are counted.
5. Every hour, and after `ROWS_A_SEGMENT`, a new segment begins, and a child process of low priority
   seals the ones before into Parquet (`seal`).
6. `on_event` gets each event after its commit was tried, so that the record has what people read.
   A commit delayed by the disk holds events back for at most `WAITED_S`; after `STALLED_S` the
   disk counts as failed (`check_stall`).
"""

from __future__ import annotations

import json
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Final

from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError, cause
from jbclog.core.locks import FolderLock
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
from jbclog.record.chains import Chain
from jbclog.record.frames import Frame
from jbclog.record.row_batches import BARE, ROWS_A_FRAME, NotRows, encode, prepare_arrow
from jbclog.record.seal_child import SEAL_S, SealChild
from jbclog.record.segments import SegmentWriter

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


WAITING_BYTES: Final = 32 << 20
"""Of rows that wait for a disk that takes none: a quarter of an hour of 64 stations."""
FACTS_S: Final = 10.0
"""Facts of a station that changed are written after so long, or at once if one of `URGENT` did."""
URGENT: Final = (
    "outcome",
    "model",
    "ports",
    "period_s",
    "signals",
    "touched",
    "asked_safe_state",
    "suction",
    "may_feed",
    "safe_state",
    "unsafe",
)
"""Facts that say what is there, how its rows are read, and what may be hot."""

OnBadRow = Callable[[str, Exception], None]
"""Called with the table and the error if a row cannot be recorded."""


class RowBuffer:
    """Takes rows from any thread; `take` turns them into frames and facts, which stay here until
    they are stored.

    Rows for which `take` gets no memory come first at its next call. It calls `on_bad_row` in its
    own thread. `dropped_rows` counts invalid rows and the oldest samples beyond `WAITING_BYTES`;
    each was numbered, and leaves a hole in `seq`.
    """

    def __init__(self, run: str, on_bad_row: OnBadRow) -> None:
        self.backlog: list[Frame] = []
        self.changed_facts: dict[str, str] = {}  # as JSON by station
        self.dropped_rows = 0
        self._on_bad_row = on_bad_row
        self._chain = Chain(run)
        self._next_seq = dict.fromkeys(TABLES, 0)  # of the next row; `_chain` numbers events
        self._adding = threading.Lock()  # held for an append or a swap, never longer
        self._values: dict[str, list[object]] = {table: [] for table in TABLES}
        self._events: deque[EventRow] = deque()  # not linked yet
        self._chunks: deque[tuple[str, list[object]]] = deque()  # rows not encoded yet
        self._facts: dict[str, dict[str, object]] = {}  # not written yet
        self._urgent: dict[str, list[object]] = {}  # by station, as handed over last
        self._facts_due: dict[str, float] = {}  # monotonic seconds, by station

    def sample(self, row: SampleRow) -> None:
        with self._adding:
            self._values["samples"].extend(row)

    def event(self, event: EventRow) -> None:
        self._events.append(event)

    def setting(self, setting: SettingRow) -> None:
        with self._adding:
            self._values["settings"].extend(setting)

    def counter(self, counter: CounterRow) -> None:
        with self._adding:
            self._values["counters"].extend(counter)

    def facts(self, facts: StationFacts) -> bool:
        """Take facts; return True if they should be written at once."""
        copy = asdict(facts)  # the session keeps changing it
        urgent = [copy[name] for name in URGENT]
        with self._adding:
            is_urgent = self._urgent.get(facts.name) != urgent
            self._facts[facts.name] = copy
            if is_urgent:
                self._urgent[facts.name] = urgent
                self._facts_due[facts.name] = 0.0
        return is_urgent

    def take(self, now: float) -> None:
        """Move all rows into `backlog`, and the facts that are due at `now` into
        `changed_facts`.
        """
        while self._events:
            self._link(self._events[0])
            self._events.popleft()
        for table in TABLES:
            fresh: list[object] = []
            with self._adding:
                if self._values[table]:
                    self._chunks.append((table, self._values[table]))
                    self._values[table] = fresh
        while self._chunks:
            self._encode_chunk()
        self._take_facts(now)

    def stored(self) -> None:
        """Clear `backlog` and `changed_facts`, which are stored."""
        self.backlog.clear()
        self.changed_facts.clear()

    def drop_oldest(self) -> None:
        """Drop the oldest samples beyond `WAITING_BYTES`."""
        excess = sum(len(frame.packed) for frame in self.backlog) - WAITING_BYTES
        samples = TABLES.index("samples")
        kept: list[Frame] = []
        for frame in self.backlog:
            if excess > 0 and frame.table == samples:
                excess -= len(frame.packed)
                self.dropped_rows += frame.rows
            else:
                kept.append(frame)
        self.backlog = kept

    def _link(self, event: EventRow) -> None:
        try:
            self._chain.link(event, self._values["events"])
        except (TypeError, ValueError) as error:
            self._bad_row("events", error)
            self._chain.skip()

    def _encode_chunk(self) -> None:
        """Move the first chunk on: into the backlog, or into its halves if it is too long or has an
        invalid row. What follows the append needs no memory, so that no row is there twice.
        """
        table, values = self._chunks[0]
        width = len(BARE[table])
        rows = len(values) // width
        first = self._next_seq[table]
        following = first + rows
        if rows > ROWS_A_FRAME:
            self._halve()
            return
        try:
            frame = encode(table, values, first, TABLES.index(table))
        except NotRows as error:
            if rows > 1:
                self._halve()
                return
            self._bad_row(table, error)
        else:
            self.backlog.append(frame)
        self._next_seq[table] = following
        self._chunks.popleft()

    def _halve(self) -> None:
        (table, values), *others = self._chunks
        middle = len(values) // len(BARE[table]) // 2 * len(BARE[table])
        halves = [(table, values[:middle]), (table, values[middle:])]
        self._chunks = deque([*halves, *others])

    def _take_facts(self, now: float) -> None:
        for station in [*self._facts]:
            if now < self._facts_due.get(station, 0.0):
                continue
            with self._adding:
                facts = self._facts[station]
                self._facts_due[station] = now + FACTS_S
            self.changed_facts[station] = json.dumps(facts)
            with self._adding:
                if self._facts[station] is facts:
                    del self._facts[station]

    def _bad_row(self, table: str, error: Exception) -> None:
        self.dropped_rows += 1
        self._on_bad_row(table, error)


COMMIT_S: Final = 0.6
# the most that a kill loses: the pause between two commits, and the commit itself
AT_RISK_S: Final = 1.0
WAITED_S: Final = 2.0
STALLED_S: Final = 10.0
ROWS_A_SEGMENT: Final = 1_000_000  # whose sealing takes some 350 MB

OnFailure = Callable[[RecordError], None]


class RunJournal:
    """The journal of one run (`rows.Journal`), written to segments in `folder`. Callers may be in
    any thread.

    Calls `on_failure` once, and `on_event`, in the writer's thread or in that of `check_stall`.
    Holds the folder's lock from `start` until `release`, so that sealing after `close` is still the
    only writer. `seal_every_s` None: nothing is sealed before the end.
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
        self._seal_at_rows = ROWS_A_SEGMENT
        self._lock: FolderLock | None = None
        self._buffer = RowBuffer(folder.name, self._bad_row)
        self._writer = SegmentWriter(folder)
        self._notes: dict[str, object] = {}  # as stored
        self._child: SealChild | None = None
        self._pending = PendingEvents(on_event)
        self._committing = threading.Lock()  # held for a whole commit
        self._commit_began: float | None = None  # monotonic seconds, during a commit
        self._safe_until = time.monotonic()  # rows added before this moment are stored
        self._risk_s = AT_RISK_S
        self._unkept_noted = 0
        self._wake = threading.Event()
        self._ending = False
        self._thread = threading.Thread(target=self._write_loop, name="jbclog-writer", daemon=True)

    def sample(self, row: SampleRow) -> None:
        self._buffer.sample(row)

    def event(self, event: EventRow, *, at_once: bool = False) -> None:
        self._buffer.event(event)
        self._pending.add(event)
        if at_once or event.severity == Severity.CRITICAL:
            self._wake.set()

    def setting(self, setting: SettingRow) -> None:
        self._buffer.setting(setting)

    def counter(self, counter: CounterRow) -> None:
        self._buffer.counter(counter)

    def facts(self, facts: StationFacts) -> None:
        if self._buffer.facts(facts):
            self._wake.set()

    @property
    def dropped_rows(self) -> int:
        """Rows that were dropped: invalid, or beyond the memory for waiting rows."""
        return self._buffer.dropped_rows

    @property
    def unkept_rows(self) -> int:
        """Rows in no commit; after `close` they are lost."""
        return self.dropped_rows + sum(frame.rows for frame in self._buffer.backlog)

    def start(self) -> None:
        """Create the journal and start to commit. Raises `RecordError` and leaves nothing open."""
        prepare_arrow()
        self._lock = FolderLock.take(self.folder)
        notes = self._notes_now(is_closing=False)
        try:
            self._writer.begin(notes, _utc_us())
        except OSError as error:
            self._writer.close()
            self.release()
            why = write_failure(error, self.folder)
            raise RecordError(
                f"{self.folder}: no record can be written there: {why}. No station was touched."
            ) from error
        self._notes = notes
        self._safe_until = time.monotonic()
        self._thread.start()

    def commit_now(self) -> None:
        """Commit all rows so far; on return they are stored. Raises `RecordError` otherwise."""
        with self._committing:
            if not self._commit():
                raise self.failure or RecordError(f"{self.folder}: not committed")

    def seal_now(self) -> None:
        """Begin a new segment now, and have a child process seal the ones before, without waiting
        for it.
        """
        with self._committing:
            self._seal()

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
            if not self._commit(is_closing=True):  # with the events of the first one
                self._writer.release_reserve()
                self._commit(is_closing=True)
            if self._child is not None:
                self._child.wait()
                self._child = None
            self._writer.close()

    @property
    def lock(self) -> FolderLock:
        """The folder's lock, for sealing after `close`."""
        if self._lock is None:
            raise RecordError(f"{self.folder}: the journal was not started")
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
                    if self._seal_every_s is None:
                        continue
                    is_due = time.monotonic() >= next_seal
                    if is_due:
                        next_seal += self._seal_every_s
                    if is_due or self._writer.rows >= self._seal_at_rows:
                        self._seal()
            except Exception as error:  # rows wait for the next turn
                with suppress(Exception):
                    self._fail(cause(error))

    def _commit(self, *, is_closing: bool = False) -> bool:
        """Store all rows so far, or keep them; return True if all are stored. Then show events."""
        pending = self._pending.count
        try:
            with self._watched():
                is_safe = self._store(is_closing)
        # any error must reach the recorder and keep the thread alive
        except Exception as error:
            self._fail(cause(error))
            is_safe = False
        finally:
            self._pending.show_first(pending)
        self._note_unkept()
        return is_safe

    @contextmanager
    def _watched(self) -> Iterator[None]:
        """Let `check_stall` see how long the disk takes."""
        self._commit_began = time.monotonic()
        try:
            yield
        finally:
            self._commit_began = None

    def _store(self, is_closing: bool) -> bool:
        self._report_failure()
        began = time.monotonic()
        utc_us = _utc_us()
        self._buffer.take(math.inf if is_closing else began)
        notes = self._notes_now(is_closing=is_closing)
        changed = {key: value for key, value in notes.items() if self._notes.get(key) != value}
        if self._buffer.backlog or self._buffer.changed_facts or changed:
            if not self._write(changed, utc_us):
                return False
            self._notes = notes
        else:
            self._writer.mark(utc_us)
        waited = math.ceil((time.monotonic() - self._safe_until) * 10) / 10
        self._risk_s = max(self._risk_s, waited)
        self._safe_until = began
        return True

    def _write(self, notes: Mapping[str, object], utc_us: int) -> bool:
        kept = self._writer.commit(self._buffer.backlog, self._buffer.changed_facts, notes, utc_us)
        if kept.is_safe:
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
        return kept.is_safe

    def _notes_now(self, *, is_closing: bool) -> dict[str, object]:
        """Return the notes of the run: what `recover` needs to know.

        `risk_s` is the longest time that a row waited for its commit. `closed`: the recorder
        committed everything.
        """
        return {
            "run": self.folder.name,
            "schema": SCHEMA_VERSION,
            "dropped": self.dropped_rows,
            "risk_s": self._risk_s,
            "closed": is_closing,
        }

    def _note_unkept(self) -> None:
        unkept = self.unkept_rows
        if self._lock is not None and unkept != self._unkept_noted:
            self._lock.write_unkept(unkept)
            self._unkept_noted = unkept

    def _seal(self) -> None:
        """Begin a new segment, and a child that seals the ones before, if none is at work: then
        the next one will.
        """
        try:
            with self._watched():
                self._writer.rotate(_utc_us())
            if self._child is None:
                self._child = SealChild(self.folder, self.lock, part=True)
        except OSError as error:
            self._not_sealed(write_failure(error, self.folder))
        self._seal_at_rows = self._writer.rows + ROWS_A_SEGMENT

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
            with suppress(Exception):  # an observer's error must not stop the recording
                self._on_failure(self.failure)

    def _note(self, kind: str, severity: Severity, text: str) -> None:
        self.event(EventRow(_utc_us(), kind, severity, text))


def _utc_us() -> int:
    return time.time_ns() // 1000
