"""What reading costs: ``python tests/bench/bench_open_run.py [--short]``.

`open_run(...).samples()` reads an hour of 32 stations at 10 Hz (1.15 million rows of 30 columns),
including the hashes of its files. `pandas.read_parquet` reads the same folder in the same process;
the best of five counts for each. Then `open_runs(...).samples(columns=...)` reads a month, 720 such
hours in one run (``--short``: a day), in a process limited to 2 GB of memory.

The limits: a second for the hour, as CPU of all threads (the wall time on an otherwise idle
machine, and more than that on two cores); the month within 2 GB.
"""

from __future__ import annotations

import os
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import pandas as pd
import pyarrow as pa
from common import at_least, at_most, cpu_s, in_own_process, is_short, judge, show

from jbclog.analysis.run import open_run
from jbclog.analysis.runs import open_runs
from jbclog.record.conclude import sealed_file
from jbclog.record.manifest import read_manifest, write_manifest
from support.records.sealed_run import samples, seal, station, table

STATIONS, HOUR_ROWS = 32, 36_000
DAY_H, MONTH_H = 24, 720
MEMORY_MB = 2000
ROUNDS = 5
COLUMNS = ["time", "station", "port", "temperature_c"]


def hour(out: Path) -> Path:
    """Make a sealed run of an hour, with rows in tick order as a recorder writes them."""
    names = [f"dde-{number:02d}" for number in range(1, STATIONS + 1)]
    rows = table(*(samples(HOUR_ROWS, name, seed=seed) for seed, name in enumerate(names)))
    ordered = rows.take(
        pa.array(np.argsort(rows["tick"].to_numpy(), kind="stable"))
    ).combine_chunks()
    return seal(out, [station(name, rows=HOUR_ROWS) for name in names], ordered)


def month(folder: Path, hours: int) -> None:
    """Extend the run: each further part is a copy of the first, under another name."""
    first = folder / "samples" / "part-0000.parquet"
    for number in range(1, hours):
        os.link(first, folder / "samples" / f"part-{number:04d}.parquet")
    manifest = read_manifest(folder)
    sealed = sealed_file(folder, first, HOUR_ROWS * STATIONS)
    others = [
        replace(sealed, path=f"samples/part-{number:04d}.parquet") for number in range(1, hours)
    ]
    write_manifest(folder, replace(manifest, files=[*manifest.files, *others]))


def best(call: Callable[[], object]) -> tuple[float, float]:
    """Return the minimum seconds and CPU seconds of some rounds."""

    def took() -> tuple[float, float]:
        begun, used = time.perf_counter(), cpu_s()
        call()
        return time.perf_counter() - begun, cpu_s() - used

    rounds = [took() for _ in range(ROUNDS)]
    return min(wall for wall, _ in rounds), min(cpu for _, cpu in rounds)


def speeds(folder: Path) -> list[tuple[float, float]]:
    """Read the hour by jbclog, by pandas alone, and four of its columns by jbclog."""
    whole = best(lambda: open_run(folder).samples())
    alone = best(lambda: pd.read_parquet(folder / "samples"))
    return [whole, alone, best(lambda: open_run(folder).samples(columns=COLUMNS))]


def through(out: Path) -> tuple[int, float, float, float]:
    """Read a month within the allowed memory; return rows, seconds, peak MB, mean temperature."""
    most = MEMORY_MB * 1024 * 1024
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    begun, rows, total = time.perf_counter(), 0, 0.0
    for piece in open_runs(out).samples(columns=COLUMNS):
        rows += len(piece)
        total += float(piece["temperature_c"].sum())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return rows, time.perf_counter() - begun, peak, total / rows


def main() -> int:
    hours = DAY_H if is_short(__doc__) else MONTH_H
    with TemporaryDirectory(prefix="jbclog-bench-") as made:
        folder = hour(Path(made))
        whole, alone, four = in_own_process(speeds, folder)
        month(folder, hours)
        rows, seconds, peak, mean = in_own_process(through, Path(made))
    expected = STATIONS * HOUR_ROWS * hours
    show(
        f"{STATIONS} stations at 10 Hz",
        ["", "seconds", "of CPU"],
        [
            ["an hour, all columns", *whole],
            ["the same by pandas.read_parquet", *alone],
            ["an hour, four columns", *four],
        ],
    )
    show(
        f"{hours} hours, four columns",
        ["", "figure"],
        [["rows", rows], ["seconds", seconds], ["peak, MB", peak], ["mean, °C", mean]],
    )
    return judge(
        [
            at_most("an hour of 32 stations, all columns: CPU", whole[1], 1.0, " s"),
            at_most("as against pandas.read_parquet of the same folder", whole[0] / alone[0], 1.25),
            at_most(f"{hours} hours of them gone through: peak memory", peak, MEMORY_MB, " MB"),
            at_least("every row of them was there", rows, expected),
        ]
    )


if __name__ == "__main__":
    raise SystemExit(main())
