"""docs/reference/audit-files.md: the audit's ledger and CSV, tip verifications, annotations, from
the types that write them.
"""

from __future__ import annotations

from collections.abc import Mapping

from jbclog.maintenance.counter_totals.observed import Errors, Fact, Identity, Observation
from jbclog.maintenance.verification import Verification
from jbclog.record.annotations import Annotation
from jbclog.report.audit.files import COLUMNS
from support.pages.manifest import keys_of, rows_of
from support.pages.md_table import MADE, code, table

OBJECTS: Mapping[str, type] = {
    "Observation": Observation,
    "Identity": Identity,
    "Errors": Errors,
    "Fact": Fact,
    "Verification": Verification,
    "Annotation": Annotation,
}
"""Heading -> what writes it."""

TEXTS: Mapping[str, str] = {
    "Observation": (
        "A line of the audit's ledger (`jbclog audit --ledger FILE`): one look at one station."
        " `counts` maps port to counter to value; what was moving or could not be read stands"
        " beside it. A station that did not answer is an observation too: `seen` is false."
    ),
    "Identity": "`identity` of an observation.",
    "Errors": "`errors` of an observation.",
    "Fact": "A line of the ledger: what `jbclog maintenance done` added.",
    "Verification": (
        "A line of `verifications.jsonl` in the folder of runs: what `jbclog verify` added."
        " Temperatures in °C."
    ),
    "Annotation": "A line of `annotations.jsonl` in a run's folder.",
}

INTRODUCTION = """
Ledger, verifications and annotations are JSON lines that are only ever added to. Each line carries the SHA-256 of the line before
it (`prev_sha256`; the first annotation that of the manifest) and its own (`sha256`), so a line that was changed, moved or removed
from between shows. Missing *last* lines do not show: note the newest hash where that matters. Times are ISO 8601 in UTC.
"""

MEANINGS: Mapping[str, str] = {
    "Observation.time": "when its counters were read",
    "Observation.audit": "when the audit began",
    "Observation.line": "production line",
    "Observation.station": "station",
    "Observation.url": "port",
    "Observation.seen": "whether the station answered",
    "Observation.why": "why not",
    "Observation.source": "`wire`, or `run:FOLDER` where a run held the station",
    "Observation.identity": "who it says it is",
    "Observation.counts": "counters by port; hours, mm or counts, by their names",
    "Observation.tool_names": "tools by port",
    "Observation.parameters": "settings by name; of one port as `2.sleep_delay_min`",
    "Observation.errors": "errors",
    "Observation.seq": "number of the line",
    "Observation.prev_sha256": "hash of the line before",
    "Observation.kind": "`observation`",
    "Identity.family": "family",
    "Identity.model": "model name",
    "Identity.software": "software version",
    "Identity.uid": "identity from the line file or from people; no manual prints a serial number",
    "Errors.station": "the station's error; null: not read",
    "Errors.ports": "errors by port",
    "Errors.events": "events in runs since the last audit, by kind; null where no record tells",
    "Errors.until": "up to when they were counted",
    "Fact.time": "when it was done",
    "Fact.told": "when it was entered",
    "Fact.by": "who",
    "Fact.line": "production line",
    "Fact.station": "station",
    "Fact.task": "task of the tasks file, or `counters-reset`, `counters-rolled-over`, `station-replaced`",
    "Fact.port": "port; null: all of them",
    "Fact.part": "number of the new tip or part",
    "Fact.text": "note",
    "Fact.seq": "number of the line",
    "Fact.prev_sha256": "hash of the line before",
    "Fact.kind": "`fact`",
    "Verification.seq": "number of the line",
    "Verification.time": "when",
    "Verification.station": "station",
    "Verification.port": "port",
    "Verification.tip": "tip",
    "Verification.tool_name": "tool",
    "Verification.model": "model name of the station",
    "Verification.reading_c": "reading of the thermometer",
    "Verification.station_c": "mean of the station's own readings",
    "Verification.station_n": "how many",
    "Verification.station_sd_c": "their standard deviation",
    "Verification.setpoint_c": "setpoint",
    "Verification.adjust_c": "adjustment in force",
    "Verification.offset_c": "thermometer minus station",
    "Verification.uncertainty_c": "expanded uncertainty of the offset (k = 2)",
    "Verification.limit_c": "limit of offset and of the deviation from the setpoint",
    "Verification.instrument": "thermometer",
    "Verification.instrument_u_c": "its expanded uncertainty (k = 2), where stated",
    "Verification.due": "day on which its calibration is due",
    "Verification.result": (
        "`pass`, `fail`, or `invalid` where the thermometer was past its due date"
    ),
    "Verification.text": "a sentence",
    "Verification.proposed_adjust_c": "adjustment that is proposed; null: none",
    "Verification.by": "who",
    "Verification.note": "note",
    "Verification.prev_sha256": "hash of the line before",
    "Annotation.seq": "number of the line",
    "Annotation.time": "when",
    "Annotation.kind": "kind, as of [events](events.md)",
    "Annotation.who": "who",
    "Annotation.what": "what",
    "Annotation.why": "why",
    "Annotation.prev_sha256": "hash of the line before; of the first the manifest's",
}

CSV: Mapping[str, str] = {
    "schema": "version of this table",
    "audit": "when the audit began",
    "line": "production line",
    "station": "station",
    "url": "port",
    "family": "family",
    "model": "model name",
    "software": "software version",
    "seen": "`yes` or `no`",
    "source": "as in the ledger",
    "last_seen": "when it answered last",
    "kind": (
        "`station`, `counter`, `task`, `use`, `error`, `parameter` or `note`: what the row is about"
    ),
    "port": "port",
    "name": "name of the counter, task, figure, error or parameter",
    "uom": "unit of `value`",
    "value": "counter as read; service interval of a task; figure",
    "low": "counter: use since `since`, at least; task: per cent of its interval, at least",
    "high": "the same, at most; empty where there is no upper end",
    "standing": "`ok`, `moving` or `unread`",
    "state": "state of the station or task; of a counter how its last difference is classified",
    "since": "from when it is counted",
    "due_p10": "due date, early (P10)",
    "due_p50": "due date, median",
    "due_p90": "due date, late (P90)",
    "part": "tip or part",
    "text": "a sentence",
}


def page() -> str:
    """The whole page."""
    sections = [
        f"## {name}\n\n{TEXTS[name]}\n\n{table(('key', 'meaning', 'type'), rows_of(name, one, MEANINGS))}"
        for name, one in OBJECTS.items()
    ]
    columns = table(("column", "meaning"), [(code(name), CSV[name]) for name in COLUMNS])
    sections.append(f"## CSV of an audit\n\n`jbclog audit --csv FILE`.\n\n{columns}")
    return (
        f"{MADE}\n\n# Ledger, verifications, annotations\n{INTRODUCTION}\n"
        + "\n\n".join(sections)
        + "\n"
    )


def keys() -> set[str]:
    """Every key, behind its heading."""
    return keys_of(OBJECTS)
