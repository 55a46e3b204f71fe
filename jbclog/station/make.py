"""Which client speaks to a station of which family."""

from __future__ import annotations

from jbclog.commands.family import OMEGA, Family
from jbclog.station.client import Client
from jbclog.station.omega import OmegaStation
from jbclog.station.robot import Station
from jbclog.wire import LineFormat


def client_for(family: Family | None, line: LineFormat, address: int | None) -> Client:
    """The client for `family`; None, a family that is still to be learnt, is asked in JBC's protocol."""
    if family is not None and family.protocol == OMEGA:
        return OmegaStation(line)
    return Station(line, address)
