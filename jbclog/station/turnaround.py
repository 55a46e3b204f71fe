"""How long a station itself takes to answer, measured with harmless reads."""

from __future__ import annotations

from collections.abc import Sequence

from jbclog.effects import Steps
from jbclog.errors import StationError
from jbclog.station.client import Asking, Client


def turnarounds_us(client: Client, questions: Sequence[Asking], reads: int) -> Steps[list[float]]:
    """Ask `reads` times, the questions in turn; how long each answer took beside its bytes, in µs.

    What was not answered is missing. Where more than half fail, no more is asked.
    """
    took: list[float] = []
    for number in range(reads):
        if number - len(took) > reads // 2:
            break
        question = questions[number % len(questions)]
        try:
            yield from client.ask(question)
        except StationError:
            continue
        took.append((client.heard - client.sent - question.wire_s) * 1e6)
    return took
