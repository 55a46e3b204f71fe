"""The tables of a report as rows of plain values, with the number of rows left out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from pathlib import Path

import pandas as pd

from jbclog.core.clock import utc_text
from jbclog.core.errors import RecordError
from jbclog.core.rows import Severity, severity_of
from jbclog.record.manifest import Ledger
from jbclog.record.schema import SCHEMAS
from jbclog.report.facts import Omitted
from jbclog.report.text import Row

MOST_EVENTS = 1000
MOST_SETTINGS = 12_000
MOST_COUNTERS = 50_000  # 512 stations of four ports have some 20 000
EVENT_COLUMNS = tuple(name for name in SCHEMAS["events"].names if name != "prev_sha256")
COUNTER_COLUMNS = ("station", "port", "counter", "value", "unit", "raw")
SETTING_COLUMNS = tuple(SCHEMAS["settings"].names)
GRAVITY = {severity: place for place, severity in enumerate(reversed(Severity))}


def plain_rows(table: pd.DataFrame, columns: Iterable[str]) -> list[Row]:
    """Return the rows of a table with Python values: ISO times, None for missing values."""
    rows = table[list(columns)].to_dict("records")
    return [{str(name): _plain(value) for name, value in row.items()} for row in rows]


def _plain(value: object) -> object:
    if isinstance(value, datetime):
        return None if pd.isna(value) else utc_text(value)
    return None if pd.isna(value) else value  # type: ignore[call-overload]  # one cell


def by_station(rows: Iterable[Row], stations: Sequence[str]) -> list[Row]:
    """Return the rows ordered by `stations` and ports; rows of a whole station come after those of
    its ports.
    """
    place = {name: number for number, name in enumerate(stations)}
    return sorted(
        rows,
        key=lambda row: (
            place.get(str(row["station"]), len(place)),
            str(row["station"]),
            _last_if_none(row["port"]),
        ),
    )


def _last_if_none(port: object) -> tuple[bool, int]:
    return (False, port) if isinstance(port, int) else (True, 0)


def event_rows(events: pd.DataFrame) -> tuple[list[Row], Omitted | None]:
    """Return the events in order; of more than `MOST_EVENTS` the most severe."""
    left = None
    if len(events) > MOST_EVENTS:
        gravity = events["severity"].map(severity_of).map(GRAVITY)
        kept = gravity.sort_values(kind="stable").index[:MOST_EVENTS]
        left = Omitted(
            len(events) - MOST_EVENTS, "further events, none graver than these, are in events/."
        )
        events = events.loc[kept.sort_values()]
    return plain_rows(events, EVENT_COLUMNS), left


def setting_rows(settings: pd.DataFrame) -> tuple[list[Row], Omitted | None]:
    """Return requested settings, and each reading that differs from the one before it; at most
    `MOST_SETTINGS`.
    """
    columns = ("station", "port", "tool", "setting", "outcome", "readback")
    kept: list[int] = []
    last: dict[tuple[object, ...], object] = {}
    for number, (*place, outcome, readback) in enumerate(_cells(settings, columns)):
        key = tuple(place)
        if outcome != "read" or key not in last or last[key] != readback:
            kept.append(number)
        last[key] = readback
    why = ", equal to the ones before," if len(kept) <= MOST_SETTINGS else ""
    shown = settings.iloc[kept[:MOST_SETTINGS]]
    left = len(settings) - len(shown)
    return plain_rows(shown, SETTING_COLUMNS), (
        Omitted(left, f"further readings{why} are in settings/.") if left else None
    )


def counter_rows(counters: pd.DataFrame, folder: Path) -> list[Row]:
    """Return first and last reading of each counter and their difference, which is unknown if a
    reading failed or the counter fell. Raises `RecordError` for too many counters.
    """
    found: dict[tuple[object, ...], list[int]] = {}
    for number, key in enumerate(_cells(counters, ("station", "port", "counter", "unit"))):
        found.setdefault(key, []).append(number)
    if len(found) > MOST_COUNTERS:
        raise RecordError(
            f"{folder}: its table of counters has {len(found)} counters; a report has at most"
            f" {MOST_COUNTERS}; `jbclog export {folder} --to csv` writes all"
        )
    ends = [number for rows in found.values() for number in (rows[0], rows[-1])]
    rows = plain_rows(counters.iloc[ends], COUNTER_COLUMNS)
    return [
        _counter(first, last, len(numbers))
        for first, last, numbers in zip(rows[::2], rows[1::2], found.values(), strict=True)
    ]


def _cells(table: pd.DataFrame, columns: Iterable[str]) -> Iterator[tuple[object, ...]]:
    """Yield these cells of each row, "" for a missing one."""
    return zip(*(table[name].astype(object).fillna("") for name in columns), strict=True)


def _counter(one: Row, other: Row, readings: int) -> Row:
    """Return the row of a counter from its first and its last reading."""
    first, last = one["value"], other["value"]
    difference, note = None, ""
    if not isinstance(first, float) or not isinstance(last, float):
        note = f"Not read: {(one if first is None else other)['raw']}."
    elif readings == 1:
        last, note = None, "Read once only."
    elif last < first:
        note = "Decreased: reset, rolled over, or another station."
    else:
        difference = last - first
    return {
        **{name: one[name] for name in ("station", "port", "counter", "unit")},
        "first": first,
        "last": last,
        "difference": difference,
        "readings": readings,
        "note": note,
    }


def ledger_rows(ledger: Ledger) -> tuple[list[Row], list[str]]:
    """Return a row for each signal of each port, and all reasons that occur, the most frequent
    first.
    """
    rows: list[Row] = []
    totals: dict[str, int] = {}
    for station, ports in ledger.items():
        for port, signals in ports.items():
            for signal, counts in signals.items():
                reasons = {
                    name: count
                    for name, count in counts.items()
                    if name not in ("due", "ok") and count
                }
                for name, count in reasons.items():
                    totals[name] = totals.get(name, 0) + count
                place = {
                    "station": station,
                    "port": int(port) if port.isdigit() else None,
                    "signal": signal,
                }
                rows.append(
                    {
                        **place,
                        "due": counts.get("due", 0),
                        "ok": counts.get("ok", 0),
                        "reasons": reasons,
                    }
                )
    return rows, sorted(totals, key=lambda name: (-totals[name], name))
