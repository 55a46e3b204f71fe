"""Keeps one guard alive for as long as a run goes on: a guard that dies is a critical event, and is replaced at once."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from jbclog.core.errors import StartRefused
from jbclog.guard import lease
from jbclog.guard.lease import StationLease
from jbclog.guard.process import GuardLost, GuardProcess

REPLACED_AT_MOST: Final = 20  # whatever kills guards will not be outlived by more of them

Tell = Callable[[str, str], None]
"""Is given the kind and the sentence of a critical event."""


class GuardSupervisor:
    """The guard of the run in `folder`. Raises `StartRefused` where the first one cannot be started."""

    def __init__(self, folder: Path, tell: Tell) -> None:
        self._folder = folder
        self._tell = tell
        self._leases: dict[str, StationLease] = {}
        self._replaced = 0
        self._is_handed_over = False  # to the guard: the lease is its own from then on
        self._guard: GuardProcess | None = GuardProcess(folder)
        self._guard.await_ready()

    @property
    def is_watching(self) -> bool:
        """Whether there is a guard now."""
        return self._guard is not None

    @property
    def pid(self) -> int | None:
        return self._guard.pid if self._guard else None

    def lease(self, station: StationLease) -> None:
        """Tell the guard what must be made safe on a station."""
        self._leases[station.name] = station
        self._say(lambda guard: guard.lease(station))

    def renew(self) -> None:
        """Say that the recorder lives; to be called each `RENEW_S`."""
        self._say(lambda guard: guard.renew())

    def end(self) -> None:
        """The tools are safe, or those that are not have been told: there is nothing left to guard."""
        if self._guard is not None:
            self._guard.end()
            self._guard = None
        if not self._is_handed_over:
            with suppress(Exception):  # a guard that was lost, or failed at this, left it open: the next start would find tools hot
                lease.keep(self._folder, ())

    def take_over(self) -> None:
        """The recorder has failed, and its ports are closed: have the guard make safe what is leased. Waits for it."""
        self._is_handed_over = True
        if self._guard is not None:
            self._guard.take_over()
            self._guard = None

    def _say(self, what: Callable[[GuardProcess], None]) -> None:
        if self._guard is None:
            return
        try:
            what(self._guard)
        except GuardLost as lost:
            self._replace(lost)

    def _replace(self, lost: GuardLost) -> None:
        if self._guard is not None:
            self._guard.kill()
        self._guard = None
        if self._replaced >= REPLACED_AT_MOST:
            self._tell("guard.lost", f"The guard was lost for good ({lost}); nobody makes the tools safe if this recorder dies.")
            return
        self._replaced += 1
        self._tell("guard.lost", f"The guard was lost ({lost}); another one takes its place.")
        try:
            self._guard = GuardProcess(self._folder)
            for station in self._leases.values():
                self._guard.lease(station)
        except (GuardLost, StartRefused) as error:
            self._guard = None
            self._tell("guard.lost", f"It could not be replaced ({error}); nobody makes the tools safe if this recorder dies.")
