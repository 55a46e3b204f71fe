"""How long a start takes: CPU of ``jbclog --help`` and ``jbclog plan`` in a fresh process, as
multiples of an empty Python program (the minimum for any program in Python); and the time to the
first sample of ``jbclog run``, on a link paced by its baud rate, also into a folder of many runs.

The processes alternate, so that other load on the machine affects all of them.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

import pyarrow.parquet as pq
from common import at_most, is_short, judge, line_text, show, virtual_stations

MAIN = [sys.executable, "-c", "from jbclog.cli import main; main()"]
NOTHING = "python -c pass"
MOST_HELP, MOST_PLAN = 5.0, 18.0  # multiples
MOST_FIRST_S = 1.2
EARLIER_RUNS = 10_000


def main() -> int:
    times = 5 if is_short(__doc__) else 15
    with virtual_stations(1) as stations:
        line, recipe = stations.folder / "plan.toml", str(stations.recipe())
        line.write_text(line_text(["dde-1"]))
        cpu = _cpu_ms(
            {
                NOTHING: [sys.executable, "-c", "pass"],
                "jbclog --help": [*MAIN, "--help"],
                "jbclog plan": [
                    *MAIN,
                    "plan",
                    recipe,
                    "--line",
                    str(stations.folder / "plan.toml"),
                ],
            },
            times,
        )
        run = [*MAIN, "run", recipe, "--line", str(stations.line), "--duration", "1s", "--out"]
        first = [_first_sample_s(run, stations.folder / f"out-{n}") for n in range(times)]
        many = _many_runs(stations.folder / "many")
        among = [_first_sample_s(run, many) for _ in range(max(times // 3, 2))]
    nothing = cpu[NOTHING]
    show(
        f"CPU, median of {times} processes",
        ("", "ms", "ratio"),
        [[name, ms, ms / nothing] for name, ms in cpu.items()],
    )
    show(
        f"seconds from the start of {times} processes to the first sample of one port",
        ("", "median", "least", "most"),
        [
            ["jbclog run", median(first), min(first), max(first)],
            [f"beside {EARLIER_RUNS} runs", median(among), min(among), max(among)],
        ],
    )
    help_, plan = cpu["jbclog --help"] / nothing, cpu["jbclog plan"] / nothing
    return judge(
        [
            at_most(f"jbclog --help, of {NOTHING}", help_, MOST_HELP),
            at_most(f"jbclog plan, of {NOTHING}", plan, MOST_PLAN),
            at_most("the first sample of a run after its start", median(first), MOST_FIRST_S, " s"),
        ]
    )


def _cpu_ms(commands: Mapping[str, Sequence[str]], times: int) -> dict[str, float]:
    """Return the median CPU of each command's process; a first one warms the file cache."""
    took: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(times + 1):
        for name, command in commands.items():
            child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            _, status, used = os.wait4(child.pid, 0)
            child.returncode = os.waitstatus_to_exitcode(status)
            if child.returncode:
                raise RuntimeError(f"{name} ended with {child.returncode}")
            took[name].append((used.ru_utime + used.ru_stime) * 1000)
    return {name: median(ms[1:]) for name, ms in took.items()}


def _first_sample_s(run: Sequence[str], out: Path) -> float:
    began = time.time()
    subprocess.run(
        [*run, str(out)],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"JBCLOG_NO_DERIVED": "1"},
    )
    folder = max(out.glob("*-bench-*"))  # the newest by its name
    times = pq.read_table(folder / "samples", columns=["time"])["time"].cast("int64").to_pylist()
    return min(times) / 1e6 - began


def _many_runs(out: Path) -> Path:
    """Make the folders of many earlier runs below `out`, of another line."""
    out.mkdir()
    for number in range(EARLIER_RUNS):
        (out / f"20260101T{number:06}Z-line-2-aaaa").mkdir()
    return out


if __name__ == "__main__":
    sys.exit(main())
