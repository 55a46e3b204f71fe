"""When the station cannot be asked: its missed ticks are written, it is sought with back-off, and looked at before it counts.

Nothing is written to a station that has come back, and nothing heats by itself: its identity and settings are read, and
what differs is an event (faults.md, rows 12, 13, 16 and 17).
"""

from __future__ import annotations

from jbclog.core.errors import LinkError, LinkFlooded, RobotModeOff, StartRefused, StationError
from jbclog.core.io_requests import Steps, Wait
from jbclog.core.quantities import Value
from jbclog.core.rows import Severity
from jbclog.protocol.commands.command import Scope
from jbclog.session.run.apply import note_status, read_all
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.run.identify import connect
from jbclog.session.run.identity import recognise
from jbclog.session.run.loss import FIRST_SEEK_S, first_pause_s, next_pause_s, tell_flood, tell_flood_over, tell_loss
from jbclog.session.run.sampling import Lost, Sampler
from jbclog.session.run.watch import stop_on, tell_change

SEEK_AT_END_S = 3.0  # after the run's end, before a station is called gone: its tools have to be made safe anyway


class Gone(Exception):
    """The run's duration ended while the station was away, and it did not come back right after it."""


def outage(desk: SessionContext, sampler: Sampler, tick: int, lost: Lost) -> Steps[int]:
    """Live through an outage that began in `tick`; give the tick at which sampling goes on.

    Raises `Gone` where the run ends first and the station is not found soon after, `SettingChanged` where the recipe stops on a
    difference.
    """
    tell_loss(desk, lost.cause)
    desk.is_proven &= not isinstance(lost.cause, LinkError)
    sampler.begin_outage(tick)
    return (yield from sampler.watched(_live_through(desk, sampler, tick, lost)))


def _live_through(desk: SessionContext, sampler: Sampler, tick: int, lost: Lost) -> Steps[int]:
    began, pause = desk.now, first_pause_s(desk)
    last_heard = min(desk.station.heard, began)
    why = lost.cause.reason if isinstance(lost.cause, RobotModeOff) else LinkError.reason
    held = _all_held(desk)
    seek_at = began + pause
    tick += 1
    while not sampler.is_over(tick):
        desk.station.unasked((yield Wait(min(sampler.grid.due(tick), seek_at))))
        tick = sampler.miss_until(tick, desk.now, why)
        if desk.now < seek_at:
            continue
        is_back = yield from _seek(desk, reopen=why == LinkError.reason or desk.is_flooded)
        tick = sampler.miss_until(tick, desk.now, why)
        if is_back:
            _resume(desk, began, why, held)
            return tick
        pause = next_pause_s(desk, pause)
        seek_at = desk.now + pause
    over = desk.now
    if (yield from _seek_at_end(desk, reopen=why == LinkError.reason)):
        _resume(desk, began, why, held)
        return tick
    away = f"away for {desk.now - last_heard:.1f} s, still {desk.now - over:.0f} s after the end of the run"
    raise Gone(f"{desk.name}: {away} ({lost})")


def _seek_at_end(desk: SessionContext, *, reopen: bool) -> Steps[bool]:
    """Whether the station is found within `SEEK_AT_END_S`. One that is late as the run ends has had no other chance.

    A flooded link is tried once.
    """
    end = desk.now + SEEK_AT_END_S
    while desk.now < end:
        desk.station.unasked((yield Wait(min(desk.now + FIRST_SEEK_S, end))))
        if (yield from _seek(desk, reopen=reopen)):
            return True
        if desk.is_flooded:
            break
    return False


def _resume(desk: SessionContext, began: float, why: str, held: dict[int | None, dict[str, Value]]) -> None:
    """The station is back, and has been looked at."""
    _tell_return(desk, began, why)
    _compare(desk, held)


def _tell_return(desk: SessionContext, began: float, why: str) -> None:
    desk.connected = True
    tell_flood_over(desk)
    away = desk.now - began
    kind = "robot.on" if why == "robot_off" else "link.back"
    known = "its identity and settings have been read again"
    if not desk.family.models:
        known = "whether it is the same one cannot be told, because it does not say who it is"
    text = f"The station is back after {away:.1f} s; {known}."
    desk.note(kind, Severity.INFO, text, since=began, value=round(away, 3))
    desk.publish()


def _seek(desk: SessionContext, *, reopen: bool) -> Steps[bool]:
    """Try once to reach the station and to learn what it holds now. Whether it may be sampled again."""
    try:
        found = yield from connect(desk, reopen=reopen, tries=1)
        if not (yield from recognise(desk, found)):
            return False
        yield from _read_tools(desk)
        yield from read_all(desk)
    except LinkFlooded as flood:
        tell_flood(desk, flood)
        return False
    except (LinkError, StartRefused, StationError):
        return False
    return True


def _read_tools(desk: SessionContext) -> Steps[None]:
    for port in desk.ports.values() if desk.family.tools else ():
        tool = yield from desk.agreed(desk.command("tool"), port.number, known=port.tool)
        if tool != port.tool and isinstance(tool, int):
            before, after = desk.tool_text(port.tool), desk.tool_text(tool)
            text = f"Port {port.number}: the tool changed from {before} to {after} during the outage."
            desk.note("tool.changed", Severity.WARNING, text, port=port.number, code=tool)
            port.tool, port.tool_is_new = tool, True


def _all_held(desk: SessionContext) -> dict[int | None, dict[str, Value]]:
    """All settings as they were last known, station first; the status is the last that was seen."""
    held: dict[int | None, dict[str, Value]] = {None: dict(desk.held)}
    for port in desk.ports.values():
        held[port.number] = dict(port.held) | ({} if port.status is None else {"status": port.status})
    return held


def _compare(desk: SessionContext, before: dict[int | None, dict[str, Value]]) -> None:
    """Tell every setting that came back different, station first; then stop, where the recipe says so."""
    changes = []
    for number, held in before.items():
        port = None if number is None else desk.ports[number]
        now = desk.held if port is None else port.held
        for name, value in held.items():
            found = now.get(name)
            if found is not None and _is_watched(desk, port, name) and not _is_alike(desk, name, value, found):
                command = desk.command(name)
                changes.append(tell_change(desk, port, name, command.shown(value), command.shown(found)))
        if port is not None:
            note_status(port)
    stop_on(desk, changes)


def _is_watched(desk: SessionContext, port: PortState | None, name: str) -> bool:
    """Whether a difference in it is one: a new tool has settings of its own, and a recipe may leave the tools' state alone."""
    if name == "status" and desk.recipe.run.status is None:
        return False
    return not (port is not None and port.tool_is_new and desk.command(name).scope is Scope.TOOL)


def _is_alike(desk: SessionContext, name: str, before: Value, found: Value) -> bool:
    """Whether nothing changed that anybody set; a status goes on by itself from stand to sleep."""
    if name == "status" and isinstance(found, tuple) and isinstance(before, tuple):
        return desk.family.status.is_working(found) == desk.family.status.is_working(before)
    return found == before
