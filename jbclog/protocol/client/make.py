"""Choose the client for a family."""

from __future__ import annotations

from jbclog.core.serial_line import LineFormat
from jbclog.protocol.client.interface import Client
from jbclog.protocol.client.omega import OmegaStation
from jbclog.protocol.client.robot import Station
from jbclog.protocol.commands.family import OMEGA, Family


def client_for(family: Family | None, line: LineFormat, address: int | None) -> Client:
    """Return the client for `family`; None (not known yet) uses JBC's protocol."""
    if family is not None and family.protocol == OMEGA:
        return OmegaStation(line)
    return Station(line, address)
