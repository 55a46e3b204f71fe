"""Which station answers at a lease's port, before anything is written to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from jbclog.core.errors import Refusal
from jbclog.guard.continuity import Hours
from jbclog.guard.lease import StationLease
from jbclog.protocol.client.confirmed_reads import read_confirmed
from jbclog.protocol.client.interface import Client
from jbclog.protocol.commands.family import FAMILIES
from jbclog.protocol.commands.plugged_hours import can_be

NO_HOURS: Final[Mapping[int, tuple[int, float]]] = MappingProxyType({})


def _ignore(_other: str) -> None:
    """Forget another station."""


async def identify(
    client: Client,
    lease: StationLease,
    hours: Hours = NO_HOURS,
    found_other: Callable[[str], None] = _ignore,
) -> bool:
    """Return True if the station answers the leased model, the leased software if there is one, and
    plugged hours that fit those of the run. `found_other` gets the description of another one.
    """
    if not (lease.model_accepted or FAMILIES[lease.family].proves(lease.model or "")):
        return False
    try:
        other = await _difference(client, lease, hours)
    except Refusal:  # the station of the run answered
        return False
    if other is not None:
        found_other(other)
    return other is None


async def _difference(client: Client, lease: StationLease, hours: Hours) -> str | None:
    """Describe how the station differs from the leased one; None if it does not."""
    family = FAMILIES[lease.family]
    commands = family.commands
    model = await read_confirmed(client, commands["model"], known=lease.model)
    if model != lease.model:
        return f"a {model}, not the {lease.model}"
    if lease.software is not None:
        software = await read_confirmed(client, commands["software_version"], known=lease.software)
        if software != lease.software:
            return f"a {model} with software {software}, not the one with {lease.software}"
    if family.hours is None:
        return None
    for port, (before, then) in hours.items():
        now = await read_confirmed(client, commands[family.hours], port, known=before, grows=True)
        if not isinstance(now, int) or not can_be(now, before, client.now - then):
            return f"a {model} with {now} plugged hours on port {port}, not the one with {before}"
    return None
