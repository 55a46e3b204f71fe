"""Meet a tool connected or changed during the run: its settings are read, never written.

If it would not cool down by itself (its sleep delay is off), its port goes to the safe state at
once (docs/reference/safe-states.md).
"""

from __future__ import annotations

from jbclog.core.errors import LinkError, RobotModeOff, StartRefused, StationSilent
from jbclog.core.quantities import OFF
from jbclog.core.rows import SettingOutcome, Severity
from jbclog.protocol.commands.command import Scope
from jbclog.session.run.apply import read_tool, readable_settings
from jbclog.session.run.context import SessionContext
from jbclog.session.run.safe import put_in_safe_state
from jbclog.session.run.setting import SettingTarget
from jbclog.session.run.state import PortState


async def meet_tool(context: SessionContext, port: PortState) -> None:
    """Read the settings of the new tool in `port`, and make it safe if necessary. Raises whatever
    prevents reading.
    """
    port.tool_is_new = False
    commands = list(readable_settings(context, Scope.TOOL))
    for command in commands:
        port.held.pop(command.name, None)
    if not port.has_tool:
        return
    try:
        await read_tool(context, port)
    except StartRefused as error:
        text = f"The settings of the new tool could not be read: {error}."
        context.log.note("tool.unknown", Severity.WARNING, text, port=port.number)
        if isinstance(error.__cause__, LinkError | StationSilent | RobotModeOff):
            raise error.__cause__ from error
    for command in commands:
        if command.name in port.held:
            target = SettingTarget(context, command, port)
            target.record(SettingOutcome.READ, readback=target.value)
    # hot air needs no delay: its safe states have the heater off
    needs_delay = "sleep_delay" in context.state.family.commands
    stays_hot = needs_delay and port.held.get("sleep_delay", OFF) is OFF
    if port.touched and stays_hot and not context.order.recipe.run.allow_no_cooldown:
        text = (
            f"The sleep delay of the new tool in port {port.number} is off or unknown: the port is"
            " put in its safe state."
        )
        context.log.note("safety.no_cooldown", Severity.WARNING, text, port=port.number)
        await put_in_safe_state(context, port)
