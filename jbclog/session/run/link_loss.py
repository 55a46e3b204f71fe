"""Report a lost link, and time the attempts to reconnect.

A flooded link counts as lost. A flood is reported once until the station is back. If floods recur,
attempts become less frequent, because each costs a second of listening.
"""

from __future__ import annotations

from typing import Final

from jbclog.core.errors import LinkError, LinkFlooded, OtherStation, RobotModeOff, StationError
from jbclog.core.rows import Severity
from jbclog.session.run.context import SessionContext

FIRST_SEEK_S: Final = 0.25
SEEK_GROWTH: Final = 1.3  # gentle, so that the search hardly prolongs a short outage
LONGEST_SEEK_S: Final = 5.0
FIRST_AFTER_FLOOD_S: Final = 1.0
FLOOD_GROWTH: Final = 2.0
LONGEST_AFTER_FLOOD_S: Final = 15.0
FORGOTTEN_S: Final = 60.0  # time without a flood after which the next one counts as the first
HOT_C: Final = 60  # a tip last read above this counts as hot


def report_loss(context: SessionContext, cause: LinkError | StationError) -> None:
    context.facts.outages += 1
    context.connected = False
    if isinstance(cause, RobotModeOff):
        text = (
            "Robot mode was switched off at the station. It is asked again from time to time;"
            " nothing is written to it."
        )
        context.note("robot.off", Severity.ERROR, text)
        return
    if isinstance(cause, LinkFlooded):
        report_flood(context, cause)
        return
    severity, warning = _heat(context)
    if isinstance(cause, OtherStation):
        text = f"This may be another station now: {cause}.{warning}"
        context.note("link.lost", severity, text, since=cause.since)
    else:
        context.note("link.lost", severity, f"The station cannot be reached: {cause}.{warning}")


def report_flood(context: SessionContext, flood: LinkFlooded) -> None:
    """Record a flood, unless one was recorded since the station last answered."""
    if context.is_flooded:
        return
    again = context.flood_ended is not None and context.now - context.flood_ended < FORGOTTEN_S
    context.flood_pause_s = (
        min(FLOOD_GROWTH * context.flood_pause_s, LONGEST_AFTER_FLOOD_S)
        if again
        else FIRST_AFTER_FLOOD_S
    )
    context.is_flooded = True
    severity, warning = _heat(context)
    what = str(flood)
    text = (
        f"{what[0].upper()}{what[1:]}. The link counts as lost and is reopened from time to"
        f" time.{warning}"
    )
    context.note(
        "link.flooded",
        severity,
        text,
        since=context.now - flood.seconds,
        value=flood.came,
        limit=flood.limit,
    )


def note_flood_over(context: SessionContext) -> None:
    """Register that the station is back after a flood."""
    if context.is_flooded:
        context.is_flooded, context.flood_ended = False, context.now


def first_pause_s(context: SessionContext) -> float:
    """Return the pause before the first attempt to reconnect."""
    return context.flood_pause_s if context.is_flooded else FIRST_SEEK_S


def next_pause_s(context: SessionContext, pause_s: float) -> float:
    """Return the pause after a failed attempt that followed a pause of `pause_s`."""
    if not context.is_flooded:
        return min(SEEK_GROWTH * pause_s, LONGEST_SEEK_S)
    context.flood_pause_s = min(FLOOD_GROWTH * context.flood_pause_s, LONGEST_AFTER_FLOOD_S)
    return context.flood_pause_s


def _heat(context: SessionContext) -> tuple[Severity, str]:
    """Return the severity of the loss, and a sentence about what may be hot."""
    hot = [
        port
        for port in context.ports.values()
        if port.touched and (port.temperature_c or 0) > HOT_C
    ]
    tips = ", ".join(f"port {port.number} at {port.temperature_c} °C" for port in hot)
    warning = f" Its {context.family.hot_part} stays as it was last set: {tips}." if hot else ""
    return Severity.CRITICAL if hot else Severity.ERROR, warning
