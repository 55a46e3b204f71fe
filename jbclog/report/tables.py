"""The tables of a report as rows of plain values, with the number of rows left out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import datetime

import pandas as pd

from jbclog.core.clock import utc_text
from jbclog.record.manifest import Ledger
from jbclog.record.schema import SCHEMAS
from jbclog.report.facts import Omitted
from jbclog.report.text import Row

MOST_EVENTS = 1000
EVENT_COLUMNS = tuple(name for name in SCHEMAS["events"].names if name != "prev_sha256")
SETTING_COLUMNS = tuple(SCHEMAS["settings"].names)
SEVERITIES = ("critical", "error", "warning", "info")


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
        gravity = events["severity"].map(SEVERITIES.index)
        kept = gravity.sort_values(kind="stable").index[:MOST_EVENTS]
        left = Omitted(
            len(events) - MOST_EVENTS, "further events, none graver than these, are in events/."
        )
        events = events.loc[kept.sort_values()]
    return plain_rows(events, EVENT_COLUMNS), left


def setting_rows(settings: pd.DataFrame) -> tuple[list[Row], Omitted | None]:
    """Return requested settings, and each reading that differs from the one before it."""
    rows, kept = plain_rows(settings, SETTING_COLUMNS), []
    last: dict[tuple[object, ...], object] = {}
    for row in rows:
        key = (row["station"], row["port"], row["tool"], row["setting"])
        if row["outcome"] != "read" or key not in last or last[key] != row["readback"]:
            kept.append(row)
        last[key] = row["readback"]
    left = len(rows) - len(kept)
    return kept, (
        Omitted(left, "further readings, equal to the ones before, are in settings/.")
        if left
        else None
    )


def counter_rows(counters: pd.DataFrame) -> list[Row]:
    """Return first and last reading of each counter and their difference, which is unknown if a
    reading failed or the counter fell.
    """
    found: dict[tuple[object, ...], list[Row]] = {}
    for row in plain_rows(counters, ["station", "port", "counter", "value", "unit", "raw"]):
        found.setdefault((row["station"], row["port"], row["counter"], row["unit"]), []).append(row)
    return [_counter(key, rows) for key, rows in found.items()]


def _counter(key: tuple[object, ...], rows: list[Row]) -> Row:
    station, port, counter, unit = key
    first, last = rows[0]["value"], rows[-1]["value"]
    difference, note = None, ""
    if not isinstance(first, float) or not isinstance(last, float):
        note = f"Not read: {rows[0]['raw'] if first is None else rows[-1]['raw']}."
    elif len(rows) == 1:
        last, note = None, "Read once only."
    elif last < first:
        note = "Decreased: reset, rolled over, or another station."
    else:
        difference = last - first
    place = {"station": station, "port": port, "counter": counter, "unit": unit}
    return {
        **place,
        "first": first,
        "last": last,
        "difference": difference,
        "readings": len(rows),
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
