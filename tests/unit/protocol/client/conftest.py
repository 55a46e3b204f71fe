"""For what reads by `Station.read`: each read both ways, by `ask`, and the short way, as a session
samples.
"""

from __future__ import annotations

import pytest

from jbclog.protocol.client.robot import Station
from support.clients.short_way import read_in_short


@pytest.fixture(params=["ask", "the short way"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param != "ask":
        monkeypatch.setattr(Station, "read", read_in_short)
