"""The guard's disk writes, in a thread: a hanging disk must not stop it from watching.

The thread writes the lease, and loads the modules that opening the ports needs, because the disk
may be gone at the take-over.
"""

from __future__ import annotations

import _thread
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from threading import Condition

from jbclog.guard import lease
from jbclog.guard.action_log import ActionLog
from jbclog.guard.lease import StationLease
from jbclog.transport.opening import make_ready

LINES_A_STATION = 3  # in the action log, plus one for each tool


class LeaseWriter:
    """Write the newest leases to `folder`, and reserve space in the `action_log` for their lines.

    If the disk fails, the guard keeps watching.
    """

    def __init__(self, folder: Path, action_log: ActionLog) -> None:
        self._folder = folder
        self._action_log = action_log
        self._changed = Condition()
        self._waiting: list[StationLease] | None = None
        self._is_writing = False
        self._is_written = False
        # `Thread.start` waits forever for a thread that is refused memory
        _thread.start_new_thread(self._write_on, ())

    def put(self, stations: Iterable[StationLease]) -> None:
        """Hand over the newest leases; does not wait."""
        with self._changed:
            self._waiting = list(stations)
            self._changed.notify_all()

    def settle(self, patience_s: float) -> None:
        """Wait until the newest leases are written, or failed."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._waiting is None and not self._is_writing, patience_s
            )

    @property
    def was_cleared(self) -> bool:
        """Return True if another process removed the leases written here. Needs no descriptor."""
        return self._is_written and not (self._folder / lease.NAME).exists()

    def _write_on(self) -> None:
        while True:
            # not `suppress`: creating one takes memory, and a refusal there would end this thread
            try:
                self._write_next()
            except Exception:
                continue

    def _write_next(self) -> None:
        with self._changed:
            self._is_writing = False
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._waiting is not None)
            stations, self._waiting, self._is_writing = self._waiting or [], None, True
        self._write(stations)

    def _write(self, stations: list[StationLease]) -> None:
        with suppress(Exception):  # earlier leases are still on the disk
            lease.write_leases(self._folder, stations)
            self._is_written = any(station.holds for station in stations)
        with suppress(Exception):
            self._action_log.reserve(
                sum(len(station.ports) + LINES_A_STATION for station in stations if station.holds)
            )
        for station in stations:
            make_ready(station.url)
