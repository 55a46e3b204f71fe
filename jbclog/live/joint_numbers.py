"""The number of joints of each port so far, counted by a process beside whoever watches.

Finding joints takes scipy and more computing time than following a run, so `joint_counter` does it, at the lowest priority.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.core.clock import Clock
from jbclog.core.errors import RecordError
from jbclog.core.foreign.json_reader import builder, json_of
from jbclog.live.states import NOT_COUNTED, Joints

KILL_S: Final = 0.5
ENDED: Final = "the process that counts them ended"

Key = tuple[str, int]


@dataclass(frozen=True, slots=True)
class PortCount:
    """A port's number of joints; None: not known, `why`. `found`: how many were found, which may not be all."""

    station: str
    port: int
    count: int | None
    found: int
    why: str | None


@dataclass(frozen=True, slots=True)
class Counted:
    """What the counting process writes as a line. `age_s`: of the newest row that was counted. `trouble`: it could not count."""

    age_s: float = 0.0
    ports: tuple[PortCount, ...] = ()
    is_final: bool = False
    trouble: str | None = None


_build_counted: Final = builder(Counted)


class JointNumbers:
    """The process that counts the joints of the run in `folder`. `look` never waits; `close` ends it."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._clock = clock
        self._counted: Counted | None = None
        self._heard_at = 0.0
        self._why = NOT_COUNTED.why
        self._rest = b""
        self._asked_at_end = False
        self._process: subprocess.Popen[bytes] | None = None
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "jbclog.live.joint_counter", str(folder)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for whoever watches
                bufsize=0,
            )
            assert self._process.stdout is not None
            os.set_blocking(self._process.stdout.fileno(), False)
        except OSError as error:
            self._why = f"cannot be counted: {error.strerror or error}"

    def look(self, *, has_ended: bool) -> Mapping[Key, Joints]:
        """Return the latest numbers. `has_ended`: the run is finalized, so that a last count can be made."""
        for line in self._lines():
            self._take(line)
        if has_ended and not self._asked_at_end and self._process is not None and self._process.stdin is not None:
            self._asked_at_end = True
            with suppress(OSError):
                self._process.stdin.write(b"\n")
        if self._counted is None:
            return {}
        age_s = None if self._counted.is_final else self._counted.age_s + self._clock.monotonic() - self._heard_at
        return {(one.station, one.port): Joints(one.count, one.found, age_s, one.why) for one in self._counted.ports}

    @property
    def not_counted(self) -> Joints:
        """What holds for a port that the latest numbers lack."""
        return Joints(why=self._why)

    def close(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        with suppress(subprocess.TimeoutExpired):
            process.wait(KILL_S)
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                stream.close()

    def _take(self, line: bytes) -> None:
        try:
            counted = _build_counted(json_of(line.decode()))
        except (ValueError, RecordError):
            return
        if counted.trouble is not None:
            self._why = counted.trouble
            return
        self._counted, self._heard_at = counted, self._clock.monotonic()

    def _lines(self) -> list[bytes]:
        if self._process is None or self._process.stdout is None:
            return []
        data = b""
        while True:
            try:
                piece = os.read(self._process.stdout.fileno(), 1 << 16)
            except BlockingIOError:
                break
            if not piece:
                self._why = ENDED if self._why == NOT_COUNTED.why else self._why
                self.close()
                break
            data += piece
        *lines, self._rest = (self._rest + data).split(b"\n")
        return lines
