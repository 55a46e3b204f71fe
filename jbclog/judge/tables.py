"""The events and settings of a sealed run, as far as a verdict looks at them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq


@dataclass(frozen=True, slots=True)
class Event:
    """What a verdict needs of a row of `events`."""

    kind: str
    severity: str
    station: str | None
    port: int | None
    text: str


def read_events(folder: Path) -> list[Event]:
    """All events of the run, in their order."""
    return [
        Event(str(row["kind"]), str(row["severity"]), _word(row["station"]), _number(row["port"]), str(row["text"]))
        for row in _rows(folder / "events", ["kind", "severity", "station", "port", "text"])
    ]


def read_outcomes(folder: Path) -> dict[str, Counter[str]]:
    """How often each outcome stands in `settings`, by station; what was only read is left out."""
    outcomes: dict[str, Counter[str]] = {}
    for row in _rows(folder / "settings", ["station", "outcome"]):
        if row["outcome"] != "read":
            outcomes.setdefault(str(row["station"]), Counter())[str(row["outcome"])] += 1
    return outcomes


def _rows(table: Path, columns: list[str]) -> Iterator[dict[str, object]]:
    for part in sorted(table.glob("part-*.parquet")):
        yield from pq.read_table(part, columns=columns, partitioning=None).to_pylist()


def _word(value: object) -> str | None:
    return None if value is None else str(value)


def _number(value: object) -> int | None:
    return value if isinstance(value, int) else None
