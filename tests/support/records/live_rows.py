"""A run that is being recorded now, row by row as a test wants it: through the real live store,
with times of now.

``python tests/support records.live_rows DIR`` records two ports until it is killed, or ends the run
at a line on stdin.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from jbclog.core.rows import (
    COLUMN,
    SAMPLE_COLUMNS,
    CounterRow,
    EventRow,
    SampleRow,
    SettingRow,
    Severity,
    StationFacts,
)
from jbclog.record.conclude import conclude
from jbclog.record.folder import create_run
from jbclog.record.manifest import LineFile, Manifest, Metadata, iso, write_manifest
from jbclog.record.seal import seal_journal
from support.product import open_store, seal_part
from support.records import sealed_run

PERIOD_S = 0.1
NAME = "dde-1"
SOLDERED_ROWS = 1500


def now_us() -> int:
    return time.time_ns() // 1000


@dataclass
class Recording:
    """A store started in a new folder below `out`, with the manifest of a run in progress."""

    out: Path
    ports: tuple[int, ...] = (1, 2)
    tick: int = 0
    began_us: int = field(default_factory=now_us)

    def __post_init__(self) -> None:
        self.folder = create_run(self.out, "bench", self.began_us / 1e6)
        self.facts = StationFacts(
            NAME,
            "a.pty",
            "dde",
            ports=list(self.ports),
            tool_names=dict.fromkeys(self.ports, "T210"),
        )
        self.facts.period_s, self.facts.rate_hz, self.facts.signals = (
            PERIOD_S,
            1 / PERIOD_S,
            ["temperature_c", "power_permille"],
        )
        self.manifest = Manifest(
            self.folder.name,
            start=iso(self.began_us),
            line=LineFile("bench", "line.toml", "0" * 64),
        )
        self.manifest.metadata = Metadata(operator="A. Rossi", order="88123")
        self.manifest.stations = [StationFacts(NAME, "a.pty", "dde", ports=list(self.ports))]
        write_manifest(self.folder, self.manifest)
        self.store = open_store(self.folder, seal_every_s=None)
        self.store.start()
        self.store.facts(self.facts)

    def rows(self, count: int, **columns: object) -> None:
        """Hand over the next `count` rows of each port; the newest was read just now. `columns`:
        instead of 350 °C and 100 ‰.
        """
        first_us = now_us() - round((count - 1) * PERIOD_S * 1e6)
        for number in range(count):
            for port in self.ports:
                self.store.sample(
                    self.row(port, first_us + round(number * PERIOD_S * 1e6), **columns)
                )
            self.tick += 1

    def row(self, port: int, time_us: int, **columns: object) -> SampleRow:
        row: SampleRow = [None] * len(SAMPLE_COLUMNS)
        plain = {
            "quality": "ok",
            "temperature_c": 350,
            "power_permille": 100,
            "setpoint_c": 350,
            "status": "working",
        }
        for name, value in {
            "time": time_us,
            "tick": self.tick,
            "station": NAME,
            "port": port,
            **plain,
            **columns,
        }.items():
            row[COLUMN[name]] = value
        return row

    def event(
        self,
        kind: str,
        text: str,
        port: int | None = None,
        *,
        station: str | None = NAME,
        raw: str | None = None,
    ) -> None:
        self.store.event(EventRow(now_us(), kind, Severity.WARNING, text, station, port, raw=raw))

    def setting(self, name: str, value: str) -> None:
        self.store.setting(
            SettingRow(
                now_us(), NAME, 1, "T210", name, "°C", value, value, value, None, "confirmed"
            )
        )

    def counter(self, name: str, value: float) -> None:
        self.store.counter(CounterRow(now_us(), NAME, 1, name, value, "h", str(value)))

    def commit(self) -> None:
        self.store.commit_now()

    def seal_part(self) -> None:
        """Do what the hourly child does."""
        self.commit()
        seal_part(self.folder)

    def close(self) -> None:
        self.store.close()

    def finalize(self) -> None:
        """End the run and finalize its record."""
        self.facts.outcome = "completed"
        self.store.facts(self.facts)
        self.close()
        seal_journal(self.folder)
        ended = Manifest(
            self.folder.name,
            exit_status="success",
            exit_code=0,
            verdict="ACCEPT",
            start=self.manifest.start,
        )
        ended.stations = [self.facts]
        conclude(self.folder, ended, self.store.lock)

    def abandon(self) -> None:
        """End what this process holds, so that no thread and no file outlives the test."""
        self.store.close()
        self.store.release()


class Soldering(Recording):
    """Port 1 solders a joint each five seconds; port 2 has no rows. `tool` is its tool's code."""

    tool: int | None = None

    def solder(self, through: int) -> None:
        columns = sealed_run.samples(SOLDERED_ROWS)
        temperature, power = (
            columns["temperature_c"].astype(int).tolist(),
            columns["power_permille"].astype(int).tolist(),
        )
        for tick in range(self.tick, through):
            time_us = self.began_us + tick * 100_000
            measured = {"temperature_c": temperature[tick], "power_permille": power[tick]}
            self.store.sample(self.row(1, time_us, tool=self.tool, **measured))
            self.tick += 1
        self.commit()


def main(arguments: Iterable[str]) -> None:
    recording = Recording(Path(*arguments))
    print(recording.folder.name, flush=True)
    while True:
        recording.rows(1)
        recording.store.commit_now()
        time.sleep(PERIOD_S)


if __name__ == "__main__":
    main(sys.argv[1:])
