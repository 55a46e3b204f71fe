"""What `bench_record.py` measures, in a process of its own, with the jbclog that is on its path.

    python record_cases.py CASE FOLDER SECONDS

A case reaches jbclog through `support.product` of the same tree only, and prints what it measured
as JSON.
"""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow as pa

from jbclog.analysis.run import open_run
from support import product

HZ = 10
T0 = 1_790_000_000_000_000
PERIOD_US = 1_000_000 // HZ
COLUMN = product.COLUMN
Figures = dict[str, float]


class Tool:
    """A port of a station in use: its rows have a course like that of a real tool, with joints,
    noise of sensors, lateness, and slow signals at their periods.
    """

    def __init__(self, rng: random.Random, station: int, port: int, phase_us: int) -> None:
        self.rng = rng
        self.name = f"dde-{station:03d}"
        self.port = port
        self.phase_us = phase_us
        self.setpoint_c = rng.choice((330, 350, 380))
        self.temperature = float(self.setpoint_c)
        self.power = 120.0
        self.joint = 0

    def row(self, tick: int) -> list[object]:
        rng = self.rng
        self._step()
        late = int(abs(rng.gauss(180, 70)))
        if rng.random() < 0.05:
            late += int(rng.expovariate(1 / 900))
        scan = int(rng.gauss(45_600, 130))
        late += (self.port - 1) * scan
        row: list[object] = [None] * len(product.SAMPLE_COLUMNS)
        row[0] = T0 + tick * PERIOD_US + self.phase_us + late + 15_060 + int(rng.gauss(0, 40))
        row[1:7] = [tick, self.name, self.port, late, scan, "ok"]
        celsius = round(self.temperature + rng.gauss(0, 0.5))
        row[8:13] = [celsius, max(0, round(self.power)), "working", False, False]
        self._slow(row, tick)
        if rng.random() < 0.0005:
            row[6], row[7], row[8] = "timeout", "temperature_c=timeout", None
        return row

    def _step(self) -> None:
        if self.joint == 0 and self.rng.random() < 0.01:
            self.joint = 15
        pull = -3.0 if self.joint else 0.0
        self.joint = max(0, self.joint - 1)
        self.temperature += 0.2 * (self.setpoint_c - self.temperature) + pull
        self.temperature += self.rng.gauss(0, 0.3)
        self.power += 0.4 * (120 + 25 * (self.setpoint_c - self.temperature) - self.power)
        self.power = min(self.power + self.rng.gauss(0, 12), 1000.0)

    def _slow(self, row: list[object], tick: int) -> None:
        turn = tick + 7 * self.port
        if turn % 20 == 0:
            row[COLUMN["alarm_high"]] = row[COLUMN["alarm_low"]] = False
            row[COLUMN["port_error"]] = 0
        if turn % 50 == 3:
            row[COLUMN["setpoint_c"]] = self.setpoint_c
            row[COLUMN["tool"]] = 2
        if turn % 100 == 14:
            row[COLUMN["transistor_c"]] = 31 + self.rng.randrange(3)
            row[7] = "delay_s=not_counting"


def tools_of(ports: int) -> list[Tool]:
    rng = random.Random(1)
    return [Tool(rng, number, 1, number * PERIOD_US // ports) for number in range(ports)]


def begun(folder: Path) -> Any:
    """Return a started store in a new run below `folder`, which seals nothing by itself."""
    store = product.open_store(product.create_run(folder, "bench", T0 / 1e6), seal_every_s=None)
    store.start()
    return store


def filled(store: Any, ports: int, seconds: float) -> tuple[int, float]:
    """Give the store rows of `ports` for so long, and commit them as often as it does; return the
    number of rows and the CPU seconds that it took.
    """
    tools = tools_of(ports)
    ticks = round(seconds * HZ)
    each = round(product.COMMIT_EVERY_S * HZ)
    rows = 0
    cpu_s = 0.0
    for begin in range(0, ticks, each):
        made = [tool.row(tick) for tick in range(begin, begin + each) for tool in tools]
        rows += len(made)
        before = time.process_time()
        for row in made:
            store.sample(row)
        store.commit_now()
        cpu_s += time.process_time() - before
    return rows, cpu_s


def bytes_of(folder: Path, pattern: str) -> int:
    return sum(path.stat().st_size for path in folder.rglob(pattern))


def keep(folder: Path, seconds: float) -> Figures:
    """CPU of commits and of sealing, of 64 stations at 10 Hz."""
    store = begun(folder)
    rows, cpu_s = filled(store, 64, seconds)
    store.close()
    store.release()
    before = time.process_time()
    product.seal(store.folder)
    sealing_s = time.process_time() - before
    return {
        "CPU of commits, µs a row": cpu_s / rows * 1e6,
        "CPU of sealing, µs a row": sealing_s / rows * 1e6,
        "CPU of both, µs a row": (cpu_s + sealing_s) / rows * 1e6,
    }


def sealed_bytes(folder: Path, ports: int, seconds: float) -> float:
    """Bytes of a sealed row."""
    store = begun(folder)
    rows, _ = filled(store, ports, seconds)
    store.close()
    store.release()
    product.seal(store.folder)
    return bytes_of(store.folder / "samples", "*.parquet") / rows


def size(folder: Path, seconds: float) -> Figures:
    """Bytes of a sealed row: of a short run of two ports, and of eight ports for longer."""
    return {
        "bytes of a sealed row, 20 s × 2 ports": sealed_bytes(folder, 2, 20.0),
        "bytes of a sealed row, 8 ports": sealed_bytes(folder, 8, seconds),
    }


def memory(folder: Path, seconds: float) -> Figures:
    """Memory of the process that seals, of 250 stations at 10 Hz."""
    store = begun(folder)
    filled(store, 250, seconds)
    product.seal_as_hourly(SimpleNamespace(_store=store))
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    store.close()
    store.release()
    return {"memory of the sealing child, MB": peak}


def recovery(folder: Path, seconds: float) -> Figures:
    """Time to recover ten stations at 10 Hz, sealed every hour until the recorder was killed."""
    child = os.fork()
    if not child:
        store = begun(folder)
        hour = 3600.0
        for begin in range(0, round(seconds), round(hour)):
            filled(store, 10, min(hour, seconds - begin))
            if begin + hour < seconds:
                product.seal_as_hourly(SimpleNamespace(_store=store))
        os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    (run,) = folder.iterdir()
    before = time.perf_counter()
    product.recover_run(run)
    return {"recovery, s": time.perf_counter() - before}


def day(folder: Path, seconds: float) -> Figures:
    """Time and memory to read one port of 64, in four parts, through the public interface."""
    store = begun(folder)
    for _ in range(4):
        filled(store, 64, seconds / 4)
        product.seal_as_hourly(SimpleNamespace(_store=store))
    store.close()
    store.release()
    (home,) = folder.iterdir()
    product.recover_run(home)
    read = subprocess.run(
        [sys.executable, "-P", __file__, "read", str(home), f"{seconds}"],
        stdout=subprocess.PIPE,
        check=True,
    )
    figures: Figures = json.loads(read.stdout)
    return figures


def read(folder: Path, seconds: float) -> Figures:
    """Time and memory to read one port of the run in `folder`."""
    run = open_run(folder)
    columns = ["time", "temperature_c", "setpoint_c"]
    run.samples("dde-031", 1, columns=columns, start="2100-01-01")  # what is imported by it
    times: list[float] = []
    for _ in range(5):
        before = time.perf_counter()
        rows = run.samples("dde-031", 1, columns=columns)
        times.append(time.perf_counter() - before)
    assert len(rows) == round(seconds * HZ)
    return {
        "one port of 64, ms": min(times) * 1e3,
        "one port of 64, most in Arrow, MB": pa.default_memory_pool().max_memory() / 1e6,
    }


def follow(folder: Path, seconds: float) -> Figures:
    """How far a follower that looks ten times a second is behind rows of 10 Hz."""
    store = begun(folder)
    product.write_manifest(store.folder, product.Manifest(run=store.folder.name))
    store.facts(product.StationFacts("dde-000", "a", "dde", ports=[1], outcome="running"))
    done = threading.Event()
    times: list[float] = []  # of each tick, whose number the row has as its temperature

    def record() -> None:
        tool = tools_of(1)[0]
        while not done.wait(1 / HZ):
            row = tool.row(len(times))
            row[0] = time.time_ns() // 1000
            row[COLUMN["temperature_c"]] = len(times)
            times.append(time.time())
            store.sample(row)

    writer = threading.Thread(target=record)
    writer.start()
    behind: list[float] = []
    follower = product.Follower(store.folder)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(0.1)
        state = follower.poll()
        for port in state.ports if state else ():
            if port.temperature.value is not None:
                behind.append(time.time() - times[port.temperature.value])
    done.set()
    writer.join()
    follower.close()
    store.close()
    store.release()
    return {"a follower behind, s at most": max(behind[20:])}


def killed(folder: Path, seconds: float) -> Figures:
    """What a kill loses at 10 Hz: from the last row that is recovered to the kill."""
    lost: list[float] = []
    while len(lost) < seconds:
        out = folder / f"{len(lost)}"
        out.mkdir()
        child = os.fork()
        if not child:
            store = begun(out)
            tool = tools_of(1)[0]
            tick = 0
            while True:
                time.sleep(1 / HZ)
                row = tool.row(tick)
                row[0] = time.time_ns() // 1000
                store.sample(row)
                tick += 1
        time.sleep(2.5 + random.random())
        os.kill(child, signal.SIGKILL)
        at = time.time()
        os.waitpid(child, 0)
        (run,) = out.iterdir()
        product.recover_run(run)
        times = [group["time"] for group in product.row_groups_of(run, "samples", ["time"])]
        last = max(time.cast("int64").to_pylist()[-1] for time in times if len(time))
        lost.append(at - last / 1e6)
    return {"lost by a kill, s at most": max(lost)}


CASES: dict[str, Callable[[Path, float], Figures]] = {
    "keep": keep,
    "size": size,
    "day": day,
    "read": read,
    "memory": memory,
    "recovery": recovery,
    "follow": follow,
    "killed": killed,
}


def main(words: list[str]) -> None:
    case, folder, seconds = words
    print(json.dumps(CASES[case](Path(folder), float(seconds))))


if __name__ == "__main__":
    main(sys.argv[1:])
