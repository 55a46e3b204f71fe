"""The tables of a report as rows of plain values, with the number of rows left out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.clock import utc_text
from jbclog.core.errors import RecordError
from jbclog.core.rows import Severity, severity_of
from jbclog.record.manifest import Ledger
from jbclog.record.schema import RUN, SCHEMAS, SEQ
from jbclog.report.facts import Omitted
from jbclog.report.text import Row

MOST_EVENTS = 1000
MOST_SETTINGS = 12_000
MOST_COUNTERS = 50_000  # 512 stations of four ports have some 20 000
EVENT_COLUMNS = tuple(name for name in SCHEMAS["events"].names if name not in (RUN, "prev_sha256"))
OF_COUNTER = ("station", "port", "counter", "uom")
COUNTER_COLUMNS = (*OF_COUNTER, "value", "raw")
ALSO_NULL = pc.ScalarAggregateOptions(skip_nulls=False)
ENDS = [(name, end, ALSO_NULL) for name in ("value", "raw") for end in ("first", "last")]
SETTING_COLUMNS = tuple(name for name in SCHEMAS["settings"].names if name not in (RUN, SEQ))
# a setting that is not as the recipe has it comes before these, also one that is not known here
OF_NO_WEIGHT = {"confirmed": 1, "unchanged": 1, "read": 2}
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
    """Return requested settings, and each reading that differs from the one before it; of more than
    `MOST_SETTINGS` those that the verdict goes by.
    """
    columns = ("station", "port", "tool_name", "setting", "outcome", "readback")
    kept: list[int] = []
    last: dict[tuple[object, ...], object] = {}
    for number, (*place, outcome, readback) in enumerate(_cells(settings, columns)):
        key = tuple(place)
        if outcome != "read" or key not in last or last[key] != readback:
            kept.append(number)
        last[key] = readback
    why = (
        ", equal to the ones before," if len(kept) <= MOST_SETTINGS else ", none graver than these,"
    )
    if len(kept) > MOST_SETTINGS:
        weight = settings["outcome"].iloc[kept].map(OF_NO_WEIGHT).fillna(0).to_numpy()
        kept = sorted(np.array(kept)[np.argsort(weight, kind="stable")[:MOST_SETTINGS]].tolist())
    shown = settings.iloc[kept]
    left = len(settings) - len(shown)
    return plain_rows(shown, SETTING_COLUMNS), (
        Omitted(left, f"further readings{why} are in settings/.") if left else None
    )


def counter_rows(groups: Iterable[pa.Table], folder: Path) -> list[Row]:
    """Return first and last reading of each counter and their difference, which is unknown if a
    reading failed or the counter fell. Raises `RecordError` for too many counters.

    `groups`: the table's row groups. It has a row for each counter and minute, for a week of 32
    ports some two million.
    """
    found: dict[tuple[object, ...], _Ends] = {}
    for group in groups:
        by_counter = group.group_by([*OF_COUNTER], use_threads=False)  # in order
        seen = by_counter.aggregate([([], "count_all"), *ENDS])
        for row in seen.to_pylist() if len(seen) <= MOST_COUNTERS else ():
            key = tuple(row[name] for name in OF_COUNTER)
            ends = found.setdefault(key, _Ends(row["value_first"], row["raw_first"]))
            ends.last, ends.last_raw = row["value_last"], row["raw_last"]
            ends.readings += row["count_all"]
        if max(len(seen), len(found)) > MOST_COUNTERS:
            raise RecordError(
                f"{folder}: its table of counters has more than {MOST_COUNTERS} counters; a report"
                f" has at most so many; `jbclog export {folder} --to csv` writes all"
            )
    return [
        {**dict(zip(OF_COUNTER, key, strict=True)), **ends.as_row()} for key, ends in found.items()
    ]


@dataclass(slots=True)
class _Ends:
    """First and last reading of a counter."""

    first: float | None
    first_raw: str
    last: float | None = None
    last_raw: str = ""
    readings: int = 0

    def as_row(self) -> Row:
        last, difference, note = self.last, None, ""
        if self.first is None or last is None:
            note = f"Not read: {self.first_raw if self.first is None else self.last_raw}."
        elif self.readings == 1:
            last, note = None, "Read once only."
        elif last < self.first:
            note = "Decreased: reset, rolled over, or another station."
        else:
            difference = last - self.first
        return {
            "first": self.first,
            "last": last,
            "difference": difference,
            "readings": self.readings,
            "note": note,
        }


def _cells(table: pd.DataFrame, columns: Iterable[str]) -> Iterator[tuple[object, ...]]:
    """Yield these cells of each row, "" for a missing one."""
    return zip(*(table[name].astype(object).fillna("") for name in columns), strict=True)


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
