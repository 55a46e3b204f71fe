"""Order a tool's safe state or the feeder's stop, and read it back, on a line that may break meanwhile.

What cannot be known is not taken for done: an order that was acknowledged and not read back is `SENT`, and what is read back
counts when two answers say it. On a flooded link nothing that is heard proves anything: neither who is there nor what was done. A
tool that stays hot is the worse of the two evils, so the order that needs no proof goes out all the same (`order_blindly`), and is
`SENT`, never `VERIFIED`.
"""

from __future__ import annotations

from collections.abc import Sequence

from jbclog.core.errors import AnswerTimeout, LinkError, LinkFlooded, NotReceived, Refusal, RobotModeOff, StationError
from jbclog.core.io_requests import Ask, IoResult, Listen, Reopen, Request, Steps, T, Wait, relay
from jbclog.core.quantities import Value
from jbclog.protocol.client.confirmed_reads import read_confirmed
from jbclog.protocol.client.interface import expect_quiet
from jbclog.protocol.commands.status import StatusWord
from jbclog.session.safety.tools import FAILED, SENT, VERIFIED, Task, Tool

STOPPED = "stopped"  # what the feeder says then
ORDER_PER_LOOK = 1.5  # an order and two answers read back, in terms of two answers
UNHURRIED_S = 1.5  # the time that must be left for an acknowledgement to be waited for in full
REOPEN_EVERY_S = 0.25


def order(task: Task, orders: Sequence[tuple[Tool, StatusWord]]) -> Steps[None]:
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
    if not (yield from is_reachable(task)):
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
    found = yield from status_now(task, tool)
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


def status_now(task: Task, tool: Tool) -> Steps[StatusWord | None]:
    """The tool's state by two answers; None where they cannot be had."""
    if not (yield from is_reachable(task)):
        return None
    begun = task.client.now
    try:
        found = yield from read_confirmed(task.client, task.family.commands["status"], tool.port)
    except (LinkError, StationError) as error:
        yield from _reach_again(task, error)
        return None
    task.is_silent, task.order_s = False, min(task.order_s, ORDER_PER_LOOK * (task.client.now - begun))
    return found if isinstance(found, tuple) else None


def stop_feeder(task: Task) -> Steps[bool]:
    """Whether the feeder was told to stop and says that it stands."""
    if not (yield from is_reachable(task)):
        return False
    try:
        yield from task.client.write(task.family.commands["stop_feeding"], 0, hurry=task.is_silent)
        feeding = yield from read_confirmed(task.client, task.family.commands["feeding"])
    except (LinkError, StationError) as error:
        yield from _reach_again(task, error)
        return False
    return feeding == STOPPED


def look_at_feeder(task: Task) -> Steps[None]:
    """A robot may have started it again while its tool was still at work."""
    task.feeds = True  # until it is known to stand
    if not (yield from is_reachable(task)):
        return
    try:
        task.feeds = (yield from read_confirmed(task.client, task.family.commands["feeding"])) != STOPPED
    except (LinkError, StationError) as error:
        yield from _reach_again(task, error)
    if task.feeds:
        task.feeds = not (yield from stop_feeder(task))


def order_blindly(task: Task) -> Steps[None]:
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


def is_reachable(task: Task) -> Steps[bool]:
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


def in_time(steps: Steps[T], now: float, end: float) -> Steps[T]:
    """Pull `steps`, which begin at `now` and are over at `end` (monotonic seconds) but for what they still make of it.

    A question that would leave later is not sent; to who asks it was not answered.
    """

    def done_by_then(wish: Request) -> Steps[IoResult]:
        nonlocal now
        if now >= end and isinstance(wish, Ask):
            raise AnswerTimeout("no time is left to ask")
        heard = yield _cut(wish, now, end)
        now = heard.now
        return heard

    return relay(steps, done_by_then)


def _cut(wish: Request, now: float, end: float) -> Request:
    if isinstance(wish, Ask):
        return Ask(wish.data, min(wish.patience_s, end - now))
    if isinstance(wish, Listen | Wait):
        return type(wish)(min(wish.until, end))
    return wish
