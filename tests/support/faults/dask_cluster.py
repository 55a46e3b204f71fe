"""A real Dask scheduler and its workers, each a process of its own, on this computer."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING

from support.forked import forked

if TYPE_CHECKING:  # a process spawned to call a function below is light
    from jbclog.analysis.run import Run

WAIT_S = 60.0
IMPORTED = (
    "distributed.cli.dask_scheduler",
    "distributed.cli.dask_worker",
    "jbclog.analysis.runs",
    "pandas",
)


def scheduler_main(words: Sequence[str]) -> None:
    from distributed.cli.dask_scheduler import main

    main(list(words))


def worker_main(words: Sequence[str]) -> None:
    from distributed.cli.dask_worker import main

    main(list(words))


PROGRAMS = {"dask_scheduler": scheduler_main, "dask_worker": worker_main}


@dataclass
class Cluster:
    """Its processes; their files and logs are in `home`."""

    home: Path
    processes: list[BaseProcess] = field(default_factory=list)
    address: str = ""

    def start(self, program: str, *words: str) -> BaseProcess:
        words = ("--no-dashboard", "--host", "tcp://127.0.0.1", *words)
        process = forked(PROGRAMS[program], words, IMPORTED, self.home / "log", self.home)
        self.processes.append(process)
        return process

    def scheduler(self) -> BaseProcess:
        """Start the scheduler, and return when it listens."""
        process = self.start("dask_scheduler", "--port", "0", "--scheduler-file", "scheduler")
        end = time.monotonic() + WAIT_S
        written = self.home / "scheduler"
        while not (written.exists() and written.stat().st_size):
            assert process.is_alive(), self.log
            assert time.monotonic() < end, self.log
            time.sleep(0.05)
        time.sleep(0.05)
        self.address = written.read_text().split('"address": "')[1].split('"')[0]
        return process

    def worker(self) -> BaseProcess:
        """Start a worker of one thread."""
        alone = ("--nthreads", "1", "--no-nanny", "--memory-limit", "0")
        return self.start("dask_worker", self.address, *alone)

    @property
    def log(self) -> str:
        return (self.home / "log").read_text(errors="replace")


@contextmanager
def cluster(home: Path, workers: int) -> Iterator[Cluster]:
    """A scheduler with so many workers, which end with the block."""
    made = Cluster(home)
    try:
        made.scheduler()
        for _ in range(workers):
            made.worker()
        yield made
    finally:
        for process in made.processes:
            process.kill()
            process.join()


# -- functions of a run that workers call ----------------------------------------------------------


def figures_of(run: Run) -> tuple[str, int, float]:
    """Two figures of a run."""
    samples = run.samples()
    return run.name, len(samples), float(samples["temperature_c"].mean())


def figures_and_process(run: Run) -> tuple[tuple[str, int, float], int]:
    """The figures of a run, and the process that computed them."""
    return figures_of(run), os.getpid()


class KilledOnce:
    """Computes the figures of a run; the process that gets the run `name` first is killed."""

    def __init__(self, name: str, mark: Path) -> None:
        self.name, self.mark = name, mark

    def __call__(self, run: Run) -> tuple[tuple[str, int, float], int]:
        figures = figures_of(run)
        if run.name == self.name and not self.mark.exists():
            self.mark.write_text(str(os.getpid()))
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.05)
        return figures, os.getpid()


def kills_always(_: Run) -> None:
    """End the process that calls it."""
    os.kill(os.getpid(), signal.SIGKILL)


def divided(run: Run) -> float:
    """Raise an error that no reader raises."""
    return len(run.samples(columns=["tick"])) / 0
