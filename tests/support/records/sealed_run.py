"""A sealed run from arrays, without recording it: long ones in a second, and ones that no station
would give.
"""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from jbclog.core.rows import CounterRow, EventRow, SettingRow, Severity, StationFacts
from jbclog.record.ledger import ledger_of
from jbclog.record.manifest import LineFile, Manifest, Metadata, RecipeFile, iso, write_manifest
from jbclog.record.schema import RUN, SCHEMAS, SEQ, constant, numbers_from
from support.records.listed_files import add_part, complete, files_of

T0_UTC_S = 1_790_000_000.0
NAME = "20260921T141320Z-bench-k7qd"
RECIPE = """[recipe]
name = "sn100c-tht"
revision = 7
families = ["dde"]

[acceptance]
coverage_percent = 99.5
longest_gap_s = 5
idle_error_c = 15
idle_sd_c = 5
alarms_max = 0
"""


def micros(second: float) -> int:
    return round((T0_UTC_S + second) * 1e6)


def station(
    name: str = "dde-1", ports: Sequence[int] = (1,), rows: int = 0, hz: float = 10.0
) -> StationFacts:
    """A station that was recorded to the end."""
    facts = StationFacts(
        name,
        f"{name}.pty",
        "dde",
        "DDE",
        "8886000",
        1,
        ports=list(ports),
        touched=list(ports),
        outcome="completed",
    )
    facts.tool_names = dict.fromkeys(ports, "T245/T470")
    facts.safe_state = dict.fromkeys(ports, "verified")
    facts.last_temperature_c = dict.fromkeys(ports, 350.0)
    facts.period_s, facts.recipe = 1 / hz, "recipes/tht.toml"
    facts.first_tick, facts.last_tick = (0, rows - 1) if rows else (None, None)
    return facts


def samples(
    rows: int,
    name: str = "dde-1",
    port: int = 1,
    hz: float = 10.0,
    seed: int = 1,
    joints_until_s: float = np.inf,
) -> dict[str, NDArray[np.generic]]:
    """Columns of one port that solders a joint each five seconds after heating up, and then rests;
    change them as you like, then `table`.
    """
    rng, second = np.random.default_rng(seed), np.arange(rows) / hz
    joint = (second % 5 > 3.5) & (second > 5) & (second < joints_until_s)
    temperature = (
        350
        + np.round(rng.normal(0, 1, rows))
        - np.where(joint, np.round(15 * np.sin((second % 5 - 3.5) / 1.5 * np.pi)), 0)
    )
    heating = second < 3
    temperature[heating] = np.round(25 + 108 * second[heating])
    power = np.clip(np.round(np.where(joint, 600, 80) + rng.normal(0, 15, rows)), 0, 1000)
    power[heating] = 1000
    late = rng.integers(90, 900, rows)
    return {
        "time": micros(0) + np.round(second * 1e6).astype(np.int64) + late + 14_000,
        "tick": np.arange(rows),
        "station": np.full(rows, name, dtype=object),
        "port": np.full(rows, port),
        "late_us": late.astype(np.float64),
        "scan_us": rng.integers(45_000, 47_000, rows).astype(np.float64),
        "quality": np.full(rows, "ok", dtype=object),
        "reasons": np.full(rows, None, dtype=object),
        "temperature_c": temperature,
        "power_permille": power,
        "status": np.full(rows, "working", dtype=object),
        "setpoint_c": np.where(np.arange(rows) % round(5 * hz) == 0, 350.0, np.nan),
        "alarm_high": np.where(np.arange(rows) % round(2 * hz) == 0, 0.0, np.nan),
    }


def lose(
    columns: dict[str, NDArray[np.generic]], rows: slice, reason: str = "disconnected"
) -> None:
    """Nothing was read in these rows."""
    fast = ("temperature_c", "power_permille", "status")
    for name in (*fast[:2], "setpoint_c", "alarm_high", "late_us", "scan_us"):
        columns[name][rows] = np.nan
    columns["status"][rows] = None
    columns["quality"][rows] = reason
    columns["reasons"][rows] = ";".join(f"{name}={reason}" for name in fast)


def table(*ports: dict[str, NDArray[np.generic]]) -> pa.Table:
    """The `samples` of these ports, one after the other; what was not given is null."""
    return pa.concat_tables(
        [_table(columns) for columns in ports] or [SCHEMAS["samples"].empty_table()]
    )


def _table(columns: dict[str, NDArray[np.generic]]) -> pa.Table:
    schema, count = SCHEMAS["samples"], len(columns["tick"])
    columns = {**columns, RUN: np.full(count, NAME, dtype=object)}
    return pa.table(
        [_array(columns.get(field.name), field.type, count) for field in schema], schema=schema
    )


def _array(values: NDArray[np.generic] | None, kind: pa.DataType, count: int) -> pa.Array:
    if values is None:
        return pa.nulls(count, kind)
    if values.dtype.kind == "f":
        return pa.array(values, pa.float64(), from_pandas=True).cast(kind)
    return (
        pa.array(values.tolist(), kind) if values.dtype.kind == "O" else pa.array(values).cast(kind)
    )


def seal(
    out: Path,
    stations: Sequence[StationFacts],
    rows: pa.Table,
    events: Sequence[EventRow] = (),
    settings: Sequence[SettingRow] = (),
    counters: Sequence[CounterRow] = (),
    recipe: str = RECIPE,
    run: str = NAME,
    **manifest: object,
) -> Path:
    """A sealed run folder below `out`; `manifest` replaces what its manifest says."""
    folder = out / run
    (folder / "recipes").mkdir(parents=True)
    (folder / "recipes" / "tht.toml").write_text(recipe)
    (folder / "line.toml").write_text('[line]\nname = "bench"\n')
    told = [
        dict(zip(EventRow._fields, event, strict=True), prev_sha256="0" * 64) for event in events
    ]
    others = {
        "events": told,
        "settings": [row._asdict() for row in settings],
        "counters": [row._asdict() for row in counters],
    }
    filled = {RUN: constant(run, len(rows)), SEQ: numbers_from(0, len(rows))}
    for place, name in enumerate((RUN, SEQ)):
        rows = rows.set_column(place, rows.schema.field(place), filled[name])
    add_part(folder, "samples", rows)
    for name, lines in others.items():
        numbered = [
            {RUN: run, "seq": seq, **line, **_times(line)} for seq, line in enumerate(lines)
        ]
        piece = pa.Table.from_pylist(numbered, SCHEMAS[name])
        add_part(folder, name, piece)
    complete(folder)
    write_manifest(folder, _manifest(folder, list(stations), recipe, manifest))
    return folder


def _times(line: dict[str, object]) -> dict[str, object]:
    stamp = pa.timestamp("us", tz="UTC")
    return {
        name: pa.scalar(line[name], pa.int64()).cast(stamp).as_py()
        for name in ("time", "earliest")
        if name in line
    }


def _manifest(
    folder: Path, stations: list[StationFacts], recipe: str, said: dict[str, object]
) -> Manifest:
    ends = [
        facts.last_tick * facts.period_s for facts in stations if facts.last_tick and facts.period_s
    ]
    found = Manifest(
        folder.name,
        state="sealed",
        exit_status="success",
        exit_code=0,
        start=iso(micros(-2)),
        stop=iso(micros(max(ends, default=0))),
        t0_mono=5000.0,
        t0_utc=T0_UTC_S,
        line=LineFile("bench", "line.toml", "0" * 64),
        recipes=[
            RecipeFile("recipes/tht.toml", sha256(recipe.encode()).hexdigest(), "sn100c-tht", 7)
        ],
        metadata=Metadata("M. Weber", "4711", "controller"),
        host={"jbclog": "0.1.0"},
        rate=10.0,
        stations=stations,
        ledger=ledger_of(folder, stations),
        files=list(files_of(folder)),
    )
    for name, value in said.items():
        assert hasattr(found, name)
        setattr(found, name, value)
    return found


def alarm(
    second: float,
    station_name: str = "dde-1",
    port: int = 1,
    text: str = "Port 1: high-temperature alarm.",
) -> EventRow:
    return EventRow(
        micros(second),
        "alarm.high",
        Severity.ERROR,
        text,
        station_name,
        port,
        micros(second - 2),
        None,
        390.0,
        380.0,
        "high",
    )


def limit(
    side: str, celsius: str, second: float = -1, station_name: str = "dde-1", port: int = 1
) -> SettingRow:
    return SettingRow(
        micros(second),
        station_name,
        port,
        None,
        f"alarm_{side}_limit",
        "°C",
        celsius,
        celsius,
        celsius,
        None,
        "confirmed",
    )
