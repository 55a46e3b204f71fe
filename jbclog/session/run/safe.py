"""The last chapter, on every way out: what this run touched is made safe (`session/safety/secure.py`), and how that went is
told.
"""

from __future__ import annotations

from jbclog.core.io_requests import Steps, Wait
from jbclog.core.rows import Severity
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.run.identity import recognise
from jbclog.session.run.loss import tell_flood
from jbclog.session.safety.secure import FAILED, SENT, VERIFIED, Task, Tool, secure


def make_safe(desk: SessionContext) -> Steps[None]:
    """Put what this run touched into the recipe's safe state; `facts.unsafe` and an event name every tool that is not.

    All is done before any of it is told, so that a record that fails keeps no tool hot.
    """
    touched = [port for port in desk.ports.values() if port.touched]
    if not touched and not desk.feeder_touched:
        return
    desk.station.unasked((yield Wait(0.0)))
    task = yield from _put(desk, touched, feeds=desk.may_feed)
    may_feed = task.feeds
    desk.feeder_stopped = not may_feed
    desk.facts.unsafe = [f"{desk.name}: the feeder could not be told to stop"] if may_feed else []
    desk.facts.unsafe += [_unsafe_text(desk, port) for port in touched if not _is_verified(desk, port)]
    if may_feed:
        desk.note("safety.not_safe", Severity.CRITICAL, f"{desk.facts.unsafe[0]}.")
    for port, tool in zip(touched, task.tools, strict=True):
        _tell(desk, port, tool)
    desk.publish()


def put_in_safe_state(desk: SessionContext, port: PortState) -> Steps[None]:
    """Order the safe state on one port until a reading bears it out, and say how that went."""
    (tool,) = (yield from _put(desk, [port], feeds=False)).tools
    _tell(desk, port, tool)


def _put(desk: SessionContext, ports: list[PortState], *, feeds: bool) -> Steps[Task]:
    """Make these ports safe. What came of it is in the facts, too, whatever ends this early."""
    tools = [Tool(port.number, desk.keeps_suction(port)) for port in ports]
    spare = desk.spares_resting
    is_stranger = desk.stranger is not None
    task = Task(
        desk.station, desk.family, desk.safe_state, tools, feeds, lambda: _is_ours(desk), desk.is_proven, spare, is_stranger
    )
    desk.facts.safe_state |= dict.fromkeys((port.number for port in ports), FAILED)
    try:
        yield from secure(task)
    finally:
        desk.is_proven = task.is_proven
        if task.flood is not None:
            tell_flood(desk, task.flood)
        for port, tool in zip(ports, tools, strict=True):
            desk.facts.safe_state[port.number] = tool.reached
            port.status = tool.status or port.status
    return task


def _is_ours(desk: SessionContext) -> Steps[bool]:
    model = yield from desk.agreed(desk.command("model"), known=desk.facts.model)
    return (yield from recognise(desk, str(model)))


def _is_verified(desk: SessionContext, port: PortState) -> bool:
    return desk.facts.safe_state[port.number] == VERIFIED


def _tell(desk: SessionContext, port: PortState, tool: Tool) -> None:
    if _is_verified(desk, port):
        text, severity = f"Port {port.number}: the tool is in its safe state, as read back: {_state_of(desk, port)}", Severity.INFO
        if tool.was_spared:
            text = f"Port {port.number}: the tool rests already and is left as it is, as read back: {_state_of(desk, port)}"
        if tool.fell_back:
            text, severity = f"{text}; {tool.fell_back}", Severity.WARNING
        desk.note("safety.safe_state", severity, f"{text}.", port=port.number)
    else:
        desk.note("safety.not_safe", Severity.CRITICAL, _unsafe_text(desk, port) + ".", port=port.number)


def _state_of(desk: SessionContext, port: PortState) -> str:
    return "not read" if port.status is None else desk.family.status.shown(port.status)


def _unsafe_text(desk: SessionContext, port: PortState) -> str:
    last = "never read" if port.temperature_c is None else f"last read {port.temperature_c} °C"
    sent = desk.facts.safe_state.get(port.number) == SENT
    what = "was told to go to its safe state and does not confirm it" if sent else "could not be put in its safe state"
    if desk.is_flooded:
        what += " (its link is flooded)"
    if desk.stranger:
        what += f" (on its cable is now {desk.stranger})"
    return f"{desk.name} port {port.number}: {what}, its {desk.family.hot_part} may be hot ({last}); switch the station off"
