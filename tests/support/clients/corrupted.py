"""What a client takes of an answer whose bits were turned over: its whole acceptance, for the
question that is out.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import combinations

from support.product import (
    Client,
    Command,
    Frame,
    FrameReader,
    IoResult,
    LineFormat,
    OmegaStation,
    PreparedRead,
    Station,
    StationError,
    Value,
    pull,
    send,
)

LINE = LineFormat()


def taken(
    command: Command, port: int | None, tool: int | None, wire: bytes, address: int | None = 1
) -> Value | None:
    """The value that a client which has just asked takes `wire` for; None where it goes on
    listening or asks again.
    """
    station = Station(LINE, address)
    return _first_taken(station, station.question(command, port, tool), wire)


def taken_by_omega(command: Command, wire: bytes) -> Value | None:
    """The same on the line of an OMEGA."""
    station = OmegaStation(LINE)
    return _first_taken(station, station.question(command), wire)


def _first_taken(client: Client, question: PreparedRead, wire: bytes) -> Value | None:
    asking = client.ask(question)
    pull(asking)
    try:
        send(asking, IoResult(0.02, wire, 0.0))
    except StopIteration as done:
        return done.value  # type: ignore[no-any-return]  # what a generator returns
    except StationError:
        return None
    asking.close()
    return None


def flipped(wire: bytes, bits: int) -> Iterator[bytes]:
    """Every way to turn over so many different bits of `wire`."""
    whole = int.from_bytes(wire, "big")
    return ((whole ^ turned).to_bytes(len(wire), "big") for turned in _turned(len(wire), bits))


@cache
def _turned(size: int, bits: int) -> list[int]:
    return [sum(places) for places in combinations([1 << place for place in range(8 * size)], bits)]


def taken_of_two_bits(
    command: Command, port: int | None, tool: int | None, wire: bytes, address: int | None = 1
) -> list[tuple[bytes, Value]]:
    """Every corruption of two bits that a client takes, and for what.

    Where a reader finds no frame at all, none can be taken; the others go through the client.
    """
    found = [
        (sent, taken(command, port, tool, sent, address)) for sent in _framed_of_two_bits(wire)
    ]
    return [(sent, value) for sent, value in found if value is not None]


@cache
def _framed_of_two_bits(wire: bytes) -> list[bytes]:
    return [
        sent
        for sent in flipped(wire, 2)
        if any(isinstance(one, Frame) for one in FrameReader().feed(sent))
    ]
