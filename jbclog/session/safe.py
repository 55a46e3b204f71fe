"""The last chapter, on every way out: feeder stopped, then each touched tool in its safe state, read back.

A station has no watchdog: what is not told to stand stays hot. So this is tried three times a tool, over a line that is
opened again if need be, and what could not be done is said with station, port and last temperature.
"""

from __future__ import annotations

from jbclog.commands.family import STAND, STATUS_ORDERS
from jbclog.effects import Reopen, Steps, Wait
from jbclog.errors import LinkError, StationError, Unsafe
from jbclog.rows import Severity
from jbclog.session.order import Desk, PortState

ALLOWED_S = 3.0  # for one station (faults.md, section 9)
TRIES = 3
VERIFIED, SENT, FAILED = "verified", "sent", "failed"
COOLING_AFTER_S = 1.0  # how long after the order an extractor state has to show in temperature or power
IDLE_PERMILLE = 20  # a heater that gets less than this is off


def make_safe(desk: Desk) -> Steps[None]:
    """Put what this run touched into the recipe's safe state. Raises `Unsafe` naming every tool that is not."""
    touched = [port for port in desk.ports.values() if port.touched]
    if not touched and not desk.feeder_touched:
        return
    desk.station.unasked((yield Wait(0.0)))
    end = desk.now + ALLOWED_S
    unsafe = []
    if (desk.feeder_touched or desk.feeding_seen) and not (yield from _stop_feeder(desk, end)):
        unsafe.append(f"{desk.name}: the feeder could not be told to stop")
        desk.note("safety.not_safe", Severity.CRITICAL, unsafe[0] + ".")
    for port in touched:
        if not (yield from put_in_safe_state(desk, port, end)):
            unsafe.append(_unsafe_text(desk, port))
    desk.facts.unsafe = unsafe
    desk.publish()
    if unsafe:
        raise Unsafe("; ".join(unsafe))


def put_in_safe_state(desk: Desk, port: PortState, end: float | None = None) -> Steps[bool]:
    """Order the safe state on one port until a reading bears it out, say so, and give whether it did."""
    end = desk.now + ALLOWED_S if end is None else end
    state = yield from _put(desk, port, end)
    desk.facts.safe_state[port.number] = state
    if state == VERIFIED:
        text = f"Port {port.number}: the tool is in its safe state ({desk.safe_state}), as read back."
        desk.note("safety.safe_state", Severity.INFO, text, port=port.number)
    else:
        desk.note("safety.not_safe", Severity.CRITICAL, _unsafe_text(desk, port) + ".", port=port.number)
    return state == VERIFIED


def _stop_feeder(desk: Desk, end: float) -> Steps[bool]:
    for _ in range(TRIES):
        try:
            yield from desk.station.write(desk.command("stop_feeding"), 0)
            feeding = yield from desk.station.read(desk.command("feeding"))
        except (LinkError, StationError):
            yield from _reach_again(desk, end)
            continue
        if feeding == "stopped":
            return True
    return False


def _put(desk: Desk, port: PortState, end: float) -> Steps[str]:
    word = STATUS_ORDERS[desk.safe_state]
    if word != STAND and (yield from _try(desk, port, word, end)) == VERIFIED and (yield from _is_cooling(desk, port)):
        return VERIFIED
    return (yield from _try(desk, port, STAND, end))  # the only state from which the station cools by itself


def _try(desk: Desk, port: PortState, word: tuple[int, ...], end: float) -> Steps[str]:
    """Order and read back, three times at most and once at least: ``verified``, ``sent`` (acknowledged) or ``failed``."""
    command, reached = desk.command("status"), FAILED
    for attempt in range(TRIES):
        if attempt and desk.now > end:
            break
        try:
            yield from desk.station.write(command, word, port.number)
            reached = SENT
        except (LinkError, StationError):
            yield from _reach_again(desk, end)
        try:
            found = yield from desk.station.read(command, port.number)
        except (LinkError, StationError):
            yield from _reach_again(desk, end)
            continue
        if isinstance(found, tuple) and _is_safe(found, word):
            return VERIFIED
    return reached


def _is_safe(found: tuple[int, ...], word: tuple[int, ...]) -> bool:
    """Stand, sleep and hibernation alike; for the extractor state its own digit."""
    return found[4] in (1, 2, 3) if word == STAND else found[3] == word[3]


def _is_cooling(desk: Desk, port: PortState) -> Steps[bool]:
    """Whether the tip falls or its heater is off: the extractor digit alone proves neither."""
    try:
        before = yield from desk.station.read(desk.command("tip_temperature"), port.number)
        desk.station.unasked((yield Wait(desk.now + COOLING_AFTER_S)))
        after = yield from desk.station.read(desk.command("tip_temperature"), port.number)
        power = yield from desk.station.read(desk.command("power"), port.number)
    except (LinkError, StationError):
        return False
    falling = isinstance(before, int) and isinstance(after, int) and after < before
    return falling or (isinstance(power, int) and power <= IDLE_PERMILLE)


def _reach_again(desk: Desk, end: float) -> Steps[None]:
    """Open the port anew, while there is time, until that works."""
    while desk.now < end:
        try:
            desk.station.unasked((yield Reopen()))
            return
        except LinkError:
            desk.station.unasked((yield Wait(desk.now + 0.25)))


def _unsafe_text(desk: Desk, port: PortState) -> str:
    last = "never read" if port.temperature_c is None else f"last read {port.temperature_c} °C"
    sent = desk.facts.safe_state.get(port.number) == SENT
    what = "was told to go to its safe state and does not confirm it" if sent else "could not be put in its safe state"
    return f"{desk.name} port {port.number}: {what}, its tip may be hot ({last}); switch the station off"
