"""An order to a station that does not answer: which one, and how it is sent. Whether it may be sent
is decided elsewhere (`guard.continuity`; `jbclog safe --unanswered`).
"""

from __future__ import annotations

from contextlib import suppress

from jbclog.core.errors import LinkFlooded, StationError
from jbclog.core.quantities import Value
from jbclog.protocol.client.interface import Client
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.status import EXTRACTOR, StatusWord
from jbclog.session.safety.time_budget import in_time

ANSWER_S = 0.15  # for an acknowledgement, which is not expected


def blind_word(family: Family, *, suction: bool, mixed: bool) -> StatusWord | None:
    """Return the order that makes a tool safe without reading anything; None if there is none.

    On a mixed line, where another family may take the same bytes otherwise, it is 00010, which
    heats no tool of any family.
    """
    orders = [family.status.orders[state] for state in family.safe_states]
    if mixed:
        return EXTRACTOR if EXTRACTOR in orders else None
    return family.status.with_suction(orders[0], on=suction) if orders else None


async def write_unanswered(
    client: Client, family: Family, name: str, value: Value, port: int | None = None
) -> bool:
    """Write once, without waiting long for an answer; return True if the frame was sent. Raises
    `LinkError` if the link breaks.
    """
    before = client.exchanges
    writing = client.write(family.commands[name], value, port, hurry=True, once=True)
    with suppress(StationError, LinkFlooded):
        await in_time(writing, client.now, client.now + ANSWER_S)
    return client.exchanges > before
