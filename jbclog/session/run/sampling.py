"""Chapter 3: the grid: tick after tick, at the due time or not at all.

A tick reads the fast signals of all ports, then as many slow ones as the wire has room for. A late tick is not made up
by a burst: what is a whole period late is a row of `skipped`. Who made it late is counted apart: only what the computer was seen
to be late by is the computer's, and nothing that a station took, however long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from jbclog.core.errors import LinkError, RobotModeOff, StartRefused, StationError, StationSilent
from jbclog.core.io_requests import RunEnded, Steps, T, Wait
from jbclog.core.rows import Severity
from jbclog.session.run.alarms import AlarmWatch
from jbclog.session.run.busy import KIND, SLOW_KIND, Busy
from jbclog.session.run.context import SessionContext
from jbclog.session.run.new_tool import meet_tool
from jbclog.session.run.omega_states import tell_late
from jbclog.session.run.scan import SKIPPED, Probe, Scan, Scanner
from jbclog.session.run.standstill import Standstill
from jbclog.session.scheduler import Demand, Grid, Reading, SlowReadings

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
