"""The live store: rows are handed over, kept within a second, and events shown after that.

The rules:

1. Handing a row over costs an append (`intake`). Only `commit_now` and `close` make their caller wait for the disk.
2. One commit a second holds everything of all stations, in one transaction, synced (`store`); `at_once` brings it forward.
3. What is committed is safe from this process: a kill loses what came after the last commit, a second at the most.
4. When a commit fails the reserve is given back to the disk or a new file is begun, and it is tried again (`keeping`).
   When that fails too, or the disk is full, `failure` is set, `on_failure` is called once, rows are held in memory as
   far as there is room for them, and every second it is tried again. Rows that there was no room for are counted.
5. Every hour a child process of low priority seals what is there into Parquet (`seal`).
6. `on_event` is called with each event when its commit was tried, so that what people are shown is in the record. A disk
   that keeps a commit waiting holds them up for `WAITED_S` at the most, and after `STALLED_S` counts as one that takes
   nothing (`look`).
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

from jbclog.core.errors import RecordError, cause
from jbclog.core.locks import CommitStatus, FolderLock
from jbclog.core.rows import CounterRow, EventRow, SampleRow, SettingRow, Severity, StationFacts
from jbclog.record.batches import BARE, Batch, NotRows, encode, keep_pandas_out
from jbclog.record.chains import Chain
from jbclog.record.schema import SCHEMA_VERSION, TABLES
from jbclog.record.seal import SealChild
from jbclog.record.store import FACTS, META, StoreWriter

# -- pending events -----------------------------------------------------------------------------------------------------------
# Events that people have not been shown yet: they wait until the disk has been asked to keep them.
#
# What a person has read must be in the record, also when the recorder is killed the moment after.

OnEvent = Callable[[EventRow], None]


class PendingEvents:
    """Holds events in their order; `show` is given each once. Callers may be in any thread."""

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
        """How many there have been so far."""
        with self._lock:
            return self._shown + len(self._waiting)

    def show_first(self, count: int) -> None:
        """Show what of the first `count` has not been shown. An observer that fails must not become a fault of the record."""
        with self._lock:
            while self._waiting and self._shown < count:
                event = self._waiting.popleft()
                self._shown += 1
                if self._show is not None:
                    with suppress(Exception):
                        self._show(event)


# -- row buffer ---------------------------------------------------------------------------------------------------------------
# Where rows are handed over, and how they become batches: from many threads in, to one writer out.

HELD_BYTES: Final = 32 << 20  # a quarter of an hour of 64 stations

OnBadRow = Callable[[str, Exception], None]
"""Is told the table and the reason when a row cannot be recorded."""


def _no_values() -> dict[str, list[object]]:
    return {table: [] for table in TABLES}


@dataclass(slots=True)
class _Rows:
    """What was handed over: the values of each table's rows laid end to end, events that are not linked yet, facts."""

    values: dict[str, list[object]] = field(default_factory=_no_values)
    events: list[EventRow] = field(default_factory=list)
    facts: dict[str, dict[str, object]] = field(default_factory=dict)


class RowBuffer:
    """Takes rows at once; `take` turns what came since into batches and facts, which stay here until they are stored.

    `take` may be refused memory at any step. What it has in hand then stays in hand, so that nothing needs to be put back, and
    is the first of the next turn. `on_bad_row` is called by `take`, in its thread. Rows that are no rows, and the oldest
    samples that `HELD_BYTES` has no room for, are counted in `dropped_rows`.
    """

    def __init__(self, run: str, on_bad_row: OnBadRow) -> None:
        self.backlog: list[Batch] = []
        self.changed_facts: dict[str, str] = {}  # as JSON by station
        self.number = 0  # of the last batch
        self.dropped_rows = 0
        self._on_bad_row = on_bad_row
        self._chain = Chain(run)
        self._handing = threading.Lock()  # held for an append or a swap, never longer
        self._handed = _Rows()
        self._in_hand = _Rows()

    # -- any thread --------------------------------------------------------------------------------------------------

    def sample(self, row: SampleRow) -> None:
        with self._handing:
            self._handed.values["samples"].extend(row)

    def event(self, event: EventRow) -> None:
        with self._handing:
            self._handed.events.append(event)

    def setting(self, setting: SettingRow) -> None:
        with self._handing:
            self._handed.values["settings"].extend(setting)

    def counter(self, counter: CounterRow) -> None:
        with self._handing:
            self._handed.values["counters"].extend(counter)

    def facts(self, facts: StationFacts) -> None:
        copy = asdict(facts)  # its owner goes on changing it
        with self._handing:
            self._handed.facts[facts.name] = copy

    # -- the writer ----------------------------------------------------------------------------------------------------

    def take(self) -> None:
        """Put what was handed over into `backlog` and `changed_facts`, after what a turn that failed has left in hand."""
        self._finish()
        with self._handing:
            self._in_hand, self._handed = self._handed, _Rows()
        self._finish()

    def stored(self) -> None:
        """All of `backlog` and `changed_facts` is safe."""
        self.backlog.clear()
        self.changed_facts.clear()

    def drop_oldest(self) -> None:
        """Make room in memory where there is too much: the oldest samples go; their numbers stay, without rows."""
        excess = sum(len(batch.data) for batch in self.backlog) - HELD_BYTES
        for place, batch in enumerate(self.backlog):
            if excess <= 0:
                return
            if batch.table == "samples" and batch.rows:
                excess -= len(batch.data)
                self.dropped_rows += batch.rows
                self.backlog[place] = encode(batch.number, batch.table, ())

    def _finish(self) -> None:
        """Empty what is in hand. Each step ends with what cannot fail: an item is either in hand or where it belongs."""
        rows = self._in_hand
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
        """Empty `values` into batches of the backlog."""
        if self._has_encoded(table, values):
            values.clear()  # which needs no memory, as to delete a part of it may
        while values:
            count = self._half(table, len(values))
            while not self._has_encoded(table, values[:count]):
                count = self._half(table, count)
            del values[:count]

    def _has_encoded(self, table: str, values: Sequence[object]) -> bool:
        """Whether these rows are a batch of the backlog now; one wrong row must not take the others with it."""
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


# -- live ---------------------------------------------------------------------------------------------------------------------

COMMIT_S: Final = 0.8
AT_RISK_S: Final = 1.0  # what a kill can take at the most: the pause between two commits, and the commit itself
SEAL_S: Final = 3600.0
WAITED_S: Final = 2.0
STALLED_S: Final = 10.0

OnFailure = Callable[[RecordError], None]


class LiveStore:
    """The journal of one run (`rows.Journal`), written to SQLite in `folder`. Callers may be in any thread.

    `on_failure` is called once, in the writer's thread or in that of `look`; `on_event` in either. The folder's lock is held
    from `start` until `release`, so that sealing after `close` is still the only writer.
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
        self._no_memory = RecordError(f"{folder}: the record is not whole: memory was refused")  # made while there is memory
        self._is_failure_told = False
        self._on_failure = on_failure
        self._seal_every_s = seal_every_s
        self._lock: FolderLock | None = None
        self._intake = RowBuffer(folder.name, self._bad_row)
        self._keeping = StoreWriter(folder)
        self._child: SealChild | None = None
        self._facts: dict[str, str] = {}
        self._untold = PendingEvents(on_event)
        self._committing = threading.Lock()  # held for a whole commit
        self._commit_began: float | None = None  # monotonic seconds, while one goes on
        self._witness = CommitStatus()
        self._safe_until = time.monotonic()  # all that was handed over before is safe
        self._wake = threading.Event()
        self._ending = False
        self._thread = threading.Thread(target=self._write_on, name="jbclog-writer", daemon=True)

    # -- the journal ---------------------------------------------------------------------------------------------------

    def sample(self, row: SampleRow) -> None:
        self._intake.sample(row)

    def event(self, event: EventRow, *, at_once: bool = False) -> None:
        self._intake.event(event)
        self._untold.add(event)
        if at_once:
            self._wake.set()

    def setting(self, setting: SettingRow) -> None:
        self._intake.setting(setting)

    def counter(self, counter: CounterRow) -> None:
        self._intake.counter(counter)

    def facts(self, facts: StationFacts) -> None:
        self._intake.facts(facts)

    @property
    def dropped_rows(self) -> int:
        """Rows that could not be kept: no room for them, or no rows at all."""
        return self._intake.dropped_rows

    @property
    def unkept_rows(self) -> int:
        """Rows that are in no commit so far; after `close` they never will be."""
        return self.dropped_rows + sum(batch.rows for batch in self._intake.backlog)

    # -- its life ------------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Make the store and begin to commit. Raises `RecordError`; then nothing is left open."""
        keep_pandas_out()
        self._lock = FolderLock.take(self.folder)
        try:
            self._keeping.begin(self._meta())
        except (OSError, sqlite3.Error) as error:
            self._keeping.close()
            self.release()
            raise RecordError(f"{self.folder}: no record can be written there: {error}. No station was touched.") from error
        self._safe_until = time.monotonic()
        self._thread.start()

    def commit_now(self) -> None:
        """Commit all that was handed over before; when this returns it is safe. Raises `RecordError` where it is not."""
        with self._committing:
            if not self._commit():
                raise self.failure or RecordError(f"{self.folder}: not committed")

    def seal_now(self) -> None:
        """Have the hourly sealing done now, in the child; does not wait for it."""
        with self._committing:
            if self._child is None:
                try:
                    self._child = SealChild(self.folder, self.lock, part=True)
                except OSError as error:
                    self._not_sealed(str(error))

    def look(self) -> None:
        """To be called each second or so by whoever must know of a disk that keeps a commit waiting; never waits itself."""
        began = self._commit_began
        waited = 0.0 if began is None else time.monotonic() - began
        if waited >= STALLED_S:
            self._fail(f"the disk has kept a commit waiting for {STALLED_S:g} s")
        if waited >= WAITED_S:
            self._untold.show_first(self._untold.count)

    @property
    def is_sealing(self) -> bool:
        """Whether the hourly child is at work."""
        return self._child is not None

    def close(self) -> None:
        """Commit the rest, end the thread, close the file. Does not raise: what could not be kept is in `failure`."""
        self._ending = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()
        with self._committing:
            self._commit()
            if not self._commit(closing=True):  # with what the first one had to tell
                self._keeping.give_for_the_end()
                self._commit(closing=True)
            if self._child is not None:
                self._child.wait()
                self._child = None
            self._keeping.close()

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

    # -- the writer's thread -------------------------------------------------------------------------------------------

    def _write_on(self) -> None:
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
            except Exception as error:  # as in `_stored`: what was handed over waits for the next turn
                with contextlib.suppress(Exception):
                    self._fail(cause(error))

    def _commit(self, *, closing: bool = False) -> bool:
        """Store everything handed over so far, or keep it for the next time; give whether all is safe. Then it is told."""
        untold = self._untold.count
        self._commit_began = began = time.monotonic()
        try:
            is_safe = self._stored(closing)
            self._testify(began if is_safe else None)
            return is_safe
        finally:
            self._commit_began = None
            self._untold.show_first(untold)

    def _testify(self, began: float | None) -> None:
        """Leave word of how far all is safe, for who finds this run without its recorder. `began`: of a good commit."""
        now, before = time.monotonic(), self._witness
        waited = now - self._safe_until
        if began is None:
            self._witness = replace(before, unkept=self.unkept_rows)
        else:
            self._safe_until = began
            self._witness = CommitStatus(
                self._intake.number, round(time.time() - (now - began), 3), max(before.risk_s, round(waited, 3)), self.dropped_rows
            )
        if self._lock is not None:
            self._lock.write_status(self._witness)

    def _stored(self, closing: bool) -> bool:
        try:
            self._tell_failure()
            self._intake.take()
            if self._intake.backlog or self._intake.changed_facts or closing:
                return self._store(closing)
        except Exception as error:  # whatever it is, the recorder must hear of it and the thread go on
            self._fail(cause(error))
            return False
        return True

    def _store(self, closing: bool) -> bool:
        meta = self._meta(closing)
        self._facts.update(self._intake.changed_facts)
        fresh = meta | {(FACTS, station): text for station, text in self._intake.changed_facts.items()}
        everything = meta | {(FACTS, station): text for station, text in self._facts.items()}
        kept = self._keeping.add(self._intake.backlog, fresh, everything)
        if kept.safe:
            self._intake.stored()
        else:
            self._intake.drop_oldest()
        if kept.moved_to:
            self._tell("record.new_file", Severity.ERROR, f"{kept.trouble}; recording goes on in {kept.moved_to}.")
        elif kept.trouble:
            self._fail(kept.trouble)
        return kept.safe

    def _meta(self, closing: bool = False) -> dict[tuple[str, str], str]:
        meta = {"schema": SCHEMA_VERSION, "run": self.folder.name, "last": self._intake.number, "dropped": self.dropped_rows}
        closed = {(META, "closed"): "1"} if closing else {}
        return {(META, key): str(value) for key, value in meta.items()} | closed

    def _reap(self) -> None:
        """Look whether the sealing child has ended; what it could not seal is sealed later."""
        if self._child is not None and (problem := self._child.ended()) is not None:
            self._child = None
            if problem:
                self._not_sealed(problem)

    def _not_sealed(self, problem: str) -> None:
        self._tell("record.not_sealed", Severity.WARNING, f"The hourly sealing failed and will be done later: {problem}")

    # -- what went wrong -----------------------------------------------------------------------------------------------

    def _bad_row(self, table: str, error: Exception) -> None:
        self._fail(f"a row of {table} could not be recorded: {cause(error)}")

    def _fail(self, text: str) -> None:
        """Remember the first failure and tell who wants to know. It is remembered also where memory is refused to this, too."""
        if self.failure is None:
            try:
                self.failure = RecordError(f"{self.folder}: the record is not whole: {text}")
            except MemoryError:
                self.failure = self._no_memory
        self._tell_failure()

    def _tell_failure(self) -> None:
        """Tell of the failure, once; where that fails, at the next commit."""
        if self.failure is None or self._is_failure_told:
            return
        self._tell("record.failed", Severity.CRITICAL, str(self.failure))
        self._is_failure_told = True
        if self._on_failure is not None:
            with contextlib.suppress(Exception):  # who cannot listen any more must not stop the recording
                self._on_failure(self.failure)

    def _tell(self, kind: str, severity: Severity, text: str) -> None:
        self.event(EventRow(time.time_ns() // 1000, kind, severity, text))
