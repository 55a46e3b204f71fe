"""Order a tool's safe state or the feeder's stop, and read it back, on a link that may break
meanwhile.

Nothing counts as done without proof: an order acknowledged but not read back is `SENT`, and a
read-back needs two equal answers. On a flooded link no answer proves anything, neither the identity
nor the result. A tool that stays hot is worse, so the order that needs no proof is sent anyway
(`order_blindly`), and is `SENT`, never `VERIFIED`.
"""

from __future__ import annotations

from collections.abc import Sequence

from jbclog.core.errors import (
    AnswerTimeout,
    LinkError,
    LinkFlooded,
    NotReceived,
    Refusal,
    RobotModeOff,
    StationError,
)
from jbclog.core.io_requests import reopen, wait
from jbclog.core.quantities import Value
from jbclog.core.states import SafetyResult
from jbclog.protocol.client.confirmed_reads import read_confirmed
from jbclog.protocol.client.interface import expect_quiet
from jbclog.protocol.commands.feeder import FeederState
from jbclog.protocol.commands.status import StatusWord
from jbclog.session.safety.time_budget import in_time
from jbclog.session.safety.tools import SafetyTask, ToolSafety

UNHURRIED_S = 1.5  # remaining time needed to wait for an acknowledgement in full
REOPEN_EVERY_S = 0.25
READ_BACK_ANSWERS = 3  # two, and one that is lost
LAST_ORDERS = 3

Orders = Sequence[tuple[ToolSafety, StatusWord]]
Failure = LinkError | StationError
"""Why an order was not acknowledged. After a `LinkError` it may or may not have been sent."""


# -- an order, and its proof -----------------------------------------------------------------------


async def order(task: SafetyTask, orders: Orders) -> None:
    """Order each tool's state once, then read each back, as long as time remains for the fallback
    states.
    """
    failures = await _send_each(task, orders)
    await _read_each_back(task, orders, failures)


async def _send_each(task: SafetyTask, orders: Orders) -> list[Failure | None]:
    """Send each order once; return the failure of each acknowledgement, if any.

    A station may be slow to acknowledge (docs/reference/contradictions.md, B-13). After one
    acknowledgement has timed out, later ones get less patience.
    """
    client, budget = task.client, task.budget
    failures: list[Failure | None] = []
    for done, (tool, word) in enumerate(orders):
        await is_reachable(task)  # before the shares: a port may take longer to open than one
        hurry = task.is_silent or task.has_waited or budget.left_s < UNHURRIED_S
        budget.note_answer()
        if hurry:  # two parts for each tool: the order, and its read-back
            until = budget.share_ends(budget.end, 2 * (len(orders) - done), answers=1)
        else:
            until = min(client.now + UNHURRIED_S, budget.end)
        sending = _send(task, tool, word, hurry=hurry)
        failure = await in_time(sending, client.now, until)
        task.has_waited |= isinstance(failure, AnswerTimeout)
        failures.append(failure)
    return failures


async def _read_each_back(
    task: SafetyTask, orders: Orders, failures: Sequence[Failure | None]
) -> None:
    """Read each order back, unless it may not have been sent."""
    client, budget = task.client, task.budget
    end = budget.latest(sum(word != task.words(tool)[-1] for tool, word in orders))
    for done, ((tool, word), failure) in enumerate(zip(orders, failures, strict=True)):
        if isinstance(failure, LinkError):
            continue
        was_silent = task.is_silent
        budget.note_answer()
        until = budget.share_ends(end, len(orders) - done, READ_BACK_ANSWERS)
        await in_time(_read_back(task, tool, word, failure), client.now, until)
        # silent before, and still: orders are more urgent than reads
        if (was_silent and task.is_silent) or client.now >= end:
            return


async def _send(
    task: SafetyTask, tool: ToolSafety, word: StatusWord, *, hurry: bool
) -> Failure | None:
    """Order a state; return the error, if any."""
    if not await is_reachable(task):
        return LinkError("not reached")
    tool.note_order(word)
    try:
        await task.client.write(task.family.commands["status"], word, tool.port, hurry=hurry)
    except LinkError as error:
        await _recover(task, error)
        return error
    except StationError as error:  # the read-back decides
        return error
    tool.reached = SafetyResult.SENT
    return None


async def _read_back(
    task: SafetyTask, tool: ToolSafety, word: StatusWord, failure: StationError | None
) -> None:
    """Read the ordered state back; `failure` came instead of the acknowledgement."""
    status = task.family.status
    found = await status_now(task, tool)
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


async def status_now(task: SafetyTask, tool: ToolSafety) -> StatusWord | None:
    """Return the tool's state by two answers; None if not available."""
    if not await is_reachable(task):
        return None
    begun = task.client.now
    try:
        found = await read_confirmed(task.client, task.family.commands["status"], tool.port)
    except (LinkError, StationError) as error:
        await _recover(task, error)
        return None
    task.is_silent = False
    task.budget.note_look(begun)
    return found if isinstance(found, tuple) else None


# -- the feeder ------------------------------------------------------------------------------------


async def stop_feeder(task: SafetyTask) -> bool:
    """Stop the feeder; return True if it reports that it has stopped."""
    if not await is_reachable(task):
        return False
    try:
        await task.client.write(task.family.commands["stop_feeding"], 0, hurry=task.is_silent)
        return await _has_stopped(task)
    except (LinkError, StationError) as error:
        await _recover(task, error)
        return False


async def look_at_feeder(task: SafetyTask) -> None:
    """Check the feeder again: a robot may have restarted it while its tool was still at work."""
    task.feeds = True  # until it reports that it has stopped
    if not await is_reachable(task):
        return
    try:
        task.feeds = not await _has_stopped(task)
    except (LinkError, StationError) as error:
        await _recover(task, error)
    if task.feeds:
        task.feeds = not await stop_feeder(task)


async def _has_stopped(task: SafetyTask) -> bool:
    feeding = await read_confirmed(task.client, task.family.commands["feeding"])
    return feeding == FeederState.STOPPED


# -- orders without proof --------------------------------------------------------------------------


async def order_at_last(task: SafetyTask, end: float) -> None:
    """Order by `end` what is not proven, when no time is left to prove it; repeat what was not
    acknowledged.

    Each order gets an equal part of the time; one extra part is reserved for lost orders.
    """
    client, tools = task.client, [tool for tool in task.tools if not tool.is_safe]
    for _ in range(LAST_ORDERS):
        if task.feeds and task.is_proven:
            until = client.now + (end - client.now) / (2 + len(tools))
            task.feeds = not await in_time(stop_feeder(task), client.now, until)
        lost = []
        for done, tool in enumerate(tools):
            if not task.is_proven:
                return
            until = client.now + (end - client.now) / (1 + len(tools) - done)
            sending = _send(task, tool, task.words(tool)[-1], hurry=True)
            failure = await in_time(sending, client.now, until)
            if isinstance(failure, StationError):
                lost.append(tool)
        tools = lost


async def order_blindly(task: SafetyTask) -> None:
    """Stop the feeder and order the states that need no proof; earlier readings are void."""
    if task.is_stranger:
        return
    if task.has_fed:
        task.feeds = True
        await _write_blindly(task, "stop_feeding", 0)
    for tool in task.tools:
        if tool.reached == SafetyResult.VERIFIED:
            tool.reached = SafetyResult.FAILED if tool.was_spared else SafetyResult.SENT
        word = task.unproven_word(tool)
        tool.was_spared = False
        tool.note_order(word)
        if await _write_blindly(task, "status", word, tool.port):
            tool.reached = SafetyResult.SENT


async def _write_blindly(
    task: SafetyTask, name: str, value: Value, port: int | None = None
) -> bool:
    """Write without proof; return True if the frame was sent."""
    before = task.client.exchanges
    try:
        await task.client.write(task.family.commands[name], value, port, hurry=True)
    except LinkFlooded as flood:
        task.flood = flood
    except LinkError:
        task.is_proven = False
    except StationError:
        pass
    return task.client.exchanges > before


# -- a link that may break -------------------------------------------------------------------------


async def is_reachable(task: SafetyTask) -> bool:
    """Return True if the intended station, and no other, is connected."""
    if not task.is_proven and not task.is_flooded:
        await _recover(task, LinkError("not proven"))
    return task.is_proven and not task.is_flooded


async def _recover(task: SafetyTask, error: Failure) -> None:
    """Record what the error shows about the link, and reopen it; a station that refuses answers.

    A silent station may still receive; a reconnected cable may lead to another station.
    """
    if isinstance(error, LinkFlooded):
        task.note_flood(error)
        return
    task.is_proven &= not isinstance(error, LinkError)
    task.is_silent = isinstance(error, AnswerTimeout)
    if not isinstance(error, Refusal):
        await _reopen(task)


async def _reopen(task: SafetyTask) -> None:
    """Reopen the port while there is time; after a broken link until the station is identified
    again.
    """
    client = task.client
    while client.now < task.budget.end:
        try:
            client.unasked(await reopen())
            if client.flow.is_flooded:
                await expect_quiet(client)
            if not task.is_proven:
                task.is_proven = await task.prove()
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
        client.unasked(await wait(before + REOPEN_EVERY_S))
        if client.now <= before:
            return  # the share of the time is over (`in_time`)
