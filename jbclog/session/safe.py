"""The last chapter, on every way out: feeder stopped, then each touched tool in its safe state, read back.

A station has no watchdog: what is not told to stand stays hot. So this is tried three times a tool, over a line that is
opened again if need be, and what could not be done is said with station, port and last temperature.
"""

from __future__ import annotations

from jbclog.commands.status import StatusWord
from jbclog.effects import Reopen, Steps, Wait
from jbclog.errors import LinkError, Refusal, StationError, Unsafe
from jbclog.rows import Severity
from jbclog.session.identity import recognise
from jbclog.session.order import Desk, PortState

ALLOWED_S = 3.0  # for one station (faults.md, section 9)
TRIES = 3
VERIFIED, SENT, FAILED = "verified", "sent", "failed"
COOLING_AFTER_S = 1.0  # how long after the order an extractor state has to show in temperature or power
IDLE_PERMILLE = 20  # a heater that gets less than this is off


def make_safe(desk: Desk) -> Steps[None]:
    """Put what this run touched into the recipe's safe state. Raises `Unsafe` naming every tool that is not.

    All is done before any of it is told, so that a record that fails keeps no tool hot.
    """
    touched = [port for port in desk.ports.values() if port.touched]
    if not touched and not desk.feeder_touched:
        return
    desk.station.unasked((yield Wait(0.0)))
    may_feed = yield from _put(desk, touched, feeds=desk.feeder_touched or desk.feeding_seen)
    desk.facts.unsafe = [f"{desk.name}: the feeder could not be told to stop"] if may_feed else []
    desk.facts.unsafe += [_unsafe_text(desk, port) for port in touched if not _is_verified(desk, port)]
    if may_feed:
        desk.note("safety.not_safe", Severity.CRITICAL, f"{desk.facts.unsafe[0]}.")
    for port in touched:
        _tell(desk, port)
    desk.publish()
    if desk.facts.unsafe:
        raise Unsafe("; ".join(desk.facts.unsafe))


def put_in_safe_state(desk: Desk, port: PortState) -> Steps[None]:
    """Order the safe state on one port until a reading bears it out, and say how that went."""
    yield from _put(desk, [port], feeds=False)
    _tell(desk, port)


def _put(desk: Desk, ports: list[PortState], *, feeds: bool) -> Steps[bool]:
    """Order the safe states, feeder first, in rounds spread over the time that is allowed; whether it may still feed.

    No tool waits for the tries of another. What came of it is in the facts.
    """
    end = desk.now + ALLOWED_S
    for port in ports:
        desk.facts.safe_state[port.number] = FAILED
    for round_ in range(TRIES):
        if round_:
            desk.station.unasked((yield Wait(desk.now + max(end - desk.now, 0.0) / (TRIES - round_ + 1))))
        feeds = feeds and not (yield from _stop_feeder(desk, end))
        for port in ports:
            if not _is_verified(desk, port):
                yield from _put_port(desk, port, end)
        if desk.now > end or not (feeds or any(not _is_verified(desk, port) for port in ports)):
            break
    return feeds


def _is_verified(desk: Desk, port: PortState) -> bool:
    return desk.facts.safe_state[port.number] == VERIFIED


def _tell(desk: Desk, port: PortState) -> None:
    if _is_verified(desk, port):
        text = f"Port {port.number}: the tool is in its safe state, as read back: {_state_of(desk, port)}."
        desk.note("safety.safe_state", Severity.INFO, text, port=port.number)
    else:
        desk.note("safety.not_safe", Severity.CRITICAL, _unsafe_text(desk, port) + ".", port=port.number)


def _state_of(desk: Desk, port: PortState) -> str:
    status = desk.family.status
    return status.state(port.status or status.orders[status.last_resort])


def _stop_feeder(desk: Desk, end: float) -> Steps[bool]:
    if not (yield from _is_reachable(desk, end)):
        return False
    try:
        yield from desk.station.write(desk.command("stop_feeding"), 0)
        feeding = yield from desk.station.read(desk.command("feeding"))
    except (LinkError, StationError) as error:
        yield from _reach_again(desk, end, error)
        return False
    return feeding == "stopped"


def _put_port(desk: Desk, port: PortState, end: float) -> Steps[None]:
    """One try. Where the state is not reached, or should cool and does not, the one follows from which the station cools."""
    states, status, wanted = desk.facts.safe_state, desk.family.status, desk.safe_state
    reached = yield from _order(desk, port, status.orders[wanted], end)
    if wanted in desk.family.proven_by_cooling and reached == VERIFIED and not (yield from _is_cooling(desk, port)):
        reached = FAILED
    if wanted != status.last_resort and reached != VERIFIED:
        reached = yield from _order(desk, port, status.orders[status.last_resort], end)
    states[port.number] = max(states[port.number], reached, key=(FAILED, SENT, VERIFIED).index)


def _order(desk: Desk, port: PortState, word: StatusWord, end: float) -> Steps[str]:
    """Order a state once and read it back: ``verified``, ``sent`` (acknowledged) or ``failed``."""
    command, reached = desk.command("status"), FAILED
    if not (yield from _is_reachable(desk, end)):
        return reached
    try:
        yield from desk.station.write(command, word, port.number)
        reached = SENT
    except LinkError as error:
        yield from _reach_again(desk, end, error)
        return reached
    except StationError:
        pass  # whether it was done is read back
    try:
        found = yield from desk.station.read(command, port.number)
    except (LinkError, StationError) as error:
        yield from _reach_again(desk, end, error)
        return reached
    if isinstance(found, tuple) and desk.family.status.is_safe(found, word):
        port.status = found
        return VERIFIED
    return reached


def _is_cooling(desk: Desk, port: PortState) -> Steps[bool]:
    """Whether the tip falls or its heater is off: the extractor digit alone proves neither."""
    command = desk.family.command_of("temperature_c")
    if command is None:
        return False
    try:
        before = yield from desk.station.read(command, port.number)
        desk.station.unasked((yield Wait(desk.now + COOLING_AFTER_S)))
        after = yield from desk.station.read(command, port.number)
        power = yield from desk.station.read(desk.command("power"), port.number)
    except (LinkError, StationError):
        return False
    falling = isinstance(before, int) and isinstance(after, int) and after < before
    return falling or (isinstance(power, int) and power <= IDLE_PERMILLE)


def _is_reachable(desk: Desk, end: float) -> Steps[bool]:
    """Whether this run's station, and no other, is at the end of the line."""
    if not desk.is_proven:
        yield from _reach_again(desk, end, LinkError("not proven"))
    return desk.is_proven


def _reach_again(desk: Desk, end: float, error: LinkError | StationError) -> Steps[None]:
    """Open the port anew, while there is time; where the link was broken, until the station has said again who it is.

    A station that is merely silent may still hear; one behind a cable that was out may be another.
    """
    desk.is_proven &= not isinstance(error, LinkError)
    if isinstance(error, Refusal):
        return  # it answers
    while desk.now < end:
        try:
            desk.station.unasked((yield Reopen()))
            if desk.is_proven or (yield from _is_ours(desk)):
                return
        except LinkError:
            desk.is_proven = False
        except StationError:
            pass  # not there yet
        desk.station.unasked((yield Wait(desk.now + 0.25)))


def _is_ours(desk: Desk) -> Steps[bool]:
    model = yield from desk.station.read(desk.command("model"))
    return (yield from recognise(desk, str(model)))


def _unsafe_text(desk: Desk, port: PortState) -> str:
    last = "never read" if port.temperature_c is None else f"last read {port.temperature_c} °C"
    sent = desk.facts.safe_state.get(port.number) == SENT
    what = "was told to go to its safe state and does not confirm it" if sent else "could not be put in its safe state"
    if desk.stranger:
        what += f" (on its cable is now {desk.stranger})"
    return f"{desk.name} port {port.number}: {what}, its tip may be hot ({last}); switch the station off"
