"""What following a run costs: one follower's CPU for 64 ports at 10 Hz, and the recorder's lateness
with and without ten followers.

There is one run; followers come and go in it, so that both cases have the same machine. Stretches
without and with ten of them alternate; the seconds in which they start do not count.

A process beside each follower counts joints and then rests (`joint_counter.SHARE`). What a count
takes is measured beside the run.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Final

import pyarrow.parquet as pq
from common import Claim, at_most, is_short, judge, percentile, show, virtual_stations
from recorder import record

from jbclog.live.joint_counter import count

STATIONS: Final = 32  # of two ports each
FOLLOWERS: Final = 10
BEGIN_S, START_S = 15.0, 15.0  # of the run, and of followers that start, at most
# times the lateness without followers, plus `SLACK_MS`: ten more processes share the processors
WIDER: Final = 2.0
SLACK_MS: Final = 5.0
FOLLOW: Final = """
import os, sys
from jbclog.cli.watch import NICENESS
from jbclog.live import follow
os.nice(NICENESS)  # as `jbclog watch` does
with follow(sys.argv[1]) as line:
    for run in line.stream():
        if run.is_whole:
            break
    print("follows", flush=True)
    for run in line.stream():
        pass
"""
Stretch = tuple[float, float]


def main() -> int:
    stretch_s, times = (20.0, 1) if is_short(__doc__) else (30.0, 3)
    seconds = BEGIN_S + (times + 1) * (2 * stretch_s + START_S)
    without: list[Stretch] = []
    with_ten: list[Stretch] = []
    shares: list[float] = []
    with (
        virtual_stations(STATIONS, ports="[1, 2]", wire=False) as stations,
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as own,
    ):
        running = own.submit(record, stations.line, stations.recipe(), stations.folder, seconds)
        time.sleep(BEGIN_S)
        for _ in range(times):
            without.append(_stretch(stretch_s))
            with following(stations.folder, FOLLOWERS) as processes:
                before = [_cpu_s(one) for one in processes]
                with_ten.append(_stretch(stretch_s))
                shares += [
                    (_cpu_s(one) - first) / stretch_s
                    for one, first in zip(processes, before, strict=True)
                ]
        counting_s = _counting_s(stations.folder)
        recorded = running.result()
        (samples,) = stations.folder.glob("*-bench-*/samples")
        late = {"without": _late_ms(samples, without), "ten followers": _late_ms(samples, with_ten)}
    figures = {
        who: (percentile(some, 50), percentile(some, 99), max(some)) for who, some in late.items()
    }
    rows = [[who, len(late[who]), *figures[who]] for who in late]
    show(
        f"{STATIONS} stations of two ports at 10 Hz, {seconds:g} s",
        ("", "ticks", "late ms 50 %", "99 %", "latest"),
        rows,
    )
    print(f"  a follower: {100 * sum(shares) / len(shares):.2f} % of a core")
    print(f"  to count the joints: {counting_s:.2f} s of CPU")
    print(f"  ticks skipped in the whole run: {recorded.ticks_skipped} of {recorded.rows}")
    return judge(_claims(figures, max(shares)))


def _counting_s(runs: Path) -> float:
    """Return the CPU seconds of counting the joints of all ports once."""
    (folder,) = runs.glob("*-bench-*")
    began = time.process_time()
    count(folder)
    return time.process_time() - began


def _claims(
    figures: dict[str, tuple[float, float, float]],
    share: float,
) -> list[Claim]:
    alone, beside = figures.values()
    return [
        at_most(
            f"a follower of {2 * STATIONS} ports, the most expensive of all, of a core",
            100 * share,
            3.0,
            " %",
        ),
        at_most(
            "ticks, half of them: late with ten followers",
            beside[0],
            WIDER * alone[0] + SLACK_MS,
            " ms",
        ),
        at_most(
            "ticks, 99 % of them: late with ten followers",
            beside[1],
            WIDER * alone[1] + SLACK_MS,
            " ms",
        ),
    ]


@contextmanager
def following(runs: Path, count: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Start that many followers; wait until each has read the run so far."""
    command = [sys.executable, "-c", FOLLOW, str(runs)]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(count)]
    try:
        for one in processes:
            assert one.stdout is not None
            one.stdout.readline()
        yield processes
    finally:
        for one in processes:
            one.kill()
            one.communicate()


def _stretch(seconds: float) -> Stretch:
    began = time.time()
    time.sleep(seconds)
    return began, time.time()


def _cpu_s(process: subprocess.Popen[bytes]) -> float:
    """Return the CPU seconds of a process so far."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _late_ms(samples: Path, stretches: Sequence[Stretch]) -> list[float]:
    # the second waits for the first
    rows = pq.read_table(samples, columns=["time", "late_us"], filters=[("port", "=", 1)])
    found = zip(rows["time"].cast("int64").to_pylist(), rows["late_us"].to_pylist(), strict=True)
    return [
        us / 1000
        for time_us, us in found
        if us is not None and any(a <= time_us / 1e6 < b for a, b in stretches)
    ] or [0.0]


if __name__ == "__main__":
    sys.exit(main())
