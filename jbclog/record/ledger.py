"""The accounting (`ledger` in the manifest): readings due, obtained and missing with their reasons,
by station, port and signal.

It is derived from the tables. A signal has the name of the first column that its answer fills; a
reading was due if that column has a value or `reasons` names it. Counters are signals of their own
names. The stations' facts add what leaves no rows: ticks of a stopped host (`skipped`), and
settings read repeatedly.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.rows import SIGNAL_COLUMNS, SIGNAL_OF_COLUMN, StationFacts
from jbclog.core.text import count_text
from jbclog.record.manifest import Ledger, SignalLedger
from jbclog.record.parts import row_groups

SIGNALS: Final = tuple(column for column in SIGNAL_COLUMNS if SIGNAL_OF_COLUMN[column] == column)
SAMPLE_COLUMNS: Final = ["station", "port", "reasons", *SIGNALS]
COUNTER_COLUMNS: Final = ["station", "port", "counter", "value", "raw"]
NO_PORT: Final = "station"

_ROWS = ""  # counts the rows of a port, beside its signals


def ledger_of(folder: Path, stations: Iterable[StationFacts] = ()) -> Ledger:
    """Compute the accounting of sealed tables. Raises pyarrow's errors if a part cannot be read,
    and `RecordError` as `row_groups` does.
    """
    samples = row_groups(folder, "samples", SAMPLE_COLUMNS)
    counters = row_groups(folder, "counters", COUNTER_COLUMNS)
    return ledger_in(samples, counters, stations)


def ledger_in(
    samples: Iterable[pa.Table], counters: Iterable[pa.Table], stations: Iterable[StationFacts]
) -> Ledger:
    """Compute the accounting of these rows, which have `SAMPLE_COLUMNS` and `COUNTER_COLUMNS`."""
    stations = list(stations)
    ledger: Ledger = {facts.name: {} for facts in stations}  # in their order
    for group in samples:
        _count_samples(ledger, group)
    for group in counters:
        _count_counters(ledger, group)
    for facts in stations:
        _add_facts(ledger, facts)
    return _tidy(ledger)


def reasons_of(text: str) -> Iterator[tuple[str, str]]:
    """Yield the columns and reasons in a row's `reasons`."""
    for item in text.split(";"):
        column, _, reason = item.partition("=")
        yield column, reason


def _count_samples(ledger: Ledger, rows: pa.Table) -> None:
    counted = rows.group_by(["station", "port"]).aggregate(
        [(signal, "count") for signal in SIGNALS] + [([], "count_all")]
    )
    for row in counted.to_pylist():
        port = _port(ledger, row["station"], row["port"])
        _add(port, _ROWS, "ok", row["count_all"])
        for signal in SIGNALS:
            _add(port, signal, "ok", row[f"{signal}_count"])
    failed = (
        rows.filter(pc.is_valid(rows["reasons"]))
        .group_by(["station", "port", "reasons"])
        .aggregate([([], "count_all")])
    )
    for row in failed.to_pylist():
        port = _port(ledger, row["station"], row["port"])
        for column, reason in reasons_of(row["reasons"]):
            if SIGNAL_OF_COLUMN.get(column) == column:
                _add(port, column, reason, row["count_all"])


def _count_counters(ledger: Ledger, rows: pa.Table) -> None:
    failed = pc.if_else(pc.is_null(rows["value"]), rows["raw"], None)
    counted = (
        rows.append_column("failed", failed)
        .group_by(["station", "port", "counter", "failed"])
        .aggregate([([], "count_all")])
    )
    for row in counted.to_pylist():
        reason = "ok" if row["failed"] is None else str(row["failed"]).strip("<>")
        _add(_port(ledger, row["station"], row["port"]), row["counter"], reason, row["count_all"])


def _add_facts(ledger: Ledger, facts: StationFacts) -> None:
    """Add ticks without rows to signals read at every tick, and watched settings (no column)."""
    for port in ledger.get(facts.name, {}).values():
        rows = port.get(_ROWS, {}).get("due", 0)
        for signal in SIGNALS:
            if facts.skipped and rows and port.get(signal, {}).get("due") == rows:
                _add(port, signal, "skipped", facts.skipped)
    for number, settings in facts.watched.items():
        for setting, counts in settings.items():
            for word, count in counts.items():
                if word != "due":
                    _add(
                        ledger.setdefault(facts.name, {}).setdefault(number, {}),
                        setting,
                        word,
                        count,
                    )


def _port(ledger: Ledger, station: object, port: object) -> dict[str, SignalLedger]:
    return ledger.setdefault(str(station), {}).setdefault(
        NO_PORT if port is None else str(port), {}
    )


def _add(port: dict[str, SignalLedger], signal: str, word: str, count: int) -> None:
    if count or word == "ok":
        one = port.setdefault(signal, {"due": 0, "ok": 0})
        one[word] = one.get(word, 0) + count
        one["due"] += count


def _tidy(ledger: Ledger) -> Ledger:
    """Remove signals that were never due; sort reasons by name."""
    return {
        station: {
            port: {
                signal: _in_order(counts)
                for signal, counts in signals.items()
                if signal != _ROWS and counts["due"]
            }
            for port, signals in sorted(ports.items())
        }
        for station, ports in ledger.items()
        if ports
    }


def _in_order(counts: SignalLedger) -> SignalLedger:
    reasons = {word: counts[word] for word in sorted(counts) if word not in ("due", "ok")}
    return {"due": counts["due"], "ok": counts["ok"], **reasons}


def disagreements(
    ledger: Mapping[str, Mapping[str, Mapping[str, SignalLedger]]], facts: StationFacts
) -> Iterator[str]:
    """Yield differences between the accounting and the session's own count of due readings.

    Counters are also read outside the sampling, so the accounting may have more of them, never
    fewer.
    """
    for port, signals in facts.due.items():
        for signal, counted in signals.items():
            found = ledger.get(facts.name, {}).get(port, {}).get(signal, {"due": 0})
            due = found["due"]
            if (
                signal in SIGNALS
                and facts.skipped
                and found.get("skipped", 0) >= facts.skipped
                and due - facts.skipped == counted
            ):
                continue
            if due < counted or (due > counted and signal in SIGNALS):
                yield (
                    f"{facts.name} port {port}: {signal}: {count_text(due, 'reading')} in the"
                    f" record, {counted} were due"
                )
