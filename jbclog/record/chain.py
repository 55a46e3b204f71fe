"""Events are a chain: each row holds the SHA-256 of the row before it, the first one that of the run's name.

A row that was changed, taken out or put in later breaks the chain at its place. The chain cannot show that its end is
missing; the manifest's hash of the file does.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Final

from jbclog.core.rows import EventRow
from jbclog.record.schema import SCHEMAS

COLUMNS: Final = tuple(SCHEMAS["events"].names)


def first_link(run: str) -> str:
    """What stands as `prev_sha256` in the first event of the run called `run`."""
    return hashlib.sha256(run.encode()).hexdigest()


def digest(row: Mapping[str, object]) -> str:
    """SHA-256 of an event as canonical JSON: all columns by name, times in µs, keys sorted, no blanks."""
    return hashlib.sha256(json.dumps(row, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


class Chain:
    """Numbers and links the events of one run, in the order in which they come."""

    def __init__(self, run: str) -> None:
        self._seq = 0
        self._previous = first_link(run)

    @classmethod
    def after(cls, row: Mapping[str, object]) -> Chain:
        """The chain that goes on behind `row`, the last that is there (times in µs)."""
        chain = cls("")
        seq = row["seq"]
        assert isinstance(seq, int)
        chain._seq, chain._previous = seq, digest(row)
        return chain

    def link(self, event: EventRow, rows: list[object]) -> None:
        """Put the row of `event`, in the columns' order, behind `rows`: it is a link then, and not before.

        Raises ValueError or TypeError for what is no event.
        """
        row = {
            "seq": self._seq + 1,
            "time": int(event.time),
            "earliest": _whole(event.earliest),
            "station": event.station,
            "port": _whole(event.port),
            "kind": event.kind,
            "severity": str(event.severity),
            "code": _whole(event.code),
            "text": event.text,
            "value": None if event.value is None else float(event.value),
            "limit": None if event.limit is None else float(event.limit),
            "raw": event.raw,
            "prev_sha256": self._previous,
        }
        previous, seq = digest(row), self._seq + 1
        rows.extend([row[column] for column in COLUMNS])
        self._seq, self._previous = seq, previous


def breaks(run: str, rows: Iterable[Mapping[str, object]]) -> Iterable[tuple[int, str]]:
    """The places at which the chain of `rows` (times in µs) does not hold: the event's seq and what is wrong."""
    previous, seq = first_link(run), 0
    for row in rows:
        found = row["seq"]
        number = found if isinstance(found, int) else -1
        if number != seq + 1:
            yield number, f"follows event {seq}; {number - seq - 1} are missing" if number > seq else f"stands after event {seq}"
        elif row["prev_sha256"] != previous:
            yield number, "does not carry the hash of the event before it: one of the two was changed"
        previous, seq = digest(row), number


def _whole(value: int | None) -> int | None:
    return None if value is None else int(value)
