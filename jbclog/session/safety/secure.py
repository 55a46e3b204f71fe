"""Stop the feeder, then put each tool in its safe state and read it back. Start with `secure`.

A station has no watchdog: a tool without an order stays hot. So each tool is tried three times,
over a link that is reopened if necessary, in rounds, so that no tool waits for the tries of
another.

A state that counts only if the tool is seen to cool is ordered on all tools first; then they are
watched together (`cooling.py`), so that four tools take no longer than one. The remaining time is
enough for the fallback states. `orders.py` sends the orders and decides which answers to accept;
`time_budget.py` limits each step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from jbclog.core.io_requests import wait
from jbclog.core.states import SafetyResult
from jbclog.protocol.commands.status import StatusWord
from jbclog.session.safety.cooling import is_cold, watch
from jbclog.session.safety.orders import (
    READ_BACK_ANSWERS,
    is_reachable,
    look_at_feeder,
    order,
    order_at_last,
    order_blindly,
    status_now,
    stop_feeder,
)
from jbclog.session.safety.time_budget import in_time
from jbclog.session.safety.tools import SafetyTask, ToolSafety

ALLOWED_S = 3.0  # for one station (docs/reference/faults.md, S-2)
# of these, to check whether the station is still the one identified; it may be silent and still
# receive
LOOK_S = 0.3
LAST_S = 0.25  # of these, to repeat orders not proven by then
TRIES = 3


async def secure(task: SafetyTask) -> None:
    """Make the station safe within `ALLOWED_S`. The task has the result; errors of link and station
    are not raised.
    """
    client, budget = task.client, task.budget
    client.unasked(await wait(0.0))
    begun = client.now
    budget.end = begun + ALLOWED_S - LAST_S
    if task.look is not None and task.is_proven and not client.flow.is_flooded:
        task.is_proven = await in_time(task.look(), begun, begun + LOOK_S)
    await in_time(_in_rounds(task), client.now, budget.end)
    if not task.is_done:
        await order_at_last(task, begun + ALLOWED_S)


async def _in_rounds(task: SafetyTask) -> None:
    """Try `TRIES` times while there is time; over a flooded link order without proof."""
    client, budget = task.client, task.budget
    if client.flow.is_flooded:
        await order_blindly(task)
    for round_ in range(TRIES):
        budget.rounds = round_
        if round_:
            await _pause(task, TRIES - round_)
        task.is_flooded = False
        await _round(task, is_first=not round_)
        if task.is_flooded or client.flow.is_suspect:
            await order_blindly(task)
        if task.is_done or client.now >= budget.end:
            return


async def _pause(task: SafetyTask, rounds_left: int) -> None:
    """Wait for a share of the remaining time: the cause of the failure may go away."""
    share_s = max(task.budget.left_s, 0.0) / (rounds_left + 1)
    task.client.unasked(await wait(task.client.now + share_s))


async def _round(task: SafetyTask, *, is_first: bool) -> None:
    """Try the feeder and each tool that is not safe once, and check a feeder that ran again."""
    client, budget = task.client, task.budget
    await is_reachable(task)  # before the shares: a port may take longer to open than one
    if task.feeds:
        budget.note_answer()
        # two parts for the feeder and for each tool: the order, and its read-back
        until = budget.share_ends(budget.end, 2 * (len(task.tools) + 1), READ_BACK_ANSWERS)
        task.feeds = not await in_time(stop_feeder(task), client.now, until)
    if task.spare:
        await _spare_resting(task)
    await _put(task, [tool for tool in task.tools if not tool.is_safe], is_first=is_first)
    if task.has_fed:
        await look_at_feeder(task)


async def _spare_resting(task: SafetyTask) -> None:
    """Find tools that already rest in a state that proves it, and leave them alone. In its
    extractor state a tool is cold or cools, in every family; an order to stand would heat it.
    """
    doubtful = []
    for tool in task.tools:
        if tool.is_safe or tool.was_ordered:
            continue
        found = await status_now(task, tool)
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
        if await is_cold(task, tool):
            _spare(tool, found)
        else:
            warm.append((tool, found))
    cooling = await watch(task, [tool for tool, _ in warm])
    for tool, found in warm:
        if tool.port in cooling:
            _spare(tool, found)


def _spare(tool: ToolSafety, found: StatusWord) -> None:
    tool.reached, tool.status, tool.was_spared = SafetyResult.VERIFIED, found, True


async def _put(task: SafetyTask, tools: Sequence[ToolSafety], *, is_first: bool) -> None:
    """Try each tool once; if its state is not reached or it does not cool, try the fallbacks."""
    words = {tool.port: task.words(tool) for tool in tools}
    await order(task, [(tool, words[tool.port][0]) for tool in tools])
    # repeat a lost order before trying another state
    await order(task, [(tool, words[tool.port][0]) for tool in tools if tool.was_lost])
    watched = [tool for tool in tools if _is_to_be_watched(task, tool)]
    await _fall_back(
        task, [tool for tool in tools if tool not in watched], words, is_first=is_first
    )
    cooling = await watch(task, watched)
    for tool in watched:
        if tool.port in cooling:
            tool.reached = SafetyResult.VERIFIED
        elif tool.ordered is not None:
            tool.pass_over(
                tool.ordered,
                f"{task.family.status.shown(tool.ordered)} was read back, but the tool did not"
                " cool",
            )
    await _fall_back(task, [tool for tool in watched if not tool.is_safe], words, is_first=is_first)


def _is_to_be_watched(task: SafetyTask, tool: ToolSafety) -> bool:
    """Return True if the ordered state was read back but does not by itself prove that the tool
    cools.
    """
    return (
        not tool.is_safe
        and tool.status is not None
        and tool.ordered is not None
        and task.has_to_cool(tool.ordered)
    )


async def _fall_back(
    task: SafetyTask,
    tools: Sequence[ToolSafety],
    words: Mapping[int, Sequence[StatusWord]],
    *,
    is_first: bool,
) -> None:
    """Order the fallback states, until one is reached.

    Repeats a word that keeps suction and got no answer once, before the plain one drops the part.
    """
    for place in range(1, max((len(words[tool.port]) for tool in tools), default=0)):
        orders = []
        for tool in tools:
            choices = words[tool.port]
            if (
                tool.is_safe
                or place >= len(choices)
                or (is_first and _may_keep_suction(task, tool))
            ):
                continue
            before = choices[place - 1]
            why = f"{task.family.status.shown(before)} was not confirmed"
            tool.pass_over_unconfirmed(before, why)
            orders.append((tool, choices[place]))
        await order(task, orders)


def _may_keep_suction(task: SafetyTask, tool: ToolSafety) -> bool:
    """Return True if a word that keeps suction was ordered, and the station has not refused it."""
    return (
        tool.ordered is not None
        and task.family.status.sucks(tool.ordered)
        and not tool.is_ruled_out(tool.ordered)
    )
