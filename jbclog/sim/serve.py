"""Serve virtual stations on their links, in one thread.

An answer is sent whole at the time when its last byte would arrive on a real line.
"""

from __future__ import annotations

import gc
import heapq
import json
import os
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from time import monotonic
from typing import Protocol

from jbclog.sim.links import Link, Waiter, exact_timers
from jbclog.sim.virtual import Reply


class ByteLog:
    """Log the bytes of all served stations as JSON lines, for tests and troubleshooting.

    ``{"t": 123.4, "station": "dde-1", "kind": "question", "text": "0001RTT1", "hex": "02..."}``:
    `t` is in monotonic seconds; `kind` is question, answer, unplugged or plugged; `text` has the
    printable characters.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", encoding="ascii", buffering=1)

    def note(self, moment: float, station: str, kind: str, data: bytes) -> None:
        # the last byte is the check byte
        text = "".join(chr(byte) for byte in data[:-1] if 0x20 <= byte < 0x7F)
        self._file.write(
            json.dumps(
                {"t": moment, "station": station, "kind": kind, "text": text, "hex": data.hex()}
            )
            + "\n"
        )

    def close(self) -> None:
        self._file.close()


class NoByteLog(ByteLog):
    """Logs nothing."""

    def __init__(self) -> None:
        return

    def note(self, moment: float, station: str, kind: str, data: bytes) -> None:
        return

    def close(self) -> None:
        return


class Servable(Protocol):
    """A station inside this program. Times are monotonic seconds."""

    @property
    def name(self) -> str: ...

    def receive(self, data: bytes, now: float) -> Sequence[Reply]: ...

    def is_unplugged(self, now: float) -> bool: ...

    def next_plugging(self, now: float) -> float | None: ...


@dataclass(frozen=True, slots=True)
class Served:
    """A station and its link."""

    station: Servable
    link: Link


class Server:
    """Serves until `stop`. `open` creates the links, so that readiness can be reported."""

    def __init__(
        self, served: Sequence[Served], waiter: Waiter, wire_file: ByteLog | None = None
    ) -> None:
        self._served = served
        self._waiter = waiter
        self._wire_file = wire_file or NoByteLog()
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._number = count()
        self._awaited: set[str] = set()  # stations whose next plugging is scheduled
        self._stopped = False

    def open(self) -> None:
        """Create all ports."""
        for one in self._served:
            self._plug_in(one)

    def run(self) -> None:
        """Serve until `stop`, then remove the ports."""
        gc.freeze()
        exact_timers()
        try:
            while not self._stopped:
                self._waiter.wait(self._do_what_is_due())
        finally:
            self.close()

    def stop(self) -> None:
        """End `run`, from a signal handler or another thread."""
        self._stopped = True
        self._waiter.wake()

    def stop_on_signals(self) -> None:
        """End `run` on SIGINT and SIGTERM."""
        self._waiter.wake_on_signals()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self.stop())

    def stop_at_end_of(self, descriptor: int) -> None:
        """End `run` when the writer of `descriptor` has closed it."""
        self._waiter.add(descriptor, partial(self._read_to_end, descriptor))

    def _read_to_end(self, descriptor: int, _now: float) -> None:
        if not os.read(descriptor, 4096):
            self._stopped = True

    def close(self) -> None:
        """Remove the ports."""
        for one in self._served:
            one.link.pull_out()

    def _do_what_is_due(self) -> float | None:
        """Run due calls; return the seconds until the next, or None."""
        while self._due:
            ahead = self._due[0][0] - monotonic()
            if ahead > 0:
                return ahead
            heapq.heappop(self._due)[2]()
        return None

    def _at(self, moment: float, do: Callable[[], None]) -> None:
        heapq.heappush(self._due, (moment, next(self._number), do))

    def _receive(self, one: Served, data: bytes, now: float) -> None:
        self._wire_file.note(now, one.station.name, "question", data)
        for reply in one.station.receive(data, now):
            self._at(reply.at, partial(self._send, one, reply.data))
        if one.station.name not in self._awaited:
            self._await_plugging(one, now)

    def _send(self, one: Served, data: bytes) -> None:
        one.link.send(data)
        self._wire_file.note(monotonic(), one.station.name, "answer", data)

    def _await_plugging(self, one: Served, now: float) -> None:
        moment = one.station.next_plugging(now)
        if moment is not None:
            self._awaited.add(one.station.name)
            self._at(moment, partial(self._change_plug, one, moment))

    def _change_plug(self, one: Served, moment: float) -> None:
        if one.station.is_unplugged(moment):
            one.link.pull_out()
            self._wire_file.note(monotonic(), one.station.name, "unplugged", b"")
        else:
            self._plug_in(one)
            self._wire_file.note(monotonic(), one.station.name, "plugged", b"")
        self._awaited.discard(one.station.name)
        self._await_plugging(one, moment)

    def _plug_in(self, one: Served) -> None:
        one.link.plug_in(partial(self._receive, one))
