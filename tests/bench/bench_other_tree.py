"""The recorder of this tree and that of another, taking turns on the same virtual stations: how
late is each tick, and what does a run cost?

    git worktree add --detach /tmp/other a5e78687
    python tests/bench/bench_other_tree.py /tmp/other

a5e78687 is the last commit on asyncio's loop. Both run in this Python. CPU is of a whole run, its
start and its sealed record included.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import pyarrow.parquet as pq
from common import Bench, at_most, judge, percentile, show, virtual_stations

HERE = Path(__file__).parents[2]
COLUMNS = ("medians of rounds", "late ms 50 %", "99 %", "latest", "skipped", "CPU s")
NOT_IN_IT_S = 2.0  # the first ticks, while a run's code is new to the processor


@dataclass(frozen=True, slots=True)
class Run:
    late_ms: tuple[float, float, float]  # of each tick's first question: 50 %, 99 %, the latest
    skipped: int
    cpu_s: float

    def row(self) -> list[float]:
        return [*self.late_ms, float(self.skipped), self.cpu_s]


def main() -> int:
    wanted = _wanted()
    runs: dict[Path, list[Run]] = {HERE: [], wanted.tree.resolve(): []}
    with virtual_stations(wanted.stations) as stations:
        recipe = stations.recipe(alarms_every_s=0.2)
        for turn in range(wanted.rounds):
            for tree in list(runs)[:: 1 if turn % 2 else -1]:
                out = stations.folder / f"{turn}-{len(runs[tree])}-{tree.name}"
                runs[tree].append(_run(tree, stations, recipe, out, wanted.seconds))
    ours, others = runs.values()
    show(
        f"{wanted.stations} stations, {wanted.rounds} rounds of {wanted.seconds:g} s",
        COLUMNS,
        [
            [name, *(median(column) for column in zip(*(run.row() for run in each), strict=True))]
            for name, each in (("this tree", ours), (str(wanted.tree), others))
        ],
    )
    ratios = [one.late_ms[1] / other.late_ms[1] for one, other in zip(ours, others, strict=True)]
    print("  99 % late by, of the other's in the same round:", *(f"{one:.2f}" for one in ratios))
    return judge(
        [
            at_most("ticks skipped, all rounds", sum(run.skipped for run in ours), 0),
            at_most("99 % of ticks late by, of the other's, median", median(ratios), wanted.most),
        ]
    )


def _wanted() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tree", type=Path, help="another working tree")
    parser.add_argument("--stations", type=int, default=250)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--most", type=float, default=0.7, help="of the other's lateness")
    return parser.parse_args()


def _run(tree: Path, stations: Bench, recipe: Path, out: Path, seconds: float) -> Run:
    command = [sys.executable, "-m", "jbclog", "run", str(recipe), "--line", str(stations.line)]
    process = subprocess.Popen(
        [*command, "--duration", f"{seconds:g}s", "--out", str(out)],
        cwd=tree,  # `-m` takes the package from there
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    (folder,) = out.glob("*-bench-*")
    table = pq.read_table(folder / "samples", columns=["time", "late_us", "reasons"])
    times = table["time"].cast("int64").to_pylist()
    begun = min(times) + NOT_IN_IT_S * 1e6
    late = [
        us / 1000
        for time, us in zip(times, table["late_us"].to_pylist(), strict=True)
        if us is not None and time >= begun
    ]
    return Run(
        (percentile(late, 50), percentile(late, 99), max(late)),
        sum("skipped" in reasons for reasons in table["reasons"].to_pylist() if reasons),
        used.ru_utime + used.ru_stime,
    )


if __name__ == "__main__":
    sys.exit(main())
