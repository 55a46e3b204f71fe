"""Values that something is decided by: believed when two answers say the same.

A check byte that is an XOR does not see two bits that are turned over in the same place of two characters, so one answer
proves little (docs/reference/faults.md, F-3). A setting, a counter, a tool and a name are asked until an answer comes a
second time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from jbclog.core.errors import ImplausibleAnswer
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value
from jbclog.protocol.client.interface import Client
from jbclog.protocol.commands.command import Command

ANSWERS = 4  # that are asked for at the most


def agreed(
    client: Client,
    command: Command,
    port: int | None = None,
    tool: int | None = None,
    *,
    known: Value | None = None,
    grows: bool = False,
    doubted: Counter[str] | None = None,
) -> Steps[Value]:
    """Ask until two answers are the same; one does where it says what is `known`, which two have said before.

    With `grows` (a counter, which may go on while it is asked) the middle one of three does that never fall: it is right,
    or lies between two that are. `doubted` counts, by the command's name, the answers that the next one did not bear out.
    Raises `ImplausibleAnswer` where `ANSWERS` answers agree on nothing, and whatever asking raises.
    """
    question = client.question(command, port, tool)
    given: list[Value] = []
    while len(given) < ANSWERS:
        given.append((yield from client.ask(question)))
        value = borne_out(given, known, grows=grows)
        if value is not None:
            return value
        if doubted is not None and len(given) > 1:
            doubted[command.name] += 1
    raise ImplausibleAnswer(f"{question.title()}: {', '.join(map(command.shown, given))} when asked {ANSWERS} times")


def borne_out(given: Sequence[Value], known: Value | None = None, *, grows: bool = False) -> Value | None:
    """What `given`, the answers so far, oldest first, agree on with the last of them; None where they do not yet."""
    *before, last = given
    if last == known or last in before:
        return last
    if grows and len(before) > 1:
        first, middle = before[-2:]
        if isinstance(first, int | float) and isinstance(middle, int | float) and isinstance(last, int | float):
            return middle if first <= middle <= last else None
    return None
