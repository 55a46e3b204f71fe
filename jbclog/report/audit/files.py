"""An audit as CSV, with a row for each value known or not known, and as one JSON object.

Each CSV row names its audit, line and station. `kind` is its subject: a `station` (its state is
that of its worst task), a `counter` (`value` as read, `low` and `high` the work since `since`,
`state` the kind of the last difference), a `task` (`value` its service interval, `low` and `high`
the used per cent), a `use` figure, an `error` as read now, a `parameter` that drifted, a `note`.
Times are UTC in ISO 8601. `high` is empty without an upper bound, and unknown values are empty;
JSON has null there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import msgspec

from jbclog.core.text import csv_text
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.due import TaskState
from jbclog.maintenance.fleet import FleetAudit, Meter, StationAudit, findings
from jbclog.report.text import Row

SCHEMA: Final = 1
COLUMNS: Final = (
    *(
        "schema",
        "audit",
        "line",
        "station",
        "url",
        "family",
        "model",
        "software",
        "seen",
        "source",
        "last_seen",
    ),
    *("kind", "port", "name", "uom", "value", "low", "high", "standing", "state", "since"),
    *("due_p10", "due_p50", "due_p90", "part", "text"),
)


def sheet_of(audit: FleetAudit) -> str:
    """Return the audit as CSV."""
    return csv_text(COLUMNS, (row for station in audit.stations for row in _rows(audit, station)))


def _rows(audit: FleetAudit, station: StationAudit) -> Iterator[Row]:
    head = _head(audit, station)
    for row in _of_station(station):
        yield head | row


def _head(audit: FleetAudit, station: StationAudit) -> Row:
    who = station.identity
    return {
        "schema": SCHEMA,
        "audit": audit.audit,
        "line": station.line,
        "station": station.station,
        "url": station.url,
        "family": who and who.family,
        "model": who and who.model,
        "software": who and who.software,
        "seen": _yes(station.seen),
        "source": station.source,
        "last_seen": station.last_seen,
    }


def _of_station(station: StationAudit) -> Iterator[Row]:
    yield {
        "kind": "station",
        "value": station.audits,
        "state": station.state.value,
        "text": station.why,
    }
    yield from map(_counter, station.meters)
    yield from map(_task, station.tasks)
    for figure in station.use:
        row: Row = {
            "kind": "use",
            "port": figure.port,
            "name": figure.name,
            "uom": figure.uom,
            "value": figure.value,
        }
        yield row | _range(figure.range) | {"text": figure.why or figure.title}
    yield from _errors(station)
    for drift in station.drifts:
        yield {
            "kind": "parameter",
            "name": drift.name,
            "value": drift.value,
            "state": drift.than,
            "text": drift.text,
        }
    for note in (*([station.question] if station.question else []), *station.notes):
        yield {"kind": "note", "text": note}


def _counter(meter: Meter) -> Row:
    total = meter.counter_total
    row: Row = {
        "kind": "counter",
        "port": meter.port,
        "name": meter.counter,
        "uom": meter.uom,
        "since": total.since,
    }
    row |= _range(total.total)
    if meter.read is not None:
        row |= {
            "value": meter.read.value,
            "standing": meter.read.standing.value,
            "text": meter.read.why,
        }
    if meter.last is not None:
        row |= {"state": meter.last.kind.value}
        row["text"] = row.get("text") or meter.last.text
    return row


def _task(task: TaskState) -> Row:
    row: Row = {
        "kind": "task",
        "port": task.port,
        "name": task.task,
        "uom": task.uom,
        "value": task.life,
    }
    row |= _range(task.percent) | {
        "state": task.state.value,
        "since": task.since,
        "part": task.part,
        "text": task.why or task.told_by or task.title,
    }
    due = task.due
    return row | (
        {} if due is None else {"due_p10": due.p10, "due_p50": due.p50, "due_p90": due.p90}
    )


def _errors(station: StationAudit) -> Iterator[Row]:
    if station.errors is None:
        return
    yield {"kind": "error", "name": "station", "text": station.errors.station}
    for port, text in station.errors.ports.items():
        yield {"kind": "error", "name": "port", "port": port, "text": text}
    for kind, count in (station.errors.events or {}).items():
        yield {"kind": "error", "name": kind, "uom": "events", "value": count}


def _range(found: Interval | None) -> Row:
    return (
        {}
        if found is None
        else {"low": found.low, "high": found.high if math.isfinite(found.high) else None}
    )


def _yes(is_so: bool) -> str:
    return "yes" if is_so else "no"


Plain = dict[str, object]


def plain_audit(audit: FleetAudit) -> Plain:
    """Return the whole audit, with each station's state and findings."""
    return plain(audit) | {"stations": [_station(one) for one in audit.stations]}


def _station(station: StationAudit) -> Plain:
    found = sorted(one.value for one in findings(station))
    return {"state": station.state.value, "findings": found} | plain(station)


def plain(model: object) -> Plain:
    """Return the fields of a model as JSON has them."""
    return msgspec.json.decode(msgspec.json.encode(model), type=Plain)
