"""The recorder of this tree and that of another, alternating on the same virtual stations: how late
each tick is, and what a run costs.

    git worktree add --detach /tmp/other a5e78687
    python tests/bench/bench_other_tree.py /tmp/other

a5e78687 is the last commit on asyncio's loop. Both run in this Python, with all processes from
their own tree, and leave no metrics, because those would be computed during the next run. CPU is of
a whole run, with its start and its sealed record.

Whether 10 Hz fit a link depends on the response time at the start, when all stations are asked at
once, and one refused station keeps all others from starting. This tree measures again before it
refuses; an older one may not. So a run that recorded nothing is shown with the end of its output
and repeated, `TRIES` times in all.
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

from jbclog.app.run.derive import OFF

HERE = Path(__file__).parents[2]
COLUMNS = ("medians of rounds", "late ms 50 %", "99 %", "latest", "skipped", "CPU s")
NOT_IN_IT_S = 2.0  # the first ticks, before caches are warm
TRIES = 3
LINES = 12  # of a run's output, where a station's refusal is


@dataclass(frozen=True, slots=True)
class Run:
    """What a run recorded, and its cost."""

    late_ms: tuple[float, float, float]  # of each tick's first question: 50 %, 99 %, the latest
    skipped: int
    cpu_s: float

    def row(self) -> list[float]:
        return [*self.late_ms, float(self.skipped), self.cpu_s]


class RecordedNothing(Exception):
    """The run has no sample that counts."""


def main() -> int:
    wanted = _wanted()
    trees = (HERE, wanted.tree.resolve())
    runs: tuple[list[Run], list[Run]] = ([], [])
    with virtual_stations(wanted.stations) as stations:
        recipe = stations.recipe(alarms_every_s=0.2)
        for turn in range(wanted.rounds):
            for which in (0, 1) if turn % 2 else (1, 0):
                out = stations.folder / f"{turn}-{which}"
                runs[which].append(_run(trees[which], stations, recipe, out, wanted.seconds))
    ours, others = runs
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
    for number in range(TRIES):
        try:
            return _tried(tree, stations, recipe, out / f"{number}", seconds)
        except RecordedNothing as nothing:
            print(nothing, file=sys.stderr, flush=True)
    sys.exit(f"{tree}: {TRIES} runs recorded nothing")


def _tried(tree: Path, stations: Bench, recipe: Path, out: Path, seconds: float) -> Run:
    """Make one run. Raises `RecordedNothing`."""
    # PYTHONPATH holds for the guard and the sealing child, too; the current folder does not
    command = [sys.executable, "-P", "-m", "jbclog", "run", str(recipe), "--line"]
    said = out.with_suffix(".log")
    said.parent.mkdir(exist_ok=True)
    with said.open("wb") as log:
        process = subprocess.Popen(
            [*command, str(stations.line), "--duration", f"{seconds:g}s", "--out", str(out)],
            env=os.environ | {"PYTHONPATH": str(tree), OFF: "1"},
            stdout=log,
            stderr=log,
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    late, skipped = _lateness(out)
    if not late:
        last = said.read_text(errors="replace").splitlines()[-LINES:]
        raise RecordedNothing(
            f"{tree}: a run of {seconds:g} s recorded no tick later than {NOT_IN_IT_S:g} s and"
            f" ended with {process.returncode}. The end of its output:\n  "
            + "\n  ".join(last or ["(it has none)"])
        )
    return Run(
        (percentile(late, 50), percentile(late, 99), max(late)),
        skipped,
        used.ru_utime + used.ru_stime,
    )


def _lateness(out: Path) -> tuple[list[float], int]:
    """Return the lateness in ms of each tick that counts, of the run below `out`, and the number of
    skipped ticks; nothing if there is no run.
    """
    parts = [*out.glob("*-bench-*/samples/*.parquet")]
    if not parts:
        return [], 0
    table = pq.read_table(parts[0].parent, columns=["time", "late_us", "reasons"])
    times = table["time"].cast("int64").to_pylist()
    begun = min(times, default=0) + NOT_IN_IT_S * 1e6
    late = [
        us / 1000
        for time, us in zip(times, table["late_us"].to_pylist(), strict=True)
        if us is not None and time >= begun
    ]
    return late, sum("skipped" in reasons for reasons in table["reasons"].to_pylist() if reasons)


if __name__ == "__main__":
    sys.exit(main())
