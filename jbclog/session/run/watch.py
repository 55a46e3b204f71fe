"""What changes while a run goes on, told once when it changes: errors, tools, settings found different."""

from __future__ import annotations

from collections.abc import Callable

from jbclog.core.errors import JbclogError
from jbclog.core.quantities import Value, text_of
from jbclog.core.rows import Severity
from jbclog.protocol.commands.robot import ErrorTable
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.run.omega_states import OMEGA_OBSERVERS

COOLS_WITHIN_S = 10.0  # a tip without heating is colder after this long, whatever it is
BAND_C = 10  # ±10 °C around the setting counts as at temperature (contract, "Exit codes")


class SettingChanged(JbclogError):
    """A setting was found changed and the recipe says to stop."""


Observe = Callable[[SessionContext, PortState, Value], None]


def _temperature(desk: SessionContext, port: PortState, value: Value) -> None:
    assert isinstance(value, int)
    if arrives(desk, port, value):
        port.at_temperature = True
    _note_above(desk, port, value)
    port.temperatures_c["temperature_c"] = value
    if counts(desk, port):
        port.hottest_c = value if port.hottest_c is None or value > port.hottest_c else port.hottest_c
        port.coolest_c = value if port.coolest_c is None or value < port.coolest_c else port.coolest_c
    else:
        port.has_counted = False


def arrives(desk: SessionContext, port: PortState, value: int) -> bool:
    """Whether alarms begin to count with this temperature: the tool is at work and has come to its setting."""
    setting = desk.set_c(port)
    if port.at_temperature or setting is None or not is_at_work(desk, port):
        return False
    return _enters(port.temperature_c, value, setting) or _stays_above(desk, port, value, setting)


def _enters(before: int | None, value: int, setting: float) -> bool:
    """Whether the tool is within the band, or passed through it from one reading to the next."""
    passed = before is not None and (before < setting) != (value < setting)
    return passed or abs(value - setting) <= BAND_C


def _stays_above(desk: SessionContext, port: PortState, value: int, setting: float) -> bool:
    """Whether a tip that was found hotter than its setting does not cool: one that runs away never comes into the band."""
    if value <= setting + BAND_C or port.found_above is None:
        return False
    since, then = port.found_above
    return desk.now - since >= COOLS_WITHIN_S and value >= then


def _note_above(desk: SessionContext, port: PortState, value: int) -> None:
    """Keep since when a tip is hotter than its setting before it was there once, and how hot it was."""
    setting = desk.set_c(port)
    if port.at_temperature or setting is None or not is_at_work(desk, port):
        return
    if value <= setting + BAND_C:
        port.found_above = None
    elif port.found_above is None or desk.now - port.found_above[0] >= COOLS_WITHIN_S:
        port.found_above = desk.now, value


def _temperature_of(name: str) -> Observe:
    def observe(desk: SessionContext, port: PortState, value: Value) -> None:
        assert isinstance(value, int)
        port.temperatures_c[name] = value

    return observe


def is_at_work(desk: SessionContext, port: PortState) -> bool:
    """Whether the tool was last seen at work."""
    return port.status is not None and desk.family.status.is_working(port.status)


def counts(desk: SessionContext, port: PortState) -> bool:
    """Whether alarms count: while the tool is working, from its first entry into set ±10 °C on (contract, "Exit codes")."""
    return port.at_temperature and is_at_work(desk, port)


def _status(desk: SessionContext, port: PortState, word: Value) -> None:
    assert isinstance(word, tuple)
    before, port.status = port.status, word
    if before is not None and before[2] == word[2]:
        _suction(desk, port, is_on=word[2] == 1)
    if before == word:
        return
    ordered, status = desk.recipe.run.status, desk.family.status
    if ordered is None or before is None or status.is_working(before) == status.is_working(word):
        return
    if status.is_working(word) != status.is_working(status.orders[ordered]):
        found_changed(desk, port, "status", text_of(before), text_of(word))


def _suction(desk: SessionContext, port: PortState, *, is_on: bool) -> None:
    """Two answers said so. The guard has to know: a safe order keeps what holds a part."""
    if port.has_suction != is_on:
        port.has_suction = is_on
        if desk.family.status.has_suction:
            desk.publish()


def _set_temperature(desk: SessionContext, port: PortState, value: Value) -> None:
    name = desk.set_name
    before = port.held.get(name)
    if before is not None and before != value:
        port.held[name] = value
        found_changed(desk, port, name, f"{before} °C", f"{value} °C")


def found_changed(desk: SessionContext, port: PortState | None, name: str, before: str, found: str) -> None:
    """Say that a setting is not what it was; raise `SettingChanged` where the recipe stops on that."""
    stop_on(desk, [tell_change(desk, port, name, before, found)])


def tell_change(desk: SessionContext, port: PortState | None, name: str, before: str, found: str) -> str:
    """Put a changed setting into the record; give it in words."""
    place = "" if port is None else f" of port {port.number}"
    change = f"{name.replace('_', ' ')}{place} was found changed: {found} instead of {before}"
    text = f"The {change}. It was not written again."
    desk.note("setting.changed", Severity.ERROR, text, port=port.number if port else None, raw=f"{name}={found}")
    desk.facts.settings_changed += 1
    return change


def stop_on(desk: SessionContext, changes: list[str]) -> None:
    """Raise `SettingChanged` with all changes where the recipe stops on them."""
    if changes and desk.recipe.run.on_difference == "stop":
        raise SettingChanged(f"{desk.name}: {'; '.join(changes)}")


WATCHED_SETTINGS = (
    "alarm_high_limit",
    "alarm_low_limit",
    "alarm_high_delay",
    "alarm_low_delay",
    "selected_external_temperature",
    "work_mode",
)


def _watched(name: str) -> Observe:
    """A setting without a column that is read again now and then."""

    def observe(desk: SessionContext, port: PortState, value: Value) -> None:
        before = port.held.get(name)
        port.held[name] = value
        if before is not None and before != value:
            command = desk.command(name)
            found_changed(desk, port, name, command.shown(before), command.shown(value))

    return observe


def _tool(desk: SessionContext, port: PortState, value: Value) -> None:
    assert isinstance(value, int)
    before, port.tool = port.tool, value
    if before == value:
        return
    port.at_temperature, port.found_above, port.tool_is_new = False, None, True
    text = f"Port {port.number}: the tool changed from {desk.tool_text(before)} to {desk.tool_text(value)}."
    desk.note("tool.changed", Severity.WARNING, text, port=port.number, code=value)


def _port_error(desk: SessionContext, port: PortState, value: Value) -> None:
    assert isinstance(value, int)
    before, port.error = port.error, value
    if before == value or (before is None and value == 0):
        return
    errors = desk.family.port_errors
    if value == 0:
        desk.note("port.ok", Severity.INFO, f"Port {port.number}: its error is gone.", port=port.number, code=0)
    elif value in errors.states:
        desk.note("port.state", Severity.WARNING, f"Port {port.number}: {errors.text(value)}.", port=port.number, code=value)
    else:
        text = f"Port {port.number}: {errors.text(value)}."
        desk.note("port.error", _severity(errors, value), text, port=port.number, code=value)


def _severity(errors: ErrorTable, code: int) -> Severity:
    return Severity.WARNING if code in errors.warnings else Severity.ERROR


def _station_error(desk: SessionContext, port: PortState, value: Value) -> None:
    before = desk.held.get("station_error", 0)
    desk.held["station_error"] = value
    if before == value or not isinstance(value, int):
        return
    if value == 0:
        desk.note("station.ok", Severity.INFO, "The station's error is gone.", code=0)
    else:
        errors = desk.family.station_errors
        desk.note("station.error", _severity(errors, value), f"Station error: {errors.text(value)}.", code=value)


OBSERVERS: dict[str, Observe] = {
    "temperature_c": _temperature,
    "status": _status,
    **{name: _temperature_of(name) for name in ("external_c", "transistor_c", "transformer_c")},
    "set_c": _set_temperature,
    "set_flow_permille": _watched("selected_air_flow"),
    "tool": _tool,
    "port_error": _port_error,
    "station_error": _station_error,
    **OMEGA_OBSERVERS,
    **{name: _watched(name) for name in WATCHED_SETTINGS},
}


def is_no_tool(desk: SessionContext, port: PortState) -> bool:
    """Whether the station last said that nothing is in `port`; its temperature then means nothing."""
    return desk.family.is_empty(port.tool, port.error)
