"""Feeder stopped, then each tool in its safe state, read back.

A station has no watchdog: what is not told to stand stays hot. So this is tried three times a tool, over a line that is
opened again if need be, in rounds, so that no tool waits for the tries of another. What cannot be known is not taken for
done: an order that was acknowledged and not read back is `SENT`, and what is read back counts when two answers say it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from jbclog.commands.command import Command
from jbclog.commands.family import Family
from jbclog.commands.status import StatusWord
from jbclog.effects import Reopen, Steps, Wait
from jbclog.errors import AnswerTimeout, LinkError, Refusal, StationError
from jbclog.safety.in_time import in_time
from jbclog.station.agreed import agreed
from jbclog.station.client import Client

ALLOWED_S = 3.0  # for one station (faults.md, section 9)
TRIES = 3
VERIFIED, SENT, FAILED = "verified", "sent", "failed"
STOPPED = "stopped"  # what the feeder says then
COOLING_AFTER_S = 1.0  # how long after the order an extractor state has to show in temperature or power
IDLE_PERMILLE = 20  # a heater that gets less than this is off
COLD_C = 60.0
ORDER_S = 1.0  # that a tool is left for its order, at the least
REOPEN_EVERY_S = 0.25

Prove = Callable[[], Steps[bool]]
"""Asks who is at the end of the line; whether it is the station that is meant. May raise what a question may."""


@dataclass(slots=True)
class Tool:
    """One port's tool and how far it got: `FAILED`, `SENT` (acknowledged) or `VERIFIED` (read back as `status`)."""

    port: int
    reached: str = FAILED
    status: StatusWord | None = None
    was_spared: bool = False  # it rested already, and was not told to
    was_told: bool = False  # an order went out, whatever came of it

    @property
    def is_safe(self) -> bool:
        return self.reached == VERIFIED


@dataclass(slots=True)
class Task:
    """The tools of one station that must be made safe, and what is known of the station.

    `wanted` is the name of one of the family's safe states; another, which a lease from elsewhere may name, is not ordered, but
    the usual one. `feeds`: the feeder may be running. `is_proven`: the port has
    not broken since the station said who it is; where it has, nothing is written before `prove` says so again. `spare`: a tool
    that rests already is left alone, because a tool that sleeps would wake to be told to stand.
    """

    client: Client
    family: Family
    wanted: str
    tools: list[Tool]
    feeds: bool
    prove: Prove
    is_proven: bool = True
    spare: bool = False
    is_silent: bool = False  # the last that was asked was not answered: acknowledgements are not waited for long
    has_fed: bool = field(init=False)
    end: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self.has_fed = self.feeds
        if self.wanted not in self.family.safe_states:
            self.wanted = next(iter(self.family.safe_states), self.wanted)

    @property
    def has_untold(self) -> bool:
        """Whether a tool still waits for its first order: then no other's answers are waited for in vain."""
        return not all(tool.was_told or tool.is_safe for tool in self.tools)

    @property
    def is_done(self) -> bool:
        return not self.feeds and all(tool.is_safe for tool in self.tools)


def secure(task: Task) -> Steps[None]:
    """Make it safe, as far as that goes in `ALLOWED_S`. What came of it stands in the task; nothing that a link or a
    station does is raised.
    """
    task.client.unasked((yield Wait(0.0)))
    begun = task.client.now
    task.end = begun + ALLOWED_S
    yield from in_time(_in_rounds(task), begun, task.end)


def _in_rounds(task: Task) -> Steps[None]:
    for round_ in range(TRIES):
        if round_:
            yield from _spread(task, TRIES - round_)
        yield from _round(task)
        if task.is_done or task.client.now >= task.end:
            return


def _spread(task: Task, rounds_left: int) -> Steps[None]:
    """Wait for a share of the time that is left: what blocked the line may go away."""
    now = task.client.now
    task.client.unasked((yield Wait(now + max(task.end - now, 0.0) / (rounds_left + 1))))


def _round(task: Task) -> Steps[None]:
    if task.feeds:
        task.feeds = not (yield from _stop_feeder(task))
    for tool in task.tools:
        if task.spare and not tool.is_safe:
            yield from _look(task, tool)
        if not tool.is_safe:
            yield from _put(task, tool)
    if task.has_fed:
        yield from _look_at_feeder(task)


def _look_at_feeder(task: Task) -> Steps[None]:
    """A robot may have started it again while its tool was still at work."""
    task.feeds = True  # until it is known to stand
    if not (yield from _is_reachable(task)):
        return
    try:
        task.feeds = (yield from agreed(task.client, task.family.commands["feeding"])) != STOPPED
    except (LinkError, StationError) as error:
        yield from _reach_again(task, error)
    if task.feeds:
        task.feeds = not (yield from _stop_feeder(task))


def _look(task: Task, tool: Tool) -> Steps[None]:
    """Whether the tool rests already, by a state that proves it."""
    if not (yield from _is_reachable(task)):
        return
    try:
        found = yield from agreed(task.client, task.family.commands["status"], tool.port)
    except (LinkError, StationError) as error:
        yield from _reach_again(task, error)
        return
    if isinstance(found, tuple) and (yield from _rests(task, tool, found)):
        tool.reached, tool.status, tool.was_spared = VERIFIED, found, True


def _rests(task: Task, tool: Tool, found: StatusWord) -> Steps[bool]:
    """A tool in its extractor state is cold, or cools, in whatever family; told to stand it would be heated."""
    status = task.family.status
    if status.is_resting(found):
        return True
    proven = [word for state, word in status.orders.items() if state in task.family.proven_by_cooling]
    if not any(status.confirms(found, word) for word in proven):
        return False
    if (yield from _is_cold(task, tool)):
        return True
    has_time = task.client.now + COOLING_AFTER_S + ORDER_S < task.end  # for the order, should it not cool
    return has_time and (yield from _is_cooling(task, tool))


def _stop_feeder(task: Task) -> Steps[bool]:
    """Whether the feeder was told to stop and says that it stands."""
    if not (yield from _is_reachable(task)):
        return False
    try:
        yield from task.client.write(task.family.commands["stop_feeding"], 0, hurry=task.is_silent)
        feeding = yield from agreed(task.client, task.family.commands["feeding"])
    except (LinkError, StationError) as error:
        yield from _reach_again(task, error)
        return False
    return feeding == STOPPED


def _put(task: Task, tool: Tool) -> Steps[None]:
    """One try. Where the state is not reached, or should cool and does not, those follow from which the station cools."""
    status = task.family.status
    reached = yield from _order(task, tool, status.orders[task.wanted])
    if task.wanted in task.family.proven_by_cooling and reached == VERIFIED and not (yield from _is_cooling(task, tool)):
        reached = FAILED
    for state in status.last_resorts:
        if state != task.wanted and reached != VERIFIED:
            reached = yield from _order(task, tool, status.orders[state])
    tool.reached = max(tool.reached, reached, key=(FAILED, SENT, VERIFIED).index)


def _order(task: Task, tool: Tool, word: StatusWord) -> Steps[str]:
    """Order a state once and read it back: how far that got."""
    command, reached = task.family.commands["status"], FAILED
    if not (yield from _is_reachable(task)):
        return reached
    tool.was_told = True
    try:
        yield from task.client.write(command, word, tool.port, hurry=task.is_silent)
        reached = SENT
    except LinkError as error:
        yield from _reach_again(task, error)
        return reached
    except StationError:  # whether it was done is read back
        if task.is_silent and task.has_untold:
            return reached
    try:
        found = yield from agreed(task.client, command, tool.port)
    except (LinkError, StationError) as error:
        yield from _reach_again(task, error)
        return reached
    task.is_silent = False
    if isinstance(found, tuple) and task.family.status.is_safe(found, word):
        tool.status = found
        return VERIFIED
    return reached


def _is_cold(task: Task, tool: Tool) -> Steps[bool]:
    """Whether nobody could burn himself at the tool and its heater is off, by two answers each."""
    command = task.family.command_of("temperature_c")
    if command is None:
        return False
    try:
        degrees = yield from _two_of(task, command, tool)
        power = yield from _two_of(task, task.family.commands["power"], tool)
    except (LinkError, StationError):
        return False
    return all(one <= COLD_C for one in degrees) and all(permille <= IDLE_PERMILLE for permille in power)


def _is_cooling(task: Task, tool: Tool) -> Steps[bool]:
    """Whether the tool gets colder or its heater is off, by two answers each: a digit of the status alone proves neither."""
    command = task.family.command_of("temperature_c")
    if command is None:
        return False
    client = task.client
    try:
        before = yield from _two_of(task, command, tool)
        client.unasked((yield Wait(client.now + COOLING_AFTER_S)))
        after = yield from _two_of(task, command, tool)
        power = yield from _two_of(task, task.family.commands["power"], tool)
    except (LinkError, StationError):
        return False
    falls = all(now < then for now in after for then in before)
    return falls or all(permille <= IDLE_PERMILLE for permille in power)


def _two_of(task: Task, command: Command, tool: Tool) -> Steps[list[float]]:
    """Two answers, one right after the other: they need not be equal, but what is made of them has to hold for both."""
    answers = []
    for _ in range(2):
        value = yield from task.client.read(command, tool.port)
        answers.append(float(value) if isinstance(value, int | float) else math.nan)  # of which nothing holds
    return answers


def _is_reachable(task: Task) -> Steps[bool]:
    """Whether the station that is meant, and no other, is at the end of the line."""
    if not task.is_proven:
        yield from _reach_again(task, LinkError("not proven"))
    return task.is_proven


def _reach_again(task: Task, error: LinkError | StationError) -> Steps[None]:
    """Open the port anew, while there is time; where the link was broken, until the station has said again who it is.

    A station that is merely silent may still hear; one behind a cable that was out may be another.
    """
    task.is_proven &= not isinstance(error, LinkError)
    task.is_silent = isinstance(error, AnswerTimeout)
    if isinstance(error, Refusal):
        return  # it answers
    client = task.client
    while client.now < task.end:
        try:
            client.unasked((yield Reopen()))
            if not task.is_proven:
                task.is_proven = yield from task.prove()
            if task.is_proven:
                return
        except LinkError:
            task.is_proven = False
        except StationError:
            pass  # not there yet
        client.unasked((yield Wait(client.now + REOPEN_EVERY_S)))
