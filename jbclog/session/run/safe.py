"""The last step on every way out: make safe what this run touched (`session/safety/secure.py`), and
report the result.
"""

from __future__ import annotations

from jbclog.core.io_requests import wait
from jbclog.core.rows import Severity
from jbclog.core.states import SafetyResult
from jbclog.session.run.context import SessionContext
from jbclog.session.run.identity import is_still_there, recognise
from jbclog.session.run.link_loss import report_flood
from jbclog.session.run.state import PortState
from jbclog.session.safety.secure import secure
from jbclog.session.safety.tools import SafetyTask, ToolSafety


async def make_safe(context: SessionContext) -> None:
    """Put touched tools into the recipe's safe state; `facts.unsafe` and an event name every tool
    that is not safe.

    Reports come last, so that a failing record keeps no tool hot.
    """
    state, facts = context.state, context.state.facts
    touched = [port for port in state.ports.values() if port.touched]
    if not touched and not state.feeder_touched:
        return
    context.station.unasked(await wait(0.0))
    task = await _put(context, touched, feeds=state.may_feed)
    state.feeder_stopped = not task.feeds
    unsafe = [port for port in touched if facts.safe_state[port.number] != SafetyResult.VERIFIED]
    facts.unsafe = [_unsafe_text(context, port) for port in unsafe]
    if task.feeds:
        text = f"{context.name}: the feeder could not be stopped"
        facts.unsafe.insert(0, text)
        context.log.note("safety.not_safe", Severity.CRITICAL, f"{text}.")
    for port, tool in zip(touched, task.tools, strict=True):
        _report(context, port, tool)
    context.publish()


async def put_in_safe_state(context: SessionContext, port: PortState) -> None:
    """Order the safe state on one port until it is read back, and report the result."""
    (tool,) = (await _put(context, [port], feeds=False)).tools
    _report(context, port, tool)


async def _put(context: SessionContext, ports: list[PortState], *, feeds: bool) -> SafetyTask:
    """Make these ports safe. The facts have the result even after an exception."""
    state = context.state
    tools = [ToolSafety(port.number, context.keeps_suction(port)) for port in ports]
    task = SafetyTask(
        context.station,
        state.family,
        context.safe_state,
        tools,
        feeds,
        prove=lambda: _is_ours(context),
        is_proven=state.is_proven,
        look=lambda: is_still_there(context),
        spare=context.spares_resting,
        is_stranger=state.stranger is not None,
    )
    state.facts.safe_state |= dict.fromkeys((port.number for port in ports), SafetyResult.FAILED)
    try:
        await secure(task)
    finally:
        state.is_proven = task.is_proven
        if task.flood is not None:
            report_flood(context, task.flood)
        for port, tool in zip(ports, tools, strict=True):
            state.facts.safe_state[port.number] = tool.reached
            port.status = tool.status or port.status
    return task


async def _is_ours(context: SessionContext) -> bool:
    model = await context.reads.confirmed(context.command("model"), known=context.state.facts.model)
    return await recognise(context, str(model))


def _report(context: SessionContext, port: PortState, tool: ToolSafety) -> None:
    number, severity = port.number, Severity.INFO
    if context.state.facts.safe_state[number] != SafetyResult.VERIFIED:
        text = f"{_unsafe_text(context, port)}."
        context.log.note("safety.not_safe", Severity.CRITICAL, text, port=number)
        return
    status = "not read"
    if port.status is not None:
        status = context.state.family.status.shown(port.status)
    text = f"Port {number}: the tool is in its safe state, as read back: {status}"
    if tool.was_spared:
        text = (
            f"Port {number}: the tool is at rest already and is left as it is, as read back:"
            f" {status}"
        )
    if tool.fell_back:
        text = f"{text}; {tool.fell_back}"
        severity = Severity.WARNING
    context.log.note("safety.safe_state", severity, f"{text}.", port=number)


def _unsafe_text(context: SessionContext, port: PortState) -> str:
    last = "never read" if port.temperature_c is None else f"last read {port.temperature_c} °C"
    if context.state.stranger:
        last = "its temperature is not known"
    sent = context.state.facts.safe_state.get(port.number) == SafetyResult.SENT
    what = (
        "was ordered into its safe state and does not confirm it"
        if sent
        else "could not be put in its safe state"
    )
    if context.state.reconnection.is_flooded:
        what += " (its link is flooded)"
    if context.state.stranger:
        what += f" ({context.state.stranger}, is now on its cable)"
    return (
        f"{context.name} port {port.number}: {what}, its {context.state.family.hot_part} may be hot"
        f" ({last}); switch the station off"
    )
