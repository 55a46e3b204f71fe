"""The recorder's end of the guard: started before anything is written, told every lease, renewed twice a second."""

from __future__ import annotations

import os
import select
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

from jbclog.errors import StartRefused
from jbclog.guard.lease import StationLease
from jbclog.guard.watch import BEAT, END

READY_S: Final = 10.0
END_S: Final = 2.0
READY: Final = b"ready\n"


class GuardLost(Exception):
    """The guard does not take what it is told: it has died, or stands still."""


class GuardProcess:
    """One guard of the run in `folder`. Raises `StartRefused` where there is no process for it.

    What is told goes through a pipe that is never waited for; a guard that does not read it is a lost one.
    """

    def __init__(self, folder: Path) -> None:
        command = [sys.executable, "-m", "jbclog.guard", str(folder), "--recorder", str(os.getpid())]
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True, bufsize=0
            )
        except OSError as error:
            raise StartRefused(f"the guard could not be started ({error}); --no-guard runs without one") from error
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._pipe = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)
        self._told: dict[str, StationLease] = {}
        self._ready = self._process.stdout.fileno()

    @property
    def pid(self) -> int:
        return self._process.pid

    def await_ready(self) -> None:
        """Wait until it watches. Raises `StartRefused`."""
        ready, _, _ = select.select([self._ready], [], [], READY_S)
        if not ready or os.read(self._ready, len(READY)) != READY:
            self.kill()
            raise StartRefused("the guard did not start; its reason stands above. --no-guard runs without one")

    def kill(self) -> None:
        """End it, whatever it does."""
        self._process.kill()
        self._process.wait()
        self._close()

    def _close(self) -> None:
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()

    def lease(self, station: StationLease) -> None:
        """Tell what must be made safe on a station, where that has changed. Raises `GuardLost`."""
        if self._told.get(station.name) != station:
            self._say(station.to_json())
            self._told[station.name] = station

    def renew(self) -> None:
        """Say that the recorder lives. Raises `GuardLost`."""
        self._say(BEAT)

    def end(self) -> None:
        """All tools are safe, or what is not has been told: there is nothing left to guard."""
        with suppress(GuardLost):
            self._say(END)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_S)
        self._close()

    def _say(self, line: str) -> None:
        data = line.encode() + b"\n"
        try:
            sent = os.write(self._pipe, data)
        except OSError as error:  # BlockingIOError: it has not read for hours
            raise GuardLost(str(error)) from error
        if sent < len(data):
            raise GuardLost("it does not read")
