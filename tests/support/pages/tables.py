"""docs/reference/tables.md: the columns of a run's tables and of those derived from them, from
their schemas.
"""

from __future__ import annotations

from collections.abc import Mapping

import pyarrow as pa

from jbclog.analysis.derived_schemas import DERIVED_SCHEMAS
from jbclog.core.rows import QUALITIES, SIGNAL_OF_COLUMN, SettingOutcome
from jbclog.record.schema import SCHEMAS
from support.pages.md_table import MADE, code, codes, table

INTRODUCTION = """
Parquet files of a [run's folder](run-folder.md). `pandas.read_parquet("RUN/samples")` reads the whole table, as `run.samples()` does:
whole numbers and flags that can be missing are Int64 and boolean, texts are strings. `runs/*/samples/*.parquet` in DuckDB and Polars has
the rows of all runs. Do not use `**`: it would mix the tables. [Query runs in SQL](../how-to/sql.md) has a view of each table.

Each table begins with `run`, the name of the run's folder in every row. In each recorded table (samples, events, settings, counters) `seq`
follows: it numbers the rows from 0, in the order in which they were recorded, and gives their order; `tick` orders the samples of a port. A
number that is missing is that of a row that was lost, which the manifest counts (`lost`). [Derived tables](#derived-tables) have no `seq`.
Names of columns need no quotes in SQL.

Samples are stored sorted by station, port and tick in each part, and read in that order; `ORDER BY seq` has them as they were recorded. The
other tables are in the order of `seq`.

Times are UTC with zone, in microseconds. Units are in the names and in the fields' metadata (`uom`, `command`). Whole numbers are
int64. **Null means not read.** Nothing is carried forward or replaced by zero.

Times are by the run's own clock: the host's clock at the start, plus the time elapsed since (suspension included). A step of the
host's clock moves none of them; it is the event `clock.step` and stands in the [manifest](manifest.md), `clock_steps`. From each step on,
host's time = run's time + `offset_s`; `run.samples(clock="wall")` gives these times, `run.host_time` and `run.run_time` convert a moment.
A step out of the time before 2020, or a first one of more than a day, corrects a clock that was wrong from the start: it applies to the
whole run there, and `runs`, `report` and `check` say so. Times that others of this host wrote are converted: those of the guard's events,
and `acknowledged_at` of alarms. Lines of `annotations.jsonl` keep the host's time. Times of runs of earlier versions follow the steps of
their hosts (`clock_steps` null).

Runs of schema 1 (0.1.0 and checkouts before 1.0; `schema` in the manifest) are read with the names of this page, also in `reasons`:
`set_c` is `setpoint_c`, `limit` is `limit_value`, `unit` is `uom`, the `tool` of settings is `tool_name`. Their `seq` is null, except that
of events, which begins at 1.
"""

OF_DERIVED = """
## Derived tables

The tables below are computed from the record. Each is a file `derived/NAME.parquet` of the run's folder, written some seconds after the
run's end by a process of the lowest priority, and anew by `jbclog report`. A process that was killed, a run that `recover` finished, and
one without a sample leave none: `jbclog report` writes them. They are no part of the sealed record, and you may delete them.

A file's metadata name what it was made from: the manifest (`jbclog.manifest_sha256`), the last annotation that names no report
(`jbclog.annotations_head`), the versions of rules and methods (`jbclog.methods`) and a checksum of its rows. jbclog reads a file only if
these are the run's and its own; else it computes the same from the samples. Other programs read what is there: after a late serial or an
acknowledgement, `jbclog report` brings it up to date.

A table has the same columns and types in every run, also without a row, so `'runs/*/derived/joints.parquet'` is one table of all runs in
DuckDB and Polars; plain pandas gives whole numbers and flags that can be missing. Units are in the names of columns (`_s`, `_c`, `_j`).
They have no `seq`: order their rows by `start`, the joints of a port by `joint`.
"""


def _of_shared() -> str:
    """Which columns of the samples one signal fills."""
    shared: dict[str, list[str]] = {}
    for column, signal in SIGNAL_OF_COLUMN.items():
        if column != signal:
            shared.setdefault(signal, []).append(code(column))
    texts = [
        f"{code(signal)} also fills {', '.join(columns)}" for signal, columns in shared.items()
    ]
    return (
        f"One answer is one signal, named after the first column that it fills: {'; '.join(texts)}."
    )


TEXTS: Mapping[str, str] = {
    "samples": (
        "One row for each tick, station and port. A disconnected station has rows (null,"
        " `disconnected`). A host that is suspended or stalls has no rows, but one event"
        " `host.suspended` and a count `skipped` in the accounting."
    ),
    "events": (
        "The event log, oldest first. Each row has the hash of the row before: the SHA-256 of its"
        " columns without `run` as JSON, with the keys sorted, no blanks, all but ASCII escaped"
        " (`\\u00b0`), times in whole µs since 1970, and a decimal point in `value` and `limit_value`."
        " The first row has that of the run's name."
        " [Events](events.md) lists the kinds."
    ),
    "settings": (
        "One row for each setting written or read. Values are text in the setting's unit. A"
        " mismatch, a refusal or an unconfirmed write stops the station; `unsupported` does not."
        " There is no rollback."
    ),
    "counters": "One row for each reading of a counter.",
    "wire": (
        "Only of a run with `--capture`. One row for what passed over the link of a station, and for"
        " each result that its session received. `run.wire(STATION)` has those of the link."
    ),
    "joints": "One row for each joint. `run.joints()`.",
    "alarms": (
        "One row for each episode of each detector; the rows of one alarm have the same `incident`."
        " `run.alarms()`."
    ),
    "units": (
        "One row for each stay of a unit on the bench; then, without times, units that were only"
        " named. A single named unit, with no serial read, spans the whole run. `run.units()`."
    ),
    "tips": (
        "One row for each port whose cartridge was named (`--tip`). The port's name goes before its"
        " station's, that before the run's; two names for one place are none."
    ),
    "metrics": "One row for each metric of each port. `run.metrics()`.",
    "accounting": (
        "One row for each signal: the accounting of the manifest (`ledger`), a column for each"
        f" reason. {_of_shared()} `reasons` of the samples names each column, and so counts more."
    ),
    "gaps": (
        "One row for each gap: from the last reading of a signal to its next one, where readings"
        " that were due are missing. Signals are named as in the [accounting](#accounting)."
        " `run.gaps()`."
    ),
}

MEANINGS: Mapping[str, str] = {
    **{f"{table}.run": "name of the run's folder" for table in SCHEMAS},
    **{
        f"{table}.seq": "number of the row, from 0; null in runs of schema 1"
        for table in ("samples", "settings", "counters")
    },
    "samples.time": (
        "last byte of this row's temperature answer; without an answer, when it was due, but not"
        " before the port's row before it: never steps back in the order of `tick`"
    ),
    "samples.tick": (
        "number on the run's grid: due = manifest `t0_mono` + tick × period. With `--rate max` it"
        " counts scans"
    ),
    "samples.station": "station",
    "samples.port": "port",
    "samples.late_us": "first question sent minus due; null with `--rate max`",
    "samples.scan_us": "last answer minus first question of this port",
    "samples.quality": "the most severe problem of this row, see below",
    "samples.reasons": (
        "each due value that is null, with its reason: `power_permille=timeout;alarm_high=nak3`. A"
        " null without a reason was not due"
    ),
    "samples.temperature_c": (
        "temperature of the tip; on hot air of the air; of tweezers one number, probably the mean"
        " of two tips: a hot and a cold tip can hide in it"
    ),
    "samples.power_permille": "power, share of the rated power",
    "samples.status": "`working` `stand` `sleep` `hibernation`; on hot air `on` `off`",
    "samples.cooling": "extractor state; on hot air cooling",
    "samples.desoldering": "desoldering; on hot air suction",
    "samples.motor": "feeder's motor: `off` `forward` `backward`",
    "samples.setpoint_c": "setpoint as read; not the sleep temperature in force",
    "samples.tool": "number of the tool",
    "samples.port_error": "number of the port's error, 0: none",
    "samples.station_error": "number of the station's error, 0: none",
    "samples.alarm_high": "the station's flag; reading it clears it",
    "samples.alarm_low": "the station's flag; reading it clears it",
    "samples.transformer_c": "transformer",
    "samples.transistor_c": "transistor",
    "samples.delay_s": "time until sleep or hibernation, while counting down",
    "samples.external_c": "external thermocouple of hot air",
    "samples.set_flow_permille": "selected air flow, share of R-MAF",
    "samples.feeding": "the feeder dispenses",
    "samples.solder_shortage": "`omega`: no solder left",
    "samples.clogged": "`omega`: solder clogged",
    "samples.preparing": "`omega`: preparing, or an error; one answer means both",
    "samples.in_range": (
        "`omega`: temperature within its alarm limits, or judged optimal, by a setting of the"
        " controller that cannot be read (B-55)"
    ),
    "events.seq": "number of the event, from 0; from 1 in runs of schema 1",
    "events.time": "when jbclog noticed it",
    "events.earliest": "start of the interval in which it happened",
    "events.station": "station, if the event has one",
    "events.port": "port, if the event has one",
    "events.kind": "kind",
    "events.severity": "`info` `warning` `error` `critical`",
    "events.code": "a number of a manual's or a page's table",
    "events.text": "one sentence",
    "events.value": "figure in the text",
    "events.limit_value": "limit in the text",
    "events.raw": "raw characters, or a name",
    "events.prev_sha256": "hash of the event before",
    "settings.time": "when its outcome was known",
    "settings.station": "station",
    "settings.port": "port; null: of the whole station",
    "settings.tool_name": "tool that it belongs to",
    "settings.setting": "name, as in [station commands](station-commands.md)",
    "settings.uom": "unit of measure of the values",
    "settings.requested": "value in the recipe",
    "settings.written": "value sent",
    "settings.readback": "value read back",
    "settings.nak": "number of the refusal",
    "settings.outcome": "outcome",
    "counters.time": "when it was read",
    "counters.station": "station",
    "counters.port": "port; null: of the whole station",
    "counters.counter": "name; ends in its unit",
    "counters.value": "value; null where it could not be read",
    "counters.uom": "unit of measure",
    "wire.seq": "number of the row, from 0, in the order of writing; a missing one is that of a lost row",
    "wire.time": "by the run's clock",
    "wire.at_s": "the same moment on the recorder's monotonic clock, as the session had it",
    "wire.station": "station",
    "wire.what": "what happened, as below",
    "wire.data": "bytes in one direction",
    "wire.text": "details: device, reason, options",
    "wire.request": "request of the session that got this result; null: of the link",
    "wire.size": "of the bytes received before, so many were given to the session",
    "wire.sent_s": "when the request's bytes left, monotonic; 0 without any",
    "wire.late_s": "how late the recorder was",
    "counters.raw": ("raw characters; without a value, the reason in angle brackets"),
}

QUALITY: Mapping[str, str] = {
    "disconnected": "the link was lost",
    "robot_off": "Robot mode was off",
    "timeout": "no answer in time",
    "bcc": "check byte wrong",
    "format": "no answer to this question",
    "nak": "refused; `reasons` has the number (`nak3`)",
    "implausible": "an impossible value, or another value when read again",
    "contradicted": "another answer to the same question came, and differed",
    "pulled": "the tip temperature fell faster than any tip cools: its tool is pulled out",
    "no_tool": "no tool in the port, as this row or one before shows",
    "skipped": "the tick was too late",
    "ok": "every due value was read",
}

OTHER_REASONS = (
    "In `reasons` only: `no_thermocouple` (hot air), `not_counting` (no time to sleep runs),"
    " `no_digit` (OMEGA answered A without a digit)."
)

OUTCOME: Mapping[str, str] = {
    "confirmed": "written, read back and equal",
    "unchanged": "already had the value; not written",
    "mismatch": "read back another value",
    "refused": "the station refused it",
    "unconfirmed": "written, but not read back",
    "unsupported": "the station does not have it",
    "read": "only read",
    "repeated": "lost on the way, and written again",
}

WHAT: Mapping[str, str] = {
    "run": "options of the session, in `text` as JSON: the first row of a station",
    "opened": "the port was opened; `failed`: it could not be",
    "sent": "bytes are about to be written",
    "heard": "bytes were read",
    "lost": "the link was lost",
    "closed": "the port was closed",
    "told": "the session got the next `size` bytes",
    "broke": "instead, the session got the loss of its link",
    "stopped": "instead, the end of the run",
    "not_started": "instead, that the run does not start, because of the stations in `text`",
    "left_out": "instead, that the run starts without this station",
    "done": "the session has ended",
}


def page() -> str:
    """The whole page."""
    sections = [_section(name, schema) for name, schema in SCHEMAS.items()]
    sections.append(OF_DERIVED.strip())
    sections += [_section(name, schema) for name, schema in DERIVED_SCHEMAS.items()]
    return f"{MADE}\n\n# Tables and columns\n{INTRODUCTION}\n" + "\n\n".join(sections) + "\n"


def _section(name: str, schema: pa.Schema) -> str:
    return f"## {name}\n\n{TEXTS[name]}\n\n{_columns(name, schema)}{_extra(name)}"


def tables() -> dict[str, pa.Schema]:
    """By name, as a run's folder has them."""
    return {**SCHEMAS, **DERIVED_SCHEMAS}


def meaning(name: str, field: pa.Field) -> str:
    """What a column holds: as its own metadata say, or the text here."""
    text = (field.metadata or {}).get(b"definition", b"").decode()
    return text or MEANINGS[f"{name}.{field.name}"]


def _columns(name: str, schema: pa.Schema) -> str:
    rows = []
    for field in schema:
        metadata = {key.decode(): value.decode() for key, value in (field.metadata or {}).items()}
        command = codes(metadata.get("command", "").split())
        kind = str(field.type).replace("timestamp[us, tz=UTC]", "timestamp UTC")
        cells = (
            code(field.name),
            meaning(name, field),
            metadata.get("uom", ""),
            kind,
            "yes" if field.nullable else "no",
        )
        rows.append((*cells, command) if name == "samples" else cells)
    head = ("column", "meaning", "unit", "type", "may be null")
    return table((*head, "command") if name == "samples" else head, rows)


def _extra(name: str) -> str:
    if name == "samples":
        rows = [(code(one), QUALITY[one]) for one in QUALITIES]
        return (
            "\n\n`quality` is the first of these that"
            f" applies:\n\n{table(('quality', 'means'), rows)}\n\n{OTHER_REASONS}"
        )
    if name == "wire":
        return "\n\n" + table(("what", "means"), [(code(one), WHAT[one]) for one in WHAT])
    if name == "settings":
        return "\n\n" + table(
            ("outcome", "means"), [(code(one), OUTCOME[one]) for one in SettingOutcome]
        )
    return ""
