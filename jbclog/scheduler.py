"""Which reading is due when on one wire, and whether all of them fit: a cyclic executive.

Fast signals are due on every tick of an absolute grid. Slow ones have a period, at which they are read when the wire
has room, and a ceiling of three times that, which the plan guarantees even while repeats take their share. They go into
what the fast ones leave, the most urgent first, one at a time, and may run into the next tick by no more than their own
length. Five percent of the wire are kept for repeats (contract, "Rates").

The same arithmetic decides before a run whether a rate fits (`Demand`) and during it what to ask next (`SlowReadings`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from jbclog.commands.command import Command, Scope
from jbclog.commands.signals import Counter, Pace, Signal
from jbclog.wire import ANSWER_BYTES, READ_BYTES, UNADDRESSED_SAVES, LineFormat

KEPT_FOR_REPEATS = 0.05
CEILING = 3.0  # a slow reading may be this many of its periods old
FIXED_PERIODS_S = {Pace.FIVE: 5.0, Pace.TEN: 10.0}


@dataclass(frozen=True, slots=True)
class Reading:
    """One thing to read repeatedly: a signal, a counter or a setting that is watched, on one port.

    `port` is the row that it belongs to; `asks_port` is None where the command speaks to the whole station.
    `period_s` is None for a fast signal.
    """

    name: str
    command: Command
    port: int
    asks_port: int | None
    wire_s: float
    period_s: float | None
    columns: tuple[str, ...] = ()
    counter: Counter | None = None

    @property
    def ceiling_s(self) -> float | None:
        return None if self.period_s is None else CEILING * self.period_s


def period_s(pace: Pace, alarms_every_s: float, counters_every_s: float) -> float | None:
    """Seconds between two readings of a pace; None for every tick."""
    if pace is Pace.FAST:
        return None
    chosen = {Pace.ALARMS: alarms_every_s, Pace.COUNTERS: counters_every_s}
    return chosen.get(pace) or FIXED_PERIODS_S[pace]


def read_wire_s(line: LineFormat, command: Command, addressed: bool) -> float:
    """Seconds that the bytes of a read and its usual answer take on the wire, without turnaround."""
    short = command.scope is Scope.STATION and len(command.letters) == 2  # RTT: a letter less both ways
    saved = 2 * short + (0 if addressed else 2 * UNADDRESSED_SAVES)
    return line.seconds(READ_BYTES + ANSWER_BYTES - saved)


@dataclass(frozen=True, slots=True)
class Demand:
    """What one wire has to carry: seconds of a tick's fast reads, and of slow ones per second at their ceilings."""

    fast_s: float
    fast_reads: int
    slow_s_per_s: float
    slow_reads_per_s: float

    @classmethod
    def of(cls, readings: Iterable[Reading]) -> Demand:
        readings = list(readings)
        fast = [reading for reading in readings if reading.period_s is None]
        slow = [(reading.wire_s, reading.ceiling_s) for reading in readings if reading.ceiling_s is not None]
        return cls(
            sum(reading.wire_s for reading in fast),
            len(fast),
            sum(wire / ceiling for wire, ceiling in slow),
            sum(1 / ceiling for _, ceiling in slow),
        )

    def load(self, rate_hz: float, turnaround_s: float) -> float:
        """The share of the wire in use, 1.0 being all of it."""
        fast = self.fast_s + self.fast_reads * turnaround_s
        return rate_hz * fast + self.slow_s_per_s + self.slow_reads_per_s * turnaround_s

    def fits(self, rate_hz: float, turnaround_s: float) -> bool:
        return self.load(rate_hz, turnaround_s) <= 1 - KEPT_FOR_REPEATS

    def best_rate_hz(self, turnaround_s: float) -> float:
        """The highest rate that fits, in Hz, rounded down to a tenth (to a hundredth below 1 Hz); 0.0 where none does."""
        fast = self.fast_s + self.fast_reads * turnaround_s
        room = 1 - KEPT_FOR_REPEATS - self.slow_s_per_s - self.slow_reads_per_s * turnaround_s
        rate = max(room, 0.0) / fast
        grain = 10 if rate >= 1 else 100
        return math.floor(rate * grain + 1e-9) / grain

    def greatest_turnaround_s(self, rate_hz: float) -> float:
        """The longest turnaround at which `rate_hz` fits, in seconds; negative where the bytes alone are too many."""
        room = 1 - KEPT_FOR_REPEATS - self.load(rate_hz, 0.0)
        return room / (rate_hz * self.fast_reads + self.slow_reads_per_s)


@dataclass(frozen=True, slots=True)
class Grid:
    """The absolute grid of due times: tick n is due at `t0 + n * period_s` (monotonic seconds)."""

    t0: float
    period_s: float

    def due(self, tick: int) -> float:
        return self.t0 + tick * self.period_s

    def first_from(self, moment: float) -> int:
        """The first tick that is due at `moment` or later."""
        return math.ceil((moment - self.t0) / self.period_s - 1e-9)

    def next_after(self, tick: int, now: float) -> int:
        """The tick to run once `tick` is done at `now`: the next one, unless that is a whole period late already.

        What lies between is skipped, not made up by a burst.
        """
        behind = math.floor((now - self.due(tick + 1)) / self.period_s)
        return tick + 1 + max(behind, 0)


@dataclass(slots=True)
class Slow:
    """A slow reading and when it is next due."""

    reading: Reading
    period_s: float
    due: float


class SlowReadings:
    """The slow readings of one wire with the moment at which each is next due."""

    def __init__(self, readings: Iterable[Reading], start: float) -> None:
        """Signals are due at `start`, so that a run knows everything as soon as the wire has room.

        Counters have been read before the first tick and are due a period later.
        """
        self._all = [
            Slow(reading, reading.period_s, start + (reading.period_s if reading.counter else 0.0))
            for reading in readings
            if reading.period_s is not None
        ]
        self._earliest = start
        self.worst_periods = 0.0  # the longest that any reading waited, in its own periods; CEILING is the promise

    def urgent(self, now: float) -> Slow | None:
        """The due reading that is nearest to its ceiling, or None. Cheap where nothing is due."""
        if now < self._earliest or not self._all:
            return None
        return min((slow for slow in self._all if slow.due <= now), key=lambda slow: slow.due + slow.period_s, default=None)

    def all_due(self, now: float) -> list[Slow]:
        """Every reading due by `now`, for a station that cannot be asked."""
        return [slow for slow in self._all if slow.due <= now]

    def taken(self, slow: Slow, now: float) -> None:
        """`slow` was asked, with whatever result; it is due again a period after it was due, and never twice in a row."""
        self.worst_periods = max(self.worst_periods, (now - slow.due) / slow.period_s + 1)
        slow.due = max(slow.due + slow.period_s, now - slow.period_s / 2)
        self._earliest = min(one.due for one in self._all)


def readings_of(
    signals: Iterable[tuple[Signal, Command]],
    counters: Iterable[tuple[Counter, Command]],
    ports: Sequence[int],
    line: LineFormat,
    addressed: bool,
    alarms_every_s: float,
    counters_every_s: float,
) -> list[Reading]:
    """Everything that is read repeatedly on one station; station-wide signals once, in the row of the first port."""
    found: list[Reading] = []
    for signal, command in signals:
        for port in ports if command.scope is Scope.PORT else ports[:1]:
            asks = port if command.scope is Scope.PORT else None
            pace = period_s(signal.pace, alarms_every_s, counters_every_s)
            found.append(Reading(signal.name, command, port, asks, read_wire_s(line, command, addressed), pace, signal.columns))
    for counter, command in counters:
        for port in ports:
            wire = read_wire_s(line, command, addressed)
            found.append(Reading(counter.name, command, port, port, wire, counters_every_s, (), counter))
    return found


def watched_readings(
    commands: Iterable[Command], ports: Sequence[int], line: LineFormat, addressed: bool, every_s: float
) -> list[Reading]:
    """Settings that are read again now and then, to find them changed; they fill no column."""
    return [
        Reading(command.name, command, port, port, read_wire_s(line, command, addressed), every_s)
        for command in commands
        for port in ports
    ]
