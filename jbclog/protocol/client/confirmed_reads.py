"""Values and families that something is decided by: read until they are confirmed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final

from jbclog.core.errors import AnswerCorrupt, AnswerFormat, AnswerTimeout, ImplausibleAnswer, NotReceived, StationError
from jbclog.core.io_requests import Steps, T, Wait
from jbclog.core.quantities import Value
from jbclog.protocol.client.interface import Client
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import Family, foreign_reads

# -- agreement ----------------------------------------------------------------------------------------------------------------
# Values that something is decided by: believed when two answers say the same.
#
# A check byte that is an XOR does not see two bits that are turned over in the same place of two characters, so one answer
# proves little (docs/reference/faults.md, F-3). A setting, a counter, a tool and a name are asked until an answer comes a
# second time.

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


# -- patient reads ------------------------------------------------------------------------------------------------------------
# Reads that a start rests on: what was lost or garbled on the line is asked again, a bounded number of times.
#
# One lost answer, or one station that says nothing for a moment, must not refuse a run. What a station says on purpose is taken
# at once: that it does not know a command, that a value is out of its range, that Robot mode is off.

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


# -- family proof -------------------------------------------------------------------------------------------------------------
# Whether a station is of the kind that the line file says, by reads whose letters no other kind has.
#
# A model name that the line file accepts proves nothing, and status 00001 lets a soldering tool rest and switches hot air on. So
# before the first status order the station answers what only its kind answers (`Family.answered_by_kind`), twice each, and none
# of what only another kind does.

NOT_DRIVEN: Final = "Nothing was written to it: correct `family`, or the cable"


def why_not_borne_out(client: Client, family: Family, port: int) -> Steps[str | None]:
    """Why the station is not of the kind of `family`, in words; None where it is. Raises `LinkError`."""
    why = yield from why_not_answering(client, family, port, START_TRIES)
    for command in foreign_reads(family) if why is None else ():
        if (yield from _refusal(client, command, port, tries=1)) is None:
            return f"it answers R-{_code(command, port)}, which only another kind of station does"
    return why


def why_not_answering(client: Client, family: Family, port: int, tries: int = 1) -> Steps[str | None]:
    """As `why_not_borne_out`, by the family's own reads alone: where there is no time for those that must not be answered."""
    for command in (family.commands[name] for name in 2 * family.answered_by_kind):
        error = yield from _refusal(client, command, port, tries)
        if error is not None:
            return f"it does not answer R-{_code(command, port)}, as a {family.name} does ({error})"
    return None


def _refusal(client: Client, command: Command, port: int, tries: int) -> Steps[StationError | None]:
    """What came in place of a value; None where a value came."""
    try:
        yield from patiently(client, lambda: client.read(command, _port(command, port)), tries)
    except StationError as error:
        return error
    return None


def _port(command: Command, port: int) -> int | None:
    return port if command.scope is Scope.PORT else None


def _code(command: Command, port: int) -> str:
    return command.code(_port(command, port))
