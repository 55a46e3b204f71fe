"""Apply the recipe: read and check every setting, write those that differ, read them back.

Every setting is read and checked before anything is written. Each outcome is a row of `settings`;
the first unconfirmed setting stops this station's run (docs/reference/tables.md). `station_run.py`
has the order of the steps.
"""

from __future__ import annotations

from collections.abc import Iterator

from jbclog.config.recipe import CAN_HEAT
from jbclog.config.recipe_settings import (
    Setting,
    foreign_keys,
    live_problems,
    settings_for,
    station_settings_for,
)
from jbclog.core.errors import NotSupported, StartRefused, StationError
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import OFF, text_of
from jbclog.core.rows import SettingOutcome, SettingRow, Severity
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.omega import StoredRecord
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.run.countdown import compare_countdowns
from jbclog.session.run.setting import keep_row, read_setting, title_of, touch, write_setting

COOLING_DELAYS = ("sleep_delay", "hibernation_delay")
NOT_REPORTED = "not reported by the station"  # so the recipe's value cannot be confirmed


Wanted = tuple[Setting, PortState | None]
"""A setting and its port; None for a setting of the whole station."""


def examine(context: SessionContext) -> Steps[list[Wanted]]:
    """Read and check everything; return the settings to write, in order. Raises `StartRefused` with
    every problem.
    """
    yield from read_all(context)
    wanted = _wanted(context)
    _check(context, wanted)
    wanted = [(_as_counted(context, setting), port) for setting, port in wanted]
    _record_untouched(context, wanted)
    return wanted


def apply(context: SessionContext, wanted: list[Wanted], *, heats: bool) -> Steps[None]:
    """Write the settings that can heat a tool, or those that cannot. Raises `StartRefused` naming
    the setting that failed.
    """
    for setting, port in wanted:
        if (setting.command.name in CAN_HEAT) == heats:
            yield from _apply(context, setting, port)


def apply_status(context: SessionContext) -> Steps[None]:
    """Put the tools to work or to rest, as the recipe requires. Raises `StartRefused`."""
    at_work = [port for port in context.ports.values() if _works(context, port)]
    if context.recipe.run.status is not None or _orders_suction(context):
        context.has_ordered_status = True
        yield from _apply_status(context)
    for port in context.ports.values():
        note_status(port)
    yield from compare_countdowns(context, at_work)
    context.publish()


def _works(context: SessionContext, port: PortState) -> bool:
    word = port.held.get("status")
    return isinstance(word, tuple) and context.family.status.is_working(word)


def note_status(port: PortState) -> None:
    """Store the status just read as the last known one, for later comparison."""
    word = port.held.get("status")
    port.status = word if isinstance(word, tuple) else None
    if port.status is not None:
        port.has_suction = port.status[2] == 1


def readable_settings(context: SessionContext, scope: Scope) -> Iterator[Command]:
    """Yield the readable settings of one scope, except `status`, which is handled separately."""
    for command in context.family.commands.values():
        if command.access == "rw" and command.scope is scope and command.name != "status":
            yield command
    condition = context.held.get("condition")
    if scope is Scope.STATION and isinstance(condition, StoredRecord):
        yield context.command("condition").numbered(condition.condition)


def read_all(context: SessionContext) -> Steps[None]:
    """Read every setting of station, ports and connected tools into `held`."""
    for command in readable_settings(context, Scope.STATION):
        yield from _read_held(context, command, None)
    for port in context.ports.values():
        yield from read_port(context, port)


def read_port(context: SessionContext, port: PortState) -> Steps[None]:
    """Read every setting of one port, and of the tool in it."""
    for command in readable_settings(context, Scope.PORT):
        yield from _read_held(context, command, port)
    if "status" in context.family.commands:
        yield from _read_held(context, context.command("status"), port)
    if port.has_tool:
        yield from read_tool(context, port)


def read_tool(context: SessionContext, port: PortState) -> Steps[None]:
    """Read the settings of the tool in `port`; none if no command can address its number."""
    if not port.can_be_spoken_to:
        text = (
            f"Tool {port.tool} in port {port.number}: no command can address this tool number, so"
            " its settings are not known."
        )
        context.note("tool.unknown", Severity.WARNING, text, port=port.number, code=port.tool)
        return
    for command in readable_settings(context, Scope.TOOL):
        yield from _read_held(context, command, port)


def _read_held(context: SessionContext, command: Command, port: PortState | None) -> Steps[None]:
    held = context.held if port is None else port.held
    try:
        held[command.name] = yield from read_setting(context, command, port, held.get(command.name))
    except NotSupported:
        held.pop(command.name, None)
        context.not_supported.add(command.name)
    except StationError as error:
        raise StartRefused(
            f"{context.name}: cannot read {title_of(command, port)}: {error}"
        ) from error


def _wanted(context: SessionContext) -> list[Wanted]:
    """List the recipe's settings for this station in writing order; tool settings only where there
    is a tool.
    """
    wanted: list[Wanted] = [
        (one, None) for one in station_settings_for(context.recipe, context.family)
    ]
    for port in context.ports.values():
        for setting in settings_for(context.recipe, context.family, port.number):
            if setting.command.scope is not Scope.TOOL or port.has_tool:
                wanted.append((setting, port))
    return wanted


def _as_counted(context: SessionContext, setting: Setting) -> Setting:
    """Convert a checked setting to the number that is sent."""
    counted = setting.as_counted(context.held)
    assert counted is not None
    return counted


def _check(context: SessionContext, wanted: list[Wanted]) -> None:
    """Check what only the station knows: its limits, and whether a standing tool ever cools."""
    problems = []
    for port in context.ports.values():
        problems += live_problems(context.recipe, context.family, port.number, context.held)
        problems += _cooling_problems(context, port, wanted)
    if problems:
        raise StartRefused(f"{context.name}: " + "; ".join(problems) + ". Nothing was written")


def _cooling_problems(context: SessionContext, port: PortState, wanted: list[Wanted]) -> list[str]:
    """List delays that are off or unknown, so that a standing tool may stay hot
    (docs/reference/safe-states.md); empty if the recipe allows that.
    """
    if not context.family.may_stand_at_last(context.safe_state) or not port.has_tool:
        return []
    off, unreported = _doubtful_delays(context, port, wanted)
    found = [
        f"{' and '.join(names)} of port {port.number} {what}"
        for names, what in ((off, "off"), (unreported, NOT_REPORTED))
        if names
    ]
    if not found:
        return []
    text = (
        f"{' and '.join(found)}, so a tool in stand"
        f" {'never cools' if off else 'may never cool'} down"
    )
    if not context.recipe.run.allow_no_cooldown:
        return [
            text
            + (
                "; set the delay in the recipe, or allow_no_cooldown = true"
                if off
                else "; allow_no_cooldown = true allows it"
            )
        ]
    context.note(
        "safety.no_cooldown", Severity.WARNING, f"Allowed by the recipe: {text}.", port=port.number
    )
    return []


def _doubtful_delays(
    context: SessionContext, port: PortState, wanted: list[Wanted]
) -> tuple[list[str], list[str]]:
    """Return the delays that will be off, and those that the station does not report."""
    asked = {one.command.name: one.value for one, place in wanted if place is port}
    in_force = {
        name: asked.get(name, port.held[name]) for name in COOLING_DELAYS if name in port.held
    }
    off = [name.replace("_", " ") for name in COOLING_DELAYS if in_force.get(name) is OFF]
    unreported = [
        name.replace("_", " ")
        for name in COOLING_DELAYS
        if name in context.family.commands and name not in in_force
    ]
    return off, unreported


def _record_untouched(context: SessionContext, wanted: list[Wanted]) -> None:
    """Record everything read but not written, and the recipe's settings for other families."""
    asked = {(one.command.name, port.number if port else None) for one, port in wanted}
    places: list[PortState | None] = [None, *context.ports.values()]
    for port in places:
        for name, value in (port.held if port else context.held).items():
            if (name, port.number if port else None) not in asked:
                keep_row(
                    context,
                    context.command(name),
                    port,
                    SettingOutcome.READ,
                    readback=text_of(value),
                )
    for key in foreign_keys(context.recipe, context.family, tuple(context.ports)):
        time = context.utc.micros(context.now)
        context.journal.setting(
            SettingRow(
                time,
                context.name,
                None,
                None,
                key,
                "",
                None,
                None,
                None,
                None,
                SettingOutcome.UNSUPPORTED,
            )
        )


def _apply(context: SessionContext, setting: Setting, port: PortState | None) -> Steps[None]:
    command, value = setting.command, setting.value
    held = context.held if port is None else port.held
    requested = text_of(value)
    if command.name not in held:  # `read_all` could not read it
        keep_row(context, command, port, SettingOutcome.UNSUPPORTED, requested=requested)
    elif held[command.name] == value:
        keep_row(
            context,
            command,
            port,
            SettingOutcome.UNCHANGED,
            requested=requested,
            readback=requested,
        )
    else:
        yield from write_setting(context, command, value, port)


def _look_at_suction(context: SessionContext, port: PortState) -> Steps[None]:
    """Read the status again: somebody may have switched suction at the station. After an error it
    counts as unchanged.
    """
    try:
        port.held["status"] = yield from read_setting(
            context, context.command("status"), port, port.held["status"]
        )
    except StationError:
        return
    note_status(port)


def _orders_suction(context: SessionContext) -> bool:
    return context.family.status.has_suction and context.recipe.suction != "keep"


def _apply_status(context: SessionContext) -> Steps[None]:
    """Put the tools to work (or to stand) after all other settings; leave an empty port alone."""
    command = context.command("status")
    for port in context.ports.values():
        if not port.has_tool:
            continue
        if context.family.status.has_suction and "status" in port.held:
            yield from _look_at_suction(context, port)
        word = context.start_word(port)
        if word is None or "status" not in port.held:
            touch(context, port)  # the tool may be at work already
            requested = text_of(word) if word is not None else f"suction {context.recipe.suction}"
            keep_row(context, command, port, SettingOutcome.UNSUPPORTED, requested=requested)
        elif port.held["status"] == word:
            touch(context, port)
            keep_row(
                context,
                command,
                port,
                SettingOutcome.UNCHANGED,
                requested=text_of(word),
                readback=text_of(word),
            )
        else:
            yield from write_setting(context, command, word, port)
