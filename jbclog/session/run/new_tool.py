"""A tool that was connected or changed during the run: its settings are read, never written.

If it would not cool down by itself (its sleep delay is off), its port goes to the safe state at once
(docs/reference/safe-states.md).
"""

from __future__ import annotations

from jbclog.core.errors import LinkError, RobotModeOff, StartRefused, StationSilent
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import OFF, text_of
from jbclog.core.rows import SettingRow, Severity
from jbclog.protocol.commands.command import Scope
from jbclog.session.run.apply import read_tool, readable_settings
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.run.safe import put_in_safe_state


def meet_tool(context: SessionContext, port: PortState) -> Steps[None]:
    """Learn what the new tool in `port` holds, and make it safe if it must be. Raises what ends the asking."""
    port.tool_is_new = False
    for command in readable_settings(context, Scope.TOOL):
        port.held.pop(command.name, None)
    if not port.has_tool:
        return
    try:
        yield from read_tool(context, port)
    except StartRefused as error:
        context.note(
            "tool.unknown", Severity.WARNING, f"The settings of the new tool could not be read: {error}.", port=port.number
        )
        if isinstance(error.__cause__, LinkError | StationSilent | RobotModeOff):
            raise error.__cause__ from error
    _record(context, port)
    if port.touched and _stays_hot(context, port) and not context.recipe.run.allow_no_cooldown:
        yield from _make_safe(context, port)


def _stays_hot(context: SessionContext, port: PortState) -> bool:
    """Whether it would never cool in stand. Hot air needs no delay for that: its safe states have the heater off."""
    return "sleep_delay" in context.family.commands and port.held.get("sleep_delay", OFF) is OFF


def _record(context: SessionContext, port: PortState) -> None:
    time, tool = context.utc.micros(context.now), context.tool_text(port.tool)
    for command in readable_settings(context, Scope.TOOL):
        if command.name in port.held:
            value = text_of(port.held[command.name])
            row = SettingRow(time, context.name, port.number, tool, command.name, command.unit, None, None, value, None, "read")
            context.journal.setting(row)


def _make_safe(context: SessionContext, port: PortState) -> Steps[None]:
    """The tool's own delay would keep it hot in stand for ever, or is not known: do not leave it at work."""
    text = f"The sleep delay of the new tool in port {port.number} is off or unknown: the port is put in its safe state."
    context.note("safety.no_cooldown", Severity.WARNING, text, port=port.number)
    yield from put_in_safe_state(context, port)
