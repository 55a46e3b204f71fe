"""Serves virtual stations on their links.

One loop, one thread. What a station says goes out whole at the moment when its last byte would have arrived
on a real wire.
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

# -- wire file ----------------------------------------------------------------------------------------------------------------
# The wire of all served stations as a file of JSON lines, for tests and for people who look for a fault.


class WireFile:
    """``{"t": 123.4, "station": "dde-1", "kind": "question", "text": "0001RTT1", "hex": "02..."}``.

    `t` is in monotonic seconds, when the bytes were read or written; `kind` is question, answer, unplugged or
    plugged; `text` is what is printable of the bytes.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", encoding="ascii", buffering=1)

    def note(self, moment: float, station: str, kind: str, data: bytes) -> None:
        text = "".join(chr(byte) for byte in data[:-1] if 0x20 <= byte < 0x7F)  # the last byte is the check byte
        self._file.write(json.dumps({"t": moment, "station": station, "kind": kind, "text": text, "hex": data.hex()}) + "\n")

    def close(self) -> None:
        self._file.close()


class NoWireFile(WireFile):
    """Notes nothing."""

    def __init__(self) -> None:
        return

    def note(self, moment: float, station: str, kind: str, data: bytes) -> None:
        return

    def close(self) -> None:
        return


# -- serve --------------------------------------------------------------------------------------------------------------------


class Servable(Protocol):
    """A station that is all in this program: virtual, or played from a tape. Moments are monotonic seconds."""

    @property
    def name(self) -> str: ...

    def receive(self, data: bytes, now: float) -> Sequence[Reply]: ...

    def is_unplugged(self, now: float) -> bool: ...

    def next_plugging(self, now: float) -> float | None: ...


@dataclass(frozen=True, slots=True)
class Served:
    """A station and the link that it is served on."""

    station: Servable
    link: Link


class Server:
    """Serves until `stop` is called. Opening the links is `open`'s work, so that ready can be told."""

    def __init__(self, served: Sequence[Served], waiter: Waiter, wire_file: WireFile | None = None) -> None:
        self._served = served
        self._waiter = waiter
        self._wire_file = wire_file or NoWireFile()
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._number = count()
        self._awaited: set[str] = set()  # stations whose next pulling or plugging in is on the list
        self._stopped = False

    def open(self) -> None:
        """Make all ports appear."""
        for one in self._served:
            self._plug_in(one)

    def run(self) -> None:
        """Serve until `stop`, then make the ports disappear."""
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
        """End `run` in good order with SIGINT and SIGTERM."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self.stop())

    def stop_at_end_of(self, descriptor: int) -> None:
        """End `run` when whoever writes to `descriptor` is gone."""
        self._waiter.add(descriptor, partial(self._read_to_end, descriptor))

    def _read_to_end(self, descriptor: int, _now: float) -> None:
        if not os.read(descriptor, 4096):
            self._stopped = True

    def close(self) -> None:
        """Make the ports disappear."""
        for one in self._served:
            one.link.pull_out()

    def _do_what_is_due(self) -> float | None:
        """Do it, in order; the seconds until the next, None where nothing is to come."""
        while self._due:
            ahead = self._due[0][0] - monotonic()
            if ahead > 0:
                return ahead
            heapq.heappop(self._due)[2]()
        return None

    def _at(self, moment: float, do: Callable[[], None]) -> None:
        heapq.heappush(self._due, (moment, next(self._number), do))

    def _hear(self, one: Served, data: bytes, now: float) -> None:
        self._wire_file.note(now, one.station.name, "question", data)
        for reply in one.station.receive(data, now):
            self._at(reply.at, partial(self._say, one, reply.data))
        if one.station.name not in self._awaited:
            self._await_plugging(one, now)

    def _say(self, one: Served, data: bytes) -> None:
        one.link.send(data)
        self._wire_file.note(monotonic(), one.station.name, "answer", data)

    def _await_plugging(self, one: Served, now: float) -> None:
        """Put the next pulling or plugging in on the list, once the station knows of it."""
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
        one.link.plug_in(partial(self._hear, one))
