"""Order a tool's safe state or the feeder's stop, and read it back, on a link that may break
meanwhile.

Nothing counts as done without proof: an order acknowledged but not read back is `SENT`, and a
read-back needs two equal answers. On a flooded link no answer proves anything, neither the identity
nor the result. A tool that stays hot is worse, so the order that needs no proof is sent anyway
(`order_blindly`), and is `SENT`, never `VERIFIED`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from jbclog.core.errors import (
    AnswerTimeout,
    LinkError,
    LinkFlooded,
    NotReceived,
    Refusal,
    RobotModeOff,
    StationError,
)
from jbclog.core.io_requests import Ask, IoResult, Listen, Reopen, Request, Steps, T, Wait, relay
from jbclog.core.quantities import Value
from jbclog.core.states import SafetyResult
from jbclog.protocol.client.confirmed_reads import read_confirmed
from jbclog.protocol.client.interface import expect_quiet
from jbclog.protocol.commands.feeder import FeederState
from jbclog.protocol.commands.status import StatusWord
from jbclog.session.safety.tools import SafetyTask, ToolSafety

ORDER_PER_LOOK = 1.5  # duration of an order and two answers, relative to two answers
UNHURRIED_S = 1.5  # remaining time needed to wait for an acknowledgement in full
REOPEN_EVERY_S = 0.25
FIRST_S = 0.2  # for an answer in the first round, at least,
PATIENCE = 4  # or so many times as long as the quickest answer took
ANSWERS = 3  # of a read-back: two, and one that is lost
LAST_ORDERS = 3
LEAST_SHARE_S = 0.3  # to ask again after a lost answer; most tools need a tenth of it


def order(task: SafetyTask, orders: Sequence[tuple[ToolSafety, StatusWord]]) -> Steps[None]:
    """Order each tool's state once, then read each back, while there is time for the fallback
    states.

    After one acknowledgement has timed out, later ones are not waited for.
    """
    failures = []
    for done, (tool, word) in enumerate(orders):
        hurry = task.is_silent or task.has_waited or task.end - task.client.now < UNHURRIED_S
        answers = 1 if hurry else inf
        until = share_ends(task, task.end, 2 * (len(orders) - done), answers)
        until = until if hurry else min(task.client.now + UNHURRIED_S, task.end)
        sending = _send(task, tool, word, hurry=hurry)
        failures.append((yield from in_time(sending, task.client.now, until)))
        task.has_waited |= isinstance(failures[-1], AnswerTimeout)
    end = task.latest(sum(word != task.words(tool)[-1] for tool, word in orders))
    for done, ((tool, word), failure) in enumerate(zip(orders, failures, strict=True)):
        if isinstance(failure, LinkError):
            continue
        was_silent = task.is_silent
        until = share_ends(task, end, len(orders) - done, answers=ANSWERS)
        yield from in_time(_read_back(task, tool, word, failure), task.client.now, until)
        if (was_silent and task.is_silent) or task.client.now >= end:
            return


def share_ends(task: SafetyTask, end: float, parts: int, answers: float = inf) -> float:
    """Return until when to wait: for one of so many equal parts of the time that is left, and for
    no longer than so many answers usually take.

    The client would wait longer for a lost answer after a single slow one, and meanwhile other
    tools had no order. Each round is twice as patient. An acknowledgement may take its time
    (docs/reference/contradictions.md, B-13).
    """
    client = task.client
    if client.heard > client.sent:
        task.answer_s = min(task.answer_s, client.heard - client.sent)
    patience_s = max(FIRST_S, PATIENCE * task.answer_s) * float(1 << task.rounds)
    share_s = max((end - client.now) / parts, LEAST_SHARE_S)
    return min(client.now + min(share_s, answers * patience_s), end)


def _send(
    task: SafetyTask, tool: ToolSafety, word: StatusWord, *, hurry: bool
) -> Steps[LinkError | StationError | None]:
    """Order a state; return the error, if any. After a `LinkError` the result is not known."""
    if not (yield from is_reachable(task)):
        return LinkError("not reached")
    tool.note_order(word)
    try:
        yield from task.client.write(task.family.commands["status"], word, tool.port, hurry=hurry)
    except LinkError as error:
        yield from _reach_again(task, error)
        return error
    except StationError as error:  # the read-back decides
        return error
    tool.reached = SafetyResult.SENT
    return None


def _read_back(
    task: SafetyTask, tool: ToolSafety, word: StatusWord, failure: StationError | None
) -> Steps[None]:
    """Read the ordered state back; `failure` came instead of the acknowledgement."""
    status = task.family.status
    found = yield from status_now(task, tool)
    if found is None:
        return
    if status.is_safe(found, word):
        tool.status = found
        tool.reached = SafetyResult.SENT if task.has_to_cool(found) else SafetyResult.VERIFIED
    elif isinstance(failure, Refusal):
        final = not isinstance(failure, NotReceived | RobotModeOff)
        tool.pass_over(
            word, f"{status.shown(word)} was refused with N {failure.code:05d}", rule_out=final
        )
    elif failure is None:
        tool.pass_over(
            word, f"{status.shown(word)} was acknowledged, but {status.shown(found)} was read back"
        )
    else:
        tool.was_lost = True


def status_now(task: SafetyTask, tool: ToolSafety) -> Steps[StatusWord | None]:
    """Return the tool's state by two answers; None where not available."""
    if not (yield from is_reachable(task)):
        return None
    begun = task.client.now
    try:
        found = yield from read_confirmed(task.client, task.family.commands["status"], tool.port)
    except (LinkError, StationError) as error:
        yield from _reach_again(task, error)
        return None
    task.is_silent, task.order_s = (
        False,
        min(task.order_s, ORDER_PER_LOOK * (task.client.now - begun)),
    )
    return found if isinstance(found, tuple) else None


def stop_feeder(task: SafetyTask) -> Steps[bool]:
    """Stop the feeder; return whether it reports that it has stopped."""
    if not (yield from is_reachable(task)):
        return False
    try:
        yield from task.client.write(task.family.commands["stop_feeding"], 0, hurry=task.is_silent)
        feeding = yield from read_confirmed(task.client, task.family.commands["feeding"])
    except (LinkError, StationError) as error:
        yield from _reach_again(task, error)
        return False
    return feeding == FeederState.STOPPED


def look_at_feeder(task: SafetyTask) -> Steps[None]:
    """Check the feeder again: a robot may have restarted it while its tool was still at work."""
    task.feeds = True  # until it reports that it has stopped
    if not (yield from is_reachable(task)):
        return
    try:
        task.feeds = (
            yield from read_confirmed(task.client, task.family.commands["feeding"])
        ) != FeederState.STOPPED
    except (LinkError, StationError) as error:
        yield from _reach_again(task, error)
    if task.feeds:
        task.feeds = not (yield from stop_feeder(task))


def order_at_last(task: SafetyTask, end: float) -> Steps[None]:
    """Order by `end` what is not proven, when no time is left to prove it; again what was not
    acknowledged.
    """
    client, tools = task.client, [tool for tool in task.tools if not tool.is_safe]
    for _ in range(LAST_ORDERS):
        if task.feeds and task.is_proven:
            until = client.now + (end - client.now) / (2 + len(tools))
            task.feeds = not (yield from in_time(stop_feeder(task), client.now, until))
        lost = []
        for done, tool in enumerate(tools):
            if not task.is_proven:
                return
            until = client.now + (end - client.now) / (1 + len(tools) - done)
            sending = _send(task, tool, task.words(tool)[-1], hurry=True)
            if isinstance((yield from in_time(sending, client.now, until)), StationError):
                lost.append(tool)
        tools = lost


def order_blindly(task: SafetyTask) -> Steps[None]:
    """Stop the feeder, order the state that always can be, unproven; earlier readings are void."""
    if task.is_stranger:
        return
    if task.has_fed:
        task.feeds = True
        yield from _write_blindly(task, "stop_feeding", 0)
    for tool in task.tools:
        if tool.reached == SafetyResult.VERIFIED:
            tool.reached = SafetyResult.FAILED if tool.was_spared else SafetyResult.SENT
        word = task.words(tool)[-1]
        tool.was_spared = False
        tool.note_order(word)
        if (yield from _write_blindly(task, "status", word, tool.port)):
            tool.reached = SafetyResult.SENT


def _write_blindly(
    task: SafetyTask, name: str, value: Value, port: int | None = None
) -> Steps[bool]:
    """Write without proof; return whether the frame was sent."""
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


def is_reachable(task: SafetyTask) -> Steps[bool]:
    """Whether the intended station, and no other, is connected."""
    if not task.is_proven and not task.is_flooded:
        yield from _reach_again(task, LinkError("not proven"))
    return task.is_proven and not task.is_flooded


def _reach_again(task: SafetyTask, error: LinkError | StationError) -> Steps[None]:
    """Reopen the port while there is time; after a broken link also until the station is identified
    again.

    A silent station may still hear; one behind a reconnected cable may be another.
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
            pass  # not ready yet
        before = client.now
        client.unasked((yield Wait(before + REOPEN_EVERY_S)))
        if client.now <= before:
            return  # the share of the time is over (`in_time`)


def in_time(steps: Steps[T], now: float, end: float) -> Steps[T]:
    """Run `steps`, which begin at `now`, until `end` (monotonic seconds).

    A later request is not sent; its sender gets a time-out.
    """

    def done_by_then(request: Request) -> Steps[IoResult]:
        nonlocal now
        if now >= end and isinstance(request, Ask):
            raise AnswerTimeout("no time is left to ask")
        heard = yield _cut(request, now, end)
        now = heard.now
        return heard

    return relay(steps, done_by_then)


def _cut(request: Request, now: float, end: float) -> Request:
    if isinstance(request, Ask):
        return Ask(request.data, min(request.patience_s, end - now))
    if isinstance(request, Listen | Wait):
        return type(request)(min(request.until, end))
    return request
