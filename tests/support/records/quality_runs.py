"""Three runs of a bench as a quality engineer has them, on a clock that jumps: serials from a
barcode reader, tips, two operators; in the last run a station is silent, a cable is pulled, a tool
is taken out, and one tip gets too hot twice.

``python tests/support records.quality_runs DIR`` makes them.
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from jbclog.app.run.options import Metadata
from jbclog.app.run.run_record import RunRecord
from jbclog.app.run.unit_feed import UnitFeed
from jbclog.core.clock import VirtualClock
from jbclog.transport.typed_lines import LineSource
from jbclog.transport.virtual import VirtualDriver
from support.readers.repository import ROOT
from support.records.derived import derive
from support.virtual.recorded_run import RecordedRun, plan_in

FIRST: Final = datetime(2026, 11, 24, 6, 30, tzinfo=UTC)
SECONDS: Final = 120.0
FAULTS: Final = {
    "dde-1": (
        'kind = "silence"\nat_s = 40\nfor_s = 2',
        'kind = "tool"\nat_s = 75\nfor_s = 5\nport = 1\ncode = 0',
    ),
    "dde-2": ('kind = "dropout"\nat_s = 58\nfor_s = 20',),
    "ucr-1": (
        'kind = "overheat"\nat_s = 50\nfor_s = 5\nby_c = 25',
        'kind = "overheat"\nat_s = 90\nfor_s = 4\nby_c = 25',
    ),
}
TIPS: Final = ("dde-1:1=T-17", "dde-1:2=T-18", "dde-2:1=T-19", "dde-2:2=T-20", "ucr-1=T-21")


@dataclass(frozen=True)
class Lot:
    """What is typed at the start of one run, and when each serial is read."""

    operator: str
    order: str
    serials: dict[float, str]
    tips: tuple[str, ...]
    units: tuple[str, ...] = ()
    has_faults: bool = False


LOTS: Final = (
    Lot("A. Rossi", "88123", {12: "SN-0091", 45: "SN-0092", 80: "SN-0093"}, TIPS),
    Lot("A. Rossi", "88125", {}, ("dde-1:1=T-17",), units=("SN-0111", "SN-0112")),
    Lot(
        "M. Bianchi",
        "88124",
        {10: "SN-0101", 30: "SN-0102", 56: "SN-0103", 85: "SN-0104"},
        TIPS,
        has_faults=True,
    ),
)


def make_runs(out: Path) -> list[Path]:
    """The three sealed runs below `out` with their derived tables, oldest first."""
    return [_record(lot, out, number) for number, lot in enumerate(LOTS)]


def _record(lot: Lot, out: Path, number: int) -> Path:
    line = (ROOT / "profiles/lines/bench.toml").read_text(encoding="utf-8")
    recipe = (ROOT / "profiles/recipes/sn100c-tht.toml").read_text(encoding="utf-8")
    line = line.replace("[station.sim]\n", f"[station.sim]\nseed = {number}\n")
    if lot.has_faults:
        line = _with_faults(line)
    metadata = Metadata(lot.operator, lot.order, "controller C4", lot.units, tips=lot.tips)
    clock = VirtualClock(utc=(FIRST + timedelta(days=number)).timestamp())
    with tempfile.TemporaryDirectory() as aside:
        plan = plan_in(Path(aside), line, recipe, SECONDS, metadata=metadata)
        reader = BarcodeReader(lot.serials)
        folder = RecordedRun(plan, out, clock, reader.plan).result.folder
    derive(folder)
    return folder


def _with_faults(line: str) -> str:
    tables = line.split("[[station]]\n")
    for name, faults in FAULTS.items():
        (place,) = [at for at, table in enumerate(tables) if f'name = "{name}"' in table]
        tables[place] += "".join(f"[[station.sim.fault]]\n{fault}\n\n" for fault in faults)
    return "[[station]]\n".join(tables)


class BarcodeReader:
    """Types each serial at its second into the feed that `jbclog run --units -` has."""

    def __init__(self, serials: dict[float, str]) -> None:
        self._serials = serials

    def plan(self, record: RunRecord, driver: VirtualDriver) -> None:
        if not self._serials:
            return
        reading, writing = os.pipe()
        feed = UnitFeed(
            LineSource(reading, "stdin"),
            lambda event: record.journal.event(event, at_once=True),
            lambda: record.utc.micros(record.clock.monotonic()),
        )

        def read(serial: str) -> None:
            os.write(writing, f"{serial}\n".encode())
            feed.look()

        def close() -> None:
            feed.finish()
            os.close(writing)

        for second, serial in self._serials.items():
            driver.at(record.t0 + second - 0.1, feed.look)
            driver.at(record.t0 + second, lambda serial=serial: read(serial))  # type: ignore[misc]
        driver.at(record.t0 + SECONDS, close)


if __name__ == "__main__":
    for run in make_runs(Path(sys.argv[1])):
        print(run)
