"""Alarm states of one port, row by row; used by the recorder and by the analysis of a record.

Only rows with temperature and status are readings; any other row is a gap. Time is that of the
grid, tick × period; without a grid (``--rate max``) it is UTC. Two readings are consecutive if at
most `GAP_PERIODS` periods lie between them (`GAP_S` without a grid); longer gaps do not count
towards delays.

A changed setting applies to rows with a later time. Rows and events are in different tables of a
record, and this rule restores their order.
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
    Condition,
    Detector,
    Machine,
    Phase,
    Report,
    Rules,
    Side,
    Transition,
    definition_of,
    number_of,
)

GAP_PERIODS: Final = 2.0
GAP_S: Final = 2.0
WORKING: Final = frozenset(["working", "on"])
BAND_C: Final = 10
COOLS_WITHIN_S: Final = 10.0
TOOL: Final = "tool"
BEFORE_ALL: Final = 0
"""Time of settings that were read before sampling began."""


class Change(NamedTuple):
    """At `at_us`, setting `name` was read as `text` (as in `settings`), or the tool was changed
    (`name` is `TOOL`).
    """

    at_us: int
    name: str
    text: str | None = None


class Arrival:
    """Whether the tool in a port has reached its setpoint since it was put there; only then its
    alarms count.

    The rule of the session (`jbclog/session/run/watch.py`): the tool works, and it is within ±10 °C
    of the setpoint, passed through it between two readings, or was found hotter and has not cooled
    for ten seconds.
    """

    __slots__ = ("_above", "has_arrived", "previous_c")

    def __init__(self) -> None:
        self.has_arrived = False
        self.previous_c: float | None = None
        # since when it is hotter than its setpoint, and its temperature then
        self._above: tuple[float, float] | None = None

    def reset(self) -> None:
        """Start again after a tool change: the last temperature was another tool's."""
        self.has_arrived, self._above, self.previous_c = False, None, None

    def see(self, seconds: float, value: float, setpoint: float | None, *, works: bool) -> None:
        """Add a reading in °C at `seconds`."""
        if setpoint is not None and works and not self.has_arrived:
            self.has_arrived = self._reaches(value, setpoint) or self._stays_above(
                seconds, value, setpoint
            )
            self._note_above(seconds, value, setpoint)
        self.previous_c = value

    def _reaches(self, value: float, setpoint: float) -> bool:
        has_passed = self.previous_c is not None and (self.previous_c < setpoint) != (
            value < setpoint
        )
        return has_passed or abs(value - setpoint) <= BAND_C

    def _stays_above(self, seconds: float, value: float, setpoint: float) -> bool:
        if value <= setpoint + BAND_C or self._above is None:
            return False
        since_s, then_c = self._above
        return seconds - since_s >= COOLS_WITHIN_S and value >= then_c

    def _note_above(self, seconds: float, value: float, setpoint: float) -> None:
        if value <= setpoint + BAND_C:
            self._above = None
        elif self._above is None or seconds - self._above[0] >= COOLS_WITHIN_S:
            self._above = seconds, value


class PortWatch:
    """The alarms of one port by one or more detectors. `period_s` None: no grid."""

    def __init__(
        self,
        station: str,
        port: int,
        period_s: float | None,
        rules: Rules,
        detectors: Sequence[Detector],
    ) -> None:
        self._stepped_us = 0
        self._period_s = period_s
        self._gap_s = GAP_S if period_s is None else GAP_PERIODS * period_s * (1 + 1e-9)
        self._rules = rules
        self._changes: deque[Change] = deque()
        self._settings: dict[str, float | None] = {}
        self._machines = [
            Machine(station, port, side, detector) for detector in detectors for side in Side
        ]
        self._arrival = Arrival()
        self._setpoint: float | None = None
        self._is_tool_new = False  # changed, and has not reached its setpoint since
        self._tick, self._us = 0, 0  # tick and time of the last reading
        self._has_read = False
        self._is_raised = False
        self._low, self._high = inf, -inf  # a reading between them changes nothing

    def change(self, change: Change) -> None:
        """Add a change, in order of time; its time is corrected for the clock steps before it."""
        self._changes.append(change)

    def step(self, size_us: int) -> None:
        """Follow a step of the wall clock: later rows have times of the new clock."""
        self._stepped_us += size_us
        self._us += size_us
        for machine in self._machines:
            machine.step_clock(size_us)

    def row(
        self,
        time_us: int,
        tick: int,
        temperature: float | None,
        works: bool,  # positional, once per row: keywords cost a third more
        setpoint_c: float | None,
    ) -> Sequence[Report]:
        """Add the next row of this port and return the transitions of its episodes.

        `temperature` is None if it or the status was not read.
        """
        if self._changes:
            self._apply_changes(time_us - self._stepped_us)
        if setpoint_c is not None:
            self._setpoint = setpoint_c
        if temperature is None:
            return self._miss(tick, time_us) if self._is_raised else ()
        if works and self._low <= temperature <= self._high:
            self._tick, self._us, self._arrival.previous_c = tick, time_us, temperature
            return ()
        return self._evaluate(time_us, tick, temperature, works=works)

    def quiet_range(self) -> tuple[float, float] | None:
        """Return the range of temperatures that change nothing while the tool works; empty is
        infinity to minus infinity. None while an alarm is pending or raised.

        Otherwise rows without a reading, or in which the tool does not work, change nothing either,
        before `due_us`.
        """
        if all(machine.phase is Phase.NORMAL for machine in self._machines):
            return self._low, self._high
        return None

    @property
    def due_us(self) -> float:
        """Time of the last row before the next change applies; infinite without one."""
        return self._changes[0].at_us + self._stepped_us if self._changes else inf

    def pass_by(self, last: tuple[int, int, float] | None, setpoint_c: float | None) -> None:
        """Skip rows that change nothing. `last`: time, tick and temperature of the last reading;
        `setpoint_c`: the last setpoint.
        """
        if setpoint_c is not None:
            self._setpoint = setpoint_c
        if last is not None:
            self._us, self._tick, self._arrival.previous_c = last
            self._has_read = True

    def _apply_changes(self, before_us: int) -> None:
        """Apply the changes found before a row's time."""
        while self._changes and self._changes[0].at_us < before_us:
            change = self._changes.popleft()
            if change.name == TOOL:
                self._arrival.reset()
                self._is_tool_new = True
            elif change.name in SETPOINTS:
                self._setpoint = number_of(change.text)
            else:
                self._settings[change.name] = number_of(change.text)
            self._low, self._high = inf, -inf
        for machine in self._machines:
            definition = definition_of(machine.side, self._settings, self._rules)
            if definition is not None and machine.detector is Detector.AFTERWARDS:
                definition = definition.without_delays()
            machine.definition = definition

    def _seconds(self, tick: int, time_us: int) -> float:
        return (
            tick * self._period_s
            if self._period_s is not None
            else (time_us - self._stepped_us) / 1e6
        )

    def _since_last_s(self, tick: int, time_us: int) -> float:
        """Return the seconds since the last reading, or infinity."""
        if not self._has_read:
            return inf
        if self._period_s is not None:
            return (tick - self._tick) * self._period_s
        return (time_us - self._us) / 1e6

    def _miss(self, tick: int, time_us: int) -> list[Report]:
        """Add a missing reading; after `stale_s` it is uncertain whether an alarm is active."""
        return self._lose() if self._since_last_s(tick, time_us) >= self._rules.stale_s else []

    def _lose(self) -> list[Report]:
        """Mark raised episodes as uncertain and return those newly marked."""
        reports: list[Report] = []
        for machine in self._machines:
            episode = machine.episode
            if machine.is_raised and episode is not None and not episode.is_lost:
                episode.is_lost = episode.is_uncertain = True
                reports.append((Transition.UNCERTAIN, episode))
        return reports

    def _evaluate(self, time_us: int, tick: int, value: float, *, works: bool) -> list[Report]:
        since_s = self._since_last_s(tick, time_us)
        reports = self._lose() if self._is_raised and since_s >= self._rules.stale_s else []
        self._arrival.see(self._seconds(tick, time_us), value, self._setpoint, works=works)
        counts = works and self._arrival.has_arrived
        reports += self._step_machines(value, since_s, time_us, counts=counts)
        self._tick, self._us, self._has_read = tick, time_us, True
        if counts:
            self._is_tool_new = False
        self._set_quiet_range(counts=counts)
        return reports

    def _step_machines(
        self, value: float, since_s: float, time_us: int, *, counts: bool
    ) -> list[Report]:
        elapsed_s = since_s if 0 < since_s <= self._gap_s else 0.0
        before_us = self._us if self._has_read else time_us
        unread_us = time_us - before_us if since_s > self._gap_s else 0
        reports = []
        for machine in self._machines:
            if counts and machine.definition is not None:
                condition, reason = machine.definition.condition(value), RETURNED
            else:
                condition, reason = Condition.NOT_COUNTED, self._end_reason(counts=counts)
            report = machine.step(
                condition, elapsed_s, before_us, time_us, value, reason, unread_us
            )
            if report is not None:
                reports.append(report)
        return reports

    def _end_reason(self, *, counts: bool) -> str:
        if counts:
            return SWITCHED_OFF
        return TOOL_CHANGED if self._is_tool_new else NOT_WORKING

    def _set_quiet_range(self, *, counts: bool) -> None:
        """Set the range of temperatures within all limits, which change nothing while no alarm is
        on.
        """
        self._is_raised = any(machine.is_raised for machine in self._machines)
        self._low, self._high = inf, -inf
        if counts and all(machine.phase is Phase.NORMAL for machine in self._machines):
            limits = {
                machine.side: machine.definition.limit_c
                for machine in self._machines
                if machine.definition is not None
            }
            self._low, self._high = limits.get(Side.LOW, -inf), limits.get(Side.HIGH, inf)
