"""docs/reference/tables.md: the columns of a run's tables and of the table of joints, from their
schemas.
"""

from __future__ import annotations

from collections.abc import Mapping

import pyarrow as pa

from jbclog.analysis.stored_tables import JOINTS_SCHEMA
from jbclog.core.rows import QUALITIES, SettingOutcome
from jbclog.record.schema import SCHEMAS
from support.pages.md_table import MADE, code, codes, table

INTRODUCTION = """
Parquet files of a [run's folder](run-folder.md). `pandas.read_parquet("RUN/samples")` reads the whole table; jbclog's
`run.samples()` returns the same with Int64 and boolean columns where values can be missing.

Times are UTC with zone, in microseconds. Units are in the names and in the fields' metadata (`unit`, `command`). Whole numbers are
int64. **Null means not read.** Nothing is carried forward or replaced by zero.

Times are by the run's own clock: the host's clock at the start, plus the time elapsed since (suspension included). A step of the
host's clock moves none of them; it is the event `clock.step` and stands in the [manifest](manifest.md), `clock_steps`. From each step on,
host's time = run's time + `offset_s`; `run.samples(clock="wall")` gives these times, `run.host_time` and `run.run_time` convert a moment.
A step out of the time before 2020, or a first one of more than a day, corrects a clock that was wrong from the start: it applies to the
whole run there, and `runs`, `report` and `check` say so. Times that others of this host wrote are converted: those of the guard's events,
and `acknowledged_at` of alarms. Lines of `annotations.jsonl` keep the host's time. Times of runs of earlier versions follow the steps of
their hosts (`clock_steps` null).
"""

TEXTS: Mapping[str, str] = {
    "samples": (
        "One row for each tick, station and port. A disconnected station has rows (null,"
        " `disconnected`). A host that is suspended or stalls has no rows, but one event"
        " `host.suspended` and a count `skipped` in the accounting."
    ),
    "events": (
        "The event log, oldest first. Each row has the hash of the row before."
        " [Events](events.md) lists the kinds."
    ),
    "settings": (
        "One row for each setting written or read. Values are text in the setting's unit. A"
        " mismatch, a refusal or an unconfirmed write stops the station; `unsupported` does not."
        " There is no rollback."
    ),
    "counters": "One row for each reading of a counter.",
    "joints": "`joints.parquet`, after `jbclog report`; `run.joints()`.",
}

MEANINGS: Mapping[str, str] = {
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
    "samples.set_c": "setpoint as read; not the sleep temperature in force",
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
    "events.seq": "number of the event, from 0",
    "events.time": "when jbclog noticed it",
    "events.earliest": "start of the interval in which it happened",
    "events.station": "station, if the event has one",
    "events.port": "port, if the event has one",
    "events.kind": "kind",
    "events.severity": "`info` `warning` `error` `critical`",
    "events.code": "a number of a manual's or a page's table",
    "events.text": "one sentence",
    "events.value": "figure in the text",
    "events.limit": "limit in the text",
    "events.raw": "raw characters, or a name",
    "events.prev_sha256": "hash of the event before",
    "settings.time": "when its outcome was known",
    "settings.station": "station",
    "settings.port": "port; null: of the whole station",
    "settings.tool": "tool that it belongs to",
    "settings.setting": "name, as in [station commands](station-commands.md)",
    "settings.unit": "unit of the values",
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
    "counters.unit": "unit",
    "counters.raw": ("raw characters; without a value, the reason in angle brackets"),
    "joints.station": "station",
    "joints.port": "port",
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


def page() -> str:
    """The whole page."""
    sections = [
        f"## {name}\n\n{TEXTS[name]}\n\n{_columns(name, schema)}{_extra(name)}"
        for name, schema in tables().items()
    ]
    return f"{MADE}\n\n# Tables and columns\n{INTRODUCTION}\n" + "\n\n".join(sections) + "\n"


def tables() -> dict[str, pa.Schema]:
    """By name, as a run's folder has them."""
    return {**SCHEMAS, "joints": JOINTS_SCHEMA}


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
            metadata.get("unit", ""),
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
    if name == "settings":
        return "\n\n" + table(
            ("outcome", "means"), [(code(one), OUTCOME[one]) for one in SettingOutcome]
        )
    return ""
