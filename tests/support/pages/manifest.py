"""docs/reference/manifest.md: every key of manifest.json, from the types that read and write it."""

from __future__ import annotations

import re
from collections.abc import Mapping

from jbclog.core.goal import Goal
from jbclog.core.rows import StationFacts, TipCheck
from jbclog.record.manifest import (
    ClockStep,
    LineFile,
    Lost,
    Manifest,
    Metadata,
    Previous,
    RecipeFile,
    SealedFile,
    Unit,
)
from support.pages.md_table import MADE, code, table

OBJECTS: Mapping[str, type] = {
    "manifest.json": Manifest,
    "line": LineFile,
    "recipes": RecipeFile,
    "metadata": Metadata,
    "units": Unit,
    "stations": StationFacts,
    "lost": Lost,
    "files": SealedFile,
    "previous": Previous,
    "verifications": TipCheck,
    "goals": Goal,
    "clock_steps": ClockStep,
}
"""Heading -> what stands there."""

INTRODUCTION = """
One JSON object in a [run's folder](run-folder.md). It never changes after sealing. Times are ISO 8601 in UTC. A key that an earlier
release did not write has its default. The last key, `digest`, is the SHA-256 of the file without it
(without its line and the comma before); the SHA-256 of the whole file is the run's fingerprint. What is counted of a station during a
run (`alarms`, `outages`, `skipped`, `due`, `last_tick` …) is that of an earlier moment, or 0 or null, in a run that a crash cut off
(`outcome` is `running`): its events and samples have the rest.
"""

MEANINGS: Mapping[str, str] = {
    "manifest.json.run": "name of the run's folder",
    "manifest.json.schema": "version of the tables",
    "manifest.json.state": "`open` or `sealed`",
    "manifest.json.exit_status": "`success`, `aborted`, `failed`, `lost`; null: not known yet",
    "manifest.json.exit_code": "[exit code](exit-codes.md) of the run",
    "manifest.json.verdict": "verdict",
    "manifest.json.rules": "number of the rules and methods of the verdict",
    "manifest.json.verdict_rules": (
        "each rule of the verdict: name, station, port, limit_value, observed, uom, result, text, bound"
    ),
    "manifest.json.start": "start",
    "manifest.json.stop": "end: start plus the time elapsed",
    "manifest.json.t0_mono": "tick 0 on the recorder's monotonic clock, s",
    "manifest.json.t0_utc": "the same moment, s since 1970 UTC",
    "manifest.json.line": "line file as it ran",
    "manifest.json.recipes": "recipes as they ran",
    "manifest.json.metadata": "options given at the start",
    "manifest.json.units": "units whose serials were read during the run",
    "manifest.json.host": "computer and versions",
    "manifest.json.rate": "Hz, or `max`",
    "manifest.json.guard": "the guard's state",
    "manifest.json.wire": "serial capture: null: none; `whole`; or what is missing of it",
    "manifest.json.stations": "stations",
    "manifest.json.ledger": "accounting: station, port, signal, then `due` = `ok` + each reason",
    "manifest.json.lost": "losses by a crash, a disk or damage",
    "manifest.json.files": "every file of the run",
    "manifest.json.previous": "previous run on the same production line",
    "manifest.json.verifications": "tip verifications that applied to its ports at the start",
    "manifest.json.goals": "numbers of units or joints that end the run",
    "manifest.json.clock_steps": (
        "steps of the host's clock, which no time of the run follows: host's time = run's time +"
        " `offset_s`; the first 1000, the others are events. Null in earlier versions, whose times"
        " follow them"
    ),
    "line.name": "name of the production line",
    "line.file": "file in the run's folder",
    "line.sha256": "its SHA-256",
    "recipes.file": "file in the run's folder",
    "recipes.sha256": "its SHA-256",
    "recipes.name": "name of the recipe",
    "recipes.revision": "its revision",
    "metadata.operator": "`--operator`",
    "metadata.order": "`--order`",
    "metadata.product": "`--product`",
    "metadata.units": "`--unit`",
    "metadata.tags": "`--tag`",
    "metadata.wire_lots": "`--wire-lot`",
    "metadata.flux_lots": "`--flux-lot`",
    "metadata.tips": "`--tip`: `ID`, `STATION=ID` or `STATION:PORT=ID`",
    "units.unit": "serial",
    "units.start": "start",
    "units.stop": "end; null: no event shows it",
    "stations.name": "name",
    "stations.url": "port",
    "stations.family": "family",
    "stations.model": "model name",
    "stations.software": "software version",
    "stations.address": "address; null: frames without addresses",
    "stations.baudrate": "baud rate",
    "stations.format": "line format",
    "stations.ports": "ports that are recorded",
    "stations.tool_names": "tool of each port",
    "stations.turnaround_us": (
        "response time in µs: median (at least the shortest of a fast signal), p99, n; `faster_by` where the link is faster than named"
    ),
    "stations.asked_rate": "Hz, `auto`, `fit` or `max`",
    "stations.rate_hz": "rate of the fast signals; null: without pause",
    "stations.period_s": "its period",
    "stations.recipe": "file of its recipe",
    "stations.rated_power_w": "rated power from the line file",
    "stations.signals": "signals that its family has",
    "stations.not_supported": "commands that it refuses as unknown",
    "stations.first_tick": "number of its first tick",
    "stations.last_tick": "number of its last tick",
    "stations.due": "readings due by port and signal, as the session counted",
    "stations.watched": "settings read again that have no column, accounted as in `ledger`",
    "stations.skipped": "ticks without rows: the recorder stood still",
    "stations.skipped_by_host": "rows marked `skipped` for which the host was too late",
    "stations.garbage_bytes": "bytes that belonged to no frame",
    "stations.strays": "frames that answer no question, by kind",
    "stations.anomalies": (
        "unusual forms of the protocol, by number of [contradictions](contradictions.md)"
    ),
    "stations.doubted": "answers read again before they were believed, by command",
    "stations.alarm_rules": "deadband, off-delay and time until uncertain of alarms from samples",
    "stations.alarms": "alarms that count",
    "stations.unconfirmed_alarms": "flags that no temperature confirms",
    "stations.settings_changed": "settings found changed",
    "stations.settings_repeated": "settings written again at the start",
    "stations.outages": "number of lost connections, and of times without Robot mode",
    "stations.worst_slow_periods": "longest wait of a slow reading, in its own periods",
    "stations.touched": "ports that the run wrote to",
    "stations.outcome": "[outcome](run-folder.md)",
    "stations.reason": "why",
    "stations.asked_safe_state": "safe state of the recipe",
    "stations.suction": "ports of hot air whose suction a safe order keeps on",
    "stations.may_feed": "whether a feeder may run that this run must stop",
    "stations.safe_state": "touched port: `verified`, `sent` or `failed`",
    "stations.unsafe": "a sentence for each tool or feeder that could not be made safe",
    "stations.last_temperature_c": "last temperature of each port",
    "stations.model_accepted": "whether the line file's `model` accepted its name",
    "lost.seconds_at_most": "seconds of every station at most; null: not known",
    "lost.text": "a sentence",
    "files.path": "path in the folder",
    "files.rows": "rows; null: it has none",
    "files.bytes": "size",
    "files.sha256": "SHA-256",
    "files.footer_bytes": "of a part: bytes of its footer, to the end of the file",
    "files.footer_sha256": "of a part: SHA-256 of its footer",
    "previous.run": "its name",
    "previous.sha256": "its fingerprint, in full",
    "previous.text": "why there is none, or why it is not known",
    "verifications.station": "station",
    "verifications.port": "port",
    "verifications.state": "`pass`, `fail`, `other tip`, `none`, `unreadable`",
    "verifications.text": "a sentence",
    "verifications.time": "when",
    "verifications.days": "age at the run's start",
    "verifications.tip": "tip",
    "verifications.instrument": "external thermometer",
    "verifications.offset_c": "thermometer minus station",
    "verifications.limit_c": "limit of that difference",
    "verifications.adjust_c": "the station's adjustment at that time",
    "verifications.seq": "number of its line in `verifications.jsonl`",
    "verifications.sha256": "hash of that line",
    "goals.what": "`units` or `joints`",
    "goals.wanted": "how many",
    "goals.reached": "how many it reached; null: not known",
    "goals.text": "a sentence",
    "clock_steps.time": "when the recorder saw it, by the run's clock; up to 1 s late",
    "clock_steps.step_s": "size, s",
    "clock_steps.offset_s": "from then on, host's time less run's time, s",
}


def page() -> str:
    """The whole page."""
    sections = (
        f"## {name}\n\n{table(('key', 'meaning', 'type'), rows_of(name, one, MEANINGS))}"
        for name, one in OBJECTS.items()
    )
    return f"{MADE}\n\n# Manifest\n{INTRODUCTION}\n" + "\n\n".join(sections) + "\n"


def keys() -> set[str]:
    """Every key, behind its heading."""
    return keys_of(OBJECTS)


def keys_of(objects: Mapping[str, type]) -> set[str]:
    """Every key of these classes, behind the name of its own."""
    return {f"{name}.{key}" for name, one in objects.items() for key in types_of(one)}


def types_of(one: type) -> dict[str, str]:
    """Key -> type, as the class declares them."""
    declared = [getattr(base, "__annotations__", {}) for base in reversed(one.__mro__)]
    return {
        key: str(kind) for keys in declared for key, kind in keys.items() if not key.startswith("_")
    }


def rows_of(name: str, one: type, meanings: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Key, meaning and type of each key of a class."""
    return [
        (code(key), meanings[f"{name}.{key}"], json_type(kind))
        for key, kind in types_of(one).items()
    ]


def json_type(kind: str) -> str:
    """A type of Python as JSON has it."""
    text = re.sub(
        r"\b(?:LineFile|RecipeFile|Metadata|Unit|StationFacts|Lost|SealedFile|Previous|TipCheck|Goal|ClockStep|Ledger)\b",
        "object",
        re.sub(r"Literal\[.*?\]|\bRunState\b", "str", kind),
    )
    for python, json in (
        ("str", "text"),
        ("int", "whole number"),
        ("float", "number"),
        ("bool", "true or false"),
        ("None", "null"),
    ):
        text = re.sub(rf"\b{python}\b", json, text)
    text = re.sub(r"\blist\[(.*)\]", r"list: \1", text)
    return (
        "object"
        if text.startswith("dict[")
        else text.replace("dict[text, object]", "object").replace(" | ", " or ")
    )
