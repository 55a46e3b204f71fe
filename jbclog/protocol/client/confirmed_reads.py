"""Reads of important values, repeated until confirmed, and the check of a station's family."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final

from jbclog.core.errors import (
    AnswerContradicted,
    AnswerCorrupt,
    AnswerFormat,
    AnswerTimeout,
    ImplausibleAnswer,
    NotReceived,
    StationError,
)
from jbclog.core.io_requests import Steps, T, wait
from jbclog.core.quantities import Value
from jbclog.protocol.client.interface import Client, PreparedRead
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import Family, foreign_reads

# An XOR check byte misses two flipped bits in the same position of two characters, so one answer
# proves little (docs/reference/faults.md, F-3). Settings, counters, tools and names are read until
# two answers agree.

ANSWERS = 4  # at most


async def read_confirmed(
    client: Client,
    command: Command,
    port: int | None = None,
    tool: int | None = None,
    *,
    known: Value | None = None,
    grows: bool = False,
    doubted: Counter[str] | None = None,
    answered: Callable[[PreparedRead], None] = lambda _: None,
) -> Value:
    """Read until two answers are equal; one is enough if it equals `known`, a value confirmed
    before.

    With `grows` (a counter, which may increase meanwhile) the middle one of three non-decreasing
    answers is enough: it is correct, or lies between two correct ones. `doubted` counts, by command
    name, answers that the next one did not confirm; `answered` is called for each answer. Raises
    `ImplausibleAnswer` if `ANSWERS` answers do not agree, and whatever reading raises.
    """
    question = client.question(command, port, tool)
    given: list[Value] = []
    while len(given) < ANSWERS:
        given.append(await client.ask(question))
        answered(question)
        value = confirmed_value(given, known, grows=grows)
        if value is not None:
            return value
        if doubted is not None and len(given) > 1:
            doubted[command.name] += 1
    raise ImplausibleAnswer(
        f"{question.title()}: {', '.join(map(command.shown, given))} when asked {ANSWERS} times"
    )


def confirmed_value(
    given: Sequence[Value], known: Value | None = None, *, grows: bool = False
) -> Value | None:
    """Return the value that the last of `given` (oldest first) confirms; None if it confirms
    none.
    """
    *before, last = given
    if last == known or last in before:
        return last
    if grows and len(before) > 1:
        first, middle = before[-2:]
        if (
            isinstance(first, int | float)
            and isinstance(middle, int | float)
            and isinstance(last, int | float)
        ):
            return middle if first <= middle <= last else None
    return None


# Reads at the start of a run are retried a few times if the link lost or garbled the answer: one
# lost answer or a busy station must not refuse a run. A refusal is final at once: unknown command,
# value out of range, Robot mode off.

SETTLE_S: Final = 0.2  # for late bytes and bursts of noise
PAUSES_S: Final = (SETTLE_S, 1.0, 2.0, 3.0)
"""Pauses between tries: a station may be busy for seconds, and no manual prints a response time."""
START_TRIES: Final = 1 + len(PAUSES_S)  # each with the client's own repeats
SILENT_S: Final = 10.0  # without a complete answer; then there are no more tries
LOST: Final = (
    AnswerTimeout,
    AnswerCorrupt,
    AnswerFormat,
    AnswerContradicted,
    ImplausibleAnswer,
    NotReceived,
)
"""Errors that the link can cause, none of them a decision of the station."""


async def with_retries(client: Client, ask: Callable[[], Steps[T]], tries: int) -> T:
    """Return the result of `ask` within `tries`. The last error states the number of tries."""
    began = client.now
    for number in range(1, tries + 1):
        try:
            return await ask()
        except LOST as error:
            if number == tries or client.now - max(client.heard, began) > SILENT_S:
                if tries > 1:
                    error.args = (f"{error}, in {number} {'try' if number == 1 else 'tries'}",)
                raise
        await pause(client, number)
    raise AssertionError("no try at all")


async def pause(client: Client, number: int) -> None:
    """Wait after try `number` (from 1), longer each time."""
    client.unasked(await wait(client.now + PAUSES_S[min(number, len(PAUSES_S)) - 1]))


# A model name accepted by the line file proves nothing, and status 00001 puts a soldering tool to
# rest but switches hot air on. So before the first status order the station must answer, twice
# each, reads that only its kind supports (`Family.answered_by_kind`), and none that only another
# kind does.

NOT_DRIVEN: Final = "Nothing was written to it: correct `family`, or the cable"


async def kind_problem(client: Client, family: Family, port: int) -> str | None:
    """Describe why the station is not of `family`'s kind; None if it is. Raises `LinkError`."""
    why = await unanswered_read(client, family, port, START_TRIES)
    for command in foreign_reads(family) if why is None else ():
        if await _refusal(client, command, port, tries=1) is None:
            return f"it answers R-{_code(command, port)}, which only another kind of station does"
    return why


async def unanswered_read(client: Client, family: Family, port: int, tries: int = 1) -> str | None:
    """As `kind_problem`, using only the family's own reads, for use when time is short."""
    for command in (family.commands[name] for name in 2 * family.answered_by_kind):
        error = await _refusal(client, command, port, tries)
        if error is not None:
            return f"it does not answer R-{_code(command, port)}, as a {family.name} does ({error})"
    return None


async def _refusal(client: Client, command: Command, port: int, tries: int) -> StationError | None:
    """Return the error of a read; None if it returned a value."""
    try:
        await with_retries(client, lambda: client.read(command, _port(command, port)), tries)
    except StationError as error:
        return error
    return None


def _port(command: Command, port: int) -> int | None:
    return port if command.scope is Scope.PORT else None


def _code(command: Command, port: int) -> str:
    return command.code(_port(command, port))
