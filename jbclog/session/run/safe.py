"""The last step on every way out: make safe what this run touched (`session/safety/secure.py`), and
report the result.
"""

from __future__ import annotations

from jbclog.core.io_requests import Steps, Wait
from jbclog.core.rows import Severity
from jbclog.core.states import SafetyResult
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.run.identity import is_still_there, recognise
from jbclog.session.run.link_loss import report_flood
from jbclog.session.safety.secure import secure
from jbclog.session.safety.tools import SafetyTask, ToolSafety


def make_safe(context: SessionContext) -> Steps[None]:
    """Put touched tools into the recipe's safe state; `facts.unsafe` and an event name every tool
    that is not safe.

    Reports come last, so that a failing record keeps no tool hot.
    """
    touched = [port for port in context.ports.values() if port.touched]
    if not touched and not context.feeder_touched:
        return
    context.station.unasked((yield Wait(0.0)))
    task = yield from _put(context, touched, feeds=context.may_feed)
    may_feed = task.feeds
    context.feeder_stopped = not may_feed
    context.facts.unsafe = [f"{context.name}: the feeder could not be stopped"] if may_feed else []
    context.facts.unsafe += [
        _unsafe_text(context, port) for port in touched if not _is_verified(context, port)
    ]
    if may_feed:
        context.note("safety.not_safe", Severity.CRITICAL, f"{context.facts.unsafe[0]}.")
    for port, tool in zip(touched, task.tools, strict=True):
        _report(context, port, tool)
    context.publish()


def put_in_safe_state(context: SessionContext, port: PortState) -> Steps[None]:
    """Order the safe state on one port until it is read back, and report the result."""
    (tool,) = (yield from _put(context, [port], feeds=False)).tools
    _report(context, port, tool)


def _put(context: SessionContext, ports: list[PortState], *, feeds: bool) -> Steps[SafetyTask]:
    """Make these ports safe. The facts have the result even after an exception."""
    tools = [ToolSafety(port.number, context.keeps_suction(port)) for port in ports]
    task = SafetyTask(
        context.station,
        context.family,
        context.safe_state,
        tools,
        feeds,
        prove=lambda: _is_ours(context),
        is_proven=context.is_proven,
        look=lambda: is_still_there(context),
        spare=context.spares_resting,
        is_stranger=context.stranger is not None,
    )
    context.facts.safe_state |= dict.fromkeys((port.number for port in ports), SafetyResult.FAILED)
    try:
        yield from secure(task)
    finally:
        context.is_proven = task.is_proven
        if task.flood is not None:
            report_flood(context, task.flood)
        for port, tool in zip(ports, tools, strict=True):
            context.facts.safe_state[port.number] = tool.reached
            port.status = tool.status or port.status
    return task


def _is_ours(context: SessionContext) -> Steps[bool]:
    model = yield from context.read_confirmed(context.command("model"), known=context.facts.model)
    return (yield from recognise(context, str(model)))


def _is_verified(context: SessionContext, port: PortState) -> bool:
    return context.facts.safe_state[port.number] == SafetyResult.VERIFIED


def _report(context: SessionContext, port: PortState, tool: ToolSafety) -> None:
    if _is_verified(context, port):
        text, severity = (
            (
                f"Port {port.number}: the tool is in its safe state, as read back:"
                f" {_state_of(context, port)}"
            ),
            Severity.INFO,
        )
        if tool.was_spared:
            text = (
                f"Port {port.number}: the tool is at rest already and is left as it is, as read"
                f" back: {_state_of(context, port)}"
            )
        if tool.fell_back:
            text, severity = f"{text}; {tool.fell_back}", Severity.WARNING
        context.note("safety.safe_state", severity, f"{text}.", port=port.number)
    else:
        context.note(
            "safety.not_safe",
            Severity.CRITICAL,
            _unsafe_text(context, port) + ".",
            port=port.number,
        )


def _state_of(context: SessionContext, port: PortState) -> str:
    return "not read" if port.status is None else context.family.status.shown(port.status)


def _unsafe_text(context: SessionContext, port: PortState) -> str:
    last = "never read" if port.temperature_c is None else f"last read {port.temperature_c} °C"
    if context.stranger:
        last = "its temperature is not known"
    sent = context.facts.safe_state.get(port.number) == SafetyResult.SENT
    what = (
        "was ordered into its safe state and does not confirm it"
        if sent
        else "could not be put in its safe state"
    )
    if context.is_flooded:
        what += " (its link is flooded)"
    if context.stranger:
        what += f" ({context.stranger}, is now on its cable)"
    return (
        f"{context.name} port {port.number}: {what}, its {context.family.hot_part} may be hot"
        f" ({last}); switch the station off"
    )
