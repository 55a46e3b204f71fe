"""What the guard wants of the disk, in a thread of its own: one that hangs must not keep it from watching.

The lease is kept there, and what opening its ports takes is loaded: at the take-over the disk may be gone.
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

LINES_A_STATION = 3  # in the diary, beside one for each tool


class LeaseWriter:
    """Keeps the newest lease in `folder`, and room in the `action_log` for what will have to be said of it.

    A disk that takes none is no reason to stop watching.
    """

    def __init__(self, folder: Path, action_log: ActionLog) -> None:
        self._folder = folder
        self._action_log = action_log
        self._changed = Condition()
        self._waiting: list[StationLease] | None = None
        self._is_writing = False
        self._is_kept = False
        _thread.start_new_thread(self._write_on, ())  # `Thread.start` waits for ever for one that is refused memory

    def put(self, stations: Iterable[StationLease]) -> None:
        """Have these kept; does not wait."""
        with self._changed:
            self._waiting = list(stations)
            self._changed.notify_all()

    def settle(self, patience_s: float) -> None:
        """Wait until the newest is kept, or was refused."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting is None and not self._is_writing, patience_s)

    @property
    def was_cleared(self) -> bool:
        """Whether somebody else has taken the lease away that was kept here."""
        return self._is_kept and not (self._folder / lease.NAME).exists()

    def _write_on(self) -> None:
        while True:
            with suppress(Exception):  # what comes next is kept all the same
                self._write_next()

    def _write_next(self) -> None:
        with self._changed:
            self._is_writing = False
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._waiting is not None)
            stations, self._waiting, self._is_writing = self._waiting or [], None, True
        self._keep(stations)

    def _keep(self, stations: list[StationLease]) -> None:
        try:
            lease.keep(self._folder, stations)
            self._is_kept = any(station.holds for station in stations)
        except Exception:
            self._is_kept = False  # no reason to stop watching
        with suppress(Exception):
            self._action_log.reserve(sum(len(station.ports) + LINES_A_STATION for station in stations if station.holds))
        for station in stations:
            make_ready(station.url)
