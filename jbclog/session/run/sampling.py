"""Chapter 3 of a station's run: samples at the ticks of the grid.

A tick reads the fast signals of all ports, then as many slow ones as the wire has room for. A late tick is not made up
by a burst: what is a whole period late is a row of `skipped`. Who made it late is counted apart: only what the computer was seen
to be late by is the computer's, and nothing that a station took, however long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Final, NamedTuple

from jbclog.core.errors import LinkError, RobotModeOff, StartRefused, StationError, StationSilent
from jbclog.core.io_requests import Ask, IoResult, Listen, Request, RunEnded, Steps, T, Wait, relay
from jbclog.core.quantities import OFF, text_of
from jbclog.core.rows import SettingRow, Severity
from jbclog.protocol.commands.command import Scope
from jbclog.session.run.alarms import AlarmWatch
from jbclog.session.run.apply import read_tool, readable_settings
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.run.safe import put_in_safe_state
from jbclog.session.run.scan import SKIPPED, Probe, Scan, Scanner
from jbclog.session.run.watch import tell_late
from jbclog.session.scheduler import Demand, Grid, Reading, SlowReadings

# -- new tool -----------------------------------------------------------------------------------------------------------------
# A tool that was connected or changed during the run: its settings are read, never written.
#
# If it would not cool down by itself (its sleep delay is off), its port goes to the safe state at once
# (docs/reference/safe-states.md).


def meet_tool(context: SessionContext, port: PortState) -> Steps[None]:
    """Learn what the new tool in `port` holds, and make it safe if it must be. Raises what ends the asking."""
    port.tool_is_new = False
    for command in readable_settings(context, Scope.TOOL):
        port.held.pop(command.name, None)
    if not port.has_tool:
        return
    try:
        yield from read_tool(context, port)
    except StartRefused as error:
        context.note(
            "tool.unknown", Severity.WARNING, f"The settings of the new tool could not be read: {error}.", port=port.number
        )
        if isinstance(error.__cause__, LinkError | StationSilent | RobotModeOff):
            raise error.__cause__ from error
    _record(context, port)
    if port.touched and _stays_hot(context, port) and not context.recipe.run.allow_no_cooldown:
        yield from _make_safe(context, port)


def _stays_hot(context: SessionContext, port: PortState) -> bool:
    """Whether it would never cool in stand. Hot air needs no delay for that: its safe states have the heater off."""
    return "sleep_delay" in context.family.commands and port.held.get("sleep_delay", OFF) is OFF


def _record(context: SessionContext, port: PortState) -> None:
    time, tool = context.utc.micros(context.now), context.tool_text(port.tool)
    for command in readable_settings(context, Scope.TOOL):
        if command.name in port.held:
            value = text_of(port.held[command.name])
            row = SettingRow(time, context.name, port.number, tool, command.name, command.unit, None, None, value, None, "read")
            context.journal.setting(row)


def _make_safe(context: SessionContext, port: PortState) -> Steps[None]:
    """The tool's own delay would keep it hot in stand for ever, or is not known: do not leave it at work."""
    text = f"The sleep delay of the new tool in port {port.number} is off or unknown: the port is put in its safe state."
    context.note("safety.no_cooldown", Severity.WARNING, text, port=port.number)
    yield from put_in_safe_state(context, port)


# -- busy ---------------------------------------------------------------------------------------------------------------------
# Ticks that the computer, or a slow station, came too late for, told together: how many, in how many places, and how late.
#
# A busy hour must not become thousands of events, and nobody is to wait long for the first: one is told once nothing more was
# skipped for `QUIET_S`, and every `LONGEST_S` where it goes on.

KIND: Final = "host.busy"
SLOW_KIND: Final = "station.slow"
QUIET_S: Final = 10.0
LONGEST_S: Final = 300.0


@dataclass(slots=True)
class Busy:
    """What has not been told yet. Times are monotonic seconds; `since` is when the first of the ticks was due."""

    ticks: int = 0
    places: int = 0
    late_s: float = 0.0
    since: float = 0.0
    last: float = 0.0

    def add(self, ticks: int, due: float, now: float) -> None:
        """`ticks` from the one that was due at `due` on were not run; it is `now`."""
        if not self.ticks:
            self.since = due
        self.ticks += ticks
        self.places += 1
        self.late_s = max(self.late_s, now - due)
        self.last = now

    def is_to_be_told(self, now: float) -> bool:
        return self.ticks > 0 and (now - self.last >= QUIET_S or now - self.since >= LONGEST_S)

    def text(self, period_s: float) -> str:
        return f"The computer was busy: {self._what(period_s)}; less work beside the run helps."

    def text_of_station(self, period_s: float, name: str) -> str:
        return f"{name} was slow to answer, or did not: {self._what(period_s)}; a lower rate leaves more time."

    def _what(self, period_s: float) -> str:
        ticks = f"{self.ticks} tick{'' if self.ticks == 1 else 's'} of {period_s:g} s"
        places = "" if self.places == 1 else f" in {self.places} places"
        return f"{ticks} not run{places}, {self.late_s:.2f} s late at most"


# -- standstill ---------------------------------------------------------------------------------------------------------------
# Whether the host stood still: time that passed although nothing was asked and nothing waited for.
#
# A station that babbles or hangs makes a tick late, and so does a host that was suspended; only the second is an event of
# its own (docs/reference/tables.md). What tells them apart is the wish: it says until when it may last.

SUSPENDED_S = 5.0  # a standstill of the host that is an event; its ticks have no rows. A busy host may be late by less


class Span(NamedTuple):
    """From the moment by which a wish ought to have come back to the one at which it did, monotonic seconds."""

    begin: float
    end: float

    @property
    def seconds(self) -> float:
        return self.end - self.begin


@dataclass(slots=True)
class Standstill:
    """When the host stood still, since `spans` was last emptied, and by how much all wishes together came back too late.

    What is waited for is no standstill, whoever waits and however long: it begins where the wish that is out should have ended.
    """

    spans: list[Span] = field(default_factory=list)
    late_s: float = 0.0
    _due: float = -inf  # the last moment at which it is known that the host went on, or need not have

    def watch(self, steps: Steps[T], now: float) -> Steps[T]:
        """Do `steps` as they are, from `now` on, and note by how much their wishes came back too late."""
        self._due = max(self._due, now)

        def timed(wish: Request) -> Steps[IoResult]:
            try:
                heard = yield wish
            except Exception:  # nobody says when: what it may have taken is not the host's
                self._due = _latest(wish, self._due)
                raise
            self._note(Span(min(_latest(wish, self._due), _held_up(wish, heard)), heard.now))
            self._due = heard.now
            return heard

        return relay(steps, timed)

    def _note(self, late: Span) -> None:
        self.late_s += max(late.seconds, 0.0)
        if late.seconds > SUSPENDED_S:
            self.spans.append(late)

    def covers(self, moment: float) -> bool:
        """Whether the host stood still at `moment`."""
        return any(span.begin < moment <= span.end for span in self.spans)


def _latest(wish: Request, now: float) -> float:
    """The moment by which `wish` ought to have come back. Nobody can say how long opening a port may take, or the others."""
    match wish:
        case Ask():
            return now + wish.patience_s
        case Listen() | Wait():
            return max(now, wish.until)
        case _:
            return inf


def _held_up(wish: Request, heard: IoResult) -> float:
    """Since when an answer may have been there, unheard. In any other wish the driver being late matters at its end only."""
    return heard.now - heard.late_s if isinstance(wish, Ask | Listen) and heard.data else inf


# -- sampling -----------------------------------------------------------------------------------------------------------------

FINISH_S = 0.5  # a tick in which the run is ended may take so much longer; hot tools are waiting


class Lost(Exception):
    """The station cannot be asked any more; `cause` says why. Only `outage` takes it."""

    def __init__(self, cause: LinkError | StationError) -> None:
        super().__init__(str(cause))
        self.cause = cause


class Sampler:
    """Samples one station. On a grid (`paced`) ticks are due times; without pause they count scans."""

    def __init__(self, context: SessionContext, readings: list[Reading], grid: Grid, *, paced: bool) -> None:
        self.context = context
        self.grid = grid
        self.paced = paced
        readings = [one for one in readings if one.name not in context.not_supported]
        self.slow = self._slow_readings(readings)
        self.end = None if context.order.duration_s is None else context.now + context.order.duration_s
        self._standstill = Standstill()
        self._busy = Busy()
        self._slow = Busy()
        self._late_s = 0.0  # by which it is behind because the computer was late
        context.facts.skipped_by_host = context.facts.skipped_by_host or 0
        self._ending: RunEnded | None = None
        self._finish_by = math.inf
        self._scanner = Scanner(context)
        self._probes = {(one.name, one.port): Probe.of(context, one) for one in readings}
        self._scans = {
            port.number: Scan(port, self._fast_of(port.number), AlarmWatch(context, port)) for port in context.ports.values()
        }

    def _slow_readings(self, readings: list[Reading]) -> SlowReadings:
        if not self.paced:
            return SlowReadings(readings, self.context.now)
        demand, turnaround_s = Demand.of(readings), self.context.facts.turnaround_us["median"] / 1e6
        return SlowReadings(
            readings,
            self.context.now,
            longest_s=demand.longest_slow_s(turnaround_s),
            tick_s=self.grid.period_s,
            runs_over=demand.runs_over(1 / self.grid.period_s, turnaround_s),
        )

    def _fast_of(self, port: int) -> list[Probe]:
        return [probe for probe in self._probes.values() if probe.reading.period_s is None and probe.reading.port == port]

    # -- the loop ----------------------------------------------------------------------------------------------------

    def is_over(self, tick: int) -> bool:
        """Whether the run's duration ends before `tick`."""
        moment = self.grid.due(tick) if self.paced else self.context.now
        return self.end is not None and moment >= self.end - 1e-9

    def run(self, tick: int) -> Steps[int]:
        """Sample from `tick` on; give the tick after the last.

        Raises `Lost` once the rows of its tick are written, and `StartRefused` where the station has nothing to sample.
        """
        while not self.is_over(tick):
            self._standstill.spans.clear()
            self._late_s = min(self._late_s, max(self.context.now - self.grid.due(tick), 0.0))
            yield from self.watched(self._await(tick))
            if not any(scan.fast for scan in self._scans.values()):  # a run without pause would spin on nothing
                raise StartRefused(f"{self.context.name}: it knows none of the signals that are read on every tick")
            tell_late(self.context)
            yield from self.watched(self._meet_new_tools())
            tick = self._following(tick)
            self._tell_skipped()
        return tick

    def watched(self, steps: Steps[T]) -> Steps[T]:
        """`steps`, with what the host is late in them noted."""
        self._standstill.late_s = 0.0
        try:
            return (yield from self._standstill.watch(steps, self.context.now))
        finally:
            self._late_s += self._standstill.late_s

    def _await(self, tick: int) -> Steps[None]:
        if self.paced:
            self.context.station.unasked((yield Wait(self.grid.due(tick))))
        self.context.facts.last_tick = tick
        yield from self._tick(tick)

    def _meet_new_tools(self) -> Steps[None]:
        for port in self.context.ports.values():
            if port.tool_is_new:
                try:
                    yield from meet_tool(self.context, port)
                except (LinkError, StationSilent, RobotModeOff) as error:
                    raise Lost(error) from error

    def _following(self, tick: int) -> int:
        if not self.paced:
            return tick + 1
        following = self.grid.next_after(tick, self.context.now)
        if following > tick + 1:
            self._skip(tick + 1, following)
        return following

    def _skip(self, first: int, end: int) -> None:
        """Account for ticks that nobody could run: rows of `skipped`, and none of those in which the host stood still."""
        missed = [tick for tick in range(first, end) if not self.is_over(tick)]
        late = [tick for tick in missed if not self._standstill.covers(self.grid.due(tick))]
        for tick in late:
            self.miss(tick, SKIPPED)
        self._leave_out([tick for tick in missed if tick not in late])
        self.context.facts.last_tick = first + len(missed) - 1
        by_host = end - self.grid.next_after(first - 1, self.context.now - self._late_s) - len(missed) + len(late)
        by_host = max(min(by_host, len(late)), 0)
        self._count_busy(late[0] if late else first, by_host)
        if len(late) > by_host:
            self._slow.add(len(late) - by_host, self.grid.due(late[0]), self.context.now)

    def _leave_out(self, ticks: Sequence[int]) -> None:
        """Account for the ticks in which the host stood still, so that nobody knows what they were: an event for each time."""
        self.context.facts.skipped += len(ticks)
        for begin, end in self._standstill.spans:
            count = sum(begin < self.grid.due(tick) <= end for tick in ticks)
            text = f"The recorder stood still for {end - begin:.1f} s (suspended or stopped host); {count} ticks have no rows."
            if count:
                self.context.note("host.suspended", Severity.ERROR, text, since=begin, value=end - begin)

    def _count_busy(self, first: int, ticks: int) -> None:
        if ticks > 0:
            self.context.facts.skipped_by_host = (self.context.facts.skipped_by_host or 0) + ticks
            self._busy.add(ticks, self.grid.due(first), self.context.now)

    def _tell_skipped(self, *, is_over: bool = False) -> None:
        """Tell what the computer and what the station made it skip, each once it is quiet again, or at the end."""
        period_s = self.grid.period_s
        if self._busy.is_to_be_told(self.context.now) or (is_over and self._busy.ticks):
            busy, self._busy = self._busy, Busy()
            self._tell_late(KIND, busy, busy.text(period_s))
        if self._slow.is_to_be_told(self.context.now) or (is_over and self._slow.ticks):
            slow, self._slow = self._slow, Busy()
            self._tell_late(SLOW_KIND, slow, slow.text_of_station(period_s, self.context.name))

    def _tell_late(self, kind: str, late: Busy, text: str) -> None:
        self.context.note(kind, Severity.WARNING, text, since=late.since, value=late.ticks, raw=f"late_s={late.late_s:.3f}")

    # -- one tick -----------------------------------------------------------------------------------------------------

    def _tick(self, tick: int) -> Steps[None]:
        due = self.grid.due(tick) if self.paced else None
        scans = self._scans.values()
        unasked = SKIPPED
        for scan in scans:
            self._scanner.begin(scan, tick)
        try:
            for scan in scans:
                yield from self._take_fast(scan)
            if self._ending is None:
                yield from self._take_slow(tick)
        except (LinkError, StationSilent, RobotModeOff) as error:
            unasked = error.reason if isinstance(error, RobotModeOff) else LinkError.reason
            self.context.connected = self._ending is None
            raise self._ending or Lost(error) from error
        finally:
            for scan in scans:
                self._scanner.finish(scan, unasked, due)
        if self._ending is not None:
            raise self._ending

    def _take_fast(self, scan: Scan) -> Steps[None]:
        """The fast readings of one port. Where the run is ended in between, they are finished first.

        A driver ends a run once. A row half read helps nobody, and would count as loss what nobody lost.
        """
        for probe in scan.fast:
            if self._ending is not None and self.context.now > self._finish_by:
                raise self._ending
            try:
                yield from self._scanner.take(probe, scan)
            except RunEnded as end:
                self._ending = end  # and kept, whatever becomes of the readings that are left
                self._finish_by = self.context.now + FINISH_S
                yield from self._scanner.take(probe, scan)

    def _take_slow(self, tick: int) -> Steps[None]:
        """Slow readings, most urgent first, while the wire has room; without a grid, or behind it, one after each scan."""
        following = self.grid.due(tick + 1) if self.paced else math.inf
        while (slow := self.slow.next(self.context.now, following)) is not None:
            probe, scan = self._probes[slow.reading.name, slow.reading.port], self._scans[slow.reading.port]
            try:
                yield from self._scanner.take(probe, scan)
            finally:
                self.slow.taken(slow, self.context.now, following if self.paced else 0.0)
            if probe.is_lacking:
                self.slow.drop(slow)
            if not self.paced or self.context.now > following:
                return

    def read_flags_once_more(self) -> Steps[None]:
        """Read the alarm flags after the last tick: what was raised since they were last read is told, not lost.

        No row holds it; what they say is an event. Called once the tools are in their safe state.
        """
        for scan in self._scans.values():
            probe = self._probes.get(("alarm_high", scan.port.number))
            if probe is None or "alarm_high" in self.context.not_supported:
                continue
            try:
                word = yield from self.context.station.ask(probe.question)
            except (LinkError, StationError) as error:
                scan.alarms.lost(self.context.now, error.reason)
            else:
                if isinstance(word, tuple):
                    scan.alarms.read(word, self.context.now)

    # -- ticks that cannot be asked --------------------------------------------------------------------------------------

    def miss(self, tick: int, why: str) -> None:
        """Write the rows of a tick at which nothing was asked."""
        for scan in self._scans.values():
            self._scanner.begin(scan, tick)
        for scan in self._scans.values():
            self._scanner.finish(scan, why, self.grid.due(tick))

    def begin_outage(self, tick: int) -> None:
        """`tick` was the last that could be asked. Without a grid the ticks of an outage follow it as scans would have."""
        if not self.paced:
            self.grid = Grid(self.context.now - tick * self.grid.period_s, self.grid.period_s)

    def miss_until(self, tick: int, now: float, why: str) -> int:
        """Write the rows of every tick due by `now`, slow readings included; give the first tick after them.

        Those in which the host stood still have none.
        """
        left_out = []
        while self.grid.due(tick) <= now and not self.is_over(tick):
            due = self.grid.due(tick)
            if self.paced and self._standstill.covers(due):
                left_out.append(tick)
                tick += 1
                continue
            for scan in self._scans.values():
                self._scanner.begin(scan, tick)
            for slow in self.slow.all_due(due):
                probe = self._probes[slow.reading.name, slow.reading.port]
                probe.due += 1
                self._scanner.unread(probe, self._scans[slow.reading.port], why)
                self.slow.taken(slow, due, self.grid.due(tick + 1))
            for scan in self._scans.values():
                self._scanner.finish(scan, why, due)
            self.context.facts.last_tick = tick
            tick += 1
        if left_out:
            self.context.facts.last_tick = max(self.context.facts.last_tick or 0, left_out[-1])
            self._leave_out(left_out)
        self._standstill.spans.clear()
        return tick

    # -- the account -----------------------------------------------------------------------------------------------------

    def account(self) -> None:
        """Put what was due, and what was got of it, into the facts."""
        facts = self.context.facts
        self._tell_skipped(is_over=True)
        facts.worst_slow_periods = round(self.slow.worst_periods, 2)
        for (name, port), probe in self._probes.items():
            due = facts.due.setdefault(str(port), {})
            due[name] = due.get(name, 0) + probe.due  # counters have been read before, too
            if not probe.reading.columns and probe.reading.counter is None:
                ok = probe.due - sum(probe.missed.values())
                facts.watched.setdefault(str(port), {})[name] = {"due": probe.due, "ok": ok, **probe.missed}
