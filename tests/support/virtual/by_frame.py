"""Asks a virtual station with frames that are built without the product's encoder."""

from __future__ import annotations

from support.golden.form import framed
from support.product import VirtualStation

T0 = 1000.0


def frame(text: str, addresses: str = "0001") -> bytes:
    """A frame; by default to the station from a computer."""
    return framed(text, addresses)


def told(asked: VirtualStation, text: str, now: float = T0) -> str | None:
    """What the station answers to a question with addresses, as text, its check byte seen to."""
    replies = asked.receive(frame(text), now)
    if not replies:
        return None
    (reply,) = replies
    assert reply.data == frame(reply.data[5:-2].decode(), "0100")
    return reply.data[5:-2].decode()
