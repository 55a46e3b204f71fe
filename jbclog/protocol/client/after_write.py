"""After a write that takes the station away from its line: a restart, another address. Generators, no I/O.

Both writes go out once, whatever comes of them. Nothing prints what the station answers
(docs/reference/contradictions.md, B-9, B-40), so an
acknowledgement and silence are taken alike, and what counts is who answers R-SMN afterwards.
"""

from __future__ import annotations

from jbclog.core.errors import AnswerTimeout, Refusal, StationError, StationSilent
from jbclog.core.io_requests import Steps, Wait
from jbclog.protocol.client.interface import Client
from jbclog.protocol.client.robot import Station
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.robot import COMMON

MODEL = next(command for command in COMMON if command.name == "model")
NOT_ACKNOWLEDGED = 40  # B-number
BACK_S = 30.0  # a station that is not back by then is gone
SEEK_S = 0.5  # between two questions to a station that restarts
STEADY = 4  # answers in a row: it may go on answering for a moment before it goes down


def restart(client: Client, command: Command) -> Steps[float]:
    """Write W-RST once and wait until the station is back; give the seconds that took.

    Raises `Refusal` where the station says no, and `StationSilent` where it does not come back.
    """
    began = client.now
    try:
        yield from client.write(command, 0)
    except Refusal:
        raise
    except StationError:  # as good as an acknowledgement
        client.anomalies.meet(NOT_ACKNOWLEDGED, "restart", f"W{command.code()} without an answer")
    yield from settle_restart(client)
    return client.now - began


def settle_restart(client: Client) -> Steps[None]:
    """Wait until a station that was told to restart answers steadily. Raises `StationSilent` where it does not."""
    end, steady = client.now + BACK_S, 0
    while steady < STEADY:
        if client.now > end:
            raise StationSilent(f"the station was told to restart and did not answer again within {BACK_S:g} s")
        client.unasked((yield Wait(client.now + SEEK_S)))
        try:
            yield from client.read(MODEL)
            steady += 1
        except StationError:
            steady = 0


def change_address(station: Station, command: Command, address: int | None) -> Steps[None]:
    """Write W-SAD once and speak to the station at its new address from then on; None is a line without addresses.

    Raises `Refusal` where the station says no, and what `settle_address` raises.
    """
    try:
        yield from station.write(command, address or 0)
    except Refusal:
        raise
    except StationError:
        pass  # who answers at which address is asked below
    yield from settle_address(station, address)


def settle_address(station: Station, address: int | None) -> Steps[None]:
    """Prove by R-SMN that the station answers at `address`.

    Raises `AnswerTimeout` where it does not: either it still answers at its old address, to which `station` then speaks
    again, or it answers at neither.
    """
    old = station.address
    for tried in (address, old, address, old):  # it may still be storing the new one
        station.move_to(tried)
        try:
            yield from station.read(MODEL)
        except StationError:
            continue
        if tried == address:
            return
        raise AnswerTimeout(f"the station still answers at its old address ({_words(old)})")
    raise AnswerTimeout(f"the station answers neither at its new address ({_words(address)}) nor at its old one ({_words(old)})")


def _words(address: int | None) -> str:
    return "none: frames without addresses" if address is None else f"{address:02d}"
