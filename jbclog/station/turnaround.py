"""How long a station itself takes to answer, measured with harmless reads."""

from __future__ import annotations

from jbclog.commands.command import Scope
from jbclog.commands.family import Family
from jbclog.effects import Steps
from jbclog.errors import StationError
from jbclog.station.client import Asking, Client

READS = 12  # enough for a median that one late answer does not move
LEAST_ANSWERED = READS // 2  # with fewer the link is too bad to run on


def turnarounds_us(client: Client, family: Family, port: int) -> Steps[list[float]]:
    """Ask `READS` times what is harmless; how long each answer took beside its bytes, in µs, in order of size.

    What was not answered is missing. Once `LEAST_ANSWERED` can no more be reached, nothing more is asked.
    """
    questions = [_question(client, family, name, port) for name in family.harmless]
    took: list[float] = []
    for number in range(READS):
        if number - len(took) > READS - LEAST_ANSWERED:
            break
        question = questions[number % len(questions)]
        try:
            yield from client.ask(question)
        except StationError:
            continue
        took.append((client.heard - client.sent - question.wire_s) * 1e6)
    return sorted(took)


def _question(client: Client, family: Family, name: str, port: int) -> Asking:
    command = family.commands[name]
    return client.question(command, None if command.scope is Scope.STATION else port)
