"""Feeder stopped, then each tool in its safe state, read back.

A station has no watchdog: what is not told to stand stays hot. So this is tried three times a tool, over a line that is
opened again if need be, in rounds, so that no tool waits for the tries of another. What cannot be known is not taken for
done: an order that was acknowledged and not read back is `SENT`, and what is read back counts when two answers say it.

A state that counts only when the tool is seen to cool is ordered on all tools of a station first; then they are watched
together, so that four of them take no longer than one. What is left of the time is enough for the states that follow.

On a flooded link nothing that is heard proves anything: neither who is there nor what was done. A tool that stays hot is the worse
of the two evils, so the order that needs no proof goes out all the same, and is `SENT`, never `VERIFIED`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from jbclog.core.errors import AnswerTimeout, LinkError, LinkFlooded, NotReceived, NotSupported, Refusal, RobotModeOff, StationError
from jbclog.core.io_requests import Reopen, Steps, Wait
from jbclog.core.quantities import Value
from jbclog.protocol.client.agreement import agreed
from jbclog.protocol.client.flow import expect_quiet
from jbclog.protocol.client.interface import Client
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.status import StatusWord
from jbclog.session.safety.deadline import in_time

ALLOWED_S = 3.0  # for one station (faults.md, section 9)
TRIES = 3
VERIFIED, SENT, FAILED = "verified", "sent", "failed"
STOPPED = "stopped"  # what the feeder says then
COOLING_AFTER_S = 1.0  # how long after the order an extractor state has to show in temperature or power
IDLE_PERMILLE = 20  # a heater that gets less than this is off
HEATING_PERMILLE = 200  # a tip that falls while its heater gets more than this is at a joint, and does not cool
FALL_C = 2  # by so much a tip that cools has fallen then; one degree is within the noise of a reading
COLD_C = 60.0
ORDER_S = 0.25  # that one tool is left for its order, at the most; as long as the quickest took, where that is known
ORDER_PER_LOOK = 1.5  # an order and two answers read back, in terms of two answers
MARGIN_S = 0.5  # beside that, for what is lost on the way
UNHURRIED_S = 1.5  # the time that must be left for an acknowledgement to be waited for in full
REOPEN_EVERY_S = 0.25

Prove = Callable[[], Steps[bool]]
"""Asks who is at the end of the line; whether it is the station that is meant. May raise what a question may."""


@dataclass(slots=True)
class Tool:
    """One port's tool and how far it got: `FAILED`, `SENT` (acknowledged, or over a flooded link) or `VERIFIED` (read back as
    `status`).

    `suction`: whether the orders keep suction on (hot air); None where it is learnt by looking, and off until then.
    """

    port: int
    suction: bool | None = False
    reached: str = FAILED
    status: StatusWord | None = None
    was_spared: bool = False  # it rested already, and was not told to
    ordered: StatusWord | None = None  # the last order that went out, whatever came of it
    was_lost: bool = False  # that order was not answered, and is not what was read back
    _first: StatusWord | None = None
    _passed_over: dict[StatusWord, str] = field(default_factory=dict)
    _ruled_out: set[StatusWord] = field(default_factory=set)

    @property
    def is_safe(self) -> bool:
        return self.reached == VERIFIED

    @property
    def was_told(self) -> bool:
        return self.ordered is not None

    @property
    def fell_back(self) -> str:
        """Why it was told another state than the one that was to be; empty where it was not."""
        return "; ".join(self._passed_over.values()) if self.ordered != self._first else ""

    def tell(self, word: StatusWord) -> None:
        """Take note that this order goes out."""
        self._first = self._first or word
        self.ordered, self.status, self.was_lost = word, None, False

    def pass_over(self, word: StatusWord, why: str, *, rule_out: bool = True) -> None:
        """This order did not make it safe. Where another follows on it (`rule_out`) it is not given again: the tool may rest by
        then, and would be heated.
        """
        self._passed_over.setdefault(word, why)
        if rule_out:
            self._ruled_out.add(word)

    def is_ruled_out(self, word: StatusWord) -> bool:
        """Whether the station does not take this order, or the tool does not cool by it."""
        return word in self._ruled_out

    def choices(self, words: Sequence[StatusWord]) -> list[StatusWord]:
        """Those of these orders that may still make it safe; the last one always may."""
        *others, last = words
        return [*(word for word in others if word not in self._ruled_out), last]


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
    is_stranger: bool = False  # nothing is told over a flooded link: another station was found there, or it was told before
    flood: LinkFlooded | None = None  # that its link brought, and the orders had to do without an answer
    is_silent: bool = False  # the last that was asked was not answered: acknowledgements are not waited for long
    has_waited: bool = field(init=False, default=False)  # in vain, for an acknowledgement
    order_s: float = field(init=False, default=ORDER_S)  # how long an order to one tool takes, with its reading back
    has_fed: bool = field(init=False)
    is_flooded: bool = field(init=False, default=False)  # its link, in this round
    end: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self.has_fed = self.feeds
        if self.wanted not in self.family.safe_states:
            self.wanted = next(iter(self.family.safe_states), self.wanted)

    def words(self, tool: Tool) -> list[StatusWord]:
        """The orders that may make this tool safe, in the order in which they are tried."""
        return tool.choices(self.family.status.safe_words(self.wanted, suction=bool(tool.suction)))

    def has_to_cool(self, word: StatusWord) -> bool:
        """Whether this state counts only when the tool is seen to cool."""
        status = self.family.status
        proven = [status.orders[state] for state in self.family.proven_by_cooling if state in status.orders]
        return not status.is_resting(word) and any(word[3] == one[3] for one in proven)

    def latest(self, tools: int) -> float:
        """When the orders to so many tools must begin, so that all of them go out and are read back."""
        return self.end - MARGIN_S - tools * self.order_s if tools else self.end

    def note_flood(self, flood: LinkFlooded) -> None:
        """Its link is flooded: who is there, and what was done, has to be proven anew."""
        self.flood, self.is_flooded, self.is_proven = flood, True, False

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
    if task.client.flow.is_flooded:
        yield from _order_blindly(task)
    for round_ in range(TRIES):
        if round_:
            yield from _spread(task, TRIES - round_)
        task.is_flooded = False
        yield from _round(task, is_first=not round_)
        if task.is_flooded or task.client.flow.is_suspect:
            yield from _order_blindly(task)
        if task.is_done or task.client.now >= task.end:
            return


def _order_blindly(task: Task) -> Steps[None]:
    """Tell the feeder to stop and each tool the state that always may be ordered; whatever was read of them before is void."""
    if task.is_stranger:
        return
    if task.has_fed:
        task.feeds = True
        yield from _write_blindly(task, "stop_feeding", 0)
    for tool in task.tools:
        if tool.reached == VERIFIED:
            tool.reached = FAILED if tool.was_spared else SENT
        word = task.words(tool)[-1]
        tool.was_spared = False
        tool.tell(word)
        if (yield from _write_blindly(task, "status", word, tool.port)):
            tool.reached = SENT


def _write_blindly(task: Task, name: str, value: Value, port: int | None = None) -> Steps[bool]:
    """Whether this went out, whatever came back."""
    before = task.client.exchanges
    try:
        yield from task.client.write(task.family.commands[name], value, port, hurry=True)
    except LinkFlooded as flood:
        task.flood = flood
    except LinkError:
        task.is_proven = False
    except StationError:
        pass
    return task.client.exchanges > before


def _spread(task: Task, rounds_left: int) -> Steps[None]:
    """Wait for a share of the time that is left: what blocked the line may go away."""
    now = task.client.now
    task.client.unasked((yield Wait(now + max(task.end - now, 0.0) / (rounds_left + 1))))


def _round(task: Task, *, is_first: bool) -> Steps[None]:
    if task.feeds:
        task.feeds = not (yield from _stop_feeder(task))
    if task.spare:
        yield from _look(task)
    yield from _put(task, [tool for tool in task.tools if not tool.is_safe], is_first=is_first)
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


def _look(task: Task) -> Steps[None]:
    """Which tools rest already, by states that prove it. One in its extractor state is cold, or cools, in whatever family; told
    to stand it would be heated.
    """
    doubtful = []
    for tool in task.tools:
        if tool.is_safe or tool.was_told:
            continue
        found = yield from _status_now(task, tool)
        if found is None and task.is_silent:
            break  # the orders are more urgent
        if found is None:
            continue
        if tool.suction is None:
            tool.suction = task.family.status.sucks(found)
        if task.family.status.is_resting(found):
            _spare(tool, found)
        elif task.has_to_cool(found):
            doubtful.append((tool, found))
    warm = []
    for tool, found in doubtful:
        if (yield from _is_cold(task, tool)):
            _spare(tool, found)
        else:
            warm.append((tool, found))
    cooling = yield from _watch(task, [tool for tool, _ in warm])
    for tool, found in warm:
        if tool.port in cooling:
            _spare(tool, found)


def _status_now(task: Task, tool: Tool) -> Steps[StatusWord | None]:
    """The tool's state by two answers; None where they cannot be had."""
    if not (yield from _is_reachable(task)):
        return None
    begun = task.client.now
    try:
        found = yield from agreed(task.client, task.family.commands["status"], tool.port)
    except (LinkError, StationError) as error:
        yield from _reach_again(task, error)
        return None
    task.is_silent, task.order_s = False, min(task.order_s, ORDER_PER_LOOK * (task.client.now - begun))
    return found if isinstance(found, tuple) else None


def _spare(tool: Tool, found: StatusWord) -> None:
    tool.reached, tool.status, tool.was_spared = VERIFIED, found, True


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


def _put(task: Task, tools: Sequence[Tool], *, is_first: bool) -> Steps[None]:
    """One try for each tool. Where its state is not reached, or should cool it and does not, those follow from which it cools."""
    words = {tool.port: task.words(tool) for tool in tools}
    yield from _order(task, [(tool, words[tool.port][0]) for tool in tools])
    yield from _order(task, [(tool, words[tool.port][0]) for tool in tools if tool.was_lost])
    watched = [tool for tool in tools if _is_to_be_watched(task, tool)]
    yield from _fall_back(task, [tool for tool in tools if tool not in watched], words, is_first=is_first)
    cooling = yield from _watch(task, watched)
    for tool in watched:
        if tool.port in cooling:
            tool.reached = VERIFIED
        elif tool.ordered is not None:
            tool.pass_over(tool.ordered, f"{task.family.status.shown(tool.ordered)} was read back, but the tool did not cool")
    yield from _fall_back(task, [tool for tool in watched if not tool.is_safe], words, is_first=is_first)


def _is_to_be_watched(task: Task, tool: Tool) -> bool:
    """Whether the tool is, as read back, in the state that was ordered, and that alone does not prove that it cools."""
    return not tool.is_safe and tool.status is not None and tool.ordered is not None and task.has_to_cool(tool.ordered)


def _fall_back(task: Task, tools: Sequence[Tool], words: Mapping[int, Sequence[StatusWord]], *, is_first: bool) -> Steps[None]:
    """Order what follows on the first word, until one is reached.

    Where nothing was heard of a word that keeps suction, it is repeated once before the plain one lets the part fall.
    """
    for place in range(1, max((len(words[tool.port]) for tool in tools), default=0)):
        orders = []
        for tool in tools:
            choices = words[tool.port]
            if tool.is_safe or place >= len(choices) or (is_first and _may_keep_suction(task, tool)):
                continue
            before = choices[place - 1]
            tool.pass_over(before, f"{task.family.status.shown(before)} was not confirmed")
            orders.append((tool, choices[place]))
        yield from _order(task, orders)


def _may_keep_suction(task: Task, tool: Tool) -> bool:
    """Whether the tool was told a word that keeps suction, and the station has not said no to it."""
    return tool.ordered is not None and task.family.status.sucks(tool.ordered) and not tool.is_ruled_out(tool.ordered)


def _order(task: Task, orders: Sequence[tuple[Tool, StatusWord]]) -> Steps[None]:
    """Order each tool's state once, then read each back, as long as there is time for what may follow on these orders.

    One acknowledgement is waited for in vain for as long as a station may take to store; then none is any more.
    """
    failures = []
    for tool, word in orders:
        hurry = task.is_silent or task.has_waited or task.end - task.client.now < UNHURRIED_S
        failures.append((yield from _send(task, tool, word, hurry=hurry)))
        task.has_waited |= isinstance(failures[-1], AnswerTimeout)
    end = task.latest(sum(word != task.words(tool)[-1] for tool, word in orders))
    for (tool, word), failure in zip(orders, failures, strict=True):
        if isinstance(failure, LinkError):
            continue
        yield from in_time(_read_back(task, tool, word, failure), task.client.now, end)
        if task.is_silent or task.client.now >= end:
            return


def _send(task: Task, tool: Tool, word: StatusWord, *, hurry: bool) -> Steps[LinkError | StationError | None]:
    """Order a state; give what came in place of an acknowledgement. With a `LinkError` nothing is known of it."""
    if not (yield from _is_reachable(task)):
        return LinkError("not reached")
    tool.tell(word)
    try:
        yield from task.client.write(task.family.commands["status"], word, tool.port, hurry=hurry)
    except LinkError as error:
        yield from _reach_again(task, error)
        return error
    except StationError as error:  # whether it was done is read back
        return error
    tool.reached = SENT
    return None


def _read_back(task: Task, tool: Tool, word: StatusWord, failure: StationError | None) -> Steps[None]:
    """Whether the tool is in the state that was ordered; `failure` came in place of the acknowledgement."""
    status = task.family.status
    found = yield from _status_now(task, tool)
    if found is None:
        return
    if status.is_safe(found, word):
        tool.status = found
        tool.reached = SENT if task.has_to_cool(found) else VERIFIED
    elif isinstance(failure, Refusal):
        final = not isinstance(failure, NotReceived | RobotModeOff)
        tool.pass_over(word, f"{status.shown(word)} was refused with N {failure.code:05d}", rule_out=final)
    elif failure is None:
        tool.pass_over(word, f"{status.shown(word)} was acknowledged, but {status.shown(found)} was read back")
    else:
        tool.was_lost = True


def _is_cold(task: Task, tool: Tool) -> Steps[bool]:
    """Whether nobody could burn himself at the tool and its heater is off, by two answers each."""
    found = yield from _heat(task, tool)
    has_both = bool(found.celsius) and bool(found.permille)
    return has_both and all(one <= COLD_C for one in found.celsius) and all(one <= IDLE_PERMILLE for one in found.permille)


def _watch(task: Task, tools: Sequence[Tool]) -> Steps[set[int]]:
    """The ports of those tools that get colder, or whose heater is off: a digit of the status alone proves neither.

    All are watched through the same second, and time is left for the orders to those that do not cool.
    """
    until, cooling, before = task.client.now + COOLING_AFTER_S, set[int](), dict[int, _Heat]()
    if not tools or until >= task.latest(len(tools)):
        return cooling
    for tool in tools:
        before[tool.port] = yield from _heat_by(task, tool, task.latest(len(tools)), with_power=False)
    task.client.unasked((yield Wait(until)))
    for tool in tools:
        after = yield from _heat_by(task, tool, task.latest(len(tools) - len(cooling)))
        if _cools(before[tool.port], after):
            cooling.add(tool.port)
    return cooling


def _heat_by(task: Task, tool: Tool, end: float, *, with_power: bool = True) -> Steps[_Heat]:
    if not (yield from _is_reachable(task)):
        return _Heat()
    return (yield from in_time(_heat(task, tool, with_power=with_power), task.client.now, end))


@dataclass(frozen=True, slots=True)
class _Heat:
    """Two temperatures and two powers of a tool; empty where they cannot be had. `tells_power`: the station knows the command."""

    celsius: Sequence[float] = ()
    permille: Sequence[float] = ()
    tells_power: bool = True


def _heat(task: Task, tool: Tool, *, with_power: bool = True) -> Steps[_Heat]:
    """What the tool tells of its heat, and of its heater."""
    command = task.family.command_of("temperature_c")
    if command is None:
        return _Heat()
    celsius: Sequence[float] = ()
    try:
        celsius = yield from _two_of(task, command, tool)
        return _Heat(celsius, (yield from _two_of(task, task.family.commands["power"], tool)) if with_power else ())
    except NotSupported:
        return _Heat(celsius, tells_power=False)
    except StationError:
        return _Heat(celsius)
    except LinkFlooded as flood:
        task.note_flood(flood)
        return _Heat(celsius)
    except LinkError:
        task.is_proven = False  # whoever is there next has to say so first
        return _Heat(celsius)


def _cools(before: _Heat, after: _Heat) -> bool:
    """Whether the heater is off, or the tip falls and the heater does not work against it, by two answers each."""
    is_off = bool(after.permille) and all(permille <= IDLE_PERMILLE for permille in after.permille)
    pairs = [(then, now) for then in before.celsius for now in after.celsius]
    falls = bool(pairs) and all(now <= then - FALL_C for then, now in pairs)
    may_be_off = not after.tells_power or (bool(after.permille) and all(one <= HEATING_PERMILLE for one in after.permille))
    return is_off or (falls and may_be_off)


def _two_of(task: Task, command: Command, tool: Tool) -> Steps[list[float]]:
    """Two answers, one right after the other: they need not be equal, but what is made of them has to hold for both."""
    answers = []
    for _ in range(2):
        value = yield from task.client.read(command, tool.port)
        answers.append(float(value) if isinstance(value, int | float) else math.nan)  # of which nothing holds
    return answers


def _is_reachable(task: Task) -> Steps[bool]:
    """Whether the station that is meant, and no other, is at the end of the line."""
    if not task.is_proven and not task.is_flooded:
        yield from _reach_again(task, LinkError("not proven"))
    return task.is_proven and not task.is_flooded


def _reach_again(task: Task, error: LinkError | StationError) -> Steps[None]:
    """Open the port anew, while there is time; where the link was broken, until the station has said again who it is.

    A station that is merely silent may still hear; one behind a cable that was out may be another.
    """
    if isinstance(error, LinkFlooded):
        task.note_flood(error)
        return
    task.is_proven &= not isinstance(error, LinkError)
    task.is_silent = isinstance(error, AnswerTimeout)
    if isinstance(error, Refusal):
        return  # it answers
    client = task.client
    while client.now < task.end:
        try:
            client.unasked((yield Reopen()))
            if client.flow.is_flooded:
                yield from expect_quiet(client)
            if not task.is_proven:
                task.is_proven = yield from task.prove()
            if task.is_proven:
                return
        except LinkFlooded as flood:
            task.note_flood(flood)
            return
        except LinkError:
            task.is_proven = False
        except StationError:
            pass  # not there yet
        client.unasked((yield Wait(client.now + REOPEN_EVERY_S)))
