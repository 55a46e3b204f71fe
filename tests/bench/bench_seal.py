"""What storing and sealing cost: ``python tests/bench/bench_seal.py [--stations 32] [--minutes
60]``.

An hour of 32 stations at 10 Hz, a quarter of them with a second port: random walks around the
setpoint, solder joints, sensor noise, realistic lateness, slow signals at their periods. It goes
through the real store a second at a time, each second committed and synced, and is then sealed in
the child process as in `run`. pandas writes the same table with its defaults in the same run, for
comparison.

The limits: 1.5 ms of CPU per 1 000 rows stored, 8 bytes per sealed row, 5 s to seal the hour.
"""

from __future__ import annotations

import argparse
import random
import resource
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from jbclog.core.locks import FolderLock
from jbclog.core.rows import COLUMN, SAMPLE_COLUMNS, SampleRow, StationFacts
from jbclog.record.batches import encode, keep_pandas_out
from jbclog.record.folder import create_run
from jbclog.record.live import RowBuffer
from jbclog.record.parts import part_paths
from jbclog.record.seal_child import seal_in_child
from jbclog.record.store import StoreWriter

HZ = 10
T0 = 1_790_000_000_000_000
PERIOD_US = 1_000_000 // HZ


class Tool:
    """One port of one station, and the shape of its rows."""

    def __init__(self, rng: random.Random, station: int, port: int, phase_us: int) -> None:
        self.rng, self.name, self.port, self.phase_us = rng, f"dde-{station:02d}", port, phase_us
        self.temperature, self.power, self.joint = 350.0, 120.0, 0
        self.set_c = rng.choice((330, 350, 380))
        self.temperature = float(self.set_c)

    def row(self, tick: int) -> SampleRow:
        rng = self.rng
        self._step()
        late = int(abs(rng.gauss(180, 70))) + (
            int(rng.expovariate(1 / 900)) if rng.random() < 0.05 else 0
        )
        scan = int(rng.gauss(45_600, 130))
        late += (self.port - 1) * scan
        row: SampleRow = [None] * len(SAMPLE_COLUMNS)
        row[0] = T0 + tick * PERIOD_US + self.phase_us + late + 15_060 + int(rng.gauss(0, 40))
        row[1:7] = [tick, self.name, self.port, late, scan, "ok"]
        row[8:13] = [
            round(self.temperature + rng.gauss(0, 0.5)),
            max(0, round(self.power)),
            "working",
            False,
            False,
        ]
        self._slow(row, tick)
        if rng.random() < 0.0005:
            row[6], row[7], row[8] = "timeout", "temperature_c=timeout", None
        return row

    def _step(self) -> None:
        if self.joint == 0 and self.rng.random() < 0.01:
            self.joint = 15
        pull = -3.0 if self.joint else 0.0
        self.joint = max(0, self.joint - 1)
        self.temperature += 0.2 * (self.set_c - self.temperature) + pull + self.rng.gauss(0, 0.3)
        self.power += 0.4 * (
            120 + 25 * (self.set_c - self.temperature) - self.power
        ) + self.rng.gauss(0, 12)
        self.power = min(self.power, 1000.0)

    def _slow(self, row: SampleRow, tick: int) -> None:
        turn = tick + 7 * self.port
        if turn % 20 == 0:
            row[COLUMN["alarm_high"]] = row[COLUMN["alarm_low"]] = False
            row[COLUMN["port_error"]] = 0
        if turn % 50 == 3:
            row[COLUMN["set_c"]], row[COLUMN["tool"]] = self.set_c, 2
        if turn % 50 == 9 and self.port == 1:
            row[COLUMN["station_error"]] = 0
        if turn % 100 == 14:
            row[COLUMN["transistor_c"]] = 31 + self.rng.randrange(3)
            row[7] = "delay_s=not_counting"
        if turn % 100 == 18 and self.port == 1:
            row[COLUMN["transformer_c"]] = 44 + self.rng.randrange(2)


def seconds_of_rows(tools: list[Tool], seconds: int) -> Iterator[list[SampleRow]]:
    for second in range(seconds):
        yield [tool.row(tick) for tick in range(second * HZ, (second + 1) * HZ) for tool in tools]


def tools_of(stations: int) -> list[Tool]:
    rng = random.Random(1)
    return [
        Tool(rng, station, port, station * PERIOD_US // stations)
        for station in range(stations)
        for port in ((1, 2) if station % 4 == 0 else (1,))
    ]


def keep(folder: Path, tools: list[Tool], seconds: int) -> tuple[int, float]:
    """Store the rows a second at a time; return their number and the CPU seconds."""
    trouble: list[str] = []
    intake, keeping = (
        RowBuffer(folder.name, lambda table, error: trouble.append(f"{table}: {error}")),
        StoreWriter(folder),
    )
    keeping.begin({})
    rows = 0
    cpu = 0.0
    for one_second in seconds_of_rows(tools, seconds):
        rows += len(one_second)
        began = time.process_time()
        for row in one_second:
            intake.sample(row)
        intake.take()
        notes = {("meta", "last"): str(intake.number)}
        assert keeping.add(intake.backlog, notes, notes).safe
        intake.backlog.clear()
        cpu += time.process_time() - began
    for name in {tool.name for tool in tools}:
        intake.facts(StationFacts(name, "bench", "dde"))
    keeping.close()
    assert not trouble, trouble
    return rows, cpu


def held_up(tools: list[Tool], busy: bool, seconds: float = 4.0) -> float:
    """Return how late a thread wakes that sleeps 1 ms repeatedly (99th percentile, in ms). With
    `busy`, another thread makes batches of a second of `tools`, one after the other, as the writer
    does once a second.
    """
    values = [value for rows in seconds_of_rows(tools, 1) for row in rows for value in row]
    done = threading.Event()

    def make() -> None:
        while not done.wait(0.002):
            encode(1, "samples", values)

    writer = threading.Thread(target=make)
    if busy:
        writer.start()
    late: list[float] = []
    end = time.perf_counter() + seconds
    while (began := time.perf_counter()) < end:
        time.sleep(0.001)
        late.append((time.perf_counter() - began) * 1000 - 1)
    done.set()
    if busy:
        writer.join()
    return sorted(late)[int(len(late) * 0.99)]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--stations", type=int, default=32)
    parser.add_argument("--minutes", type=int, default=60)
    given = parser.parse_args()
    out = Path(tempfile.mkdtemp(prefix="jbclog-bench-"))
    try:
        for name, value, limit in figures(out, given.stations, given.minutes):
            print(f"{name:<52} {value:>10}  {limit}")
    finally:
        shutil.rmtree(out)


def figures(out: Path, stations: int, minutes: int) -> Iterator[tuple[str, str, str]]:
    keep_pandas_out()
    folder = create_run(out, "bench", T0 / 1e6)
    rows, cpu = keep(folder, tools_of(stations), minutes * 60)
    yield f"rows ({stations} stations, {minutes} min, {HZ} Hz)", f"{rows}", ""
    yield "keeping: ms of CPU per 1 000 rows", f"{cpu / rows * 1e6:.2f}", "<= 1.5"
    yield "live store: bytes a row", f"{(folder / 'live.sqlite').stat().st_size / rows:.1f}", ""
    for name, busy in (("alone", False), ("beside batches of 64 stations", True)):
        yield f"a thread wakes late, 99 %, {name}: ms", f"{held_up(tools_of(64), busy):.2f}", "<= 1"
    began = time.perf_counter()
    lock = FolderLock.take(folder)
    seal_in_child(folder, lock)
    lock.release()
    yield "sealing, child's start to end: s", f"{time.perf_counter() - began:.2f}", "<= 5"
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    yield "sealing, peak memory of the child: MB", f"{peak:.0f}", ""
    sealed = sum(path.stat().st_size for path in part_paths(folder, "samples"))
    yield "sealed: bytes a row", f"{sealed / rows:.2f}", "<= 8"
    yield from beside_pandas(folder, rows)


def beside_pandas(folder: Path, rows: int) -> Iterator[tuple[str, str, str]]:
    """Write the same table as most programs would."""
    import pandas as pd

    began = time.perf_counter()
    samples = pd.read_parquet(folder / "samples")
    yield "pd.read_parquet of all of it: s", f"{time.perf_counter() - began:.2f}", ""
    assert len(samples) == rows
    plain = pd.DataFrame(
        {
            name: samples[name].astype(object).where(samples[name].notna(), None)
            for name in samples.columns
        }
    )
    plain = plain.infer_objects()
    for name, frame in (("nullable dtypes", samples), ("inferred dtypes", plain)):
        path = folder / "pandas.parquet"
        frame.to_parquet(path)
        yield f"pandas' defaults, {name}: bytes a row", f"{path.stat().st_size / rows:.2f}", ""


if __name__ == "__main__":
    main()
