"""Bridge an outage: record the missed ticks, reconnect with back-off, and check the station before
it counts again.

Nothing is written to a station that is back, and nothing heats by itself: the session reads
identity and settings and reports each difference as an event (docs/reference/faults.md, F-12, F-13,
F-16 and F-17).
"""

from __future__ import annotations

from jbclog.core.errors import (
    LinkError,
    LinkFlooded,
    OtherStation,
    RobotModeOff,
    StartRefused,
    StationError,
)
from jbclog.core.io_requests import Steps, Wait
from jbclog.core.quantities import Value
from jbclog.core.rows import Severity
from jbclog.protocol.commands.command import Scope
from jbclog.session.run.apply import note_status, read_all
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.run.identify import connect
from jbclog.session.run.identity import recognise
from jbclog.session.run.link_loss import (
    FIRST_SEEK_S,
    first_pause_s,
    next_pause_s,
    note_flood_over,
    report_flood,
    report_loss,
)
from jbclog.session.run.mix_ups import identity_of
from jbclog.session.run.sampling import Sampler, StationLost
from jbclog.session.run.watch import report_change, stop_on

# after the run's end, before a station counts as gone: its tools must be made safe anyway
SEEK_AT_END_S = 3.0


class StationGone(Exception):
    """The run ended during an outage, and the station did not come back right after."""


def outage(context: SessionContext, sampler: Sampler, tick: int, lost: StationLost) -> Steps[int]:
    """Bridge an outage that began in `tick`; return the tick at which sampling resumes.

    Raises `StationGone` if the run ends first and the station does not come back soon, and
    `SettingChanged` if the recipe stops on a difference.
    """
    report_loss(context, lost.cause)
    context.is_proven &= not isinstance(lost.cause, LinkError)
    if isinstance(lost.cause, OtherStation):
        context.identity_at.clear()
    sampler.begin_outage(tick)
    return (yield from sampler.watched(_bridge(context, sampler, tick, lost)))


def _bridge(context: SessionContext, sampler: Sampler, tick: int, lost: StationLost) -> Steps[int]:
    began, pause = context.now, first_pause_s(context)
    last_heard = min(context.station.heard, began)
    why = lost.cause.reason if isinstance(lost.cause, RobotModeOff) else LinkError.reason
    held = _all_held(context)
    seek_at = began + pause
    tick += 1
    while not sampler.is_over(tick):
        context.station.unasked((yield Wait(min(sampler.grid.due(tick), seek_at))))
        tick = sampler.miss_until(tick, context.now, why)
        if context.now < seek_at:
            continue
        is_back = yield from _seek(context, reopen=why == LinkError.reason or context.is_flooded)
        tick = sampler.miss_until(tick, context.now, why)
        if is_back:
            _resume(context, began, why, held)
            return tick
        pause = next_pause_s(context, pause)
        seek_at = context.now + pause
    over = context.now
    if (yield from seek_at_end(context, reopen=why == LinkError.reason)):
        _resume(context, began, why, held)
        return tick
    silent_s, waited_s = context.now - last_heard, context.now - over
    if context.mix_up is not None:
        raise StationGone(f"{context.name}: {context.mix_up}")
    if context.stranger is not None:
        raise StationGone(
            f"{context.name}: another station answers on {context.order.url}, {context.stranger} of"
            " this run; compare with the label on the station, and correct the cable"
        )
    raise StationGone(
        f"{context.name}: not reachable for the last {silent_s:.1f} s; waited {waited_s:.0f} s"
        f" after the end of the run ({lost})"
    )


def seek_at_end(context: SessionContext, *, reopen: bool) -> Steps[bool]:
    """Try to reconnect for `SEEK_AT_END_S`, the last chance of a station that is late at the run's
    end; return True if it is there.

    Tries a flooded link once.
    """
    end = context.now + SEEK_AT_END_S
    while context.now < end:
        context.station.unasked((yield Wait(min(context.now + FIRST_SEEK_S, end))))
        if (yield from _seek(context, reopen=reopen)):
            return True
        if context.is_flooded:
            break
    return False


def _resume(
    context: SessionContext, began: float, why: str, held: dict[int | None, dict[str, Value]]
) -> None:
    """Report that the station is back, with its changes."""
    _report_return(context, began, why)
    _compare(context, held)


def _report_return(context: SessionContext, began: float, why: str) -> None:
    context.connected = True
    note_flood_over(context)
    away = context.now - began
    kind = "robot.on" if why == "robot_off" else "link.back"
    if context.family.models:
        compared = identity_of(context).compared()
        known = f"{compared} as before; its settings have been read again"
    else:
        known = "whether it is the same one cannot be told, because it does not say who it is"
    text = f"The station is back after {away:.1f} s; {known}."
    context.note(kind, Severity.INFO, text, since=began, value=round(away, 3))
    if context.alike:
        others = ", ".join(context.alike)
        doubt = (
            f"Nothing that the station says tells it from {others}: it may be one of these, if"
            " cables were exchanged meanwhile. Compare with the label on the station."
        )
        context.note("identity.not_known", Severity.WARNING, doubt, since=began)
    context.publish()


def _seek(context: SessionContext, *, reopen: bool) -> Steps[bool]:
    """Try once to reconnect and to read the settings; return True if the station may be sampled
    again.
    """
    try:
        found = yield from connect(context, reopen=reopen, tries=1)
        if not (yield from recognise(context, found)):
            return False
        yield from _read_tools(context)
        yield from read_all(context)
    except LinkFlooded as flood:
        report_flood(context, flood)
        return False
    except (LinkError, StartRefused, StationError):
        return False
    return True


def _read_tools(context: SessionContext) -> Steps[None]:
    for port in context.ports.values() if context.family.tools else ():
        tool = yield from context.read_confirmed(
            context.command("tool"), port.number, known=port.tool
        )
        if tool != port.tool and isinstance(tool, int):
            before, after = context.tool_text(port.tool), context.tool_text(tool)
            text = (
                f"Port {port.number}: the tool changed from {before} to {after} during the outage."
            )
            context.note("tool.changed", Severity.WARNING, text, port=port.number, code=tool)
            port.tool, port.tool_is_new = tool, True


def _all_held(context: SessionContext) -> dict[int | None, dict[str, Value]]:
    """Return all last known settings, station first, with the last seen status."""
    held: dict[int | None, dict[str, Value]] = {None: dict(context.held)}
    for port in context.ports.values():
        held[port.number] = dict(port.held) | (
            {} if port.status is None else {"status": port.status}
        )
    return held


def _compare(context: SessionContext, before: dict[int | None, dict[str, Value]]) -> None:
    """Report every changed setting, station first; then stop if the recipe requires it."""
    changes = []
    for number, held in before.items():
        port = None if number is None else context.ports[number]
        now = context.held if port is None else port.held
        for name, value in held.items():
            found = now.get(name)
            if (
                found is not None
                and _is_watched(context, port, name)
                and not _is_alike(context, name, value, found)
            ):
                command = context.command(name)
                changes.append(
                    report_change(context, port, name, command.shown(value), command.shown(found))
                )
        if port is not None:
            note_status(port)
    stop_on(context, changes)


def _is_watched(context: SessionContext, port: PortState | None, name: str) -> bool:
    """Return True if a difference counts: a new tool has its own settings, and the recipe may leave
    the tools' state alone.
    """
    if name == "status" and context.recipe.run.status is None:
        return False
    return not (port is not None and port.tool_is_new and context.command(name).scope is Scope.TOOL)


def _is_alike(context: SessionContext, name: str, before: Value, found: Value) -> bool:
    """Return True if nobody changed the value; a status proceeds from stand to sleep by itself."""
    if name == "status" and isinstance(found, tuple) and isinstance(before, tuple):
        return context.family.status.is_working(found) == context.family.status.is_working(before)
    return found == before
