"""How a lost link is told, and after how long it is tried again. A flooded one counts as lost, too.

A flood is told once until the station is back. Where one comes again and again, the link is tried more and more rarely: each try
costs a second of all that is sent.
"""

from __future__ import annotations

from typing import Final

from jbclog.core.errors import LinkError, LinkFlooded, OtherStation, RobotModeOff, StationError
from jbclog.core.rows import Severity
from jbclog.session.run.context import SessionContext

FIRST_SEEK_S: Final = 0.25
SEEK_GROWTH: Final = 1.3  # gentle, so that a short drop-out is not made much longer by the search
LONGEST_SEEK_S: Final = 5.0
FIRST_AFTER_FLOOD_S: Final = 1.0
FLOOD_GROWTH: Final = 2.0
LONGEST_AFTER_FLOOD_S: Final = 15.0
FORGOTTEN_S: Final = 60.0  # after so long without one, a flood is the first again
HOT_C: Final = 60  # a tip that was last seen above this is called hot


def tell_loss(context: SessionContext, cause: LinkError | StationError) -> None:
    """Put the loss into the record and note it in the facts."""
    context.facts.outages += 1
    context.connected = False
    if isinstance(cause, RobotModeOff):
        text = "Robot mode was switched off at the station. It is asked again from time to time; nothing is written to it."
        context.note("robot.off", Severity.ERROR, text)
        return
    if isinstance(cause, LinkFlooded):
        tell_flood(context, cause)
        return
    severity, warning = _heat(context)
    if isinstance(cause, OtherStation):
        text = f"The station may be another now: {cause}.{warning}"
        context.note("link.lost", severity, text, since=cause.since)
    else:
        context.note("link.lost", severity, f"The station cannot be reached: {cause}.{warning}")


def tell_flood(context: SessionContext, flood: LinkFlooded) -> None:
    """Put a flood into the record, unless one was told since the station was last heard of."""
    if context.is_flooded:
        return
    again = context.flood_ended is not None and context.now - context.flood_ended < FORGOTTEN_S
    context.flood_pause_s = min(FLOOD_GROWTH * context.flood_pause_s, LONGEST_AFTER_FLOOD_S) if again else FIRST_AFTER_FLOOD_S
    context.is_flooded = True
    severity, warning = _heat(context)
    what = str(flood)
    text = f"{what[0].upper()}{what[1:]}. It counts as lost and is opened again from time to time.{warning}"
    context.note("link.flooded", severity, text, since=context.now - flood.seconds, value=flood.came, limit=flood.limit)


def tell_flood_over(context: SessionContext) -> None:
    """The station has been reached again."""
    if context.is_flooded:
        context.is_flooded, context.flood_ended = False, context.now


def first_pause_s(context: SessionContext) -> float:
    """How long to wait before a lost link is tried again."""
    return context.flood_pause_s if context.is_flooded else FIRST_SEEK_S


def next_pause_s(context: SessionContext, pause_s: float) -> float:
    """The same after a try that failed, behind a pause of `pause_s`."""
    if not context.is_flooded:
        return min(SEEK_GROWTH * pause_s, LONGEST_SEEK_S)
    context.flood_pause_s = min(FLOOD_GROWTH * context.flood_pause_s, LONGEST_AFTER_FLOOD_S)
    return context.flood_pause_s


def _heat(context: SessionContext) -> tuple[Severity, str]:
    """How severe it is that the station cannot be reached, and what may be hot there."""
    hot = [port for port in context.ports.values() if port.touched and (port.temperature_c or 0) > HOT_C]
    tips = ", ".join(f"port {port.number} at {port.temperature_c} °C" for port in hot)
    warning = f" Its {context.family.hot_part} stays as it was last set: {tips}." if hot else ""
    return Severity.CRITICAL if hot else Severity.ERROR, warning
