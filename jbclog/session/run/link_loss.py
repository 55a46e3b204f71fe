"""Report a lost link. A flooded link counts as lost; a flood is reported once until the station is
back.
"""

from __future__ import annotations

from typing import Final

from jbclog.core.errors import LinkError, LinkFlooded, OtherStation, RobotModeOff, StationError
from jbclog.core.rows import Severity
from jbclog.session.run.context import SessionContext
from jbclog.session.run.state import StationState

HOT_C: Final = 60  # a tip last read above this counts as hot


def report_loss(context: SessionContext, cause: LinkError | StationError) -> None:
    context.state.facts.outages += 1
    context.state.connected = False
    if isinstance(cause, RobotModeOff):
        text = (
            "Robot mode was switched off at the station. It is asked again from time to time;"
            " nothing is written to it."
        )
        context.log.note("robot.off", Severity.ERROR, text)
        return
    if isinstance(cause, LinkFlooded):
        report_flood(context, cause)
        return
    severity, warning = _heat(context.state)
    if isinstance(cause, OtherStation):
        text = f"This may be another station now: {cause}.{warning}"
        context.log.note("link.lost", severity, text, since=cause.since)
    else:
        context.log.note("link.lost", severity, f"The station cannot be reached: {cause}.{warning}")


def report_flood(context: SessionContext, flood: LinkFlooded) -> None:
    """Record a flood, unless one was recorded since the station last answered."""
    reconnection = context.state.reconnection
    if reconnection.is_flooded:
        return
    reconnection.begin_flood(context.now)
    severity, warning = _heat(context.state)
    what = str(flood)
    context.log.note(
        "link.flooded",
        severity,
        f"{what[0].upper()}{what[1:]}. The link counts as lost and is reopened from time to"
        f" time.{warning}",
        since=context.now - flood.seconds,
        value=flood.came,
        limit=flood.limit,
    )


def _heat(state: StationState) -> tuple[Severity, str]:
    """Return the severity of the loss, and a sentence about what may be hot."""
    hot = [
        port for port in state.ports.values() if port.touched and (port.temperature_c or 0) > HOT_C
    ]
    if not hot:
        return Severity.ERROR, ""
    tips = ", ".join(f"port {port.number} at {port.temperature_c} °C" for port in hot)
    return Severity.CRITICAL, f" Its {state.family.hot_part} stays as it was last set: {tips}."
