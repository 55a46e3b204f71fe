"""Compare the time to sleep with the sleep delay: anomalies that only a session can detect.

The client counts the others (`protocol/client/interface.py`); `SessionContext.report_anomalies`
reports all of them.
"""

from __future__ import annotations

from collections.abc import Iterable

from jbclog.core.errors import StationError
from jbclog.core.quantities import Value
from jbclog.session.run.context import SessionContext
from jbclog.session.run.state import PortState

DELAY_UNIT, NO_COUNTDOWN = 20, 25  # B-numbers (docs/reference/contradictions.md)
LATE_S, EARLY_S = 30, 5  # tolerance of a countdown shortly after its start


def note_zero_countdown(context: SessionContext, port: PortState, value: Value) -> None:
    """Report a time to sleep of 0 s when nothing counts down (docs/reference/contradictions.md,
    B-25).
    """
    if value == 0:
        _note_anomaly(context, NO_COUNTDOWN, "time to sleep", port)


async def compare_countdowns(context: SessionContext, ports: Iterable[PortState]) -> None:
    """Compare the time to sleep with the sleep delay on `ports`, which were at work and have just
    been put in stand.

    Manuals give the delay in minutes, in seconds or without a unit; only this comparison can decide
    (docs/reference/contradictions.md, B-20).
    """
    if (
        "time_to_sleep" not in context.state.family.commands
        or "delay_s" in context.state.not_supported
    ):
        return
    for port in ports:
        delay = port.held.get("sleep_delay")
        if isinstance(delay, int) and delay > 0 and port.status is not None and port.status[4] == 1:
            await _compare_countdown(context, port, delay)


async def _compare_countdown(context: SessionContext, port: PortState, delay: int) -> None:
    try:
        left = await context.station.read(context.command("time_to_sleep"), port.number)
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
