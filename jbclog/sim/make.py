"""Which virtual station plays a station of which family."""

from __future__ import annotations

from jbclog.config.line import StationSpec
from jbclog.protocol.commands.family import FAMILIES, OMEGA
from jbclog.sim.omega import VirtualOmega
from jbclog.sim.virtual import VirtualStation


def virtual_station(spec: StationSpec, *, now: float) -> VirtualStation | VirtualOmega:
    """The virtual station that a line file describes, switched on at `now`. Raises `UsageError` where there is none."""
    family = FAMILIES.get(spec.family)
    if family is not None and family.protocol == OMEGA:
        return VirtualOmega(spec, now=now)
    return VirtualStation(spec, now=now)
