"""Which client speaks to a station of which family."""

from __future__ import annotations

from jbclog.commands.family import Family
from jbclog.station.client import Client
from jbclog.station.robot import Station
from jbclog.wire import LineFormat


def client_for(family: Family | None, line: LineFormat, address: int | None) -> Client:
    """The client for `family`; None, a family that is still to be learnt, is asked in JBC's protocol."""
    return Station(line, address)
