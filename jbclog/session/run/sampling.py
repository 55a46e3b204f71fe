"""Sample at the ticks of the grid.

A tick reads the fast signals of all ports, then slow ones as time permits. Late ticks are not
caught up: a tick a whole period late becomes a row of `skipped`. Its cause is counted separately:
the computer if it was measurably late, else the station.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from jbclog.core.errors import LinkError, RobotModeOff, StartRefused, StationError, StationSilent
from jbclog.core.io_requests import Ask, IoResult, Listen, RunEnded, Steps, T, Wait
from jbclog.core.quantities import OFF, text_of
from jbclog.core.rows import SettingOutcome, Severity
from jbclog.protocol.client.dialogue import LEAST_S
from jbclog.protocol.commands.command import Scope
from jbclog.protocol.commands.family import NEEDS_A_TOOL
from jbclog.session.run.alarms import AlarmWatch
from jbclog.session.run.apply import read_tool, readable_settings
from jbclog.session.run.context import PortState, ReadingCount, SessionContext
from jbclog.session.run.lateness import (
    KIND,
    SLOW_KIND,
    WHY_STILL,
    SkippedTicks,
    Standstill,
    sampling_times,
)
from jbclog.session.run.omega_states import report_completions
from jbclog.session.run.safe import put_in_safe_state
from jbclog.session.run.scan import SKIPPED, PortScan, Scanner, SignalRead
from jbclog.session.run.setting import keep_row
from jbclog.session.scheduler import Demand, Grid, ScheduledRead, SlowReadings

# A tool connected or changed during the run: its settings are read, never written. If it would not
# cool down by itself (its sleep delay is off), its port goes to the safe state at once
# (docs/reference/safe-states.md).


def meet_tool(context: SessionContext, port: PortState) -> Steps[None]:
    """Read the settings of the new tool in `port`, and make it safe if necessary. Raises whatever
    prevents reading.
    """
    port.tool_is_new = False
    for command in readable_settings(context, Scope.TOOL):
        port.held.pop(command.name, None)
    if not port.has_tool:
        return
    try:
        yield from read_tool(context, port)
    except StartRefused as error:
        context.note(
            "tool.unknown",
            Severity.WARNING,
            f"The settings of the new tool could not be read: {error}.",
            port=port.number,
        )
        if isinstance(error.__cause__, LinkError | StationSilent | RobotModeOff):
            raise error.__cause__ from error
    _record(context, port)
    if port.touched and _stays_hot(context, port) and not context.recipe.run.allow_no_cooldown:
        yield from _make_safe(context, port)


def _stays_hot(context: SessionContext, port: PortState) -> bool:
    """Return True if the tool would never cool in stand. Hot air needs no delay: its safe states
    have the heater off.
    """
    return "sleep_delay" in context.family.commands and port.held.get("sleep_delay", OFF) is OFF


def _record(context: SessionContext, port: PortState) -> None:
    for command in readable_settings(context, Scope.TOOL):
        if command.name in port.held:
            value = text_of(port.held[command.name])
            keep_row(context, command, port, SettingOutcome.READ, readback=value)


def _make_safe(context: SessionContext, port: PortState) -> Steps[None]:
    """Make the tool safe: its own delay would keep it hot in stand forever, or is unknown."""
    text = (
        f"The sleep delay of the new tool in port {port.number} is off or unknown: the port is put"
        " in its safe state."
    )
    context.note("safety.no_cooldown", Severity.WARNING, text, port=port.number)
    yield from put_in_safe_state(context, port)


FINISH_S = 0.5  # a tick in which the run is ended may take this much longer; hot tools are waiting


class StationLost(Exception):
    """The station is unreachable because of `cause`. `outage` handles it."""

    def __init__(self, cause: LinkError | StationError) -> None:
        super().__init__(str(cause))
        self.cause = cause


class Sampler:
    """Samples one station. On a grid (`paced`) ticks are due times; without pause they are
    scans.
    """

    def __init__(
        self, context: SessionContext, readings: list[ScheduledRead], grid: Grid, *, paced: bool
    ) -> None:
        self.context = context
        self.grid = grid
        self.paced = paced
        readings = [one for one in readings if one.name not in context.not_supported]
        self.slow = self._slow_readings(readings)
        self.end = (
            None if context.order.duration_s is None else context.now + context.order.duration_s
        )
        self._standstill = Standstill()
        self._busy = SkippedTicks()
        self._slow = SkippedTicks()
        context.facts.skipped_by_host = context.facts.skipped_by_host or 0
        self._ending: RunEnded | None = None
        self._finish_by = math.inf
        self._scanner = Scanner(context)
        alarms = {number: AlarmWatch(context, port) for number, port in context.ports.items()}
        self._probes = {
            (one.name, one.port): SignalRead.of(context, one, alarms[one.port]) for one in readings
        }
        context.count_readings = self._count_readings
        self._scans = {
            number: PortScan(port, self._fast_of(number), alarms[number], self._needs_tool(number))
            for number, port in context.ports.items()
        }

    def _count_readings(self, port: int) -> ReadingCount:
        """Count the temperature's readings, or those of all signals if there is none, as the
        accounting does. Safe to call from other threads.
        """
        main = self._probes.get(("temperature_c", port))
        probes = (
            [main]
            if main
            else [
                one
                for (_, number), one in self._probes.items()
                if number == port and one.reading.columns
            ]
        )
        due = sum(one.due for one in probes)
        obtained = due - sum(sum([*one.missed.values()]) for one in probes)
        return ReadingCount(
            due + self.context.facts.skipped * sum(one.reading.period_s is None for one in probes),
            obtained,
        )

    def _slow_readings(self, readings: list[ScheduledRead]) -> SlowReadings:
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

    def _fast_of(self, port: int) -> list[SignalRead]:
        return [
            probe
            for probe in self._probes.values()
            if probe.reading.period_s is None and probe.reading.port == port
        ]

    def _needs_tool(self, port: int) -> list[SignalRead]:
        return [
            probe
            for (name, number), probe in self._probes.items()
            if number == port and name in NEEDS_A_TOOL
        ]

    def is_over(self, tick: int) -> bool:
        moment = self.grid.due(tick) if self.paced else self.context.now
        return self.end is not None and moment >= self.end - 1e-9

    def run(self, tick: int) -> Steps[int]:
        """Sample from `tick` on; return the tick after the last.

        Raises `StationLost` after writing the rows of its tick, and `StartRefused` if the station
        has nothing to sample.
        """
        try:
            tick = yield from self._run(tick)
        except RunEnded:
            self._scanner.act_at_end()
            raise
        except Exception:
            self._scanner.hand_over()
            self._scanner.raise_failure()
            raise
        yield from self._await_contradiction()
        return tick

    def _run(self, tick: int) -> Steps[int]:
        standstill, station = self._standstill, self.context.station
        standstill.due = max(standstill.due, station.now)
        while not self.is_over(tick):
            due = self.grid.due(tick)
            standstill.spans.clear()
            if standstill.late_s:  # no tick was late for longer than this one is
                standstill.late_s = min(standstill.late_s, max(station.now - due, 0.0))
            if self.paced:
                held_until = self._scanner.held_until
                if held_until is not None and held_until < due:
                    yield from self._await_contradiction()
                yield from self._wait(due)
            self.context.facts.last_tick = tick
            yield from self._tick(tick, due if self.paced else None)
            # without pause the loop would never wait
            if not any(scan.fast for scan in self._scans.values()):
                raise StartRefused(
                    f"{self.context.name}: it knows none of the signals that are read on every tick"
                )
            report_completions(self.context)
            for port in self.context.ports.values():
                if port.tool_is_new:
                    yield from self._meet_new_tool(port)
            tick = self._following(tick)
            if self._busy.ticks or self._slow.ticks:
                self._report_skipped()
        return tick

    def _wait(self, until: float) -> Steps[None]:
        wait = Wait(until)
        heard = yield wait
        self._standstill.wait_over(wait, heard.now)
        self.context.station.unasked(heard)

    def _await_contradiction(self) -> Steps[None]:
        """Wait until the rows that are held have to be handed over, and do so."""
        until = self._scanner.held_until
        if until is not None:
            yield from self._wait(until)
        self._scanner.hand_over()
        self._scanner.raise_failure()

    def watched(self, steps: Steps[T]) -> Steps[T]:
        """Run `steps` and measure the host's delays."""
        return self._standstill.watch(steps, self.context.now)

    def _meet_new_tool(self, port: PortState) -> Steps[None]:
        try:
            yield from self.watched(meet_tool(self.context, port))
        except (LinkError, StationSilent, RobotModeOff) as error:
            raise StationLost(error) from error

    def _following(self, tick: int) -> int:
        if not self.paced or self.context.station.now <= self.grid.due(tick + 1):
            return tick + 1
        following = self.grid.next_after(tick, self.context.now)
        if following > tick + 1:
            self._skip(tick + 1, following)
        return following

    def _skip(self, first: int, end: int) -> None:
        """Account for missed ticks: rows of `skipped`, except within a standstill."""
        missed = [tick for tick in range(first, end) if not self.is_over(tick)]
        late = [tick for tick in missed if not self._standstill.covers(self.grid.due(tick))]
        for tick in late:
            self.miss(tick, SKIPPED)
        self._leave_out([tick for tick in missed if tick not in late])
        self.context.facts.last_tick = first + len(missed) - 1
        by_host = (
            end
            - self.grid.next_after(first - 1, self.context.now - self._standstill.late_s)
            - len(missed)
            + len(late)
        )
        self._count_late(late, max(min(by_host, len(late)), 0))

    def _count_late(self, late: Sequence[int], by_host: int) -> None:
        """Count late ticks, the last `by_host` of them as the computer's, each group with its part
        of the delay.
        """
        if not late:
            return
        now, first = self.context.now, self.grid.due(late[0])
        host_s = min(self._standstill.late_s, now - first)
        if by_host:
            facts = self.context.facts
            facts.skipped_by_host = (facts.skipped_by_host or 0) + by_host
            self._busy.add(by_host, self.grid.due(late[-by_host]), host_s, now)
        if len(late) > by_host:
            self._slow.add(len(late) - by_host, first, now - first - host_s, now)

    def _leave_out(self, ticks: Sequence[int]) -> None:
        """Account for the ticks of each standstill, which have no rows, by an event."""
        self.context.facts.skipped += len(ticks)
        for begin, end in self._standstill.spans:
            count = sum(begin < self.grid.due(tick) <= end for tick in ticks)
            text = (
                f"The recorder stood still for {end - begin:.1f} s ({WHY_STILL});"
                f" {sampling_times(count)} {'has' if count == 1 else 'have'} no rows."
            )
            if count:
                self.context.note(
                    "host.suspended", Severity.ERROR, text, since=begin, value=end - begin
                )

    def _report_skipped(self, *, is_over: bool = False) -> None:
        """Report the ticks skipped by the computer and by the station, after a pause in each
        series, or at the end.
        """
        period_s = self.grid.period_s
        if self._busy.is_due(self.context.now) or (is_over and self._busy.ticks):
            busy, self._busy = self._busy, SkippedTicks()
            self._report_late(KIND, busy, busy.text(period_s))
        if self._slow.is_due(self.context.now) or (is_over and self._slow.ticks):
            slow, self._slow = self._slow, SkippedTicks()
            self._report_late(SLOW_KIND, slow, slow.text_of_station(period_s))

    def _report_late(self, kind: str, late: SkippedTicks, text: str) -> None:
        self.context.note(
            kind,
            Severity.WARNING,
            text,
            since=late.since,
            value=late.ticks,
            raw=f"late_s={late.late_s:.3f}",
        )

    def _tick(self, tick: int, due: float | None) -> Steps[None]:
        scans = self._scans.values()
        unasked = SKIPPED
        for scan in scans:
            self._scanner.begin(scan, tick)
        try:
            for scan in scans:
                yield from self._take(scan, scan.fast)
            if self._ending is None:
                yield from self._take_slow(tick)
            self._scanner.raise_failure()
        except (LinkError, StationSilent, RobotModeOff) as error:
            unasked = error.reason if isinstance(error, RobotModeOff) else LinkError.reason
            self.context.connected = self._ending is None
            raise self._ending or StationLost(error) from error
        finally:
            for scan in scans:
                self._scanner.finish(scan, unasked, due)
        if self._ending is not None:
            raise self._ending

    def _take(self, scan: PortScan, probes: Sequence[SignalRead]) -> Steps[None]:
        """Read signals of one port. If the run is ended meanwhile, finish the fast ones first.

        A driver ends a run once, and half a row would count as loss.

        The usual answer, whole or in pieces, takes no generator but this one, which saves a third
        of an exchange's work; `Scanner.settle` handles anything else. Both ways record the same
        (tests/line/test_two_ways.py).
        """
        context, scanner, standstill = self.context, self._scanner, self._standstill
        station = context.station
        for probe in probes:
            if scanner.failure is not None:
                scanner.raise_failure()
            if self._ending is not None and station.now > self._finish_by:
                raise self._ending
            probe.due += 1
            heard: IoResult | BaseException | None = None
            value = None
            asked = station.request(probe.question)
            if asked is not None:
                request: Ask | Listen = asked
                try:
                    if scanner.finished:
                        heard = result = yield from self._ask_holding(asked)
                    else:
                        heard = result = yield asked
                    value = station.value(probe.question, result)
                    now = result.now
                    if result.late_s or now > standstill.due + LEAST_S:  # sooner, nothing is late
                        standstill.note(request, result)
                    standstill.due = now
                    while value is None and (rest := station.rest(probe.question, result)):
                        if scan.first_sent is None:
                            scan.first_sent = result.sent
                        request = rest
                        heard = result = yield request
                        value = station.completed(probe.question, result)
                        if result.late_s or result.now > rest.until:
                            standstill.note(request, result)
                        standstill.due = result.now
                    is_doubtful = (
                        value is None
                        or probe.expect is not None
                        or probe.look.is_due(context, value)
                    )
                except BaseException as error:
                    standstill.fail(request)
                    heard = error
                else:
                    if value is not None and not is_doubtful:
                        if scan.first_sent is None:
                            scan.first_sent = result.sent
                        scanner.keep(probe, scan, value)
                        continue
            try:
                yield from self.watched(scanner.settle(probe, scan, heard, value))
            except RunEnded as end:
                if probe.reading.period_s is not None:
                    raise
                self._ending = end  # also if a remaining reading fails
                self._finish_by = self.context.now + FINISH_S
                yield from self.watched(scanner.take(probe, scan))

    def _ask_holding(self, request: Ask) -> Steps[IoResult]:
        """Send the first request after a tick whose rows are still held; hand them over when their
        time is up, even if no answer has come yet.
        """
        held_until, now = self._scanner.held_until, self.context.now
        if held_until is None or now + request.patience_s <= held_until:
            return (yield request)
        result = yield Ask(request.data, max(held_until - now, 0.0))
        end = result.sent + request.patience_s
        if result.data or result.now >= end:
            return result
        self._scanner.hand_over()
        rest = yield Listen(end)
        return rest._replace(sent=result.sent)

    def _take_slow(self, tick: int) -> Steps[None]:
        """Read slow signals, most urgent first, while there is time; without a grid, or if late,
        one after each scan.
        """
        following = self.grid.due(tick + 1) if self.paced else math.inf
        while (slow := self.slow.next(self.context.station.now, following)) is not None:
            probe, scan = (
                self._probes[slow.reading.name, slow.reading.port],
                self._scans[slow.reading.port],
            )
            try:
                yield from self._take(scan, (probe,))
            finally:
                self.slow.taken(slow, self.context.now, following if self.paced else 0.0)
            if probe.is_lacking:
                self.slow.drop(slow)
            if not self.paced or self.context.now > following:
                return

    def read_flags_once_more(self) -> Steps[None]:
        """Read the alarm flags after the last tick, so that none is lost.

        The result is an event, not a row. Call this once the tools are in their safe state.
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

    def miss(self, tick: int, why: str) -> None:
        """Write the rows of a tick without requests."""
        for scan in self._scans.values():
            self._scanner.begin(scan, tick)
        for scan in self._scans.values():
            self._scanner.finish(scan, why, self.grid.due(tick))

    def begin_outage(self, tick: int) -> None:
        """Register `tick` as the last before an outage. Without a grid the outage's ticks follow at
        the pace of the scans.
        """
        if not self.paced:
            self.grid = Grid(self.context.now - tick * self.grid.period_s, self.grid.period_s)

    def miss_until(self, tick: int, now: float, why: str) -> int:
        """Write the rows of every tick due by `now`, slow readings included; return the first tick
        after them.

        Ticks within a standstill have none.
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

    def close(self) -> None:
        """Write the rows that still wait, once the tools are in their safe state."""
        self._scanner.hand_over()
        self._scanner.raise_failure()
        self._scanner.report_contradicted()

    def account(self) -> None:
        """Put the numbers of due and obtained readings into the facts."""
        facts = self.context.facts
        self._report_skipped(is_over=True)
        facts.worst_slow_periods = round(self.slow.worst_periods, 2)
        for (name, port), probe in self._probes.items():
            due = facts.due.setdefault(str(port), {})
            due[name] = due.get(name, 0) + probe.due  # counters were read before as well
            if not probe.reading.columns and probe.reading.counter is None:
                ok = probe.due - sum(probe.missed.values())
                facts.watched.setdefault(str(port), {})[name] = {
                    "due": probe.due,
                    "ok": ok,
                    **probe.missed,
                }
