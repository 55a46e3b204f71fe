"""Apply the recipe: read and check every setting, write those that differ, read them back.

Every setting is read and checked before anything is written. Each outcome is a row of `settings`;
the first unconfirmed setting stops this station's run (docs/reference/tables.md). `station_run.py`
has the order of the steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from jbclog.config.recipe import CAN_HEAT
from jbclog.config.recipe_settings import (
    Setting,
    foreign_keys,
    live_problems,
    settings_for,
    station_settings_for,
)
from jbclog.core.errors import NotSupported, StartRefused, StationError
from jbclog.core.quantities import OFF, Value
from jbclog.core.rows import SettingOutcome, SettingRow, Severity
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.omega import StoredRecord
from jbclog.session.run.context import SessionContext
from jbclog.session.run.countdown import compare_countdowns
from jbclog.session.run.setting import RepeatedWrite, SettingTarget
from jbclog.session.run.state import PortState

COOLING_DELAYS = ("sleep_delay", "hibernation_delay")
NOT_REPORTED = "not reported by the station"  # so the recipe's value cannot be confirmed


class Wanted(NamedTuple):
    """A setting of the recipe, and where it goes."""

    target: SettingTarget
    setting: Setting


async def examine(context: SessionContext) -> list[Wanted]:
    """Read and check everything; return the settings to write, in order. Raises `StartRefused` with
    every problem.
    """
    await read_all(context)
    wanted = _wanted(context)
    _check(context, wanted)
    counted = []
    for target, setting in wanted:
        sent = setting.as_counted(context.state.held)
        assert sent is not None  # checked
        counted.append(Wanted(target, sent))
    _record_untouched(context, counted)
    return counted


async def apply(context: SessionContext, wanted: list[Wanted], *, heats: bool) -> None:
    """Write the settings that can heat a tool, or those that cannot. Raises `StartRefused` naming
    the setting that failed.
    """
    for target, setting in wanted:
        if (setting.command.name in CAN_HEAT) == heats:
            await _apply(target, setting.value)


async def apply_status(context: SessionContext) -> None:
    """Put the tools to work or to rest, as the recipe requires. Raises `StartRefused`."""
    state = context.state
    at_work = [port for port in state.ports.values() if _works(context, port)]
    if context.order.recipe.run.status is not None or _orders_suction(context):
        state.has_ordered_status = True
        await _apply_status(context)
    for port in state.ports.values():
        note_status(port)
    await compare_countdowns(context, at_work)
    context.publish()


def _works(context: SessionContext, port: PortState) -> bool:
    word = port.held.get("status")
    return isinstance(word, tuple) and context.state.family.status.is_working(word)


def note_status(port: PortState) -> None:
    """Store the status just read as the last known one, for later comparison."""
    word = port.held.get("status")
    port.status = word if isinstance(word, tuple) else None
    if port.status is not None:
        port.has_suction = port.status[2] == 1


def readable_settings(context: SessionContext, scope: Scope) -> Iterator[Command]:
    """Yield the readable settings of one scope, except `status`, which is handled separately."""
    for command in context.state.family.commands.values():
        if command.access == "rw" and command.scope is scope and command.name != "status":
            yield command
    condition = context.state.held.get("condition")
    if scope is Scope.STATION and isinstance(condition, StoredRecord):
        yield context.command("condition").numbered(condition.condition)


async def read_all(context: SessionContext) -> None:
    """Read every setting of station, ports and connected tools into `held`."""
    for command in readable_settings(context, Scope.STATION):
        await _read(SettingTarget(context, command, None))
    for port in context.state.ports.values():
        await read_port(context, port)


async def read_port(context: SessionContext, port: PortState) -> None:
    """Read every setting of one port, and of the tool in it."""
    for command in readable_settings(context, Scope.PORT):
        await _read(SettingTarget(context, command, port))
    if "status" in context.state.family.commands:
        await _read(SettingTarget(context, context.command("status"), port))
    if port.has_tool:
        await read_tool(context, port)


async def read_tool(context: SessionContext, port: PortState) -> None:
    """Read the settings of the tool in `port`; none if no command can address its number."""
    if not port.can_be_spoken_to:
        text = (
            f"Tool {port.tool} in port {port.number}: no command can address this tool number, so"
            " its settings are not known."
        )
        context.log.note("tool.unknown", Severity.WARNING, text, port=port.number, code=port.tool)
        return
    for command in readable_settings(context, Scope.TOOL):
        await _read(SettingTarget(context, command, port))


async def _read(target: SettingTarget) -> None:
    """Read the setting into `held`; an unsupported one has no value there."""
    context, name = target.context, target.command.name
    try:
        target.held[name] = await target.read(known=target.value)
    except NotSupported:
        target.held.pop(name, None)
        context.state.not_supported.add(name)
    except StationError as error:
        raise StartRefused(f"{context.name}: cannot read {target.title}: {error}") from error


def _wanted(context: SessionContext) -> list[Wanted]:
    """List the recipe's settings for this station in writing order; tool settings only where there
    is a tool.
    """
    recipe, family = context.order.recipe, context.state.family
    wanted = [
        Wanted(SettingTarget(context, setting.command, None), setting)
        for setting in station_settings_for(recipe, family)
    ]
    for port in context.state.ports.values():
        for setting in settings_for(recipe, family, port.number):
            if setting.command.scope is not Scope.TOOL or port.has_tool:
                wanted.append(Wanted(SettingTarget(context, setting.command, port), setting))
    return wanted


def _check(context: SessionContext, wanted: list[Wanted]) -> None:
    """Check what only the station knows: its limits, and whether a standing tool ever cools."""
    state = context.state
    problems = []
    for port in state.ports.values():
        problems += live_problems(context.order.recipe, state.family, port.number, state.held)
        problems += _cooling_problems(context, port, wanted)
    if problems:
        raise StartRefused(f"{context.name}: " + "; ".join(problems) + ". Nothing was written")


def _cooling_problems(context: SessionContext, port: PortState, wanted: list[Wanted]) -> list[str]:
    """List delays that are off or unknown, so that a standing tool may stay hot
    (docs/reference/safe-states.md); empty if the recipe allows that.
    """
    if not context.state.family.may_stand_at_last(context.safe_state) or not port.has_tool:
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
    if not context.order.recipe.run.allow_no_cooldown:
        remedy = "allow_no_cooldown = true allows it"
        if off:
            remedy = "set the delay in the recipe, or allow_no_cooldown = true"
        return [f"{text}; {remedy}"]
    context.log.note(
        "safety.no_cooldown", Severity.WARNING, f"Allowed by the recipe: {text}.", port=port.number
    )
    return []


def _doubtful_delays(
    context: SessionContext, port: PortState, wanted: list[Wanted]
) -> tuple[list[str], list[str]]:
    """Return the delays that will be off, and those that the station does not report."""
    in_force = {name: port.held[name] for name in COOLING_DELAYS if name in port.held}
    for target, setting in wanted:
        if target.port is port and setting.command.name in in_force:
            in_force[setting.command.name] = setting.value
    off = [name.replace("_", " ") for name in COOLING_DELAYS if in_force.get(name) is OFF]
    unreported = [
        name.replace("_", " ")
        for name in COOLING_DELAYS
        if name in context.state.family.commands and name not in in_force
    ]
    return off, unreported


def _record_untouched(context: SessionContext, wanted: list[Wanted]) -> None:
    """Record everything read but not written, and the recipe's settings for other families."""
    state = context.state
    targets: list[SettingTarget] = []
    written = {(target.command.name, target.number) for target, _ in wanted}
    for name in state.held:
        targets.append(SettingTarget(context, context.command(name), None))
    for port in state.ports.values():
        for name in port.held:
            targets.append(SettingTarget(context, context.command(name), port))
    for target in targets:
        if (target.command.name, target.number) not in written:
            target.record(SettingOutcome.READ, readback=target.value)
    for key in foreign_keys(context.order.recipe, state.family, tuple(state.ports)):
        context.log.journal.setting(
            SettingRow(
                time=context.log.utc.micros(context.now),
                station=context.name,
                port=None,
                tool_name=None,
                setting=key,
                uom="",
                requested=None,
                written=None,
                readback=None,
                nak=None,
                outcome=SettingOutcome.UNSUPPORTED,
            )
        )


async def _apply(target: SettingTarget, value: Value) -> None:
    if target.value is None:  # `read_all` could not read it
        target.record(SettingOutcome.UNSUPPORTED, requested=value)
    elif target.value == value:
        target.record(SettingOutcome.UNCHANGED, requested=value, readback=value)
    else:
        await RepeatedWrite(target, value).run()


async def _read_suction(target: SettingTarget, port: PortState) -> None:
    """Read the status again: somebody may have switched suction at the station. After an error it
    counts as unchanged.
    """
    try:
        port.held["status"] = await target.read(known=target.value)
    except StationError:
        return
    note_status(port)


def _orders_suction(context: SessionContext) -> bool:
    return context.state.family.status.has_suction and context.order.recipe.suction != "keep"


async def _apply_status(context: SessionContext) -> None:
    """Put the tools to work (or to stand) after all other settings; leave an empty port alone."""
    command = context.command("status")
    for port in context.state.ports.values():
        if not port.has_tool:
            continue
        target = SettingTarget(context, command, port)
        if context.state.family.status.has_suction and target.value is not None:
            await _read_suction(target, port)
        word = context.start_word(port)
        if word is None:
            target.touch()  # the tool may be at work already
            suction = f"suction {context.order.recipe.suction}"
            target.record(SettingOutcome.UNSUPPORTED, requested=suction)
            continue
        if target.value is None or target.value == word:
            target.touch()
        await _apply(target, word)
