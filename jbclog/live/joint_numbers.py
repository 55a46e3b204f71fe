"""The number of joints of each port so far, from a process that counts them.

Finding joints needs scipy and more CPU time than recording or following a run, so `joint_counter`
does it in a process of the lowest priority.
"""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.core.children import kill
from jbclog.core.clock import Clock
from jbclog.core.errors import RecordError
from jbclog.core.json_files import builder, json_of
from jbclog.core.operating_system import IS_POSIX, set_blocking
from jbclog.core.rows import PortKey
from jbclog.live.states import NOT_COUNTED, OF_TIPS_ONLY, Joints

KILL_S: Final = 0.5
ENDED: Final = "the process that counts them ended"
NOT_HERE: Final = "counting joints of a run in progress needs a POSIX system such as Linux"
NOW: Final = b"now\n"
LAST: Final = b"last\n"


@dataclass(frozen=True, slots=True)
class PortCount:
    """Number of joints of a port. `count` None: not known, for the reason `why`; `found` is then a
    lower estimate that may include false ones.
    """

    station: str
    port: int
    count: int | None
    found: int
    why: str | None


@dataclass(frozen=True, slots=True)
class Counted:
    """A count, as the counting process writes it, one per line.

    `age_s`: age of the newest counted row. `took_s`: duration of the count. `trouble`: why counting
    failed.
    """

    age_s: float = 0.0
    ports: tuple[PortCount, ...] = ()
    is_final: bool = False
    took_s: float = 0.0
    trouble: str | None = None

    @property
    def found(self) -> int:
        """Joints found on all ports; ports whose number is not known may have more."""
        return sum(port.found for port in self.ports)

    @property
    def not_known(self) -> list[PortCount]:
        """Ports whose number of joints is not known."""
        return [port for port in self.ports if port.why not in (None, OF_TIPS_ONLY)]


_build_counted: Final = builder(Counted)


class JointCounting:
    """The process that counts the joints of the run in `folder`; `close` ends it.

    `latest` is its newest count. `why` is set when there will be no further count.
    """

    def __init__(self, folder: Path) -> None:
        self.latest: Counted | None = None
        self.why: str | None = None
        self._rest = b""
        self._process: subprocess.Popen[bytes] | None = None
        if not IS_POSIX:
            self.why = NOT_HERE
            return
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "jbclog.live.joint_counter", str(folder)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for the parent
                bufsize=0,
            )
            assert self._process.stdout is not None
            set_blocking(self._process.stdout.fileno(), blocks=False)
        except OSError as error:
            self.why = error.strerror or str(error)

    def poll(self) -> bool:
        """Read the process's output without waiting; return whether there is a new count."""
        before = self.latest
        for line in self._lines():
            self._take(line)
        return self.latest is not before

    def ask(self, *, is_last: bool = False) -> None:
        """Request a count now. `is_last`: all rows are committed."""
        if self._process is not None and self._process.stdin is not None:
            with suppress(OSError):  # `poll` notices that the process has ended
                self._process.stdin.write(LAST if is_last else NOW)

    def last(self, most_s: float) -> Counted | None:
        """Count a run whose rows are all committed, within `most_s` seconds. None: see `why`."""
        self.ask(is_last=True)
        end = time.monotonic() + most_s
        while self.why is None and not self._is_final:
            if not self._wait(end - time.monotonic()):
                self.why = f"it took more than {most_s:g} s"
            self.poll()
        return self.latest if self._is_final else None

    def close(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        kill(process, KILL_S)
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                stream.close()

    @property
    def _is_final(self) -> bool:
        return self.latest is not None and self.latest.is_final

    def _wait(self, most_s: float) -> bool:
        if self._process is None or self._process.stdout is None:
            return True
        return bool(select.select([self._process.stdout], [], [], max(most_s, 0.0))[0])

    def _take(self, line: bytes) -> None:
        try:
            counted = _build_counted(json_of(line.decode()))
        except (ValueError, RecordError):
            return
        if counted.trouble is not None:
            self.why = counted.trouble
        else:
            self.latest = counted

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
                self.why = self.why or ENDED
                self.close()
                break
            data += piece
        *lines, self._rest = (self._rest + data).split(b"\n")
        return lines


class JointNumbers:
    """Current joint numbers of the run in `folder`. `look` never waits; `close` ends the counting
    process.
    """

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._clock = clock
        self._counting = JointCounting(folder)
        self._counted_at = 0.0
        self._asked_at_end = False

    def look(self, *, has_ended: bool) -> Mapping[PortKey, Joints]:
        """Return the latest numbers. `has_ended`: the run is finalized, so request a last count."""
        if self._counting.poll():
            self._counted_at = self._clock.monotonic()
        if has_ended and not self._asked_at_end:
            self._asked_at_end = True
            self._counting.ask(is_last=True)
        counted = self._counting.latest
        if counted is None:
            return {}
        age_s = (
            None if counted.is_final else counted.age_s + self._clock.monotonic() - self._counted_at
        )
        return {
            (one.station, one.port): Joints(one.count, one.found, age_s, one.why)
            for one in counted.ports
        }

    @property
    def not_counted(self) -> Joints:
        """The value for a port that the latest numbers do not have."""
        return (
            NOT_COUNTED
            if self._counting.why is None
            else Joints(why=f"cannot be counted: {self._counting.why}")
        )

    def close(self) -> None:
        self._counting.close()
