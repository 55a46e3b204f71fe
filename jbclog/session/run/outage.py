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
from jbclog.core.io_requests import wait
from jbclog.core.quantities import Value
from jbclog.core.rows import Severity
from jbclog.protocol.commands.command import Scope
from jbclog.session.run.apply import note_status, read_all
from jbclog.session.run.context import SessionContext
from jbclog.session.run.identify import connect
from jbclog.session.run.identity import recognise
from jbclog.session.run.link_loss import report_flood, report_loss
from jbclog.session.run.reconnection import FIRST_SEEK_S
from jbclog.session.run.sampling import Sampler, StationLost
from jbclog.session.run.state import PortState, StationState
from jbclog.session.run.watch import report_change, stop_on

# after the run's end, before a station counts as gone: its tools must be made safe anyway
SEEK_AT_END_S = 3.0


class StationGone(Exception):
    """The run ended during an outage, and the station did not come back right after."""


class Outage:
    """An outage that began with the error `lost`, and the way back."""

    def __init__(self, context: SessionContext, sampler: Sampler, lost: StationLost) -> None:
        self._context = context
        self._sampler = sampler
        self._lost = lost
        self._why = LinkError.reason  # of missed readings
        if isinstance(lost.cause, RobotModeOff):
            self._why = lost.cause.reason
        self._last_heard = min(context.station.heard, context.now)
        self._held_before = _all_held(context.state)

    async def bridge(self, tick: int) -> int:
        """Bridge the outage from `tick`, in which it began; return the tick at which sampling
        resumes.

        Raises `StationGone` if the run ends first and the station does not come back soon, and
        `SettingChanged` if the recipe stops on a difference.
        """
        context, cause = self._context, self._lost.cause
        report_loss(context, cause)
        context.state.is_proven &= not isinstance(cause, LinkError)
        if isinstance(cause, OtherStation):
            context.state.identity_at.clear()
        self._sampler.begin_outage(tick)
        return await self._sampler.watched(self._bridge(tick + 1))

    async def _bridge(self, tick: int) -> int:
        context, sampler = self._context, self._sampler
        reconnection = context.state.reconnection
        is_link_lost = self._why == LinkError.reason
        pause_s = reconnection.first_pause_s()
        seek_at = context.now + pause_s
        while not sampler.is_over(tick):
            context.station.unasked(await wait(min(sampler.grid.due(tick), seek_at)))
            tick = sampler.miss_until(tick, context.now, self._why)
            if context.now < seek_at:
                continue
            is_back = await _seek(context, reopen=is_link_lost or reconnection.is_flooded)
            tick = sampler.miss_until(tick, context.now, self._why)
            if is_back:
                self._resume()
                return tick
            pause_s = reconnection.next_pause_s(pause_s)
            seek_at = context.now + pause_s
        over = context.now
        if not await seek_at_end(context, reopen=is_link_lost):
            raise StationGone(f"{context.name}: {self._why_gone(context.now - over)}")
        self._resume()
        return tick

    def _why_gone(self, waited_s: float) -> str:
        state = self._context.state
        if state.mix_up is not None:
            return state.mix_up
        if state.stranger is not None:
            return (
                f"another station answers on {self._context.order.url}, {state.stranger} of this"
                " run; compare with the label on the station, and correct the cable"
            )
        silent_s = self._context.now - self._last_heard
        return (
            f"not reachable for the last {silent_s:.1f} s; waited {waited_s:.0f} s after the end of"
            f" the run ({self._lost})"
        )

    def _resume(self) -> None:
        """Report that the station is back, with its changes."""
        self._report_return()
        self._compare()

    def _report_return(self) -> None:
        """Report how long nothing could be read: from the last answer before until now, when it may
        be sampled again. Each port's gap has the same ends, to within a scan.
        """
        context, state = self._context, self._context.state
        state.connected = True
        state.reconnection.end_flood(context.now)
        away_s = context.now - self._last_heard
        kind = "link.back" if self._why == LinkError.reason else "robot.on"
        if state.family.models:
            compared = state.identity().compared()
            known = f"{compared} as before; its settings have been read again"
        else:
            known = "whether it is the same one cannot be told, because it does not say who it is"
        text = f"The station is back after {away_s:.1f} s; {known}."
        since = self._last_heard
        context.log.note(kind, Severity.INFO, text, since=since, value=round(away_s, 3))
        if state.alike:
            others = ", ".join(state.alike)
            doubt = (
                f"Nothing that the station says tells it from {others}: it may be one of these, if"
                " cables were exchanged meanwhile. Compare with the label on the station."
            )
            context.log.note("identity.not_known", Severity.WARNING, doubt, since=since)
        context.publish()

    def _compare(self) -> None:
        """Report every changed setting, station first; then stop if the recipe requires it."""
        context, state = self._context, self._context.state
        changes = []
        for number, before in self._held_before.items():
            port = None if number is None else state.ports[number]
            now = state.held if port is None else port.held
            for name, value in before.items():
                found = now.get(name)
                if found is None or not self._is_watched(port, name):
                    continue
                if not self._is_alike(name, value, found):
                    command = context.command(name)
                    change = command.shown(value), command.shown(found)
                    changes.append(report_change(context, port, name, *change))
            if port is not None:
                note_status(port)
        stop_on(context, changes)

    def _is_watched(self, port: PortState | None, name: str) -> bool:
        """Return True if a difference counts: a new tool has its own settings, and the recipe may
        leave the tools' state alone.
        """
        if name == "status" and self._context.order.recipe.run.status is None:
            return False
        if port is None or not port.tool_is_new:
            return True
        return self._context.command(name).scope is not Scope.TOOL

    def _is_alike(self, name: str, before: Value, found: Value) -> bool:
        """Return True if nobody changed the value; a status proceeds from stand to sleep by
        itself.
        """
        if name == "status" and isinstance(found, tuple) and isinstance(before, tuple):
            status = self._context.state.family.status
            return status.is_working(found) == status.is_working(before)
        return found == before


async def seek_at_end(context: SessionContext, *, reopen: bool) -> bool:
    """Try to reconnect for `SEEK_AT_END_S`, the last chance of a station that is late at the run's
    end; return True if it is there.

    Tries a flooded link once.
    """
    end = context.now + SEEK_AT_END_S
    while context.now < end:
        context.station.unasked(await wait(min(context.now + FIRST_SEEK_S, end)))
        if await _seek(context, reopen=reopen):
            return True
        if context.state.reconnection.is_flooded:
            break
    return False


async def _seek(context: SessionContext, *, reopen: bool) -> bool:
    """Try once to reconnect and to read the settings; return True if the station may be sampled
    again.
    """
    try:
        found = await connect(context, reopen=reopen, tries=1)
        if not await recognise(context, found):
            return False
        await _read_tools(context)
        await read_all(context)
    except LinkFlooded as flood:
        report_flood(context, flood)
        return False
    except (LinkError, StartRefused, StationError):
        return False
    return True


async def _read_tools(context: SessionContext) -> None:
    state = context.state
    for port in state.ports.values() if state.family.tools else ():
        tool = await context.reads.confirmed(context.command("tool"), port.number, known=port.tool)
        if tool != port.tool and isinstance(tool, int):
            before, after = state.tool_text(port.tool), state.tool_text(tool)
            text = (
                f"Port {port.number}: the tool changed from {before} to {after} during the outage."
            )
            context.log.note("tool.changed", Severity.WARNING, text, port=port.number, code=tool)
            port.tool, port.tool_is_new = tool, True


def _all_held(state: StationState) -> dict[int | None, dict[str, Value]]:
    """Return all last known settings by port, station (None) first, with the last seen status."""
    held: dict[int | None, dict[str, Value]] = {None: dict(state.held)}
    for port in state.ports.values():
        held[port.number] = dict(port.held)
        if port.status is not None:
            held[port.number]["status"] = port.status
    return held
