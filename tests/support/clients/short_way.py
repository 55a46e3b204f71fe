"""A read as a session samples: by `request` and `value`, with `rest` and `completed` where the
answer comes in pieces, and by `ask` from there on where something else comes.
"""

from __future__ import annotations

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
    while value is None and (rest := station.rest(question, heard)):
        heard = yield rest
        value = station.completed(question, heard)
    return value if value is not None else (yield from station.ask(question, heard))
