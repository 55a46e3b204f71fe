"""What of a run's folder is not as the pages say: written from docs/reference and
docs/explanation/record.md alone, by somebody who had not seen how jbclog makes the tables.

`Folder(path).wrong()` gives a sentence for each difference. Columns and types are those that
`tables.md` prints; accounting, gaps, units and metrics are counted again from the samples. Nothing
here imports jbclog.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "tables.md"
RECORDED = ("samples", "events", "settings", "counters")
DERIVED = ("joints", "alarms", "units", "tips", "metrics", "accounting", "gaps")
TYPES = {
    "string": pa.string(),
    "int64": pa.int64(),
    "double": pa.float64(),
    "bool": pa.bool_(),
    "timestamp UTC": pa.timestamp("us", tz="UTC"),
}
COMPANIONS = {
    "cooling": "status",
    "desoldering": "status",
    "motor": "status",
    "alarm_low": "alarm_high",
}
"""Columns of an answer that is accounted under the name of another one."""
PAUSE_US = 500_000
BRIDGED = 2
"""Periods between two readings that metrics, energies and alarms bridge."""
ROUNDING_US = 2
ROUNDED = 1e-3
"""Figures of derived tables have three decimals."""
REASONS_ONLY = ("no_thermocouple", "not_counting", "no_digit")
UNANSWERED = ("disconnected", "robot_off", "timeout", "skipped")
SUMMED = {
    "joint_deficit_c": "deficit_c",
    "joint_resting_below_c": "resting_below_c",
    "joint_depth_c": "depth_c",
    "joint_dwell_s": "dwell_s",
    "joint_heat_permille_s": "heat_permille_s",
    "joint_energy_permille_s": "energy_permille_s",
    "joint_heat_j": "heat_j",
}
"""Metrics that are the median of a column of the joints."""


@dataclass(frozen=True)
class Column:
    name: str
    type: pa.DataType
    is_nullable: bool
    uom: str
    command: str


@cache
def documented() -> dict[str, list[Column]]:
    """The columns of each table, as the page prints them."""
    tables: dict[str, list[Column]] = {}
    rows: list[Column] = []
    for line in PAGE.read_text().splitlines():
        if line.startswith("## "):
            rows = tables.setdefault(line[3:], [])
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        if line.startswith("| `") and len(cells) >= 5 and cells[3] in TYPES:
            name, _, uom, kind, null = cells[:5]
            command = cells[5] if len(cells) > 5 else ""
            rows.append(Column(name.strip("`"), TYPES[kind], null == "yes", uom, command))
    return {name: columns for name, columns in tables.items() if columns}


@cache
def severities() -> list[str]:
    """Qualities, the most severe first."""
    table = PAGE.read_text().partition("| quality | means |")[2].partition("\n\n")[0]
    return re.findall(r"^\| `(\w+)`", table, re.MULTILINE)


def micros(times: pd.Series) -> list[int | None]:
    return [None if pd.isna(time) else int(time.value // 1000) for time in times]


def at_us(text: str | pd.Timestamp) -> int:
    return int(pd.Timestamp(text).value // 1000)


@dataclass
class Gap:
    """Times in µs; `missing` has the reason of each reading that was due."""

    start: int
    stop: int
    reasons: list[str] = field(default_factory=list)
    missing: int = 0
    at_least: bool = False

    def row(self) -> tuple[int, int, int, str, bool]:
        return (
            self.start,
            self.stop,
            self.missing,
            ";".join(dict.fromkeys(self.reasons)),
            self.at_least,
        )


@dataclass
class Folder:
    """A run's folder, sealed, with its derived tables."""

    path: Path

    @cached_property
    def manifest(self) -> dict[str, Any]:
        loaded: dict[str, Any] = json.loads((self.path / "manifest.json").read_text())
        return loaded

    def parts(self, name: str) -> list[Path]:
        return sorted((self.path / name).glob("part-*.parquet"))

    @cached_property
    def tables(self) -> dict[str, pa.Table]:
        """All rows; samples, which are sorted by port in their parts, as they were recorded."""
        found = {}
        for name in RECORDED:
            parts = self.parts(name)
            if not parts:  # of a run that is open
                continue
            found[name] = pa.concat_tables([pq.ParquetFile(part).read() for part in parts])
        if "samples" in found and "seq" in found["samples"].column_names:  # not of 0.1.0
            found["samples"] = found["samples"].sort_by("seq")
        for name in DERIVED:
            file = self.path / "derived" / f"{name}.parquet"
            if file.exists():
                found[name] = pq.ParquetFile(file).read()
        return found

    @cached_property
    def frames(self) -> dict[str, pd.DataFrame]:
        types = {pa.int64(): pd.Int64Dtype(), pa.bool_(): pd.BooleanDtype()}
        return {
            name: table.to_pandas(types_mapper=types.get) for name, table in self.tables.items()
        }

    @cached_property
    def stations(self) -> dict[str, dict[str, Any]]:
        return {station["name"]: station for station in self.manifest["stations"]}

    @property
    def is_unpaced(self) -> bool:
        """`--rate max`."""
        return any(station["asked_rate"] == "max" for station in self.stations.values())

    def period_s(self, station: str) -> float | None:
        period: float | None = self.stations[station]["period_s"]
        return period

    def due_us(self, station: str, tick: int) -> int | None:
        """When a tick was due; None without a grid."""
        period = self.period_s(station)
        if period is None:
            return None
        return round((self.manifest["t0_utc"] + tick * period) * 1e6)

    @cached_property
    def ports(self) -> dict[tuple[str, int], Port]:
        samples = self.frames["samples"]
        return {
            (str(key[0]), int(key[1])): Port(self, str(key[0]), int(key[1]), rows)
            for key, rows in samples.groupby(["station", "port"], sort=False)
        }

    def wrong(self) -> list[str]:
        return list(self.differences())

    def differences(self) -> Iterator[str]:
        yield from self.wrong_columns()
        yield from self.wrong_files()
        yield from self.wrong_order()
        for port in self.ports.values():
            yield from port.wrong_rows()
        yield from self.wrong_accounting()
        yield from self.wrong_gaps()
        yield from self.wrong_verdict()
        yield from self.wrong_metrics()
        yield from self.wrong_alarms()
        yield from self.wrong_joints()
        yield from self.wrong_units()
        yield from self.wrong_tips()
        yield from self.wrong_clock()

    # -- files -------------------------------------------------------------------------------------

    def wrong_columns(self) -> Iterator[str]:
        for name in (*RECORDED, *DERIVED):
            columns = documented()[name]
            if name not in self.tables:
                yield f"{name}: no file"
                continue
            table = self.tables[name]
            if table.column_names != [column.name for column in columns]:
                yield f"{name}: columns {table.column_names}"
                continue
            for column in columns:
                mine = table.schema.field(column.name)
                if mine.type != column.type or mine.nullable != column.is_nullable:
                    yield f"{name}.{column.name}: {mine}"
                if not column.is_nullable and table[column.name].null_count:
                    yield f"{name}.{column.name}: null"
                metadata = {
                    key.decode(): text.decode() for key, text in (mine.metadata or {}).items()
                }
                if name in RECORDED and metadata.get("uom", "") != column.uom:
                    yield f"{name}.{column.name}: metadata {metadata}, uom {column.uom}"
                command = column.command.replace("`", "")
                if name in RECORDED and metadata.get("command", "") != command:
                    yield f"{name}.{column.name}: metadata {metadata}, command {command}"
            others = set(table["run"].to_pylist()) - {self.path.name}
            if others:
                yield f"{name}.run: {others}"
            if name in RECORDED:
                for part in (self.path / name).iterdir():
                    encodings = pq.read_metadata(part)
                    for group in range(encodings.num_row_groups):
                        if not encodings.row_group(group).column(0).has_dictionary_page:
                            yield f"{part}: run is not dictionary-coded"

    def wrong_files(self) -> Iterator[str]:
        manifest = self.manifest
        text = (self.path / "manifest.json").read_text()
        without, _, _ = text.rpartition(',\n "digest"')
        digest = hashlib.sha256(f"{without}\n}}\n".encode()).hexdigest()
        if manifest["digest"] != digest:
            yield "manifest.json: digest"
        if list(manifest)[-1] != "digest":
            yield "manifest.json: digest is not its last key"
        if manifest["run"] != self.path.name:
            yield f"manifest.json: run {manifest['run']}"
        rows: Counter[str] = Counter()
        named = set()
        for file in manifest["files"]:
            data = (self.path / file["path"]).read_bytes()
            named.add(file["path"])
            if (len(data), hashlib.sha256(data).hexdigest()) != (file["bytes"], file["sha256"]):
                yield f"{file['path']}: another hash"
            if file["rows"] is not None:
                rows[file["path"].partition("/")[0]] += file["rows"]
            if file["footer_bytes"] is not None:
                footer = data[-file["footer_bytes"] :]
                if hashlib.sha256(footer).hexdigest() != file["footer_sha256"]:
                    yield f"{file['path']}: another footer"
        for name in RECORDED:
            if rows[name] != len(self.tables[name]):
                yield f"{name}: {len(self.tables[name])} rows, manifest {rows[name]}"
            for part in (self.path / name).iterdir():
                if f"{name}/{part.name}" not in named:
                    yield f"{name}/{part.name}: not in the manifest"
        fingerprint = hashlib.sha256((self.path / "manifest.json").read_bytes()).hexdigest()
        heads = {fingerprint}  # of any moment: a guard may add its lines while they are made
        notes = self.path / "annotations.jsonl"
        if notes.exists():
            lines = notes.read_text().splitlines()
            heads |= {hashlib.sha256(line.encode()).hexdigest() for line in lines}
        for name in DERIVED:
            if name in self.tables:
                metadata = self.tables[name].schema.metadata
                if metadata[b"jbclog.manifest_sha256"].decode() != fingerprint:
                    yield f"derived/{name}: of another manifest"
                if metadata[b"jbclog.annotations_head"].decode() not in heads:
                    yield f"derived/{name}: of another annotation"

    # -- order -------------------------------------------------------------------------------------

    def wrong_order(self) -> Iterator[str]:
        yield from self.wrong_chain()
        for part in self.parts("samples"):
            rows = pq.ParquetFile(part).read(columns=["station", "port", "tick"])
            if rows != rows.sort_by([(name, "ascending") for name in rows.column_names]):
                yield f"samples: {part.name} is not sorted by station, port and tick"
        for name in RECORDED:
            numbers = self.tables[name]["seq"].to_pylist()
            if any(later <= earlier for earlier, later in pairwise(numbers)):
                yield f"{name}.seq is not in order"
            expected = range(len(numbers))
            if numbers != list(expected) and self.manifest["lost"] is None:
                holes = sorted(set(expected) - set(numbers))
                yield f"{name}.seq: holes {holes[:5]}, and nothing is lost"
        events = self.frames["events"]
        late = events[events["earliest"] > events["time"]]
        if len(late):
            yield f"events: earliest after time: {late['text'].tolist()}"

    def wrong_chain(self) -> Iterator[str]:
        before = hashlib.sha256(self.path.name.encode()).hexdigest()
        events = self.tables.get("events", pa.table({}))
        for row in events.to_pylist():
            if row["prev_sha256"] != before:
                yield f"events: {row['seq']} does not have the hash of the row before"
            before = hashed(row)

    # -- accounting --------------------------------------------------------------------------------

    @cached_property
    def counted(self) -> dict[tuple[str, int, str], Counter[str]]:
        """Readings due, obtained and lost by each reason, by SQL over the samples."""
        samples = self.tables["samples"]
        signals = [
            column.name for column in documented()["samples"][10:] if column.name not in COMPANIONS
        ]
        found: dict[tuple[str, int, str], Counter[str]] = {}
        base = duckdb.connect()
        base.register("samples", samples)
        obtained = ", ".join(f"count({name})" for name in signals)
        for station, port, *counts in base.execute(
            f"SELECT station, port, {obtained} FROM samples GROUP BY ALL"
        ).fetchall():
            for name, count in zip(signals, counts, strict=True):
                if count:
                    found.setdefault((station, port, name), Counter())["obtained"] += count
        for station, port, name, reason, count in base.execute(
            "WITH words AS (SELECT station, port, unnest(string_split(reasons, ';')) AS word"
            " FROM samples WHERE reasons IS NOT NULL)"
            " SELECT station, port, split_part(word, '=', 1), split_part(word, '=', 2), count(*)"
            " FROM words GROUP BY ALL"
        ).fetchall():
            if name not in COMPANIONS:
                found.setdefault((station, port, name), Counter())[reason_column(reason)] += count
        for (station, number), port in self.ports.items():
            for name in port.each_tick:
                if port.absent:
                    found.setdefault((station, number, name), Counter())["skipped"] += len(
                        port.absent
                    )
        base.register("counters", self.tables["counters"])
        for station, port, name, reason, count in base.execute(
            "SELECT station, port, counter,"
            " CASE WHEN value IS NULL THEN trim(raw, '<>') ELSE 'obtained' END AS why, count(*)"
            " FROM counters GROUP BY ALL"
        ).fetchall():
            word = reason if reason == "obtained" else reason_column(reason)
            found.setdefault((station, port, name), Counter())[word] += count
        return found

    def wrong_accounting(self) -> Iterator[str]:
        ledger: dict[tuple[str, int | None, str], Counter[str]] = {}
        for station, ports in self.manifest["ledger"].items():
            for port, signals in ports.items():
                for name, row in signals.items():
                    place = (station, int(port) if port.isdigit() else None, name)
                    if row["due"] != sum(row.values()) - row["due"]:
                        yield f"ledger {place}: {row}"
                    words = Counter()
                    for word, count in row.items():
                        if word != "due":
                            words["obtained" if word == "ok" else reason_column(word)] += count
                    ledger[place] = words
        rows: dict[tuple[str, int | None, str], Counter[str]] = {}
        for row in self.tables.get("accounting", pa.table({})).to_pylist():
            reasons = {word: count for word, count in list(row.items())[5:] if count}
            if row["due"] != sum(reasons.values()):
                yield f"accounting {row}: due is not obtained and all columns after it"
            place = (row["station"], row["port"], row["signal"])
            if place in rows:
                yield f"accounting {place} stands twice"
            rows[place] = Counter(reasons)
        for place in ledger.keys() | rows.keys():
            if +ledger.get(place, Counter()) != +rows.get(place, Counter()):
                yield f"accounting {place}: {rows.get(place)}, ledger {ledger.get(place)}"
        watched = {
            (station["name"], int(port), name)
            for station in self.stations.values()
            for port, names in station["watched"].items()
            for name in names
        }
        for place in (ledger.keys() | self.counted.keys()) - watched:
            mine = +self.counted.get(place, Counter())  # type: ignore[arg-type]  # a port is a number
            if mine != +ledger.get(place, Counter()):
                yield f"ledger {place}: {dict(ledger.get(place, {}))}, recounted {dict(mine)}"
        for station in self.stations.values():
            for port, names in ({} if station["outcome"] == "running" else station["due"]).items():
                for name, due in names.items():
                    place = (station["name"], int(port), name)
                    absent = 0
                    if name in self.ports[station["name"], int(port)].each_tick:
                        absent = len(self.ports[station["name"], int(port)].absent)
                    if sum(ledger.get(place, Counter()).values()) - absent != due:
                        yield f"stations.due {place}: {due}, ledger {ledger.get(place)}"

    # -- gaps --------------------------------------------------------------------------------------

    @cached_property
    def gaps(self) -> dict[tuple[str, int, str], list[Gap]]:
        found = {}
        for (station, number), port in self.ports.items():
            for name in dict.fromkeys((*port.each_tick, *port.due_signals)):
                gaps = port.gaps(name)
                if gaps:
                    found[station, number, name] = gaps
        return found

    def wrong_gaps(self) -> Iterator[str]:
        if "gaps" not in self.frames:
            return
        yield from self.wrong_gaps_of(self.frames["gaps"], "derived/gaps")

    def wrong_gaps_of(self, rows: pd.DataFrame, told: str) -> Iterator[str]:
        theirs: dict[tuple[str, int, str], list[tuple[int, int, int, str, bool]]] = {}
        for row in rows.itertuples(index=False):
            start, stop = micros(pd.Series([row.start, row.stop]))
            assert start is not None
            assert stop is not None
            if abs(row.seconds - (stop - start) / 1e6) > 2e-6:
                yield f"{told}: {row.seconds} s from {row.start} to {row.stop}"
            theirs.setdefault((row.station, row.port, row.signal), []).append(
                (start, stop, int(row.missing), row.reasons, bool(row.at_least))
            )
        for place in theirs.keys() | self.gaps.keys():
            mine = [gap.row() for gap in self.gaps.get(place, [])]
            other = theirs.get(place, [])
            if len(mine) != len(other) or not all(map(same_gap, mine, other)):
                yield (
                    f"{told} {place}: {told_gaps(set(other) - set(mine))}; recounted"
                    f" {told_gaps(set(mine) - set(other))}"
                )
            missing = sum(gap[2] for gap in other)
            counts = self.counted.get(place, Counter())
            if missing != sum(counts.values()) - counts["obtained"]:
                yield f"{told} {place}: {missing} missing, accounting {dict(counts)}"

    # -- verdict and metrics -----------------------------------------------------------------------

    def wrong_verdict(self) -> Iterator[str]:
        for rule in self.manifest["verdict_rules"]:
            place = (rule["station"], rule["port"], "temperature_c")
            if rule["name"] == "longest_gap" and rule["observed"] is not None:
                gaps = self.gaps.get(place, [])
                longest = max((gap.stop - gap.start for gap in gaps), default=0) / 1e6
                if abs(longest - rule["observed"]) > 5e-6:
                    yield f"verdict {place}: longest gap {rule['observed']}, recounted {longest}"
            if rule["name"] == "coverage" and rule["observed"] is not None:
                counts = self.counted.get(place, Counter())
                share = 100 * counts["obtained"] / sum(counts.values())
                if abs(share - rule["observed"]) > 1e-9:
                    yield f"verdict {place}: coverage {rule['observed']}, recounted {share}"
        events = self.frames["events"]
        for name, station in self.stations.items():
            if station["outcome"] == "running":  # cut off: its manifest has no counts
                continue
            of_station = events[events["station"] == name]
            alarms = of_station["kind"].isin(["alarm.high", "alarm.low"]).sum()
            if alarms != station["alarms"]:
                yield f"{name}: {station['alarms']} alarms, {alarms} events"
            outages = of_station["kind"].isin(["link.lost", "robot.off"]).sum()
            if outages != station["outages"]:
                yield f"{name}: {station['outages']} outages, {outages} events"

    def wrong_metrics(self) -> Iterator[str]:
        if "metrics" not in self.frames or "joints" not in self.frames:
            return
        joints = self.frames["joints"]
        for row in self.frames["metrics"].itertuples(index=False):
            told = f"metrics {row.station} {row.port} {row.metric}: {row.value}"
            if pd.isna(row.value) == pd.isna(row.why):
                yield f"{told}, why {row.why}"
            if not pd.isna(row.value) and (row.low > row.value or row.high < row.value):
                yield f"{told} is not between {row.low} and {row.high}"
            if row.coverage is not None and not pd.isna(row.coverage) and row.coverage > 100:
                yield f"{told}, coverage {row.coverage}"
            of_port = joints[(joints["station"] == row.station) & (joints["port"] == row.port)]
            port = self.ports.get((row.station, row.port))
            if port is None:
                continue
            if row.metric == "energy_permille_s" and row.n > 1 and not self.is_unpaced:
                gaps = self.gaps.get((row.station, row.port, "power_permille"), [])
                most = max((gap.missing for gap in gaps), default=0)
                if pd.isna(row.value) not in (most > 1, port.longest_run > 1):
                    yield f"{told}, with a gap of {most} readings"
            if pd.isna(row.value):
                continue
            mine = port.metric(row.metric, of_port)
            if mine is not None and not math.isclose(
                mine, row.value, rel_tol=1e-6, abs_tol=ROUNDED
            ):
                yield f"{told}, recounted {mine}"

    # -- alarms ------------------------------------------------------------------------------------

    def wrong_alarms(self) -> Iterator[str]:
        if "alarms" not in self.frames:
            return
        alarms = self.frames["alarms"]
        if alarms["episode"].duplicated().any():
            yield "alarms: two episodes with one name"
        for incident, rows in alarms.groupby("incident"):
            mains = int(rows["main"].sum())
            expected = int(rows["detector"].isin(["A", "B"]).any())
            if mains != expected:
                yield f"alarms: incident {incident} has {mains} main rows"
            elif mains and rows[rows["main"]]["detector"].iloc[0] != min(
                set(rows["detector"]), key="BAC".index
            ):
                yield f"alarms: incident {incident}: its main row is not the first of B, else of A"
            count = Counter(rows["detector"])
            witnesses = ", ".join(
                name if count[name] == 1 else f"{name} ×{count[name]}" for name in sorted(count)
            )
            if set(rows["witnesses"]) != {witnesses}:
                yield f"alarms: incident {incident}: {set(rows['witnesses'])}, not {witnesses}"
        for row in alarms.itertuples(index=False):
            yield from self._wrong_alarm(row)

    def _wrong_alarm(self, row: Any) -> Iterator[str]:
        told = f"alarm {row.episode}"
        if row.start_earliest > row.start or row.stop_earliest > row.stop:
            yield f"{told}: an interval ends before it begins"
        if row.start > row.stop or row.start > row.raised:
            yield f"{told}: stops or is raised before it starts"
        if pd.isna(row.stop) != pd.isna(row.seconds):
            yield f"{told}: stop {row.stop}, {row.seconds} s"
        if (
            not pd.isna(row.stop)
            and abs((row.stop - row.start).total_seconds() - row.seconds) > 1e-6
        ):
            yield f"{told}: {row.seconds} s from {row.start} to {row.stop}"
        if row.seconds_least > row.seconds or row.seconds_most < row.seconds:
            yield f"{told}: {row.seconds} s, {row.seconds_least} to {row.seconds_most}"
        if row.state == "active" and not pd.isna(row.stop):
            yield f"{told}: active until {row.stop}"
        port = self.ports[row.station, row.port]
        signal = f"alarm_{row.side}" if row.detector == "A" else "temperature_c"
        readings = port.readings(signal)
        start, earliest = micros(pd.Series([row.start, row.start_earliest]))
        assert start is not None
        if row.detector == "A":
            yield from self._wrong_flag(told, port, signal, start, earliest)
            return
        before = max((time for time in readings if time < start), default=None)
        if earliest is not None and (before is None or earliest > before):
            yield f"{told}: began after {earliest}; the reading before is {before}"
        if start not in readings:
            yield f"{told}: starts at {row.start}, where {signal} was not read"
        else:
            beyond = (
                readings[start] > row.limit_c
                if row.side == "high"
                else (readings[start] < row.limit_c)
            )
            if not beyond:
                yield f"{told}: starts at {readings[start]} °C, limit {row.limit_c}"
            if not pd.isna(row.stop):
                (stop,) = micros(pd.Series([row.stop]))
                assert stop is not None
                inside = [value for time, value in readings.items() if start <= time <= stop]
                furthest = max(inside) if row.side == "high" else min(inside)
                if furthest != row.peak_c:
                    yield f"{told}: peak {row.peak_c}, read {furthest}"

    def _wrong_flag(
        self, told: str, port: Port, signal: str, start: int, earliest: int | None
    ) -> Iterator[str]:
        """A flag's times are those of its answers, which lie in the scans of their rows."""
        events = self.frames["events"]
        is_lost = (events["kind"] == "alarm.unknown") & (events["station"] == port.station)
        of_port = events[is_lost & (events["port"] == port.port)]
        scans = port.scans(signal)
        scans += [(time, time, False) for time in micros(of_port["time"]) if time is not None]
        ends = [end for _, end, _ in scans if end < start]
        if earliest is not None and not any(begin <= earliest <= end for begin, end, _ in scans):
            yield f"{told}: began after {pd.Timestamp(earliest, unit='us')}, not a reading"
        if earliest is not None and ends and earliest > max(ends):
            yield f"{told}: began after {earliest}, the reading before ended at {max(ends)}"
        inside = [flag for begin, end, flag in port.scans(signal) if begin <= start <= end]
        if start <= port.times[-1] and inside != [True]:
            yield f"{told}: starts at {start}, where the flag is {inside}"

    # -- joints, units, tips -----------------------------------------------------------------------

    def tip_of(self, station: str, port: int) -> str | None:
        names: dict[str, set[str]] = {}
        for text in self.manifest["metadata"]["tips"]:
            place, separator, tip = text.rpartition("=")
            names.setdefault(place if separator else "", set()).add(tip)
        for place in (f"{station}:{port}", station, ""):
            if place in names:
                return names[place].pop() if len(names[place]) == 1 else None
        return None

    def wrong_tips(self) -> Iterator[str]:
        if "tips" not in self.tables:
            return
        rows = {
            (row["station"], row["port"]): row["tip"] for row in self.tables["tips"].to_pylist()
        }
        expected = {}
        for name, station in self.stations.items():
            for port in station["ports"]:
                tip = self.tip_of(name, port)
                if tip is not None:
                    expected[name, port] = tip
        if rows != expected:
            yield f"tips: {rows}, named were {expected}"

    def wrong_joints(self) -> Iterator[str]:
        if "joints" not in self.frames:
            return
        joints = self.frames["joints"]
        units = self.stays
        for (station, number), rows in joints.groupby(["station", "port"]):
            if rows["joint"].tolist() != list(range(1, len(rows) + 1)):
                yield f"joints {station} {number}: numbers {rows['joint'].tolist()}"
            if not rows["start_s"].is_monotonic_increasing:
                yield f"joints {station} {number}: not in order"
            if any(rows["start_s"].iloc[1:].to_numpy() < rows["stop_s"].iloc[:-1].to_numpy()):
                yield f"joints {station} {number}: one begins in another"
            times = self.ports[station, number].times
            rated = self.stations[station]["rated_power_w"]
            for row in rows.itertuples(index=False):
                told = f"joint {row.joint} of {station} {number}"
                if row.start > row.stop or row.start_s > row.stop_s:
                    yield f"{told}: stops before it starts"
                for name in ("start", "stop"):
                    (at,) = micros(pd.Series([getattr(row, name)]))
                    seconds = getattr(row, f"{name}_s")
                    assert at is not None
                    moments = [each / 1e6 - self.manifest["t0_utc"] for each in times]
                    place = min(bisect_left(moments, seconds - 1e-5), len(times) - 1)
                    if at != times[place]:
                        yield f"{told}: {name} {at}, first row after {seconds} s: {times[place]}"
                start = row.start
                inside = [
                    unit
                    for unit, begun, ended in units
                    if begun is not None and begun <= start and (ended is None or start < ended)
                ]
                unit = None if pd.isna(row.unit) else row.unit
                if unit != (inside[0] if inside else None):
                    yield f"{told}: unit {unit}, on the bench was {inside}"
                tip = None if pd.isna(row.tip) else row.tip
                if tip != self.tip_of(station, number):
                    yield f"{told}: tip {tip}"
                for relative, joules in (
                    ("energy_permille_s", "energy_j"),
                    ("heat_permille_s", "heat_j"),
                ):
                    value, energy = getattr(row, relative), getattr(row, joules)
                    if rated is None or pd.isna(value):
                        if not pd.isna(energy):
                            yield f"{told}: {joules} {energy}"
                    elif not math.isclose(energy, value * rated / 1000, abs_tol=ROUNDED):
                        yield f"{told}: {joules} {energy}, {relative} {value}"
                if row.lowest_c is not None and not pd.isna(row.depth_c):
                    port = self.ports[station, number]
                    lowest = min(value for value in port.readings("temperature_c").values())
                    if row.lowest_c < lowest:
                        yield f"{told}: lowest {row.lowest_c}, read {lowest}"
                if not 0 <= row.confidence <= 1:
                    yield f"{told}: confidence {row.confidence}"

    @cached_property
    def stays(self) -> list[tuple[str, pd.Timestamp | None, pd.Timestamp | None]]:
        """Units on the bench by the manifest, in order."""
        named = self.manifest["metadata"]["units"]
        if not self.manifest["units"]:
            if len(named) != 1:
                return [(unit, None, None) for unit in dict.fromkeys(named)]
            span = [pd.Timestamp(self.manifest[key]) for key in ("start", "stop")]
            return [(named[0], span[0], span[1])]
        stays: list[tuple[str, pd.Timestamp | None, pd.Timestamp | None]] = [
            (
                unit["unit"],
                pd.Timestamp(unit["start"]),
                None if unit["stop"] is None else pd.Timestamp(unit["stop"]),
            )
            for unit in self.manifest["units"]
        ]
        read = {unit for unit, _, _ in stays}
        return stays + [(unit, None, None) for unit in dict.fromkeys(named) if unit not in read]

    def wrong_units(self) -> Iterator[str]:
        if "units" not in self.frames:
            return
        units = self.frames["units"]
        theirs = [
            (row.unit, *(None if pd.isna(time) else time for time in (row.start, row.stop)))
            for row in units.itertuples(index=False)
        ]
        if theirs != self.stays:
            yield f"units: {theirs}, manifest {self.stays}"
            return
        alarms, joints = self.frames["alarms"], self.frames["joints"]
        for row in units.itertuples(index=False):
            told = f"unit {row.unit}"
            if pd.isna(row.start) or pd.isna(row.stop):
                figures = [row.joints, row.energy_j, row.coverage, row.alarms]
                if not all(pd.isna(figure) for figure in figures):
                    yield f"{told}: without times, and {figures}"
                continue
            if row.start > row.stop:
                yield f"{told}: ends before it starts"
            inside = joints[(joints["start"] >= row.start) & (joints["start"] < row.stop)]
            if not pd.isna(row.joints) and row.joints != len(inside):
                yield f"{told}: {row.joints} joints, {len(inside)} begin in it"
            counted = alarms[alarms["main"]]
            still = counted["stop"].isna() | (counted["stop"] >= row.start)
            on = counted[(counted["start"] < row.stop) & still]
            if row.alarms != on["incident"].nunique():
                yield f"{told}: {row.alarms} alarms, {on['incident'].nunique()} were on"
            begun, ended = micros(pd.Series([row.start, row.stop]))
            assert begun is not None
            assert ended is not None
            due = obtained = 0
            energy: float | None = 0.0
            for (station, _), port in self.ports.items():
                for name in ("temperature_c", "power_permille"):
                    was_due, was_obtained = port.counts_between(name, begun, ended)
                    due, obtained = due + was_due, obtained + was_obtained
                rated = self.stations[station]["rated_power_w"]
                if energy is None or rated is None or port.is_hidden(begun, ended):
                    energy = None
                else:
                    energy += port.energy_between(begun, ended) * rated / 1000
            coverage = None if due == 0 else 100 * obtained / due
            if coverage is None or pd.isna(row.coverage):
                if (coverage is None) != pd.isna(row.coverage):
                    yield f"{told}: coverage {row.coverage}, recounted {coverage}"
            elif abs(coverage - row.coverage) > ROUNDED:
                yield f"{told}: coverage {row.coverage}, recounted {coverage}"
            if energy is None and not pd.isna(row.energy_j):
                yield f"{told}: energy {row.energy_j}, where readings or powers are missing"
            elif energy is not None and abs(energy - row.energy_j) > 2 * ROUNDED:
                yield f"{told}: energy {row.energy_j} J, recounted {energy}"

    # -- clock -------------------------------------------------------------------------------------

    def wrong_clock(self) -> Iterator[str]:
        manifest, events = self.manifest, self.frames["events"]
        steps = manifest["clock_steps"]
        seen = events[events["kind"] == "clock.step"]
        if [step["step_s"] for step in steps] != seen["value"].tolist()[: len(steps)]:
            yield f"clock_steps {steps}, events {seen['value'].tolist()}"
        offset = 0.0
        for step in steps:
            offset += step["step_s"]
            if abs(offset - step["offset_s"]) > 0.5:
                yield f"clock_steps: offset {step['offset_s']}, sum of the steps {offset}"
        start, stop = at_us(manifest["start"]), at_us(manifest["stop"])
        if abs(start - manifest["t0_utc"] * 1e6) > 5e6:
            yield f"manifest: start {start}, t0_utc {manifest['t0_utc']}"
        for name in RECORDED:
            times = [time for time in micros(self.frames[name]["time"]) if time is not None]
            if times and (min(times) < start - 1_000_000 or max(times) > stop):
                yield f"{name}: times beyond start and stop"


def hashed(row: dict[str, Any]) -> str:
    """The hash of an event, as tables.md says."""
    cells = {
        name: None if value is None or name not in ("time", "earliest") else at_us(value)
        for name, value in row.items()
        if name != "run"
    }
    cells |= {name: value for name, value in row.items() if name not in ("run", "time", "earliest")}
    text = json.dumps(cells, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def reason_column(reason: str) -> str:
    """The accounting's column of a reason."""
    if re.fullmatch(r"nak\d+", reason):
        return "nak"
    names = [column.name for column in documented()["accounting"][6:]]
    return reason if reason in names else "other"


def same_gap(mine: tuple[int, int, int, str, bool], other: tuple[int, int, int, str, bool]) -> bool:
    near = all(abs(a - b) <= ROUNDING_US for a, b in zip(mine[:2], other[:2], strict=True))
    return near and mine[2:] == other[2:]


def told_gaps(gaps: Iterable[tuple[int, int, int, str, bool]]) -> str:
    return ", ".join(
        f"{pd.Timestamp(start, unit='us'):%T.%f}–{pd.Timestamp(stop, unit='us'):%T.%f}"
        f" {missing} {reasons}{' at least' if at_least else ''}"
        for start, stop, missing, reasons, at_least in sorted(gaps)[:3]
    )


class Port:
    """The samples of one port, in the order of `seq`."""

    def __init__(self, folder: Folder, station: str, port: int, rows: pd.DataFrame) -> None:
        self.folder, self.station, self.port = folder, station, port
        self.rows = rows
        self.ticks = [int(tick) for tick in rows["tick"]]
        self.times = [time for time in micros(rows["time"]) if time is not None]
        self.reasons = [parsed(text) for text in rows["reasons"]]

    @cached_property
    def due_signals(self) -> list[str]:
        """The signals that were due in some row."""
        of_rows = [name for row in self.reasons for name, _ in row]
        signals = [column.name for column in documented()["samples"][10:]]
        read = [name for name in signals if name not in COMPANIONS and self.rows[name].count()]
        return [name for name in dict.fromkeys([*read, *of_rows]) if name not in COMPANIONS]

    @cached_property
    def each_tick(self) -> list[str]:
        """The signals that were due in every row: temperature, power and status, and others."""
        named = [set(dict(row)) for row in self.reasons]
        return [
            name
            for name in self.due_signals
            if all(
                is_read or name in names
                for is_read, names in zip(self.rows[name].notna(), named, strict=True)
            )
        ]

    @cached_property
    def absent(self) -> list[int]:
        """Ticks without a row."""
        station = self.folder.stations[self.station]
        if self.folder.period_s(self.station) is None:
            return []
        here = set(self.ticks)
        first, last = station["first_tick"], station["last_tick"]
        if station["outcome"] == "running":  # cut off: from row to row
            first, last = self.ticks[0], self.ticks[-1]
        return [tick for tick in range(first, last + 1) if tick not in here]

    def readings(self, signal: str) -> dict[int, Any]:
        """Values by time."""
        values = self.rows[signal]
        return {
            time: value.item() if isinstance(value, np.generic) else value
            for time, value in zip(self.times, values, strict=True)
            if not pd.isna(value)
        }

    def scans(self, signal: str) -> list[tuple[int, int, Any]]:
        """Begin and end of the scan of each row with a value, in µs."""
        found = []
        for tick, row in zip(self.ticks, self.rows.itertuples(index=False), strict=True):
            value, late, scan = getattr(row, signal), row.late_us, row.scan_us
            if not pd.isna(value) and not pd.isna(scan):
                (time,) = micros(pd.Series([row.time]))
                assert time is not None
                begin = time - int(scan) if pd.isna(late) else self.due_us(tick, 0) + int(late)
                end = begin + int(scan) * (2 if pd.isna(late) else 1)
                found.append((begin - ROUNDING_US, end + ROUNDING_US, bool(value)))
        return found

    @cached_property
    def longest_run(self) -> int:
        """How many ticks in a row have no reading of the power, at most."""
        ticks = [
            tick
            for tick, is_read in zip(self.ticks, self.rows["power_permille"].notna(), strict=True)
            if is_read
        ]
        runs = [later - earlier - 1 for earlier, later in pairwise(ticks)]
        edges = [ticks[0] - self.ticks[0], self.ticks[-1] - ticks[-1]] if ticks else []
        return max(runs + edges, default=0)

    def due_us(self, tick: int, time: int) -> int:
        due = self.folder.due_us(self.station, tick)
        return time if due is None else due

    def missing(self, signal: str) -> list[tuple[int, int, str]]:
        """Tick, moment and reason of each reading that was due and is missing, in order. A row
        without an answer has the time of a late answer before it.
        """
        found = [
            (tick, time, dict(reasons)[signal])
            for tick, time, reasons in zip(self.ticks, self.times, self.reasons, strict=True)
            if signal in dict(reasons)
        ]
        if signal in self.each_tick:
            found += [(tick, self.due_us(tick, 0), "no_rows") for tick in self.absent]
        return sorted(found)

    def gaps(self, signal: str) -> list[Gap]:
        """Gaps by the definition of record.md. At the start and end of the record they begin and
        stop at rows.
        """
        missing = self.missing(signal)
        obtained = ~self.rows[signal].isna().to_numpy()
        at = [time for time, is_read in zip(self.times, obtained, strict=True) if is_read]
        gaps: dict[int, Gap] = {}
        stops = [moment for _, moment, _ in missing[-1:]]
        pauses = self.pauses(signal, at)
        for weight, (_, moment, reason) in sorted(
            [(1, each) for each in missing] + [(0, each) for each in pauses],
            key=lambda weighed: (*weighed[1][:2], -weighed[0]),
        ):
            before = bisect_left(at, moment)
            if before not in gaps:
                start = at[before - 1] if before else self.first_due_us(signal)
                stop = at[before] if before < len(at) else stops[0]
                is_open = before == 0 or before == len(at)
                gaps[before] = Gap(start, stop, at_least=is_open)
            gaps[before].missing += weight
            gaps[before].reasons.append(reason)
        return [gaps[number] for number in sorted(gaps)]

    def first_due_us(self, signal: str) -> int:
        """Time of the first row in which a reading was due, obtained or not."""
        read = self.rows[signal].notna()
        due = [
            time
            for time, reasons, is_read in zip(self.times, self.reasons, read, strict=True)
            if is_read or signal in dict(reasons)
        ]
        absent = self.absent if signal in self.each_tick else []
        return min(due[:1] + [self.due_us(tick, 0) for tick in absent[:1]])

    def pauses(self, signal: str, at: list[int]) -> list[tuple[int, int, str]]:
        """Pauses between rows of a run without a grid, as `missing`; no reading is due in them."""
        if self.folder.period_s(self.station) is not None or signal not in self.each_tick:
            return []
        return [
            (tick, earlier + 1, "no_rows")
            for tick, (earlier, later) in zip(self.ticks, pairwise(self.times), strict=False)
            if later - earlier > PAUSE_US
        ]

    def counts_between(self, signal: str, start: int, stop: int) -> tuple[int, int]:
        """Readings due and obtained at `start` ≤ time < `stop`."""
        obtained = sum(start <= time < stop for time in self.readings(signal))
        due = obtained
        for time, reasons in zip(self.times, self.reasons, strict=True):
            due += start <= time < stop and signal in dict(reasons)
        for tick in self.absent:
            due += start <= self.due_us(tick, 0) < stop
        return due, obtained

    def is_hidden(self, start: int, stop: int) -> bool:
        """Whether a gap of more than one reading, or a pause, hides something of this time."""
        return any(
            gap.start <= stop and gap.stop >= start and gap.missing != 1
            for name in ("temperature_c", "power_permille")
            for gap in self.folder.gaps.get((self.station, self.port, name), [])
        )

    def energy_between(self, start: int, stop: int) -> float:
        """‰·s of the power readings by trapezoids, those at the edges in proportion."""
        total = 0.0
        for (earlier, first), (later, second) in pairwise(self.readings("power_permille").items()):
            inside = min(later, stop) - max(earlier, start)
            if inside > 0:
                total += (first + second) / 2 * inside / 1e6
        return total

    def metric(self, name: str, joints: pd.DataFrame) -> float | None:
        """A metric whose definition needs no more than rows and joints; None for others."""
        rows = self.rows
        power = rows["power_permille"]
        working = rows["status"].isin(["working", "on"]) & self.in_place
        if name == "joints":
            return float(len(joints))
        if name == "joints_not_recovered":
            return float((joints["recovered"] == False).sum())  # noqa: E712  # null is neither
        if name == "joints_fed_alone":
            return float((joints["touches"] == 0).sum())
        if name in SUMMED:
            return float(joints[SUMMED[name]].median())
        if name == "power_mean_permille":
            return float(power[working].mean())
        if name == "duty_percent":
            of_work = power[working].dropna()
            return 100 * float((of_work >= 500).mean())
        if name == "utilisation_percent":
            return 100 * float(working[~rows["status"].isna()].mean())
        period = self.folder.period_s(self.station)
        if name in ("energy_permille_s", "energy_recorded_permille_s") and period is not None:
            readings = list(self.readings("power_permille").values())
            seconds = list(self.grid_s("power_permille").values())
            return sum(
                (first + second) / 2 * (later - earlier)
                for (earlier, first), (later, second) in pairwise(
                    zip(seconds, readings, strict=True)
                )
                if later - earlier < BRIDGED * period + 1e-6
            )
        return None

    @cached_property
    def in_place(self) -> pd.Series:
        """The rows between two readings of one tool, and of a port that works."""
        tool, error = self.rows["tool"], self.rows["port_error"]
        before, after = tool.ffill(), tool.bfill()
        is_same = (before == after) | before.isna() | after.isna()
        is_there = (before.fillna(1) > 0) & (after.fillna(1) > 0)
        fits = pd.Series(True, index=self.rows.index)
        if self.folder.stations[self.station]["family"] != "jtse":
            works = error.isin([0, 9]).astype("boolean").mask(error.isna())
            fits = works.ffill().fillna(True) & works.bfill().fillna(True)
        return (is_same & is_there & fits).astype(bool)

    def grid_s(self, signal: str) -> dict[int, float]:
        """Seconds on the run's grid by time, of the rows with a reading."""
        period = self.folder.period_s(self.station)
        is_read = ~self.rows[signal].isna()
        return {
            time: time / 1e6 - self.folder.manifest["t0_utc"] if period is None else tick * period
            for time, tick, obtained in zip(self.times, self.ticks, is_read, strict=True)
            if obtained
        }

    # -- rows --------------------------------------------------------------------------------------

    def wrong_rows(self) -> Iterator[str]:
        told = f"samples {self.station} {self.port}"
        if any(later <= earlier for earlier, later in pairwise(self.ticks)):
            yield f"{told}: ticks are not unique and in order"
        if any(later < earlier for earlier, later in pairwise(self.times)):
            yield f"{told}: time steps back"
        station = self.folder.stations[self.station]
        first, last = station["first_tick"], station["last_tick"]
        if station["outcome"] != "running" and (self.ticks[0] < first or self.ticks[-1] > last):
            yield f"{told}: ticks from {self.ticks[0]} to {self.ticks[-1]}, not {first} to {last}"
        before = 0
        names = [column.name for column in documented()["samples"]]
        for at, row in enumerate(self.rows.itertuples(index=False)):
            reasons = dict(self.reasons[at])
            place = f"{told} tick {self.ticks[at]}"
            if len(reasons) != len(self.reasons[at]):
                yield f"{place}: a reason stands twice: {row.reasons}"
            for name, reason in reasons.items():
                if name not in names[10:]:
                    yield f"{place}: reason of {name}"
                elif not pd.isna(getattr(row, name)):
                    yield f"{place}: {name} has a value and a reason"
                if reason_column(reason) == "other":
                    yield f"{place}: {reason} is no reason of the page"
            for name, of in COMPANIONS.items():
                has = not self.rows[name].isna().all() or name in reasons
                if has and reasons.get(name) != reasons.get(of):
                    yield f"{place}: {name} {reasons.get(name)}, {of} {reasons.get(of)}"
                if has and pd.isna(getattr(row, name)) != pd.isna(getattr(row, of)):
                    yield f"{place}: {name} and {of} are of one answer"
            worst = [
                word
                for word in severities()
                if word in {reason_column(reason) for reason in reasons.values()}
            ]
            if row.quality != (worst or ["ok"])[0]:
                yield f"{place}: quality {row.quality}, reasons {row.reasons}"
            yield from self._wrong_time(place, row, reasons, self.times[at], before)
            before = self.times[at]

    def _wrong_time(
        self, place: str, row: Any, reasons: dict[str, str], time: int, before: int
    ) -> Iterator[str]:
        due = self.folder.due_us(self.station, int(row.tick))
        if (due is None) != pd.isna(row.late_us) and row.quality not in UNANSWERED:
            yield f"{place}: late_us {row.late_us}"
        if due is None:
            return
        if time < due - ROUNDING_US:
            yield f"{place}: {due - time} µs before it was due"
        reason = reasons.get("temperature_c")
        if reason in UNANSWERED and abs(time - max(due, before)) > ROUNDING_US:
            yield f"{place}: {reason} at {time}, due {due}, row before {before}"
        if not pd.isna(row.temperature_c) and not pd.isna(row.late_us):
            asked = due + int(row.late_us)
            if not asked - ROUNDING_US <= time <= asked + int(row.scan_us) + ROUNDING_US:
                yield f"{place}: read at {time}, asked at {asked}, scan {row.scan_us}"


def parsed(text: object) -> list[tuple[str, str]]:
    """Signal and reason of each word of `reasons`."""
    if text is None or pd.isna(text):
        return []
    words = str(text).split(";")
    return [(word.partition("=")[0], word.partition("=")[2]) for word in words]
