"""What is written of a run, as JSON lines, and what of it must differ between two runs of one
history.

A line is an object: `table`, and of a row its `station`, `row` (counted by table and station) and
under `is` the columns that are not null in it. Whatever columns a table has are written; before its
rows comes a line with their names. Rows stand in the order of `seq`, where a table has that, else
in their own; stations are compared one by one.

Of every history:

| what | becomes |
|---|---|
| columns `run` and `prev_sha256` (the run's name, and a hash over it) | left out |
| times | microseconds since the run's zero |
| numbers with a fraction | nine digits: sums in another order differ in the last ones |
| in texts: URLs, the run's folder, its parent, the version | station, RUN, HOME, VERSION |
| manifest | facts of the stations and the state; the verdict is compared by its corpus |

On real ports no two runs have the same timing. So of a live history is written, in place of rows:

| table | what is written |
|---|---|
| frames | what was written to each station and its answer, in order; how it was left |
| samples | by port the courses of tool, status and setpoint; whether it has temperatures |
| settings | each row once, without `time` and `seq` |
| events | each kind, severity, port and text once, with # for numbers, less `UNSTEADY` |
| stations | those of `STATION_KEYS`, with # for numbers in texts |
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import jbclog
from support.histories.benches import Wire

LEFT_OUT = ("run", "prev_sha256")
TABLES = (
    "samples",
    "settings",
    "events",
    "counters",
    "alarms",
    "gaps",
    "joints",
    "accounting",
)
KEPT_LIVE = ("settings", "events", "stations")
COURSES = ("tool", "status", "setpoint_c")
EVENT_COLUMNS = ("kind", "severity", "port", "text")
STATION_KEYS = ("outcome", "reason", "safe_state", "unsafe", "model", "software", "ports")
UNSTEADY = re.compile(
    r"(sample|late|host|rate|pace|read|protocol|clock|record|guard\.list|link|alarm)\b"
    r"|counters\.missed"
)
"""Kinds of events that depend on how fast the host is."""
NUMBER = re.compile(r"\d+(\.\d+)?")
Line = dict[str, Any]


class Text:
    """Puts words for what is not the same in two runs."""

    def __init__(self, home: Path, run: Path | None, urls: Mapping[str, str]) -> None:
        self._words = {} if run is None else {str(run): "RUN", run.name: "RUN"}
        self._words |= {str(home): "HOME", jbclog.__version__: "VERSION"}
        self._words |= {url: name for name, url in urls.items()}

    def __call__(self, text: str) -> str:
        for words, instead in self._words.items():
            text = text.replace(words, instead)
        return text


def lines(folder: Path, text: Text, zero_us: int) -> Iterator[Line]:
    """Yield all lines of a run whose zero is at `zero_us`, microseconds since 1970."""
    run = jbclog.open_run(folder)
    for table in TABLES:
        try:
            frame = getattr(run, table)()
        except Exception as error:
            yield {"table": table, "raised": f"{type(error).__name__}: {text(str(error))}"}
            continue
        yield from _rows(table, frame, text, zero_us)
    yield from _manifest(folder, text)


def frames(wires: Mapping[str, Wire], zero_s: float) -> Iterator[Line]:
    """Yield what each station was asked, took as a frame and said, with the second."""
    for name, wire in wires.items():
        for row, frame in enumerate(wire.cable.rows):
            values = {"at": round(frame.at - zero_s, 6), "what": frame.what}
            values |= {"data": frame.data.decode("latin-1"), "fault": frame.fault}
            yield {"table": "frames", "station": name, "row": row, "is": values}


def without_timing(found: Iterator[Line]) -> Iterator[Line]:
    """Of the lines of a live history, yield what two runs have in common."""
    courses: dict[tuple[str, int], Line] = {}
    rows: dict[tuple[str, str], list[Line]] = {}
    for line in found:
        table, values = line["table"], line.get("is", {})
        if "is" not in line:
            yield line
        elif table == "samples":
            _follow(courses.setdefault((line["station"], values["port"]), {}), values)
        elif table == "end":
            yield line
        elif table in KEPT_LIVE:
            kept = _steady(table, values)
            those = rows.setdefault((table, line["station"]), [])
            if kept and kept not in those:
                those.append(kept)
    for (station, port), course in courses.items():
        yield {"table": "samples", "station": station, "row": port, "is": course}
    for (table, station), those in rows.items():
        if table == "events":
            those.sort(key=json.dumps)
        for row, kept in enumerate(those):
            yield {"table": table, "station": station, "row": row, "is": kept}


def _steady(table: str, values: Line) -> Line:
    """What two runs have in common of a row; nothing if that is nothing."""
    if table == "settings":
        return {key: value for key, value in values.items() if key not in ("time", "seq")}
    if table == "stations":
        words = {**values, "value": NUMBER.sub("#", values["value"])}
        steady = words if values["key"] in ("reason", "unsafe") else values
        return steady if values["key"] in STATION_KEYS else {}
    if UNSTEADY.match(values["kind"]):
        return {}
    kept = {key: values[key] for key in EVENT_COLUMNS if key in values}
    return {**kept, "text": NUMBER.sub("#", values["text"])}


def _follow(course: Line, values: Line) -> None:
    """Add what changed with a sample to the course of its port."""
    for column in COURSES:
        value = values.get(column)
        states = course.setdefault(column, [])
        if value is not None and states[-1:] != [value]:
            states.append(value)
    if values.get("temperature_c") is not None:
        course["has_temperature"] = True


def _rows(table: str, frame: Any, text: Text, zero_us: int) -> Iterator[Line]:
    columns = [name for name in frame.columns if name not in LEFT_OUT]
    yield {"table": table, "columns": columns}
    if "seq" in columns:
        frame = frame.sort_values("seq", kind="stable")
    counted: Counter[str] = Counter()
    for record in frame[columns].to_dict("records"):
        station = record.get("station")
        name = station if isinstance(station, str) else ""
        values = {key: _value(value, text, zero_us) for key, value in record.items()}
        there = {key: value for key, value in values.items() if value is not None}
        yield {"table": table, "station": name, "row": counted[name], "is": there}
        counted[name] += 1


def _value(value: Any, text: Text, zero_us: int) -> Any:
    if hasattr(value, "as_unit"):  # a moment or a duration of pandas
        if value != value:
            return None
        micros = value.value // 1000
        return micros - zero_us if hasattr(value, "tzinfo") else micros
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float):
        return float(f"{value:.9g}") if math.isfinite(value) else None
    if isinstance(value, str):
        return text(value)
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, bytes):
        return value.decode("latin-1")
    return None if value != value else text(str(value))  # pandas has NA


def _manifest(folder: Path, text: Text) -> Iterator[Line]:
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    for station in manifest["stations"]:
        for row, (key, value) in enumerate(sorted(station.items())):
            values = {"key": key, "value": text(json.dumps(value))}
            yield {"table": "stations", "station": station["name"], "row": row, "is": values}
    yield {"table": "end", "station": "", "row": 0, "is": {"state": manifest.get("state")}}
