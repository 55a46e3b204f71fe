"""Detects changes during a run, and reports each once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from jbclog.core.errors import (
    JbclogError,
    LinkError,
    NotSupported,
    RobotModeOff,
    StationError,
    StationSilent,
)
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value, text_of
from jbclog.core.rows import CounterRow, Severity
from jbclog.protocol.client.omega import OmegaStation
from jbclog.protocol.commands.omega import (
    COMPLETION_MESSAGES,
    CONTROL,
    INFORMATION,
    TRUE_ANSWERS,
    WITHOUT_DIGIT,
)
from jbclog.protocol.commands.robot import ErrorTable
from jbclog.protocol.commands.signals import UsageCounter
from jbclog.session.rates import WATCHED_SETTINGS
from jbclog.session.run.context import PortState, SessionContext

# Hour and cycle counters are read at the start and at the end of a run; each needs two equal
# answers.


def read_counters(context: SessionContext) -> Steps[None]:
    """Record a row for every counter of every port; null with its reason where it cannot be read.

    Raises `LinkError`, `StationSilent` or `RobotModeOff` where nothing more can be read.
    """
    for port in context.ports.values():
        for counter in context.family.counters:
            if counter.name not in context.not_supported:
                yield from _read(context, port, counter)


def _read(context: SessionContext, port: PortState, counter: UsageCounter) -> Steps[None]:
    command, known = context.command(counter.command), port.counted.get(counter.name)
    try:
        found = yield from context.read_confirmed(command, port.number, known=known, grows=True)
    except NotSupported:
        context.not_supported.add(counter.name)
    except (LinkError, StationError) as error:
        _keep(context, port, counter, None, f"<{error.reason}>")
        if isinstance(error, LinkError | StationSilent | RobotModeOff):
            raise
    else:
        port.counted[counter.name] = found
        _keep(
            context,
            port,
            counter,
            float(found) if isinstance(found, int | float) else None,
            command.raw_text(context.station.data, found),
        )


def _keep(
    context: SessionContext, port: PortState, counter: UsageCounter, value: float | None, raw: str
) -> None:
    due = context.facts.due.setdefault(str(port.number), {})
    due[counter.name] = due.get(counter.name, 0) + 1
    time = context.utc.micros(context.now)
    context.journal.counter(
        CounterRow(time, context.name, port.number, counter.name, value, counter.unit, raw)
    )


# Anomalies that only a session can notice. The client counts the others
# (`protocol/client/interface.py`), and `SessionContext.tell_anomalies` reports all of them.

DELAY_UNIT, NO_COUNTDOWN = 20, 25  # B-numbers (docs/reference/contradictions.md)
LATE_S, EARLY_S = 30, 5  # tolerance of a countdown shortly after its start


def note_zero_countdown(context: SessionContext, port: PortState, value: Value) -> None:
    """Note a time to sleep of 0 s where nothing counts down (docs/reference/contradictions.md,
    B-25).
    """
    if value == 0:
        _note_anomaly(context, NO_COUNTDOWN, "time to sleep", port)


def compare_countdowns(context: SessionContext, ports: Iterable[PortState]) -> Steps[None]:
    """Compare the time to sleep with the sleep delay on `ports`, which were at work and have just
    been put in stand.

    Manuals give the delay in minutes, in seconds or without a unit; only this can decide
    (docs/reference/contradictions.md, B-20).
    """
    if "time_to_sleep" not in context.family.commands or "delay_s" in context.not_supported:
        return
    for port in ports:
        delay = port.held.get("sleep_delay")
        if isinstance(delay, int) and delay > 0 and port.status is not None and port.status[4] == 1:
            yield from _compare_countdown(context, port, delay)


def _compare_countdown(context: SessionContext, port: PortState, delay: int) -> Steps[None]:
    try:
        left = yield from context.station.read(context.command("time_to_sleep"), port.number)
    except StationError:
        return
    if (
        isinstance(left, int)
        and 0 < left < 65535
        and not 60 * delay - LATE_S <= left <= 60 * delay + EARLY_S
    ):
        _note_anomaly(context, DELAY_UNIT, f"time to sleep with a sleep delay of {delay}", port)


def _note_anomaly(context: SessionContext, number: int, what: str, port: PortState) -> None:
    context.station.anomalies.meet(
        number, f"{what}, port {port.number}", context.station.data, port.number
    )


# OMEGA's states are reported when they change. Solder shortage and a clogged nozzle are errors as
# long as readings show them. Preparing is reported for information, and so is a temperature out of
# range, if it lasts: each joint causes that for a moment.

LASTING_S = 10.0


@dataclass(frozen=True, slots=True)
class _FlagEvents:
    """One flag, a column of `samples`: the events when it becomes true, and when it becomes
    false.
    """

    begins: str
    severity: Severity
    begun: str
    ends: str
    ended: str


SHORTAGE = _FlagEvents(
    "solder.shortage",
    Severity.ERROR,
    "There is no solder left.",
    "solder.shortage.ended",
    "There is solder again.",
)
CLOGGED = _FlagEvents(
    "feeder.clogged",
    Severity.ERROR,
    "The solder is clogged.",
    "feeder.clogged.ended",
    "The solder is no longer clogged.",
)
PREPARING = _FlagEvents(
    "control.preparing",
    Severity.INFO,
    "It is preparing, or has an error; one answer means both.",
    "control.ready",
    "It is ready.",
)
OUT_OF_RANGE = "temperature.out_of_range"


def _flags(
    signal: str, flags: Mapping[str, _FlagEvents]
) -> Callable[[SessionContext, PortState, Value], None]:
    """Report each change of the flags in the answers to `signal`; at the first reading those that
    are set.
    """

    def observe(context: SessionContext, port: PortState, value: Value) -> None:
        before = port.states.get(signal)
        port.states[signal] = (value, context.now)
        for column, state in flags.items():
            was, is_now = (
                before is not None and before[0] in TRUE_ANSWERS[column],
                value in TRUE_ANSWERS[column],
            )
            if was != is_now:
                kind, severity, text = (
                    (state.begins, state.severity, state.begun)
                    if is_now
                    else (state.ends, Severity.INFO, state.ended)
                )
                context.note(
                    kind, severity, text, port=port.number, since=before[1] if before else None
                )

    return observe


def _in_range(context: SessionContext, port: PortState, value: Value) -> None:
    """Report a temperature out of range for `LASTING_S`; `states` has the present state and its
    begin.
    """
    before = port.states.get("in_range")
    is_in = value in TRUE_ANSWERS["in_range"]
    if before is None or before[0] != value:
        port.states["in_range"] = (value, context.now)
        if is_in and OUT_OF_RANGE in port.states:
            del port.states[OUT_OF_RANGE]
            context.note(
                "temperature.in_range",
                Severity.INFO,
                "The temperature is in its range again.",
                port=port.number,
            )
    elif not is_in and OUT_OF_RANGE not in port.states and context.now - before[1] >= LASTING_S:
        port.states[OUT_OF_RANGE] = (value, context.now)
        text = f"The temperature has been out of its range for {context.now - before[1]:.0f} s."
        context.note(OUT_OF_RANGE, Severity.INFO, text, port=port.number, since=before[1])


OMEGA_OBSERVERS = {
    "solder_shortage": _flags("solder_shortage", {"solder_shortage": SHORTAGE, "clogged": CLOGGED}),
    "preparing": _flags("preparing", {"preparing": PREPARING}),
    "in_range": _in_range,
}


USUAL = {"solder_shortage": INFORMATION.names[0], "preparing": CONTROL.names[0]}
"""Assumed states before the first reading."""


def differs_from_last(name: str) -> Callable[[SessionContext, PortState, Value], bool]:
    """Return a check whether a state differs from the last reading; such a state is read twice
    before it is accepted.
    """

    def doubt(_context: SessionContext, port: PortState, value: Value) -> bool:
        last = port.states.get(name)
        if value == WITHOUT_DIGIT and last is None:
            return False
        return value != (USUAL[name] if last is None else last[0])

    return doubt


def unreported_states_text(context: SessionContext) -> str:
    """Describe the states that this controller does not report; empty where it reports all."""
    unreported = [
        signal.command.replace("_", " ")
        for signal in context.family.signals
        if signal.name in context.not_supported
    ]
    text = (
        f" It does not answer {', '.join(unreported)}: that is not due, and not known."
        if unreported
        else ""
    )
    if isinstance(context.station, OmegaStation) and context.station.without_digit:
        text += " It answers A with a alone: whether solder is short or clogged is not known."
    return text


def report_completions(context: SessionContext) -> None:
    """Report unsolicited messages: a joint is completed that somebody else, or an earlier order,
    began.
    """
    if not isinstance(context.station, OmegaStation):
        return
    for completion in context.station.completions:
        kind = "omega.completed" if completion.letter == "h" else "omega.first_stage"
        text = (
            f"It says that {COMPLETION_MESSAGES[completion.letter]}; this run asked for no joint."
        )
        context.note(kind, Severity.INFO, text, raw=completion.letter)
    context.station.completions.clear()


COOLS_WITHIN_S = 10.0  # after this time a tip without heating is colder, whatever it is
BAND_C = 10  # ±10 °C around the setpoint counts as at temperature (docs/reference/exit-codes.md)


class SettingChanged(JbclogError):
    """A setting has changed and the recipe says to stop."""


Observe = Callable[[SessionContext, PortState, Value], None]


def _temperature(context: SessionContext, port: PortState, value: Value) -> None:
    assert isinstance(value, int)
    if not port.at_temperature:
        port.at_temperature = arrives(context, port, value)
        _note_above(context, port, value)
    port.temperatures_c["temperature_c"] = value
    if counts(context, port):
        if port.hottest_c is None or value > port.hottest_c:
            port.hottest_c = value
        if port.coolest_c is None or value < port.coolest_c:
            port.coolest_c = value
    else:
        port.has_counted = False


def arrives(context: SessionContext, port: PortState, value: int) -> bool:
    """Whether alarms begin to count with this temperature: the tool is at work and reaches its
    setpoint.
    """
    setting = None if port.at_temperature else context.set_c(port)
    if setting is None or not is_at_work(context, port):
        return False
    return _enters(port.temperature_c, value, setting) or _stays_above(
        context, port, value, setting
    )


def _enters(before: int | None, value: int, setting: float) -> bool:
    """Whether the tool is within the band, or crossed it between two readings."""
    passed = before is not None and (before < setting) != (value < setting)
    return passed or abs(value - setting) <= BAND_C


def _stays_above(context: SessionContext, port: PortState, value: int, setting: float) -> bool:
    """Whether a tip found hotter than its setpoint does not cool: a runaway tip never enters the
    band.
    """
    if value <= setting + BAND_C or port.found_above is None:
        return False
    since, then = port.found_above
    return context.now - since >= COOLS_WITHIN_S and value >= then


def _note_above(context: SessionContext, port: PortState, value: int) -> None:
    """Note since when a tip is hotter than its setpoint before reaching it, and how hot it was."""
    setting = None if port.at_temperature else context.set_c(port)
    if setting is None or not is_at_work(context, port):
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


def is_at_work(context: SessionContext, port: PortState) -> bool:
    """Whether the last status is at work."""
    return port.status is not None and context.family.status.is_working(port.status)


def counts(context: SessionContext, port: PortState) -> bool:
    """Whether alarms count: while working, after first entering setpoint ±10 °C
    (docs/reference/exit-codes.md).
    """
    return port.at_temperature and is_at_work(context, port)


def _status(context: SessionContext, port: PortState, word: Value) -> None:
    assert isinstance(word, tuple)
    before, port.status = port.status, word
    if before is not None and before[2] == word[2]:
        _suction(context, port, is_on=word[2] == 1)
    if before is not None and before != word and _is_changed_status(context, before, word):
        found_changed(context, port, "status", text_of(before), text_of(word))


def _is_changed_status(context: SessionContext, before: Value, found: Value) -> bool:
    """Whether a tool that the recipe ordered to another status stopped, or began, to work."""
    ordered, status = context.recipe.run.status, context.family.status
    if ordered is None or not isinstance(before, tuple) or not isinstance(found, tuple):
        return False
    is_working = status.is_working(found)
    return status.is_working(before) != is_working != status.is_working(status.orders[ordered])


def would_change(context: SessionContext, port: PortState, name: str, found: Value) -> bool:
    """Whether the reading `name` with the answer `found` is reported as a changed setting or
    status.
    """
    if name == "status":
        return port.status is not None and _is_changed_status(context, port.status, found)
    setting = {"set_c": context.set_name, "set_flow_permille": "selected_air_flow"}.get(name, name)
    return (name != setting or name in WATCHED_SETTINGS) and port.held.get(setting, found) != found


def _suction(context: SessionContext, port: PortState, *, is_on: bool) -> None:
    """Note suction confirmed by two answers, and publish it for the guard: a safe order keeps
    suction that holds a part.
    """
    if port.has_suction != is_on:
        port.has_suction = is_on
        if context.family.status.has_suction:
            context.publish()


def _set_temperature(context: SessionContext, port: PortState, value: Value) -> None:
    name = context.set_name
    before = port.held.get(name)
    if before is not None and before != value:
        port.held[name] = value
        found_changed(context, port, name, f"{before} °C", f"{value} °C")


def found_changed(
    context: SessionContext, port: PortState | None, name: str, before: str, found: str
) -> None:
    """Report a changed setting; raise `SettingChanged` where the recipe stops on that."""
    stop_on(context, [report_change(context, port, name, before, found)])


def report_change(
    context: SessionContext, port: PortState | None, name: str, before: str, found: str
) -> str:
    """Record a changed setting; return its description."""
    place = "" if port is None else f" of port {port.number}"
    change = f"{name.replace('_', ' ')}{place} was found changed: {found} instead of {before}"
    text = f"The {change}. It was not written again."
    context.note(
        "setting.changed",
        Severity.ERROR,
        text,
        port=port.number if port else None,
        raw=f"{name}={found}",
    )
    context.facts.settings_changed += 1
    return change


def stop_on(context: SessionContext, changes: list[str]) -> None:
    """Raise `SettingChanged` with all changes where the recipe stops on them."""
    if changes and context.recipe.run.on_difference == "stop":
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
    text = (
        f"Port {port.number}: the tool changed from {context.tool_text(before)} to"
        f" {context.tool_text(value)}."
    )
    context.note("tool.changed", Severity.WARNING, text, port=port.number, code=value)


def _port_error(context: SessionContext, port: PortState, value: Value) -> None:
    assert isinstance(value, int)
    before, port.error = port.error, value
    if before == value or (before is None and value == 0):
        return
    errors = context.family.port_errors
    if value == 0:
        context.note(
            "port.ok",
            Severity.INFO,
            f"Port {port.number}: its error is gone.",
            port=port.number,
            code=0,
        )
    elif value in errors.states:
        context.note(
            "port.state",
            Severity.WARNING,
            f"Port {port.number}: {errors.text(value)}.",
            port=port.number,
            code=value,
        )
    else:
        text = f"Port {port.number}: {errors.text(value)}."
        context.note("port.error", _severity(errors, value), text, port=port.number, code=value)


def _severity(errors: ErrorTable, code: int) -> Severity:
    return Severity.WARNING if code in errors.warnings else Severity.ERROR


def _station_error(context: SessionContext, port: PortState, value: Value) -> None:
    before = context.held.get("station_error", 0)
    context.held["station_error"] = value
    if before == value or not isinstance(value, int):
        return
    if value == 0:
        context.note("station.ok", Severity.INFO, "The station's error is gone.", code=0)
    else:
        errors = context.family.station_errors
        context.note(
            "station.error",
            _severity(errors, value),
            f"Station error: {errors.text(value)}.",
            code=value,
        )


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


def is_no_tool(context: SessionContext, port: PortState) -> bool:
    """Whether the station last reported no tool in `port`, so that its temperature means
    nothing.
    """
    return context.family.is_empty(port.tool, port.error)
