"""Sample at the ticks of the grid.

A tick reads the fast signals of all ports, then slow ones as time permits. Late ticks are not
caught up: a tick a whole period late becomes a row of `skipped`. Its cause is counted separately:
the computer if it was measurably late, else the station.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Iterator, Sequence
from contextlib import contextmanager

from jbclog.core.errors import LinkError, RobotModeOff, StartRefused, StationError, StationSilent
from jbclog.core.io_requests import RunEnded, Steps, T, Wait, do
from jbclog.protocol.commands.family import NEEDS_A_TOOL
from jbclog.session.run.alarms import AlarmWatch
from jbclog.session.run.context import SessionContext
from jbclog.session.run.lateness import SkippedTickReport, Standstill
from jbclog.session.run.new_tool import meet_tool
from jbclog.session.run.omega_states import report_completions
from jbclog.session.run.port_rows import SKIPPED, PortRow, RowReader
from jbclog.session.run.signal_read import SignalRead
from jbclog.session.run.state import PortState, ReadingCount
from jbclog.session.scheduler import Demand, Grid, ScheduledRead, SlowReadings

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
        self._station = context.station
        self.grid = grid
        self.paced = paced
        state = context.state
        readings = [read for read in readings if read.name not in state.not_supported]
        self.slow = self._slow_readings(readings)
        duration_s = context.order.duration_s
        self.end = None if duration_s is None else context.now + duration_s
        self._standstill = Standstill()
        self._skipped = SkippedTickReport(state.facts, context.log)
        self._ending: RunEnded | None = None
        self._finish_by = math.inf
        self._reader = RowReader(context)
        self._signals: dict[tuple[str, int], SignalRead] = {}
        self._rows: dict[int, PortRow] = {}
        for number, port in state.ports.items():
            alarms = AlarmWatch(context, port)
            signals = [
                SignalRead.of(context, read, alarms) for read in readings if read.port == number
            ]
            self._signals |= {(signal.reading.name, number): signal for signal in signals}
            fast = [signal for signal in signals if signal.reading.period_s is None]
            needs_tool = [signal for signal in signals if signal.reading.name in NEEDS_A_TOOL]
            self._rows[number] = PortRow(port, fast, alarms, needs_tool)
        state.count_readings = self._count_readings

    def _slow_readings(self, readings: list[ScheduledRead]) -> SlowReadings:
        if not self.paced:
            return SlowReadings(readings, self.context.now)
        demand = Demand.of(readings)
        turnaround_s = self.context.state.facts.turnaround_us["median"] / 1e6
        return SlowReadings(
            readings,
            self.context.now,
            longest_s=demand.longest_slow_s(turnaround_s),
            tick_s=self.grid.period_s,
            runs_over=demand.runs_over(1 / self.grid.period_s, turnaround_s),
        )

    def _count_readings(self, port: int) -> ReadingCount:
        """Count the temperature's readings, or those of all signals if there is none, as the
        accounting does. Safe to call from other threads.
        """
        signals = [
            signal
            for (_, number), signal in self._signals.items()
            if number == port and signal.reading.columns
        ]
        main = self._signals.get(("temperature_c", port))
        if main is not None:
            signals = [main]
        due = sum(signal.due for signal in signals)
        missed = sum(sum([*signal.missed.values()]) for signal in signals)
        fast = sum(signal.reading.period_s is None for signal in signals)
        return ReadingCount(due + self.context.state.facts.skipped * fast, due - missed)

    def is_over(self, tick: int) -> bool:
        moment = self.grid.due(tick) if self.paced else self.context.now
        return self.end is not None and moment >= self.end - 1e-9

    async def run(self, tick: int) -> int:
        """Sample from `tick` on; return the tick after the last.

        Raises `StationLost` after writing the rows of its tick, and `StartRefused` if the station
        has nothing to sample.
        """
        state = self.context.state
        standstill = self._standstill
        station = self._station
        standstill.due = max(standstill.due, station.now)
        with self._handed_over_on_failure():
            while not self.is_over(tick):
                due = self.grid.due(tick)
                standstill.spans.clear()
                if standstill.late_s:  # no tick was late for longer than this one is
                    standstill.late_s = min(standstill.late_s, max(station.now - due, 0.0))
                if self.paced:
                    held_until = self._reader.held_until
                    if held_until is not None and held_until < due:
                        await self._await_contradiction()
                    await self._wait(due)
                state.facts.last_tick = tick
                await self.watched(self._tick(tick, due if self.paced else None))
                self._expect_fast_signals()
                report_completions(self.context)
                for port in state.ports.values():
                    if port.tool_is_new:
                        await self._meet_new_tool(port)
                tick = self._following(tick)
                self._skipped.report(self.grid.period_s)
        await self._await_contradiction()
        return tick

    @contextmanager
    def _handed_over_on_failure(self) -> Iterator[None]:
        """Hand over the rows that wait if sampling fails; if the run is ended, act on the last
        answer.
        """
        try:
            yield
        except RunEnded:
            self._reader.act_at_end()
            raise
        except Exception:
            self._reader.hand_over()
            self._reader.raise_failure()
            raise

    def _expect_fast_signals(self) -> None:
        """Raise `StartRefused` if none is left: without pause the loop would never wait."""
        for port_row in self._rows.values():
            if port_row.fast:
                return
        raise StartRefused(
            f"{self.context.name}: it knows none of the signals that are read on every tick"
        )

    async def _wait(self, until: float) -> None:
        wait = Wait(until)
        heard = await do(wait)
        self._standstill.wait_over(wait, heard.now)
        self._station.unasked(heard)

    async def _await_contradiction(self) -> None:
        """Wait until the rows that are held have to be handed over, and do so."""
        until = self._reader.held_until
        if until is not None:
            await self._wait(until)
        self._reader.hand_over()
        self._reader.raise_failure()

    def watched(self, steps: Steps[T]) -> Awaitable[T]:
        """Run `steps` and measure the host's delays."""
        return self._standstill.watch(steps, self._station.now)

    async def _meet_new_tool(self, port: PortState) -> None:
        try:
            await self.watched(meet_tool(self.context, port))
        except (LinkError, StationSilent, RobotModeOff) as error:
            raise StationLost(error) from error

    def _following(self, tick: int) -> int:
        if not self.paced or self._station.now <= self.grid.due(tick + 1):
            return tick + 1
        following = self.grid.next_after(tick, self._station.now)
        if following > tick + 1:
            self._skip(tick + 1, following)
        return following

    def _skip(self, first: int, end: int) -> None:
        """Account for missed ticks: rows of `skipped`, except within a standstill."""
        missed = [tick for tick in range(first, end) if not self.is_over(tick)]
        late = [tick for tick in missed if not self._standstill.covers(self.grid.due(tick))]
        for tick in late:
            self.miss(tick, SKIPPED)
        left_out = [tick for tick in missed if tick not in late]
        self._skipped.leave_out(self.grid, left_out, self._standstill.spans)
        self.context.state.facts.last_tick = first + len(missed) - 1
        by_host = (
            end
            - self.grid.next_after(first - 1, self.context.now - self._standstill.late_s)
            - len(missed)
            + len(late)
        )
        by_host = max(min(by_host, len(late)), 0)
        self._skipped.add(self.grid, late, by_host, self._standstill.late_s)

    async def _tick(self, tick: int, due: float | None) -> None:
        rows = self._rows.values()
        unasked = SKIPPED
        for port_row in rows:
            self._reader.begin(port_row, tick)
        try:
            for port_row in rows:
                await self._read(port_row, port_row.fast)
            if self._ending is None:
                await self._read_slow(tick)
            self._reader.raise_failure()
        except (LinkError, StationSilent, RobotModeOff) as error:
            unasked = error.reason if isinstance(error, RobotModeOff) else LinkError.reason
            self.context.state.connected = self._ending is None
            raise self._ending or StationLost(error) from error
        finally:
            for port_row in rows:
                self._reader.finish(port_row, unasked, due)
        if self._ending is not None:
            raise self._ending

    async def _read(self, port_row: PortRow, signals: Sequence[SignalRead]) -> None:
        """Read signals of one port. If the run is ended meanwhile, finish the fast ones first: half
        a row would count as loss, and a driver ends a run once.
        """
        reader = self._reader
        station = self._station
        if port_row.first_sent is None:
            station.first_sent = None
        try:
            for signal in signals:
                if reader.failure is not None:
                    reader.raise_failure()
                if self._ending is not None and station.now > self._finish_by:
                    raise self._ending
                try:
                    await reader.read(signal, port_row)
                except RunEnded as end:
                    if signal.reading.period_s is not None:
                        raise
                    self._ending = end  # also if a remaining reading fails
                    self._finish_by = self.context.now + FINISH_S
                    await reader.read(signal, port_row)
        finally:
            if port_row.first_sent is None:
                port_row.first_sent = station.first_sent

    async def _read_slow(self, tick: int) -> None:
        """Read slow signals, most urgent first, while there is time; without a grid, or if late,
        one after each port_row.
        """
        following = self.grid.due(tick + 1) if self.paced else math.inf
        while (slow := self.slow.next(self._station.now, following)) is not None:
            port = slow.reading.port
            signal = self._signals[slow.reading.name, port]
            try:
                await self._read(self._rows[port], (signal,))
            finally:
                self.slow.taken(slow, self._station.now, following if self.paced else 0.0)
            if signal.is_lacking:
                self.slow.drop(slow)
            if not self.paced or self._station.now > following:
                return

    async def read_flags_once_more(self) -> None:
        """Read the alarm flags after the last tick, so that none is lost.

        The result is an event, not a row. Call this once the tools are in their safe state.
        """
        for port_row in self._rows.values():
            signal = self._signals.get(("alarm_high", port_row.port.number))
            if signal is None or "alarm_high" in self.context.state.not_supported:
                continue
            try:
                word = await self.context.station.ask(signal.question)
            except (LinkError, StationError) as error:
                port_row.alarms.lost(self.context.now, error.reason)
            else:
                if isinstance(word, tuple):
                    port_row.alarms.read(word, self.context.now)

    def miss(self, tick: int, why: str) -> None:
        """Write the rows of a tick without requests."""
        for port_row in self._rows.values():
            self._reader.begin(port_row, tick)
        for port_row in self._rows.values():
            self._reader.finish(port_row, why, self.grid.due(tick))

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
            for port_row in self._rows.values():
                self._reader.begin(port_row, tick)
            for slow in self.slow.all_due(due):
                signal = self._signals[slow.reading.name, slow.reading.port]
                signal.due += 1
                self._reader.unread(signal, self._rows[slow.reading.port], why)
                self.slow.taken(slow, due, self.grid.due(tick + 1))
            for port_row in self._rows.values():
                self._reader.finish(port_row, why, due)
            self.context.state.facts.last_tick = tick
            tick += 1
        if left_out:
            self.context.state.facts.last_tick = max(
                self.context.state.facts.last_tick or 0, left_out[-1]
            )
            self._skipped.leave_out(self.grid, left_out, self._standstill.spans)
        self._standstill.spans.clear()
        return tick

    def close(self) -> None:
        """Write the rows that still wait, once the tools are in their safe state."""
        self._reader.hand_over()
        self._reader.raise_failure()
        self._reader.report_contradicted()

    def account(self) -> None:
        """Put the numbers of due and obtained readings into the facts."""
        facts = self.context.state.facts
        self._skipped.report(self.grid.period_s, is_over=True)
        facts.worst_slow_periods = round(self.slow.worst_periods, 2)
        for (name, port), signal in self._signals.items():
            due = facts.due.setdefault(str(port), {})
            due[name] = due.get(name, 0) + signal.due  # counters were read before as well
            if not signal.reading.columns and signal.reading.counter is None:
                ok = signal.due - sum(signal.missed.values())
                facts.watched.setdefault(str(port), {})[name] = {
                    "due": signal.due,
                    "ok": ok,
                    **signal.missed,
                }
