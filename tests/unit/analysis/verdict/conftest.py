"""Sealed tables for a judge: one station, one port unless told otherwise, 10 Hz, idling at its
setting.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbclog.analysis.verdict import Evidence, Targets
from jbclog.core.rows import StationFacts
from jbclog.record.schema import SCHEMAS, SEQ

UTC_US = 1_790_000_000_000_000
STAMP = pa.timestamp("us", tz="UTC")


@dataclass
class Tip:
    """What one port reads at each tick; None: nothing was read."""

    seconds: float = 60.0
    hz: float = 10.0
    temperature: list[int | None] = field(default_factory=list)
    power: list[int | None] = field(default_factory=list)
    setting: list[int | None] = field(default_factory=list)
    status: list[str | None] = field(default_factory=list)
    tool: list[int | None] = field(default_factory=list)
    port_error: list[int | None] = field(default_factory=list)
    extractor: bool = False
    skipped: set[int] = field(default_factory=set)  # rows that the computer had no time for

    def __post_init__(self) -> None:
        n = round(self.seconds * self.hz)
        self.temperature = [350] * n
        self.power = [60] * n
        self.setting = [350 if i % round(5 * self.hz) == 0 else None for i in range(n)]
        self.status = ["working"] * n
        self.tool = [2 if i % round(5 * self.hz) == 0 else None for i in range(n)]
        self.port_error = [0 if i % round(2 * self.hz) == 0 else None for i in range(n)]

    def lose(self, start_s: float, seconds: float) -> Tip:
        """Nothing at all was read for `seconds`."""
        for i in range(round(start_s * self.hz), round((start_s + seconds) * self.hz)):
            self.temperature[i] = self.power[i] = self.status[i] = self.setting[i] = None
        return self

    def skip(self, start_s: float, seconds: float) -> Tip:
        """The computer was busy for `seconds`."""
        self.skipped |= set(range(round(start_s * self.hz), round((start_s + seconds) * self.hz)))
        return self.lose(start_s, seconds)

    def quality(self, row: int) -> str:
        return (
            "ok"
            if self.temperature[row] is not None
            else "skipped"
            if row in self.skipped
            else "timeout"
        )

    def reasons(self, row: int) -> str | None:
        quality = self.quality(row)
        return None if quality == "ok" else f"temperature_c={quality};power_permille={quality}"

    def at(self, start_s: float, seconds: float, temperature: int, power: int) -> Tip:
        for i in range(round(start_s * self.hz), round((start_s + seconds) * self.hz)):
            self.temperature[i], self.power[i] = temperature, power
        return self


def complete(rows: pa.Table, name: str) -> pa.Table:
    """Return the rows with all columns of a table, empty where nothing was given."""
    columns = []
    for entry in SCHEMAS[name]:
        if entry.name in rows.column_names and (entry.nullable or not rows[entry.name].null_count):
            column = rows[entry.name]
        elif entry.nullable:
            column = pa.nulls(len(rows), entry.type)
        elif entry.name == SEQ:
            column = pa.array(range(len(rows)))
        else:
            column = pa.array([0] * len(rows))
        columns.append(column.cast(entry.type))
    return pa.table(columns, schema=SCHEMAS[name])


class Case:
    """Tables in a folder and the evidence over them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.stations: list[StationFacts] = []
        self.ledger: dict[str, dict[str, dict[str, dict[str, int]]]] = {}
        self.event_rows: list[dict[str, object]] = []
        self.setting_rows: list[dict[str, object]] = []
        self.parts = 0
        self.exit_status = "success"
        self.targets: dict[str, Targets] = {}

    def station(
        self, name: str, *tips: Tip, outcome: str = "completed", skipped: int = 0
    ) -> StationFacts:
        """A station with one port for each tip, its ledger as the session would count it, its
        samples sealed as one part.
        """
        ports = range(1, len(tips) + 1)
        facts = StationFacts(
            name,
            "/dev/x",
            "dde",
            ports=list(ports),
            touched=list(ports),
            outcome=outcome,
            skipped=skipped,
        )
        facts.period_s, facts.first_tick = 1 / tips[0].hz, 0
        facts.last_tick = len(tips[0].temperature) - 1 + skipped
        self.stations.append(facts)
        for port, tip in zip(ports, tips, strict=True):
            ok = sum(value is not None for value in tip.temperature)
            due, without = len(tip.temperature) + skipped, skipped + len(tip.skipped)
            counts = {"due": due, "ok": ok, "timeout": due - ok - without, "skipped": without}
            self.ledger.setdefault(name, {})[str(port)] = {
                "temperature_c": counts,
                "alarm_high": {"due": 30, "ok": 30},
            }
        self.seal([(name, port, tip) for port, tip in zip(ports, tips, strict=True)])
        return facts

    def seal(self, tips: list[tuple[str, int, Tip]], first_tick: int = 0) -> None:
        """Write the tips as one part of `samples`, interleaved tick by tick as by a recorder."""
        n = len(tips[0][2].temperature)
        rows = [(i, name, port, tip) for i in range(n) for name, port, tip in tips]
        ticks = [first_tick + i for i, *_ in rows]
        table = pa.table(
            {
                "time": pa.array(
                    [UTC_US + round(1e6 * tick / tips[0][2].hz) for tick in ticks], STAMP
                ),
                "tick": pa.array(ticks, pa.int64()),
                "station": pa.array([name for _, name, _, _ in rows]).dictionary_encode(),
                "quality": pa.array([tip.quality(i) for i, _, _, tip in rows]).dictionary_encode(),
                "reasons": (
                    pa.array([tip.reasons(i) for i, _, _, tip in rows], pa.string())
                ).dictionary_encode(),
                "port": pa.array([port for _, _, port, _ in rows], pa.int64()),
                "temperature_c": pa.array(
                    [tip.temperature[i] for i, _, _, tip in rows], pa.int64()
                ),
                "power_permille": pa.array([tip.power[i] for i, _, _, tip in rows], pa.int64()),
                "status": (
                    pa.array(
                        [tip.status[i] for i, _, _, tip in rows], pa.string()
                    ).dictionary_encode()
                ),
                "cooling": pa.array([tip.extractor for *_, tip in rows], pa.bool_()),
                "setpoint_c": pa.array([tip.setting[i] for i, _, _, tip in rows], pa.int64()),
                "tool": pa.array([tip.tool[i] for i, _, _, tip in rows], pa.int64()),
                "port_error": pa.array([tip.port_error[i] for i, _, _, tip in rows], pa.int64()),
            }
        )
        self._write("samples", table, self.parts)
        self.parts += 1

    def event(
        self,
        kind: str,
        severity: str,
        station: str | None = None,
        port: int | None = None,
        text: str = "It happened.",
        **more: object,
    ) -> None:
        place = {"kind": kind, "severity": severity, "station": station, "port": port, "text": text}
        self.event_rows.append({**place, **more})

    def setting(
        self,
        station: str,
        outcome: str,
        setting: str = "adjust",
        requested: str | None = "0",
        port: int | None = None,
    ) -> None:
        row = {
            "station": station,
            "setting": setting,
            "requested": requested,
            "outcome": outcome,
            "port": port,
        }
        self.setting_rows.append(row)

    def ask(
        self, station: str, status: str | None, *ports: int, heated: tuple[int, ...] = (1,)
    ) -> None:
        """The recipe sets the temperature of the ports `heated`; those of `ports` were told
        `status` at the start.
        """
        self.targets[station] = Targets(frozenset(heated), status)
        for port in ports:
            self.setting(station, "confirmed", "status", "00000", port)

    def _write(self, name: str, table: pa.Table, part: int = 0) -> None:
        (self.folder / name).mkdir(exist_ok=True)
        table = complete(table, name)
        pq.write_table(table, self.folder / name / f"part-{part:04d}.parquet")

    def evidence(self) -> Evidence:
        """Everything said so far, sealed."""
        texts = {
            "kind": pa.string(),
            "severity": pa.string(),
            "station": pa.string(),
            "port": pa.int64(),
            "text": pa.string(),
        }
        texts |= {"time": STAMP, "value": pa.float64(), "raw": pa.string()}
        self._write("events", pa.Table.from_pylist(self.event_rows, pa.schema(texts)))
        columns = dict.fromkeys(
            ("station", "setting", "requested", "outcome", "readback"), pa.string()
        ) | {"port": pa.int64()}
        self._write("settings", pa.Table.from_pylist(self.setting_rows, pa.schema(columns)))
        return Evidence(
            self.folder, self.stations, self.ledger, self.exit_status, targets=self.targets
        )


@pytest.fixture
def case(tmp_path: Path) -> Case:
    return Case(tmp_path)


@pytest.fixture
def tip() -> Callable[..., Tip]:
    return Tip


@pytest.fixture
def noise() -> Callable[[int], list[int]]:
    return lambda n: [int(v) for v in np.random.default_rng(7).integers(-1, 2, n)]
