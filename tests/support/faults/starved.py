"""Runs whose recorder or guard is refused memory at a chosen request, while their tools are hot
(`failing_alloc.c`).
"""

from __future__ import annotations

import mmap
import os
import re
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from support.campaigns.awaited import INTERNAL_ERROR
from support.command import until
from support.faults.guarded import GUARD, TOOLS, guard_that_is_there
from support.oracles.invariants import Ended, violations
from support.product import LEASES_FILE, MAIN, SIM_STAND, RecordError, read_manifest, recover_run
from support.virtual.served_line import ServedLine
from support.virtual.station_log import heard_in

PROGRAM = MAIN
RECORDER, WATCHING, TAKING_OVER = "recorder", "guard that watches", "guard that takes over"
WORD = {RECORDER: PROGRAM, WATCHING: GUARD.decode(), TAKING_OVER: GUARD.decode()}
ALWAYS = -1  # as `many`: from then on
SOON_S = 30.0  # the run's end, and the guard's, on a busy machine
DURATION_S = 5.0
NO_THREAD = "cannot allocate memory for thread-local data: ABORT"
ACCOUNT = re.compile(r"were due|are accounted for")
"""What does not hold of a station whose session broke in the middle of a reading: the record says
that it broke, and `check` what is missing."""


class Page:
    """The numbers that a starved process shares (`failing_alloc.c`)."""

    def __init__(self, folder: Path, pid: int) -> None:
        path = folder / str(pid)
        assert until(lambda: path.exists() and path.stat().st_size == 32), (
            f"process {pid} is not watched"
        )
        with path.open("r+b") as file:
            self._page = mmap.mmap(file.fileno(), 32)

    def refuse(self, nth: int, many: int) -> None:
        """The Nth request from now on and the next, `many` in all."""
        self._page[8:16] = struct.pack("q", many)
        self._page[0:8] = struct.pack("q", nth)

    @property
    def asked(self) -> int:
        return int(struct.unpack_from("q", self._page, 16)[0])

    @property
    def refused(self) -> int:
        return int(struct.unpack_from("q", self._page, 24)[0])


@dataclass
class Starving:
    """One run of `line` below `home` in which `who` is refused request `nth` and the next, `many`
    in all.
    """

    line: ServedLine
    home: Path
    preloaded: Path
    who: str
    nth: int
    many: int
    code: int | None = None
    said: str = ""
    asked: int = 0
    refused: int = 0
    # from the first moment at which memory could be refused until no tool was hot
    safe_s: float = 0.0

    @property
    def out(self) -> Path:
        return self.home / "runs"

    @property
    def folder(self) -> Path:
        (folder,) = (path for path in self.out.iterdir() if path.is_dir())
        return folder

    def go(self) -> list[str]:
        """Do it; what is wrong afterwards."""
        assert self.line.log is not None
        begin = self.line.log.stat().st_size
        for port in self.line.tools():
            port.order(SIM_STAND, False)
        with self._running() as run:
            if (
                not until(lambda: self.line.at_work() == TOOLS or run.poll() is not None, 60)
                or run.poll() is not None
            ):
                return [f"it did not start: {run.communicate(timeout=60)[1]}"]
            guard = guard_that_is_there(run.pid)
            page = Page(self.home, run.pid if self.who == RECORDER else guard)
            began, before = time.monotonic(), page.asked
            page.refuse(self.nth, self.many)
            if self.who == TAKING_OVER:
                run.kill()
            safe = until(lambda: self._is_safe() and run.poll() is not None, SOON_S)
            self.safe_s = time.monotonic() - began
            ended = until(lambda: run.poll() is not None, 1.0)
            self.asked, self.refused = page.asked - before, page.refused
            run.kill()
            self.said, self.code = run.communicate(timeout=SOON_S)[1], run.returncode
        wrong = (
            []
            if safe
            else [
                f"hot {SOON_S:g} s later: {self.line.at_work()} tools, feeder"
                f" {self.line.motor('ale-1')}"
            ]
        )
        wrong += [] if ended else ["it hung"]
        return [*wrong, *self._record(begin)]

    def _is_safe(self) -> bool:
        return self.line.at_work() == 0 and not self.line.motor("ale-1")

    @contextmanager
    def _running(self) -> Iterator[subprocess.Popen[str]]:
        self.home.mkdir(parents=True)
        more = {
            "LD_PRELOAD": str(self.preloaded),
            "PYTHONMALLOC": "malloc",
            "FAILING_ALLOC": str(self.home),
            "FAILING_ALLOC_IN": WORD[self.who],
            "XDG_STATE_HOME": str(self.home / "state"),
        }
        words = [
            "run",
            self.line.recipe,
            "--line",
            self.line.path,
            "--out",
            self.out,
            "--rate",
            "fit",
        ]
        words += ["-d", "1h" if self.who == TAKING_OVER else f"{DURATION_S:g}s"]
        command = [sys.executable, "-c", PROGRAM, *map(str, words)]
        run = subprocess.Popen(
            command,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **more},
        )
        try:
            yield run
        finally:
            run.kill()
            run.wait()

    def _record(self, begin: int) -> list[str]:
        """The folder recovers, its record holds, and no lease is open."""
        assert self.line.log is not None
        until(lambda: not (self.folder / LEASES_FILE).exists(), SOON_S)  # a guard goes on by itself
        try:
            recover_run(self.folder)
        except RecordError as error:
            return [f"not recovered: {error}"]
        # which Python says by itself
        said = re.sub(r"^Exception ignored in.*?MemoryError: $", "", self.said, flags=re.S | re.M)
        # a beat that is done again soon
        said = re.sub(r"^<bound method \S+ of .*?^MemoryError$", "", said, flags=re.S | re.M)
        code = -signal.SIGABRT if NO_THREAD in said else self.code or 0  # as the C library ends it
        found = violations(self.folder, heard_in(self.line.log, begin), ended=Ended(code, said))
        manifest = read_manifest(self.folder)
        broken = [facts.name for facts in manifest.stations if INTERNAL_ERROR in facts.reason]
        wrong = [
            text
            for text in found
            if not any(name in text and ACCOUNT.search(text) for name in broken)
        ]
        if (self.folder / LEASES_FILE).exists():
            wrong.append("a lease is open")
        if self.code not in (0, 1, 3, 4, 5) and manifest.exit_status == "success":
            wrong.append(f"it ended with {self.code}, and the record says {manifest.exit_status}")
        return wrong
