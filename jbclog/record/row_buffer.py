"""Where rows are handed over, and how they become batches: from many threads in, to one writer out."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Final

from jbclog.core.rows import CounterRow, EventRow, SampleRow, SettingRow, StationFacts
from jbclog.record.batches import BARE, Batch, NotRows, encode
from jbclog.record.chain import Chain
from jbclog.record.schema import TABLES

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
