"""Each read of a station, both ways: by `ask`, and by `request` and `value`, as a session
samples.
"""

from __future__ import annotations

import pytest

from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value
from jbclog.protocol.client.robot import Station
from jbclog.protocol.commands.command import Command


def read_in_short(
    station: Station, command: Command, port: int | None = None, tool: int | None = None
) -> Steps[Value]:
    question = station.question(command, port, tool)
    request = station.request(question)
    if request is None:
        return (yield from station.ask(question))
    heard = yield request
    value = station.value(question, heard)
    return value if value is not None else (yield from station.ask(question, heard))


@pytest.fixture(autouse=True, params=["ask", "request and value"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param != "ask":
        monkeypatch.setattr(Station, "read", read_in_short)
