"""What a run knows of its stations' identities now, for its guard (`guard.continuity`)."""

from __future__ import annotations

from collections.abc import Iterable

from jbclog.config.line import Line
from jbclog.core.clock import elapsed
from jbclog.guard.continuity import Proof
from jbclog.protocol.commands.status import StatusWord
from jbclog.session.run.context import SessionContext
from jbclog.session.run.state import PortState
from jbclog.transport.device import PortDevice, device_of
from jbclog.transport.port import Port


class Identities:
    """Collects proofs from the sessions `contexts`, and the devices that their ports lead to."""

    def __init__(self, line: Line, contexts: Iterable[SessionContext]) -> None:
        self._contexts = {context.name: context for context in contexts}
        self._others = {
            station.family for station in line.stations if station.name not in self._contexts
        }
        self._opened: dict[str, tuple[PortDevice | None, float]] = {}
        self._proofs: dict[str, Proof] = {}

    def note_opened(self, name: str, port: Port) -> None:
        """Register that a station's port was opened. Safe to call from other threads."""
        device = device_of(self._contexts[name].order.url, port.fileno())
        self._opened[name] = device, elapsed()

    def __contains__(self, name: str) -> bool:
        """Return True if the station has a proof."""
        return name in self._proofs

    def families(self) -> list[str]:
        """Return the families of the line, recorded or not; ``auto`` for an unknown one."""
        recorded = {context.state.facts.family for context in self._contexts.values()}
        return sorted(self._others | recorded)

    def proofs(self) -> list[Proof]:
        """Return the last proof of each station with touched tools."""
        for name, context in self._contexts.items():
            if any(port.touched for port in context.state.ports.values()):
                self._renew(name, context)
        return list(self._proofs.values())

    def _renew(self, name: str, context: SessionContext) -> None:
        """Renew a proof if the station counts as the one of the start. While it is away, the last
        proof stays; drop it once another station has answered.
        """
        if context.state.stranger is not None or not context.state.identity_at:
            self._proofs.pop(name, None)
            return
        device, opened_at = self._opened.get(name, (None, 0.0))
        is_of_this_device = min(context.state.identity_at.values()) >= opened_at
        if device is not None and context.state.is_proven and is_of_this_device:
            statuses = {
                port.number: _status(context, port)
                for port in context.state.ports.values()
                if port.touched
            }
            hours = dict(context.state.plugged_hours)
            self._proofs[name] = Proof(name, device, context.station.heard, statuses, hours)


def _status(context: SessionContext, port: PortState) -> StatusWord | None:
    """Return the last status word; None if it is unknown: never read, or ordered since."""
    if port.status is not None or context.state.has_ordered_status:
        return port.status
    before = port.held.get("status")
    return before if isinstance(before, tuple) else None
