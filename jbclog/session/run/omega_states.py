"""OMEGA's states: told when they change, and what its controller says by itself.

Solder that has run out and a clogged nozzle are errors from the reading on that shows them, and no longer one as soon as a
reading does not. That it prepares is told for information, and so is a temperature out of its range that lasts: each joint
takes it there for a moment, and that stands in the samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from jbclog.core.quantities import Value
from jbclog.core.rows import Severity
from jbclog.protocol.client.omega import OmegaStation
from jbclog.protocol.commands.omega import CONTROL, INFORMATION, LATE, SAYS_YES
from jbclog.protocol.commands.omega_values import UNTOLD
from jbclog.session.run.context import PortState, SessionContext

LASTING_S = 10.0


@dataclass(frozen=True, slots=True)
class _State:
    """One flag, a column of `samples`: what is told when it becomes true, and when it does no longer."""

    begins: str
    severity: Severity
    begun: str
    ends: str
    ended: str


SHORTAGE = _State("solder.shortage", Severity.ERROR, "There is no solder left.", "solder.shortage.ended", "There is solder again.")
CLOGGED = _State(
    "feeder.clogged", Severity.ERROR, "The solder is clogged.", "feeder.clogged.ended", "The solder is no longer clogged."
)
PREPARING = _State(
    "control.preparing", Severity.INFO, "It is preparing, or has an error; one answer means both.", "control.ready", "It is ready."
)
OUT_OF_RANGE = "temperature.out_of_range"


def _flags(signal: str, flags: Mapping[str, _State]) -> Callable[[SessionContext, PortState, Value], None]:
    """Tell each change of the flags in the answers to `signal`; at the first reading those that are set."""

    def observe(context: SessionContext, port: PortState, value: Value) -> None:
        before = port.states.get(signal)
        port.states[signal] = (value, context.now)
        for column, state in flags.items():
            was, is_now = before is not None and before[0] in SAYS_YES[column], value in SAYS_YES[column]
            if was != is_now:
                kind, severity, text = (
                    (state.begins, state.severity, state.begun) if is_now else (state.ends, Severity.INFO, state.ended)
                )
                context.note(kind, severity, text, port=port.number, since=before[1] if before else None)

    return observe


def _in_range(context: SessionContext, port: PortState, value: Value) -> None:
    """A temperature that has been out of its range for `LASTING_S`; `states` holds since when it is as it is."""
    before = port.states.get("in_range")
    is_in = value in SAYS_YES["in_range"]
    if before is None or before[0] != value:
        port.states["in_range"] = (value, context.now)
        if is_in and OUT_OF_RANGE in port.states:
            del port.states[OUT_OF_RANGE]
            context.note("temperature.in_range", Severity.INFO, "The temperature is in its range again.", port=port.number)
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
"""What a state is taken to have been before the first reading of it."""


def differs_from_last(name: str) -> Callable[[SessionContext, PortState, Value], bool]:
    """Whether a state is another than at the last reading; where that is an error it is asked twice before it is believed."""

    def doubt(_context: SessionContext, port: PortState, value: Value) -> bool:
        last = port.states.get(name)
        if value == UNTOLD and last is None:
            return False
        return value != (USUAL[name] if last is None else last[0])

    return doubt


def told_text(context: SessionContext) -> str:
    """What this controller does not tell of its states, as sentences; nothing where it tells them all."""
    untold = [signal.command.replace("_", " ") for signal in context.family.signals if signal.name in context.not_supported]
    text = f" It does not answer {', '.join(untold)}: that is not due, and not known." if untold else ""
    if isinstance(context.station, OmegaStation) and context.station.without_digit:
        text += " It answers A with a alone: whether solder is short or clogged is not known."
    return text


def tell_late(context: SessionContext) -> None:
    """Tell what the controller has said by itself: that a joint is done which somebody else, or an earlier order, began."""
    if not isinstance(context.station, OmegaStation):
        return
    for said in context.station.by_itself:
        kind = "omega.completed" if said.letter == "h" else "omega.first_stage"
        text = f"It says that {LATE[said.letter]}; this run asked for no joint."
        context.note(kind, Severity.INFO, text, raw=said.letter)
    context.station.by_itself.clear()
