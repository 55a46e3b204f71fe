"""Report OMEGA's states when they change.

Solder shortage and a clogged nozzle are errors as long as readings show them. Preparing is
information, and so is a temperature out of range if it lasts: each joint causes that for a moment.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from jbclog.core.quantities import Value
from jbclog.core.rows import Severity
from jbclog.protocol.client.omega import OmegaStation
from jbclog.protocol.commands.omega import (
    COMPLETION_MESSAGES,
    CONTROL,
    INFORMATION,
    TRUE_ANSWERS,
    WITHOUT_DIGIT,
)
from jbclog.session.run.context import SessionContext
from jbclog.session.run.state import PortState

LASTING_S = 10.0


@dataclass(frozen=True, slots=True)
class _FlagEvents:
    """One flag, a column of `samples`: the events when it becomes true and false."""

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
    """Return a handler that reports each change of the flags in the answers to `signal`; at the
    first reading, the flags that are set.
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
                context.log.note(
                    kind, severity, text, port=port.number, since=before[1] if before else None
                )

    return observe


def _in_range(context: SessionContext, port: PortState, value: Value) -> None:
    """Report a temperature out of range for `LASTING_S`; `states` has the present state and its
    beginning.
    """
    before = port.states.get("in_range")
    if before is None:
        context.station.anomalies.meet(55, "set temperature state", context.station.data)
    is_in = value in TRUE_ANSWERS["in_range"]
    if before is None or before[0] != value:
        port.states["in_range"] = (value, context.now)
        if is_in and OUT_OF_RANGE in port.states:
            del port.states[OUT_OF_RANGE]
            context.log.note(
                "temperature.in_range",
                Severity.INFO,
                "The temperature is in its range again.",
                port=port.number,
            )
    elif not is_in and OUT_OF_RANGE not in port.states and context.now - before[1] >= LASTING_S:
        port.states[OUT_OF_RANGE] = (value, context.now)
        text = f"The temperature has been out of its range for {context.now - before[1]:.0f} s."
        context.log.note(OUT_OF_RANGE, Severity.INFO, text, port=port.number, since=before[1])


OMEGA_OBSERVERS = {
    "solder_shortage": _flags("solder_shortage", {"solder_shortage": SHORTAGE, "clogged": CLOGGED}),
    "preparing": _flags("preparing", {"preparing": PREPARING}),
    "in_range": _in_range,
}


USUAL = {"solder_shortage": INFORMATION.names[0], "preparing": CONTROL.names[0]}
"""Assumed states before the first reading."""


def differs_from_last(name: str) -> Callable[[SessionContext, PortState, Value], bool]:
    """Return a check whether a state differs from the last reading; a different state is read twice
    before it is accepted.
    """

    def doubt(_context: SessionContext, port: PortState, value: Value) -> bool:
        last = port.states.get(name)
        if value == WITHOUT_DIGIT and last is None:
            return False
        return value != (USUAL[name] if last is None else last[0])

    return doubt


def unreported_states_text(context: SessionContext) -> str:
    """Describe the states that this controller does not report; empty if it reports all."""
    unreported = [
        signal.command.replace("_", " ")
        for signal in context.state.family.signals
        if signal.name in context.state.not_supported
    ]
    text = (
        f" It does not answer {', '.join(unreported)}, so the record does not have it."
        if unreported
        else ""
    )
    if isinstance(context.station, OmegaStation) and context.station.without_digit:
        text += " It answers A with a alone: whether solder is short or clogged is not known."
    return text


def report_completions(context: SessionContext) -> None:
    """Report unsolicited messages: completion of a joint begun by somebody else, or by an earlier
    order.
    """
    if not isinstance(context.station, OmegaStation):
        return
    for completion in context.station.completions:
        kind = "omega.completed" if completion.letter == "h" else "omega.first_stage"
        text = (
            f"It says that {COMPLETION_MESSAGES[completion.letter]}; this run asked for no joint."
        )
        context.log.note(kind, Severity.INFO, text, raw=completion.letter)
    context.station.completions.clear()
