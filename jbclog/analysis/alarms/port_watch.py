"""Alarm states of one port, row by row. The recorder and the analysis of a record both feed it.

Only rows in which temperature and status were read say anything; any other is a gap. Time is that of the grid, tick × period;
without a grid (``--rate max``) it is UTC. Two readings follow each other where at most `GAP_PERIODS` periods lie between them
(`GAP_S` without a grid); longer is a gap, which delays do not count.

A setting found changed at a moment holds for the rows behind it: in a record, where rows and events stand in different
tables, that is the order in which they came.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import inf
from typing import Final, NamedTuple

from jbclog.analysis.alarms.state_machine import (
    NOT_WORKING,
    RETURNED,
    SETPOINTS,
    SWITCHED_OFF,
    TOOL_CHANGED,
    WORKING,
    Arrival,
    Condition,
    Detector,
    Machine,
    News,
    Phase,
    Rules,
    Side,
    Told,
    bare,
    defined,
    number,
)

GAP_PERIODS: Final = 2.0
GAP_S: Final = 2.0
TOOL: Final = "tool"
BEFORE_ALL: Final = 0
"""The moment of what held when sampling began."""


class Change(NamedTuple):
    """At `at_us` a setting was found to be `text` (as in `settings`), or the tool was changed (`name` is `TOOL`)."""

    at_us: int
    name: str
    text: str | None = None


class PortWatch:
    """The alarms of one port by one detector or more. `period_s` is None where there is no grid."""

    def __init__(self, station: str, port: int, period_s: float | None, rules: Rules, detectors: Sequence[Detector]) -> None:
        self._stepped_us = 0
        self._period_s = period_s
        self._gap_s = GAP_S if period_s is None else GAP_PERIODS * period_s * (1 + 1e-9)
        self._rules = rules
        self._changes: deque[Change] = deque()
        self._held: dict[str, float | None] = {}
        self._machines = [Machine(station, port, side, detector) for detector in detectors for side in Side]
        self._arrival = Arrival()
        self._setting: float | None = None
        self._tool_changed = False  # and has not come to its setting since
        self._tick, self._us = 0, 0  # of the last reading
        self._has_read = False
        self._stands = False
        self._low, self._high = inf, -inf  # within these nothing can happen

    def change(self, change: Change) -> None:
        """Something else was learnt than a row; in their order. Times are less what the wall clock was stepped before."""
        self._changes.append(change)

    def step(self, size_us: int) -> None:
        """The wall clock was stepped; the rows that follow are by the new one."""
        self._stepped_us += size_us
        self._us += size_us
        for machine in self._machines:
            machine.step_clock(size_us)

    def row(self, time_us: int, tick: int, temperature: float | None, status: str | None, set_c: float | None) -> Sequence[Told]:
        """The next row of this port; what is new."""
        if self._changes:
            self._apply(time_us - self._stepped_us)
        if set_c is not None:
            self._setting = set_c
        if temperature is None or status is None:
            return self._miss(tick, time_us) if self._stands else ()
        if self._low <= temperature <= self._high and status in WORKING:
            self._tick, self._us, self._arrival.before_c = tick, time_us, temperature
            return ()
        return self._closely(time_us, tick, temperature, works=status in WORKING)

    # -- settings -----------------------------------------------------------------------------------------------------------

    def _apply(self, before_us: int) -> None:
        """Let what was found before a row's time hold."""
        while self._changes and self._changes[0].at_us < before_us:
            change = self._changes.popleft()
            if change.name == TOOL:
                self._arrival.forget()
                self._tool_changed = True
            elif change.name in SETPOINTS:
                self._setting = number(change.text)
            else:
                self._held[change.name] = number(change.text)
            self._low, self._high = inf, -inf
        self._define()

    def _define(self) -> None:
        for machine in self._machines:
            definition = defined(machine.side, self._held, self._rules)
            machine.definition = bare(definition) if machine.detector is Detector.AFTERWARDS else definition

    # -- rows ---------------------------------------------------------------------------------------------------------------

    def _seconds(self, tick: int, time_us: int) -> float:
        return tick * self._period_s if self._period_s is not None else (time_us - self._stepped_us) / 1e6

    def _since_last_s(self, tick: int, time_us: int) -> float:
        """Seconds since the last reading; infinite where there is none."""
        if not self._has_read:
            return inf
        if self._period_s is not None:
            return (tick - self._tick) * self._period_s
        return (time_us - self._us) / 1e6

    def _miss(self, tick: int, time_us: int) -> list[Told]:
        """Note a missing reading; after a while it is not known whether an alarm is still active."""
        if self._since_last_s(tick, time_us) < self._rules.stale_s:
            return []
        return list(self._lose())

    def _lose(self) -> list[Told]:
        told: list[Told] = []
        for machine in self._machines:
            episode = machine.episode
            if machine.stands and episode is not None and not episode.is_lost:
                episode.is_lost = episode.is_uncertain = True
                told.append((News.UNCERTAIN, episode))
        return told

    def _closely(self, time_us: int, tick: int, value: float, *, works: bool) -> list[Told]:
        since_s = self._since_last_s(tick, time_us)
        told = self._lose() if self._stands and since_s >= self._rules.stale_s else []
        self._arrival.see(self._seconds(tick, time_us), value, self._setting, works=works)
        counts = works and self._arrival.has_come
        told += self._step_all(value, since_s, time_us, counts=counts)
        self._tick, self._us, self._has_read = tick, time_us, True
        if counts:
            self._tool_changed = False
        self._look_ahead(counts=counts)
        return told

    def _step_all(self, value: float, since_s: float, time_us: int, *, counts: bool) -> list[Told]:
        told = []
        elapsed_s = since_s if 0 < since_s <= self._gap_s else 0.0
        before_us = self._us if self._has_read else time_us
        for machine in self._machines:
            definition = machine.definition
            if counts and definition is not None:
                condition, reason = definition.condition(value), RETURNED
            else:
                condition, reason = Condition.NOT_COUNTED, self._reason(counts=counts)
            news = machine.step(condition, elapsed_s, before_us, time_us, value, reason)
            if news is not None:
                told.append(news)
        return told

    def _reason(self, *, counts: bool) -> str:
        if counts:
            return SWITCHED_OFF
        return TOOL_CHANGED if self._tool_changed else NOT_WORKING

    def _look_ahead(self, *, counts: bool) -> None:
        """Where nothing stands nor is pending, a reading within all limits changes nothing."""
        self._stands = any(machine.stands for machine in self._machines)
        self._low, self._high = inf, -inf
        if counts and all(machine.phase is Phase.NORMAL for machine in self._machines):
            limits = {machine.side: machine.definition.limit_c for machine in self._machines if machine.definition is not None}
            self._low, self._high = limits.get(Side.LOW, -inf), limits.get(Side.HIGH, inf)
