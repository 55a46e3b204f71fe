"""Reads that a start rests on: what was lost or garbled on the line is asked again, a bounded number of times.

One lost answer, or one station that says nothing for a moment, must not refuse a run. What a station says on purpose is taken
at once: that it does not know a command, that a value is out of its range, that Robot mode is off.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from jbclog.core.errors import AnswerCorrupt, AnswerFormat, AnswerTimeout, ImplausibleAnswer, NotReceived
from jbclog.core.io_requests import Steps, T, Wait
from jbclog.protocol.client.interface import Client

SETTLE_S: Final = 0.2  # what is still on its way arrives, a burst of noise ends
PAUSES_S: Final = (SETTLE_S, 1.0, 2.0, 3.0)
"""Between two tries, longer each time: a station may be busy for seconds, and no manual prints a response time."""
START_TRIES: Final = 1 + len(PAUSES_S)  # each of them with the client's own repeats
SILENT_S: Final = 10.0  # without one whole answer, after which nothing is tried again
LOST: Final = (AnswerTimeout, AnswerCorrupt, AnswerFormat, ImplausibleAnswer, NotReceived)
"""What a line does to an answer, or a question: nothing here says that the station does not want to."""


def patiently(client: Client, ask: Callable[[], Steps[T]], tries: int) -> Steps[T]:
    """What `ask` gives, within so many tries. The error that the last of them raises says how many there were."""
    began = client.now
    for number in range(1, tries + 1):
        try:
            return (yield from ask())
        except LOST as error:
            if number == tries or client.now - max(client.heard, began) > SILENT_S:
                if tries > 1:
                    error.args = (f"{error}, in {number} {'try' if number == 1 else 'tries'}",)
                raise
        yield from pause(client, number)
    raise AssertionError("no try at all")


def pause(client: Client, number: int) -> Steps[None]:
    """Wait after the `number`-th try of several (from 1), longer each time."""
    client.unasked((yield Wait(client.now + PAUSES_S[min(number, len(PAUSES_S)) - 1])))
