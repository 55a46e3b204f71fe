"""A real Dask scheduler and its workers, each a process of its own, on this computer."""

from __future__ import annotations

import os
import signal
import subprocess
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
    "jbclog.analysis.store.runs",
    "pandas",
)
TLS = ("--tls-ca-file", "ca.pem", "--tls-cert", "node.pem", "--tls-key", "node.key")


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
    options: Sequence[str] = ()
    processes: list[BaseProcess] = field(default_factory=list)
    address: str = ""

    def start(self, program: str, *words: str) -> BaseProcess:
        words = ("--no-dashboard", "--host", self.host, *self.options, *words)
        process = forked(PROGRAMS[program], words, IMPORTED, self.home / "log", self.home)
        self.processes.append(process)
        return process

    @property
    def host(self) -> str:
        return "tls://127.0.0.1" if self.options else "tcp://127.0.0.1"

    def scheduler(self) -> BaseProcess:
        """Start the scheduler, and return when it listens."""
        process, end = (
            self.start("dask_scheduler", "--port", "0", "--scheduler-file", "scheduler"),
            time.monotonic() + WAIT_S,
        )
        said = self.home / "scheduler"
        while not (said.exists() and said.stat().st_size):
            assert process.is_alive(), self.log
            assert time.monotonic() < end, self.log
            time.sleep(0.05)
        time.sleep(0.05)
        self.address = said.read_text().split('"address": "')[1].split('"')[0]
        return process

    def worker(self, *words: str) -> BaseProcess:
        """Start a worker of one thread."""
        return self.start(
            "dask_worker",
            self.address,
            "--nthreads",
            "1",
            "--no-nanny",
            "--memory-limit",
            "0",
            *words,
        )

    @property
    def log(self) -> str:
        return (self.home / "log").read_text(errors="replace")


@contextmanager
def cluster(home: Path, workers: int, options: Sequence[str] = ()) -> Iterator[Cluster]:
    """A scheduler with so many workers, which end with the block."""
    made = Cluster(home, options)
    try:
        made.scheduler()
        for _ in range(workers):
            made.worker()
        yield made
    finally:
        for process in made.processes:
            process.kill()
            process.join()


def certificates(home: Path) -> None:
    """Write an authority and one certificate of it, with its key, for whoever takes part."""

    def run(*words: str) -> None:
        subprocess.run(["openssl", *words], cwd=home, check=True, capture_output=True)

    new = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    run(
        "req",
        "-x509",
        *new,
        "-keyout",
        "ca.key",
        "-out",
        "ca.pem",
        "-days",
        "2",
        "-subj",
        "/CN=test authority",
    )
    run("req", *new, "-keyout", "node.key", "-out", "node.csr", "-subj", "/CN=node")
    run(
        "x509",
        "-req",
        "-in",
        "node.csr",
        "-CA",
        "ca.pem",
        "-CAkey",
        "ca.key",
        "-CAcreateserial",
        "-out",
        "node.pem",
        "-days",
        "2",
    )


# -- functions that tests have workers call --------------------------------------------------------


def rows_of(run: Run) -> tuple[int, float, int]:
    """Two figures of a run, and who computed them."""
    return len(run.samples()), float(run.samples()["temperature_c"].mean()), os.getpid()


def killed_at(number: int, at: int, mark: Path) -> int:
    """End this process, once, at this task."""
    if number == at and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def ends_always(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def slow(number: int) -> int:
    time.sleep(0.1)
    return number


def divided(run: Run) -> float:
    return len(run.samples()) / 0


def length(run: Run) -> int:
    return len(run.samples())
