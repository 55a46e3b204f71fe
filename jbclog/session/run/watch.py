"""Detect changes during a run, and report each once."""

from __future__ import annotations

from collections.abc import Callable

from jbclog.core.errors import JbclogError
from jbclog.core.quantities import Value, text_of
from jbclog.core.rows import Severity
from jbclog.protocol.commands.error_tables import ErrorTable
from jbclog.session.rates import WATCHED_SETTINGS
from jbclog.session.run.context import SessionContext
from jbclog.session.run.omega_states import OMEGA_OBSERVERS
from jbclog.session.run.state import PortState

COOLS_WITHIN_S = 10.0  # after this time a tip without heating is colder, whatever it is
BAND_C = 10  # ±10 °C around the setpoint counts as at temperature (docs/reference/exit-codes.md)


class SettingChanged(JbclogError):
    """A setting changed, and the recipe stops on that."""


Observe = Callable[[SessionContext, PortState, Value], None]


def _temperature(context: SessionContext, port: PortState, value: Value) -> None:
    assert isinstance(value, int)
    if not port.at_temperature:
        port.at_temperature = arrives(context, port, value)
        _note_above(context, port, value)
    port.temperatures_c["temperature_c"] = value
    port.temperature_at, port.pulled_c = context.now, None
    if context.state.alarms_count(port):
        if port.hottest_c is None or value > port.hottest_c:
            port.hottest_c = value
        if port.coolest_c is None or value < port.coolest_c:
            port.coolest_c = value
    else:
        port.has_counted = False


def arrives(context: SessionContext, port: PortState, value: int) -> bool:
    """Return True if alarms begin to count with this temperature: the tool is at work and reaches
    its setpoint.
    """
    setting = None if port.at_temperature else context.state.setpoint_c(port)
    if setting is None or not context.state.is_at_work(port):
        return False
    before = None if port.temperature_at is None else port.temperature_c
    return _enters(before, value, setting) or _stays_above(context, port, value, setting)


def _enters(before: int | None, value: int, setting: float) -> bool:
    """Return True if the tool is within the band, or crossed it between two readings."""
    passed = before is not None and (before < setting) != (value < setting)
    return passed or abs(value - setting) <= BAND_C


def _stays_above(context: SessionContext, port: PortState, value: int, setting: float) -> bool:
    """Return True if a tip found hotter than its setpoint does not cool: a runaway tip never enters
    the band.
    """
    if value <= setting + BAND_C or port.found_above is None:
        return False
    since, then = port.found_above
    return context.now - since >= COOLS_WITHIN_S and value >= then


def _note_above(context: SessionContext, port: PortState, value: int) -> None:
    """Store since when a tip is hotter than its setpoint before reaching it, and how hot it was."""
    setting = None if port.at_temperature else context.state.setpoint_c(port)
    if setting is None or not context.state.is_at_work(port):
        return
    if value <= setting + BAND_C:
        port.found_above = None
    elif port.found_above is None or context.now - port.found_above[0] >= COOLS_WITHIN_S:
        port.found_above = context.now, value


def _temperature_of(name: str) -> Observe:
    def observe(context: SessionContext, port: PortState, value: Value) -> None:
        assert isinstance(value, int)
        port.temperatures_c[name] = value

    return observe


def _status(context: SessionContext, port: PortState, word: Value) -> None:
    assert isinstance(word, tuple)
    before, port.status = port.status, word
    if before is not None and before[2] == word[2]:
        _suction(context, port, is_on=word[2] == 1)
    if before is not None and before != word and _is_changed_status(context, before, word):
        found_changed(context, port, "status", text_of(before), text_of(word))


def _is_changed_status(context: SessionContext, before: Value, found: Value) -> bool:
    """Return True if a tool that the recipe ordered to another status stopped, or began, to
    work.
    """
    ordered, status = context.order.recipe.run.status, context.state.family.status
    if ordered is None or not isinstance(before, tuple) or not isinstance(found, tuple):
        return False
    is_working = status.is_working(found)
    return status.is_working(before) != is_working != status.is_working(status.orders[ordered])


def would_change(context: SessionContext, port: PortState, name: str, found: Value) -> bool:
    """Return True if the answer `found` to the reading `name` is reported as a changed setting or
    status.
    """
    if name == "status":
        return port.status is not None and _is_changed_status(context, port.status, found)
    setting = {"setpoint_c": context.state.set_name, "set_flow_permille": "selected_air_flow"}.get(
        name, name
    )
    return (name != setting or name in WATCHED_SETTINGS) and port.held.get(setting, found) != found


def _suction(context: SessionContext, port: PortState, *, is_on: bool) -> None:
    """Store suction confirmed by two answers, and publish it for the guard: a safe order keeps
    suction that holds a part.
    """
    if port.has_suction != is_on:
        port.has_suction = is_on
        if context.state.family.status.has_suction:
            context.publish()


def _set_temperature(context: SessionContext, port: PortState, value: Value) -> None:
    name = context.state.set_name
    before = port.held.get(name)
    if before is not None and before != value:
        port.held[name] = value
        found_changed(context, port, name, f"{before} °C", f"{value} °C")


def found_changed(
    context: SessionContext, port: PortState | None, name: str, before: str, found: str
) -> None:
    """Report a changed setting; raise `SettingChanged` if the recipe stops on that."""
    stop_on(context, [report_change(context, port, name, before, found)])


def report_change(
    context: SessionContext, port: PortState | None, name: str, before: str, found: str
) -> str:
    """Record a changed setting; return its description."""
    place = "" if port is None else f" of port {port.number}"
    change = f"{name.replace('_', ' ')}{place} was found changed: {found} instead of {before}"
    text = f"The {change}. It was not written again."
    context.log.note(
        "setting.changed",
        Severity.ERROR,
        text,
        port=port.number if port else None,
        raw=f"{name}={found}",
    )
    context.state.facts.settings_changed += 1
    return change


def stop_on(context: SessionContext, changes: list[str]) -> None:
    """Raise `SettingChanged` with all changes if the recipe stops on them."""
    if changes and context.order.recipe.run.on_difference == "stop":
        raise SettingChanged(f"{context.name}: {'; '.join(changes)}")


def _watched(name: str) -> Observe:
    """Watch a setting without a column that is read periodically."""

    def observe(context: SessionContext, port: PortState, value: Value) -> None:
        before = port.held.get(name)
        port.held[name] = value
        if before is not None and before != value:
            command = context.command(name)
            found_changed(context, port, name, command.shown(before), command.shown(value))

    return observe


def _tool(context: SessionContext, port: PortState, value: Value) -> None:
    assert isinstance(value, int)
    before, port.tool = port.tool, value
    if before == value:
        return
    port.at_temperature, port.found_above, port.tool_is_new = False, None, True
    port.temperature_at = port.pulled_c = None  # the last temperature was another tool's
    text = (
        f"Port {port.number}: the tool changed from {context.state.tool_text(before)} to"
        f" {context.state.tool_text(value)}."
    )
    context.log.note("tool.changed", Severity.WARNING, text, port=port.number, code=value)


def _port_error(context: SessionContext, port: PortState, value: Value) -> None:
    assert isinstance(value, int)
    before, port.error = port.error, value
    if before == value or (before is None and value == 0):
        return
    errors = context.state.family.port_errors
    kind, severity = "port.error", _severity(errors, value)
    text = f"Port {port.number}: {errors.text(value)}."
    if value == 0:
        kind, severity, text = "port.ok", Severity.INFO, f"Port {port.number}: its error is gone."
    elif value in errors.states:
        kind, severity = "port.state", Severity.WARNING
    context.log.note(kind, severity, text, port=port.number, code=value)


def _severity(errors: ErrorTable, code: int) -> Severity:
    return Severity.WARNING if code in errors.warnings else Severity.ERROR


def _station_error(context: SessionContext, port: PortState, value: Value) -> None:
    state = context.state
    before = state.held.get("station_error", 0)
    state.held["station_error"] = value
    if before == value or not isinstance(value, int):
        return
    if value == 0:
        context.log.note("station.ok", Severity.INFO, "The station's error is gone.", code=0)
    else:
        errors = state.family.station_errors
        context.log.note(
            "station.error",
            _severity(errors, value),
            f"Station error: {errors.text(value)}.",
            code=value,
        )


OBSERVERS: dict[str, Observe] = {
    "temperature_c": _temperature,
    "status": _status,
    **{name: _temperature_of(name) for name in ("external_c", "transistor_c", "transformer_c")},
    "setpoint_c": _set_temperature,
    "set_flow_permille": _watched("selected_air_flow"),
    "tool": _tool,
    "port_error": _port_error,
    "station_error": _station_error,
    **OMEGA_OBSERVERS,
    **{name: _watched(name) for name in WATCHED_SETTINGS},
}
