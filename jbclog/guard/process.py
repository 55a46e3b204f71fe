"""The recorder's end of the guard: started before anything is written, told every lease, renewed four times a second."""

from __future__ import annotations

import fcntl
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from jbclog.core.errors import StartRefused
from jbclog.guard.lease import StationLease
from jbclog.guard.watch import BEAT, END, FAILED

READY_S: Final = 10.0
END_S: Final = 2.0
KILL_S: Final = 0.2
TAKEN_OVER_S: Final = 12.0
READY: Final = b"ready\n"
ANSWER: Final = b"."
UNANSWERED_MOST: Final = 4  # renewals: at most 1.25 s of a recorder that goes on itself, and a guard that answers none of them
PIPE_SIZE: Final = 1 << 20  # what Linux gives anybody: the leases of a line of any size, while the guard is starting


@contextmanager
def _deaf() -> Iterator[None]:
    """What is started here is deaf to what ends a run, from its first step on: Ctrl-C reaches all processes of a terminal."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class GuardLost(Exception):
    """The guard does not take what it is told, or does not answer: it has died, or stands still."""


class GuardProcess:
    """One guard of the run in `folder`. Raises `StartRefused` where there is no process for it.

    What is told goes through a pipe that is never waited for; a guard that does not read it is a lost one.
    """

    def __init__(self, folder: Path) -> None:
        # -P: a file of the user's in the current folder must not pass for a module
        command = [sys.executable, "-P", "-m", "jbclog.guard", str(folder), "--recorder", str(os.getpid())]
        try:
            with _deaf():
                self._process = subprocess.Popen(
                    command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True, bufsize=0
                )
        except OSError as error:
            raise StartRefused(f"the guard could not be started ({error}); --no-guard runs without one") from error
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._pipe = self._process.stdin.fileno()
        self._answers = self._process.stdout.fileno()
        self._unanswered = 0
        self._told: dict[str, StationLease] = {}
        for descriptor in (self._pipe, self._answers):
            os.set_blocking(descriptor, False)
        with suppress(OSError, AttributeError):
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, PIPE_SIZE)

    @property
    def pid(self) -> int:
        return self._process.pid

    def await_ready(self) -> None:
        """Wait until it watches. Raises `StartRefused`."""
        if not self._can_be_read_within(READY_S) or not os.read(self._answers, len(READY)):
            self.kill()
            raise StartRefused("the guard did not start; its reason stands above. --no-guard runs without one")

    def kill(self) -> None:
        """End it, whatever it does; does not wait for one that a hanging disk keeps from ending."""
        self._process.kill()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(KILL_S)
        self._close()

    def _close(self) -> None:
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()

    def lease(self, station: StationLease) -> None:
        """Tell what must be made safe on a station, where that has changed. Raises `GuardLost`."""
        if self._told.get(station.name) != station:
            self._say(station.to_json())
            self._told[station.name] = station

    def renew(self) -> None:
        """Say that the recorder lives, and see that the guard does. Raises `GuardLost`."""
        if self._has_answered():
            self._unanswered = 0
        if self._unanswered >= UNANSWERED_MOST:
            raise GuardLost("it stands still")
        self._say(BEAT)
        self._unanswered += 1

    def end(self) -> None:
        """All tools are safe, or what is not has been told: there is nothing left to guard."""
        with suppress(GuardLost):
            self._say(END)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_S)
        self._close()

    def take_over(self) -> None:
        """Have it take over now: the ports are closed. Waits until it has done what it can."""
        with suppress(GuardLost):
            self._say(FAILED)
            end = time.monotonic() + TAKEN_OVER_S
            while self._can_be_read_within(end - time.monotonic()) and self._has_answered():
                pass  # until it lets go of its end, which is no answer
        self._close()

    def _can_be_read_within(self, seconds: float) -> bool:
        watched = select.poll()  # which knows no highest descriptor
        watched.register(self._answers, select.POLLIN)
        return bool(watched.poll(max(seconds, 0.0) * 1000))

    def _has_answered(self) -> bool:
        """Whether it has read what it was told since this was last asked. Raises `GuardLost` where it is gone."""
        try:
            if os.read(self._answers, 4096):
                return True
        except BlockingIOError:
            return False
        raise GuardLost("it ended")

    def _say(self, line: str) -> None:
        data = line.encode() + b"\n"
        try:
            sent = os.write(self._pipe, data)
        except OSError as error:  # BlockingIOError: it has not read for hours
            raise GuardLost(str(error)) from error
        if sent < len(data):
            raise GuardLost("it does not read")
