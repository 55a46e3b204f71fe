"""Workers of a Dask scheduler compared with bare processes on the same files: ``python
tests/bench/bench_fleet.py [--rows N]``.

The store has N rows of samples (default 100 million): copies of the samples file of one sealed run,
all of which count. Each worker and each bare process has one thread (Arrow's included) and its own
processor. A bare process computes every second part of the same list and sends its partial result
through a pipe. Both are measured in the same run, alternately, three times each; medians count.
Limits: the speed-up of two workers is at least 0.9 of that of two bare processes, and the answers
agree to the last digit.
"""

from __future__ import annotations

import argparse
import os
import statistics as st
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

import pyarrow as pa
from common import at_least, judge, show

from jbclog.analysis.fleet.scheduler import Scheduler
from jbclog.analysis.store.parts import PART_ROWS, FilePart, together
from jbclog.analysis.store.place import Place, place_of
from jbclog.analysis.store.reader import Store
from jbclog.analysis.store.statistics import Owner, Part, Task, finish, partial
from jbclog.app.publish.folder import publish_all
from jbclog.app.publish.publisher import Publisher
from support.faults.dask_cluster import cluster
from support.records.many_runs import one_run

ROWS, RUN_ROWS, TRIALS = 100_000_000, 500_000, 3
BY = ("station", "port")


def tasks_of(place: Place, rows: int) -> list[Task]:
    """Read the run's file, copied up to that many rows, in parts like any store."""
    store = Store(place)
    (run,) = store.runs()
    (path,) = [fragment.path for fragment in store.dataset("samples").get_fragments()]
    whole = Path(place.of("samples"), path)
    files = []
    for number in range(max(1, rows // run.rows["samples"])):
        copy = whole.with_name(f"copy-{number}.parquet")
        copy.write_bytes(whole.read_bytes())
        name = str(Path(path).with_name(copy.name))
        part = FilePart(place, "samples", name, 0, 1, frozenset([run.record]))
        files.append((part, run.rows["samples"]))
    owners = {run.record: Owner.of(run.found)}
    return [Task(part, "temperature_c", BY, owners) for part in together(files)]


def merged(parts: Sequence[Part]) -> Part:
    whole = Part()
    for one in parts:
        whole.add(one)
    return whole


def pinned(processor: int) -> None:
    """Keep this process on one processor, with one Arrow thread."""
    os.sched_setaffinity(0, {processor})
    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)


def all_of(tasks: Sequence[Task]) -> Part:
    return merged([partial(one) for one in tasks])


class Bare:
    """Processes that each compute a share of the tasks."""

    def __init__(self, processors: Sequence[int]) -> None:
        self._pools = [
            ProcessPoolExecutor(1, get_context("spawn"), pinned, (one,)) for one in processors
        ]
        self([])

    def __call__(self, tasks: Sequence[Task]) -> Part:
        count = len(self._pools)
        begun = [pool.submit(all_of, tasks[place::count]) for place, pool in enumerate(self._pools)]
        return merged([one.result() for one in begun])

    def close(self) -> None:
        for pool in self._pools:
            pool.shutdown()


def by(engine: Scheduler) -> Callable[[Sequence[Task]], Part]:
    return lambda tasks: merged([*engine.run(partial, tasks)])


def peak_mb(process: int) -> float:
    lines = Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM:"))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rows", type=int, default=ROWS)
    rows = parser.parse_args().rows
    processors = sorted(os.sched_getaffinity(0))[:2]
    with TemporaryDirectory() as made:
        home = Path(made)
        one_run(home / "runs", 0, 0.2, rows=min(rows, RUN_ROWS, PART_ROWS))
        place = place_of(home / "store")
        with Publisher(place) as publisher:
            list(publish_all(publisher, home / "runs"))
        return compare(home, tasks_of(place, rows), processors)


def compare(home: Path, tasks: Sequence[Task], processors: Sequence[int]) -> int:
    seconds: dict[str, list[float]] = {}
    answers, memory = [], 0.0
    for count in (1, len(processors)):
        (folder := home / f"cluster-{count}").mkdir()
        with cluster(folder, 0) as one:
            workers = [one.worker() for _ in range(count)]
            for worker, processor in zip(workers, processors, strict=False):
                os.sched_setaffinity(worker.pid, {processor})  # before it has threads
            bare, engine = Bare(processors[:count]), Scheduler(one.address)
            list(engine.run(partial, tasks[:count]))
            calls: dict[str, Callable[[Sequence[Task]], Part]] = {
                "bare": bare,
                "workers": by(engine),
            }
            for name, call in [*calls.items()] * TRIALS:
                began = time.perf_counter()
                answers.append(call(tasks))
                seconds.setdefault(f"{count} {name}", []).append(time.perf_counter() - began)
            memory = max(memory, *(peak_mb(worker.pid) for worker in workers))
            bare.close()
    return compared(seconds, answers, memory)


def compared(seconds: dict[str, list[float]], answers: Sequence[Part], memory: float) -> int:
    read = answers[0].counts.total()
    middle = {name: st.median(each) for name, each in seconds.items()}
    show(
        f"{read} rows",
        ["", "s", "rows/s"],
        [[name, took, read / took] for name, took in middle.items()],
    )
    bare, workers = (middle[f"1 {name}"] / middle[f"2 {name}"] for name in ("bare", "workers"))
    show(
        "two against one",
        ["", "value"],
        [
            ["speed-up, bare", bare],
            ["speed-up, workers", workers],
            ["peak of a worker, MB", memory],
        ],
    )
    same = all(finish(one, BY).equals(finish(answers[0], BY)) for one in answers)
    return judge(
        [
            at_least(
                "speed-up of two workers, share of that of two bare processes", workers / bare, 0.9
            ),
            at_least("the answers are the same (1: yes)", float(same), 1.0),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
