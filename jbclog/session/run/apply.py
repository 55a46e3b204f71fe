"""Chapter 2: the recipe, setting by setting: read, checked, written where it differs, read back.

Every setting of the station is read first; nothing is written before all of that has been checked. The outcome of each
is a row of `settings`. The first that is not confirmed stops this station's run (contract, "settings"). When what is written:
`start.py`.
"""

from __future__ import annotations

from collections.abc import Iterator

from jbclog.config.recipe_settings import Setting, foreign_keys, live_problems, settings_for, station_settings_for
from jbclog.config.write_order import CAN_HEAT
from jbclog.core.errors import NotSupported, StartRefused, StationError
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import OFF, text_of
from jbclog.core.rows import SettingRow, Severity
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.omega_values import Stored
from jbclog.session.run.anomalies import compare_countdowns
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.run.setting import keep_row, read_setting, title_of, touch, write_setting

COOLING_DELAYS = ("sleep_delay", "hibernation_delay")
UNTOLD = "not told by the station"  # and what the recipe asks for it cannot be proven


Wanted = tuple[Setting, PortState | None]
"""A setting and its port; None for one of the whole station."""


def examine(desk: SessionContext) -> Steps[list[Wanted]]:
    """Read and check everything; give what is to be set, in order. Raises `StartRefused` with all that does not fit."""
    yield from read_all(desk)
    wanted = _wanted(desk)
    _check(desk, wanted)
    wanted = [(_as_counted(desk, setting), port) for setting, port in wanted]
    _record_untouched(desk, wanted)
    return wanted


def apply(desk: SessionContext, wanted: list[Wanted], *, heats: bool) -> Steps[None]:
    """Bring what can heat a tool, or what cannot, to the recipe. Raises `StartRefused` naming the setting that failed."""
    for setting, port in wanted:
        if (setting.command.name in CAN_HEAT) == heats:
            yield from _apply(desk, setting, port)


def apply_status(desk: SessionContext) -> Steps[None]:
    """Put the tools to work, or to rest, where the recipe says so. Raises `StartRefused`."""
    at_work = [port for port in desk.ports.values() if _works(desk, port)]
    if desk.recipe.run.status is not None or _orders_suction(desk):
        yield from _apply_status(desk)
    for port in desk.ports.values():
        note_status(port)
    yield from compare_countdowns(desk, at_work)
    desk.publish()


def _works(desk: SessionContext, port: PortState) -> bool:
    word = port.held.get("status")
    return isinstance(word, tuple) and desk.family.status.is_working(word)


def note_status(port: PortState) -> None:
    """Take the status that was read as the last one known; what is found later is held against it."""
    word = port.held.get("status")
    port.status = word if isinstance(word, tuple) else None
    if port.status is not None:
        port.has_suction = port.status[2] == 1


# -- what there is and what is wanted -----------------------------------------------------------------------------------


def readable_settings(desk: SessionContext, scope: Scope) -> Iterator[Command]:
    """The settings of one scope that a run reads: all that can be read back. `status` has its own way."""
    for command in desk.family.commands.values():
        if command.access == "rw" and command.scope is scope and command.name != "status":
            yield command
    condition = desk.held.get("condition")
    if scope is Scope.STATION and isinstance(condition, Stored):
        yield desk.command("condition").numbered(condition.condition)


def read_all(desk: SessionContext) -> Steps[None]:
    """Read every setting of station, ports and connected tools into `held`."""
    for command in readable_settings(desk, Scope.STATION):
        yield from _read_held(desk, command, None)
    for port in desk.ports.values():
        yield from read_port(desk, port)


def read_port(desk: SessionContext, port: PortState) -> Steps[None]:
    """Read every setting of one port, and of the tool in it if there is one."""
    for command in readable_settings(desk, Scope.PORT):
        yield from _read_held(desk, command, port)
    if "status" in desk.family.commands:
        yield from _read_held(desk, desk.command("status"), port)
    if port.has_tool:
        yield from read_tool(desk, port)


def read_tool(desk: SessionContext, port: PortState) -> Steps[None]:
    """Read the settings that belong to the tool in `port`. One whose number no command can carry keeps them to itself."""
    if not port.can_be_spoken_to:
        text = f"Tool {port.tool} in port {port.number}: no command has a place for this number, so its settings are not known."
        desk.note("tool.unknown", Severity.WARNING, text, port=port.number, code=port.tool)
        return
    for command in readable_settings(desk, Scope.TOOL):
        yield from _read_held(desk, command, port)


def _read_held(desk: SessionContext, command: Command, port: PortState | None) -> Steps[None]:
    held = desk.held if port is None else port.held
    try:
        held[command.name] = yield from read_setting(desk, command, port, held.get(command.name))
    except NotSupported:
        held.pop(command.name, None)
        desk.not_supported.add(command.name)
    except StationError as error:
        raise StartRefused(f"{desk.name}: cannot read {title_of(command, port)}: {error}") from error


def _wanted(desk: SessionContext) -> list[Wanted]:
    """What the recipe asks for here, in the order in which it is written; tool settings only where a tool is."""
    wanted: list[Wanted] = [(one, None) for one in station_settings_for(desk.recipe, desk.family)]
    for port in desk.ports.values():
        for setting in settings_for(desk.recipe, desk.family, port.number):
            if setting.command.scope is not Scope.TOOL or port.has_tool:
                wanted.append((setting, port))
    return wanted


def _as_counted(desk: SessionContext, setting: Setting) -> Setting:
    """The setting with the number that goes on the wire, once it has been checked that there is one."""
    counted = setting.as_counted(desk.held)
    assert counted is not None
    return counted


# -- checks before the first write ----------------------------------------------------------------------------------------


def _check(desk: SessionContext, wanted: list[Wanted]) -> None:
    """What only the station knows: its limits, and whether a tool told to stand will ever cool."""
    problems = []
    for port in desk.ports.values():
        problems += live_problems(desk.recipe, desk.family, port.number, desk.held)
        problems += _cooling_problems(desk, port, wanted)
    if problems:
        raise StartRefused(f"{desk.name}: " + "; ".join(problems) + ". Nothing was written")


def _cooling_problems(desk: SessionContext, port: PortState, wanted: list[Wanted]) -> list[str]:
    """Delays that are off or not told, so that a tool in stand stays hot or may (contract, "Safe state")."""
    if not desk.family.may_stand_at_last(desk.safe_state) or not port.has_tool:
        return []
    asked = {one.command.name: one.value for one, place in wanted if place is port}
    in_force = {name: asked.get(name, port.held[name]) for name in COOLING_DELAYS if name in port.held}
    off = [name.replace("_", " ") for name in COOLING_DELAYS if in_force.get(name) is OFF]
    untold = [name.replace("_", " ") for name in COOLING_DELAYS if name in desk.family.commands and name not in in_force]
    found = [f"{' and '.join(names)} of port {port.number} {what}" for names, what in ((off, "off"), (untold, UNTOLD)) if names]
    if not found:
        return []
    text = f"{' and '.join(found)}, so a tool told to stand {'never cools' if off else 'may never cool'} down"
    if not desk.recipe.run.allow_no_cooldown:
        return [
            text + ("; set the delay in the recipe, or allow_no_cooldown = true" if off else "; allow_no_cooldown = true allows it")
        ]
    desk.note("safety.no_cooldown", Severity.WARNING, f"Allowed by the recipe: {text}.", port=port.number)
    return []


# -- one setting ------------------------------------------------------------------------------------------------------------


def _record_untouched(desk: SessionContext, wanted: list[Wanted]) -> None:
    """A row for everything that was read and is left alone, and for what the recipe has for other families."""
    asked = {(one.command.name, port.number if port else None) for one, port in wanted}
    places: list[PortState | None] = [None, *desk.ports.values()]
    for port in places:
        for name, value in (port.held if port else desk.held).items():
            if (name, port.number if port else None) not in asked:
                keep_row(desk, desk.command(name), port, "read", readback=text_of(value))
    for key in foreign_keys(desk.recipe, desk.family, tuple(desk.ports)):
        time = desk.utc.micros(desk.now)
        desk.journal.setting(SettingRow(time, desk.name, None, None, key, "", None, None, None, None, "unsupported"))


def _apply(desk: SessionContext, setting: Setting, port: PortState | None) -> Steps[None]:
    command, value = setting.command, setting.value
    held = desk.held if port is None else port.held
    requested = text_of(value)
    if command.name not in held:  # it could not be read: `read_all` has tried
        keep_row(desk, command, port, "unsupported", requested=requested)
    elif held[command.name] == value:
        keep_row(desk, command, port, "unchanged", requested=requested, readback=requested)
    else:
        yield from write_setting(desk, command, value, port)


def _look_at_suction(desk: SessionContext, port: PortState) -> Steps[None]:
    """Read the status once more: a key of the station's own may have switched suction since. What cannot be read is as it was."""
    try:
        port.held["status"] = yield from read_setting(desk, desk.command("status"), port, port.held["status"])
    except StationError:
        return
    note_status(port)


def _orders_suction(desk: SessionContext) -> bool:
    return desk.family.status.has_suction and desk.recipe.suction != "keep"


def _apply_status(desk: SessionContext) -> Steps[None]:
    """Put the tools to work (or to stand) once everything else holds; a port without a tool is left alone."""
    command = desk.command("status")
    for port in desk.ports.values():
        if not port.has_tool:
            continue
        if desk.family.status.has_suction and "status" in port.held:
            yield from _look_at_suction(desk, port)
        word = desk.start_word(port)
        if word is None or "status" not in port.held:
            touch(desk, port)  # it may be at work already
            requested = text_of(word) if word is not None else f"suction {desk.recipe.suction}"
            keep_row(desk, command, port, "unsupported", requested=requested)
        elif port.held["status"] == word:
            touch(desk, port)
            keep_row(desk, command, port, "unchanged", requested=text_of(word), readback=text_of(word))
        else:
            yield from write_setting(desk, command, word, port)
