"""Reads that a start rests on: what was lost or garbled on the line is asked again, a bounded number of times.

One lost answer, or one station that says nothing for a moment, must not refuse a run. What a station says on purpose is taken
at once: that it does not know a command, that a value is out of its range, that Robot mode is off.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from jbclog.effects import Steps, T, Wait
from jbclog.errors import AnswerCorrupt, AnswerFormat, AnswerTimeout, ImplausibleAnswer, NotReceived
from jbclog.station.client import Client

START_TRIES: Final = 3  # each of them with the client's own repeats
SETTLE_S: Final = 0.2  # between two tries: what is still on its way arrives, a burst of noise ends
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
        client.unasked((yield Wait(client.now + SETTLE_S)))
    raise AssertionError("no try at all")
