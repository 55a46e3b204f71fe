"""What a station does otherwise than the manuals recommend: told once each, and what only a session can notice of it.

A client takes other forms and counts them (`protocol/client/anomalies.py`); whoever holds the context tells
(`SessionContext.tell_anomalies`).
"""

from __future__ import annotations

from collections.abc import Iterable

from jbclog.core.errors import StationError
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value
from jbclog.session.run.context import PortState, SessionContext

DELAY_UNIT, NO_COUNTDOWN = 20, 25  # B-numbers (docs/reference/contradictions.md)
LATE_S, EARLY_S = 30, 5  # how far a countdown may be from a whole delay shortly after it began


def note_zero_countdown(context: SessionContext, port: PortState, value: Value) -> None:
    """A time to sleep of 0 s where nothing counts down (docs/reference/contradictions.md, B-25)."""
    if value == 0:
        _meet(context, NO_COUNTDOWN, "time to sleep", port)


def compare_countdowns(context: SessionContext, ports: Iterable[PortState]) -> Steps[None]:
    """Hold the time to sleep against the sleep delay on `ports`, which were at work and have just been told to stand.

    Manuals give the delay in minutes, in seconds or without a unit; only this can tell (docs/reference/contradictions.md, B-20).
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
    if isinstance(left, int) and 0 < left < 65535 and not 60 * delay - LATE_S <= left <= 60 * delay + EARLY_S:
        _meet(context, DELAY_UNIT, f"time to sleep with a sleep delay of {delay}", port)


def _meet(context: SessionContext, number: int, what: str, port: PortState) -> None:
    context.station.anomalies.meet(number, f"{what}, port {port.number}", context.station.data, port.number)
