"""Decide by temperature and power whether a tool is cold or cools; a status proves neither."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from jbclog.core.errors import LinkError, LinkFlooded, NotSupported, StationError
from jbclog.core.io_requests import wait
from jbclog.protocol.commands.command import Command
from jbclog.session.safety.orders import is_reachable
from jbclog.session.safety.time_budget import in_time
from jbclog.session.safety.tools import SafetyTask, ToolSafety

# time after the order by which the extractor state must show in temperature or power
COOLING_AFTER_S = 1.0
IDLE_PERMILLE = 20  # below it a heater is off
HEATING_PERMILLE = 200  # above it a falling tip is at a joint and does not cool
FALL_C = 2  # a cooling tip falls by this much; one degree is within the noise
COLD_C = 60.0


async def is_cold(task: SafetyTask, tool: ToolSafety) -> bool:
    """Return True if the tool is too cold to burn anyone and its heater is off, by two answers
    each.
    """
    found = await _heat(task, tool)
    has_both = bool(found.celsius) and bool(found.permille)
    return (
        has_both
        and all(one <= COLD_C for one in found.celsius)
        and all(one <= IDLE_PERMILLE for one in found.permille)
    )


async def watch(task: SafetyTask, tools: Sequence[ToolSafety]) -> set[int]:
    """Return the ports of those tools that cool down, or whose heater is off.

    Watches all of them during the same second, and leaves time for orders to those that do not
    cool.
    """
    until, cooling, before = task.client.now + COOLING_AFTER_S, set[int](), dict[int, _Heat]()
    if not tools or until >= task.budget.latest(len(tools)):
        return cooling
    for tool in tools:
        before[tool.port] = await _heat_by(
            task, tool, task.budget.latest(len(tools)), with_power=False
        )
    task.client.unasked(await wait(until))
    for tool in tools:
        after = await _heat_by(task, tool, task.budget.latest(len(tools) - len(cooling)))
        if _cools(before[tool.port], after):
            cooling.add(tool.port)
    return cooling


@dataclass(frozen=True, slots=True)
class _Heat:
    """Two temperatures and two powers of a tool; empty if not available. `tells_power`: the station
    has the command.
    """

    celsius: Sequence[float] = ()
    permille: Sequence[float] = ()
    tells_power: bool = True


async def _heat_by(
    task: SafetyTask, tool: ToolSafety, end: float, *, with_power: bool = True
) -> _Heat:
    if not await is_reachable(task):
        return _Heat()
    return await in_time(_heat(task, tool, with_power=with_power), task.client.now, end)


async def _heat(task: SafetyTask, tool: ToolSafety, *, with_power: bool = True) -> _Heat:
    """Read temperature and heater power."""
    command = task.family.command_of("temperature_c")
    if command is None:
        return _Heat()
    celsius: Sequence[float] = ()
    try:
        celsius = await _two_of(task, command, tool)
        return _Heat(
            celsius,
            await _two_of(task, task.family.commands["power"], tool) if with_power else (),
        )
    except NotSupported:
        return _Heat(celsius, tells_power=False)
    except StationError:
        return _Heat(celsius)
    except LinkFlooded as flood:
        task.note_flood(flood)
        return _Heat(celsius)
    except LinkError:
        task.is_proven = False  # the next station to answer must identify itself
        return _Heat(celsius)


def _cools(before: _Heat, after: _Heat) -> bool:
    """Return True if, by two answers each, the heater is off, or the tip falls without heating."""
    is_off = bool(after.permille) and all(permille <= IDLE_PERMILLE for permille in after.permille)
    pairs = [(then, now) for then in before.celsius for now in after.celsius]
    falls = bool(pairs) and all(now <= then - FALL_C for then, now in pairs)
    may_be_off = not after.tells_power or (
        bool(after.permille) and all(one <= HEATING_PERMILLE for one in after.permille)
    )
    return is_off or (falls and may_be_off)


async def _two_of(task: SafetyTask, command: Command, tool: ToolSafety) -> list[float]:
    """Read twice in a row: the answers may differ, but a conclusion must hold for both."""
    answers = []
    for _ in range(2):
        value = await task.client.read(command, tool.port)
        # NaN fails every comparison
        answers.append(float(value) if isinstance(value, int | float) else math.nan)
    return answers
