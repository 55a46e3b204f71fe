"""The guard of a run, as `app.run.runner` sees it: leases made of what the sessions know, renewed while the loop turns."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from jbclog.core.rows import StationFacts
from jbclog.guard.lease import StationLease
from jbclog.guard.supervisor import GuardSupervisor

RUNNING = "running"  # the outcome of a session that has not ended
NO_MORE = "verified"  # a tool that was read back in its safe state is nobody's to guard any more


class Guarding:
    """A guard from `start` to `end`; without a start nothing is told to anybody."""

    def __init__(self) -> None:
        self._supervisor: GuardSupervisor | None = None

    def start(self, folder: Path, tell: Callable[[str, str], None]) -> None:
        """Start it. Raises `StartRefused`; nothing has been sent to any station then."""
        self._supervisor = GuardSupervisor(folder, tell)

    def know(self, facts: StationFacts) -> None:
        """Lease what these facts say may be hot. Called before the first write to a tool goes out."""
        if self._supervisor is not None and facts.asked_safe_state:
            self._supervisor.lease(lease_of(facts))

    def renew(self) -> None:
        """Say that the recorder lives."""
        if self._supervisor is not None:
            self._supervisor.renew()

    def end(self) -> None:
        """All sessions have come to their own ends."""
        if self._supervisor is not None:
            self._supervisor.end()

    def take_over(self) -> None:
        """Sessions have not come to their own ends, and all ports are closed. Waits until the guard has done what it can."""
        if self._supervisor is not None:
            self._supervisor.take_over()


def lease_of(facts: StationFacts) -> StationLease:
    """What must be made safe on a station if its recorder dies now. While its session goes on, all that was touched."""
    is_over = facts.outcome != RUNNING
    return StationLease(
        name=facts.name,
        url=facts.url,
        baudrate=facts.baudrate,
        format=facts.format,
        address=facts.address,
        family=facts.family,
        model=facts.model,
        software=facts.software,
        safe_state=facts.asked_safe_state,
        ports=tuple(port for port in facts.touched if not (is_over and facts.safe_state.get(port) == NO_MORE)),
        feeds=facts.may_feed,
        model_accepted=facts.model_accepted,
        suction=tuple(facts.suction),
    )
