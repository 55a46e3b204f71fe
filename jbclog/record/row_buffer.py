"""Where rows are handed over, and how they become batches: from many threads in, to one writer out."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Final

from jbclog.core.rows import CounterRow, EventRow, SampleRow, SettingRow, StationFacts
from jbclog.record.batches import BARE, Batch, NotRows, encode
from jbclog.record.chain import Chain
from jbclog.record.schema import TABLES

HELD_BYTES: Final = 32 << 20  # a quarter of an hour of 64 stations

OnBadRow = Callable[[str, Exception], None]
"""Is told the table and the reason when a row cannot be recorded."""


class RowBuffer:
    """Takes rows at once; `take` turns what came since into batches, which stay in `backlog` until they are stored.

    `on_bad_row` is called by `take`, in its thread. Rows that are no rows, and the oldest samples that `HELD_BYTES` has
    no room for, are counted in `dropped_rows`.
    """

    def __init__(self, run: str, on_bad_row: OnBadRow) -> None:
        self.backlog: list[Batch] = []
        self.number = 0  # of the last batch
        self.dropped_rows = 0
        self._on_bad_row = on_bad_row
        self._chain = Chain(run)
        self._handing = threading.Lock()  # held for an append or a swap, never longer
        self._values = _no_values()
        self._events: list[EventRow] = []
        self._facts: dict[str, dict[str, object]] = {}

    # -- any thread --------------------------------------------------------------------------------------------------

    def sample(self, row: SampleRow) -> None:
        with self._handing:
            self._values["samples"].extend(row)

    def event(self, event: EventRow) -> None:
        with self._handing:
            self._events.append(event)

    def setting(self, setting: SettingRow) -> None:
        with self._handing:
            self._values["settings"].extend(setting)

    def counter(self, counter: CounterRow) -> None:
        with self._handing:
            self._values["counters"].extend(counter)

    def facts(self, facts: StationFacts) -> None:
        copy = asdict(facts)  # its owner goes on changing it
        with self._handing:
            self._facts[facts.name] = copy

    # -- the writer ----------------------------------------------------------------------------------------------------

    def take(self) -> dict[str, str]:
        """Put what was handed over into the backlog; give the facts that changed, as JSON by station.

        Where something is raised that is no row's fault, all that is not in the backlog by then waits for the next time.
        """
        with self._handing:
            values, self._values = self._values, _no_values()
            events, self._events = self._events, []
            facts, self._facts = self._facts, {}
        try:
            while events:
                self._link(events[0], values["events"])
                del events[0]
            for table in TABLES:
                if values[table]:
                    self._encode(table, values[table])
                    values[table] = []
            return {station: json.dumps(fact) for station, fact in facts.items()}
        except BaseException:
            with self._handing:
                for table in TABLES:
                    self._values[table][:0] = values[table]
                self._events[:0] = events
                self._facts = facts | self._facts
            raise

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

    def _link(self, event: EventRow, values: list[object]) -> None:
        try:
            values.extend(self._chain.link(event))
        except (TypeError, ValueError) as error:
            self._bad_row("events", error)

    def _encode(self, table: str, values: Sequence[object]) -> None:
        try:
            self.backlog.append(encode(self.number + 1, table, values))
            self.number += 1
        except NotRows as error:
            width = len(BARE[table])
            half = len(values) // width // 2 * width
            if not half:
                self._bad_row(table, error)
                return
            self._encode(table, values[:half])  # one wrong row must not take the others with it
            self._encode(table, values[half:])

    def _bad_row(self, table: str, error: Exception) -> None:
        self.dropped_rows += 1
        self._on_bad_row(table, error)


def _no_values() -> dict[str, list[object]]:
    return {table: [] for table in TABLES}
