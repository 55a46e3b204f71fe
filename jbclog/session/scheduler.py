"""Decide which reading is due when on one link, and whether all of them fit: a cyclic executive.

Fast signals are due on every tick of an absolute grid. Slow ones have a period, at which they are
read when the link has time (once a tick at most), and a ceiling of three periods, which the plan
guarantees even with repeats: they use the time that the fast ones leave, the most urgent first, one
at a time, and if necessary run into the next tick by at most their own length. Five percent of the
link's time are reserved for repeats (docs/decisions/0006-cyclic-executive.md), a fifth for a rate
chosen by `auto_rate_hz`.

The same arithmetic decides before a run whether a rate fits (`Demand`) and during it what to read
next (`SlowReadings`). Why the ceilings hold: a value read once in each of its periods is never
older than two. Earliest deadline first achieves that if the shortest period leaves time for its
share of all slow readings and for the one just being read (Liu and Layland 1973, with the fast
signals as an intermittent supply).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from itertools import count

from jbclog.core.serial_line import ADDRESSES, FRAMING, LineFormat
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.signals import ReadInterval, UsageCounter

KEPT_FOR_REPEATS = 0.05
KEPT_BY_AUTO = 0.2
AUTO_RATES_HZ = (
    10.0,
    5.0,
    4.0,
    2.0,
    1.0,
    0.5,
    0.4,
    0.2,
    0.1,
    0.05,
    0.04,
    0.02,
    0.01,
    0.005,
    0.004,
    0.002,
    0.001,
)
CEILING = 3.0  # maximum age of a slow reading, in periods
BEHIND_LETTERS = {Scope.STATION: 0, Scope.PORT: 1, Scope.TOOL: 2}  # characters for port and tool
USUAL_DIGITS = 5  # assumed for an answer of unprinted length
FIXED_PERIODS_S = {ReadInterval.FIVE: 5.0, ReadInterval.TEN: 10.0}


@dataclass(frozen=True, slots=True)
class ScheduledRead:
    """Something read periodically on one port: a signal, a counter, a watched setting or the
    identity.

    `port` is the port of its row; `asks_port` is None if the command addresses the whole station.
    `period_s` is None for a fast signal.
    """

    name: str
    command: Command
    port: int
    asks_port: int | None
    wire_s: float
    period_s: float | None
    columns: tuple[str, ...] = ()
    counter: UsageCounter | None = None
    is_identity: bool = False  # the station's model or software

    @property
    def was_read(self) -> bool:
        """True if it was read before the first tick."""
        return self.counter is not None or self.is_identity


def period_s(pace: ReadInterval, alarms_every_s: float, counters_every_s: float) -> float | None:
    """Return the seconds between two readings; None for every tick."""
    if pace is ReadInterval.FAST:
        return None
    chosen = {ReadInterval.ALARMS: alarms_every_s, ReadInterval.COUNTERS: counters_every_s}
    return chosen.get(pace) or FIXED_PERIODS_S[pace]


def read_wire_s(line: LineFormat, command: Command, addressed: bool) -> float:
    """Return the transmission time of a read and its usual answer, without response time."""
    code = len(command.letters) + BEHIND_LETTERS[command.scope]
    digits = USUAL_DIGITS if command.answer_digits is None else command.answer_digits
    return line.seconds(2 * (FRAMING + code + (ADDRESSES if addressed else 0)) + digits)


@dataclass(frozen=True, slots=True)
class Demand:
    """The load of one link: the fast reads of a tick, and slow ones as pairs of transmission time
    and period in seconds.
    """

    fast_s: float
    fast_reads: int
    slow: tuple[tuple[float, float], ...] = ()

    @classmethod
    def of(cls, readings: Iterable[ScheduledRead]) -> Demand:
        readings = list(readings)
        fast = [reading.wire_s for reading in readings if reading.period_s is None]
        return cls(
            sum(fast),
            len(fast),
            tuple((one.wire_s, one.period_s) for one in readings if one.period_s is not None),
        )

    def tick_s(self, turnaround_s: float) -> float:
        """Return the time that the fast reads of a tick take, in seconds."""
        return self.fast_s + self.fast_reads * turnaround_s

    def longest_slow_s(self, turnaround_s: float) -> float:
        """Return the time that the longest slow read takes, in seconds; 0.0 if there is none."""
        return max((wire_s + turnaround_s for wire_s, _ in self.slow), default=0.0)

    def load(self, rate_hz: float, turnaround_s: float) -> float:
        """Return the share of the link's time in use, slow readings at their ceilings; 1.0 is
        all.
        """
        return (
            rate_hz * self.tick_s(turnaround_s) + self._slow_share(rate_hz, turnaround_s) / CEILING
        )

    def fits(self, rate_hz: float, turnaround_s: float, kept: float = KEPT_FOR_REPEATS) -> bool:
        """Return True if every tick and slow reading is in time while the share `kept` stays
        free.
        """
        free_s = 1 / rate_hz - self.tick_s(turnaround_s)
        return self.load(rate_hz, turnaround_s) <= 1 - kept and self._is_in_time(
            free_s, rate_hz, turnaround_s
        )

    def runs_over(self, rate_hz: float, turnaround_s: float) -> bool:
        """Return True if slow readings run into the next tick, because too few complete ones fit
        before it.
        """
        one_s = self.longest_slow_s(turnaround_s)
        free_s = 1 / rate_hz - self.tick_s(turnaround_s)
        return bool(self.slow) and not self._is_in_time(
            math.floor(free_s / one_s + 1e-9) * one_s, rate_hz, turnaround_s
        )

    def best_rate_hz(self, turnaround_s: float) -> float:
        """Return the highest rate that fits, in Hz, rounded down to a tenth (to a hundredth below 1
        Hz); 0.0 for none.
        """
        rate = _boundary(
            lambda rate_hz: self.fits(rate_hz, turnaround_s), 1e-3, 1 / self.tick_s(turnaround_s)
        )
        grain = 10 if rate >= 1 else 100
        return math.floor(rate * grain + 1e-9) / grain

    def auto_rate_hz(self, turnaround_s: float, longest_s: float) -> float:
        """Return the highest of `AUTO_RATES_HZ` that leaves a fifth of the link's time free, in Hz;
        0.0 for none.

        The fifth counts with the usual response time; with `longest_s`, the longest to be expected,
        the rate must still fit. No rate is lower than the slow readings need.
        """
        rates = (rate_hz for rate_hz in AUTO_RATES_HZ if not self.is_too_slow(rate_hz))
        return next(
            (
                hz
                for hz in rates
                if self.fits(hz, turnaround_s, KEPT_BY_AUTO) and self.fits(hz, longest_s)
            ),
            0.0,
        )

    def greatest_turnaround_s(self, rate_hz: float, kept: float = KEPT_FOR_REPEATS) -> float:
        """Return the longest response time at which `rate_hz` fits, in seconds; negative if the
        bytes alone are too many.
        """
        return _boundary(
            lambda turnaround_s: self.fits(rate_hz, turnaround_s, kept),
            -self.fast_s / self.fast_reads,
            1 / rate_hz,
        )

    @property
    def slowest_rate_hz(self) -> float:
        """Return the lowest rate that keeps the slow readings' ceilings, in Hz; 0.0 without slow
        readings.
        """
        return 1 / (CEILING * min(period_s for _, period_s in self.slow)) if self.slow else 0.0

    def is_too_slow(self, rate_hz: float) -> bool:
        """Return True if `rate_hz` is too low for the slow readings' ceilings."""
        return rate_hz < self.slowest_rate_hz * (1 - 1e-9)

    def _slow_share(self, rate_hz: float, turnaround_s: float) -> float:
        """Return the share of time that slow readings take, each once in its period or a tick."""
        return sum(
            (wire_s + turnaround_s) / max(period_s, 1 / rate_hz) for wire_s, period_s in self.slow
        )

    def _is_in_time(self, free_s: float, rate_hz: float, turnaround_s: float) -> bool:
        """Return True if slow readings are in time when each tick leaves `free_s` for them."""
        tick_s = 1 / rate_hz
        window_s = max(min((period_s for _, period_s in self.slow), default=0.0), tick_s)
        whole, rest_s = divmod(window_s + 1e-12, tick_s)
        # the worst case begins with fast reads
        blocked_s = (tick_s - free_s) * whole + min(tick_s - free_s, rest_s)
        needed_s = self._slow_share(rate_hz, turnaround_s) * window_s + self.longest_slow_s(
            turnaround_s
        )
        return window_s - blocked_s >= needed_s - 1e-9


def _boundary(fits: Callable[[float], bool], good: float, bad: float) -> float:
    """Find where `fits` changes from true at `good` to false at `bad`."""
    while bad - good > 1e-9:
        between = (good + bad) / 2
        good, bad = (between, bad) if fits(between) else (good, between)
    return good


@dataclass(frozen=True, slots=True)
class Grid:
    """The grid of due times: tick n is due at `t0 + n * period_s` (monotonic seconds)."""

    t0: float
    period_s: float

    def due(self, tick: int) -> float:
        return self.t0 + tick * self.period_s

    def first_from(self, moment: float) -> int:
        """Return the first tick due at `moment` or later."""
        return math.ceil((moment - self.t0) / self.period_s - 1e-9)

    def next_after(self, tick: int, now: float) -> int:
        """Return the tick to run after `tick` was finished at `now`: the next one, unless it is
        already a whole period late.

        Ticks in between are skipped, not caught up.
        """
        behind = math.floor((now - self.due(tick + 1)) / self.period_s)
        return tick + 1 + max(behind, 0)


@dataclass(slots=True, eq=False)
class SlowRead:
    """A slow reading: when it is due next, and when it was last read."""

    reading: ScheduledRead
    period_s: float
    due: float
    last: float


class SlowReadings:
    """The slow readings of one link. `longest_s` is the duration of the longest, with response
    time.

    With `runs_over` one may begin before a tick and end in it. With ticks `tick_s` apart none is
    due more often.
    """

    def __init__(
        self,
        readings: Iterable[ScheduledRead],
        start: float,
        *,
        longest_s: float = 0.0,
        tick_s: float = 0.0,
        runs_over: bool = False,
    ) -> None:
        """Signals are due at `start`, so that everything is known as soon as possible.

        Counters, model and software were read before the first tick and are due a period later.
        """
        found = [
            SlowRead(
                reading,
                max(reading.period_s, tick_s),
                start + (reading.period_s if reading.was_read else 0.0),
                start,
            )
            for reading in readings
            if reading.period_s is not None
        ]
        self._coming = [(slow.due, number, slow) for number, slow in enumerate(found)]  # a heap
        heapify(self._coming)
        self._number = count(len(found))
        self._waiting: list[SlowRead] = []  # due, not yet taken
        self._longest_s = longest_s
        self._runs_over = runs_over
        # longest wait of any reading, in its own periods; CEILING is the guarantee
        self.worst_periods = 0.0

    def next(self, now: float, following: float) -> SlowRead | None:
        """Return the due reading nearest to its ceiling, if there is time for it before the tick
        due at `following`.

        Returns one that has waited a whole period even without time: on a link with many repeats
        ticks may be late or skipped, but slow signals are not starved.
        """
        if self._coming and self._coming[0][0] <= now:
            self._fall_due(now)
        if not self._waiting:
            return None
        one = min(self._waiting, key=_urgency)
        is_room = now + self._longest_s <= following + 1e-9 or (
            self._runs_over and now <= following
        )
        return one if is_room or now > one.due + one.period_s else None

    def all_due(self, now: float) -> list[SlowRead]:
        """Return every reading due by `now`, for an unreachable station."""
        self._fall_due(now)
        return list(self._waiting)

    def _fall_due(self, now: float) -> None:
        while self._coming and self._coming[0][0] <= now:
            self._waiting.append(heappop(self._coming)[2])

    def taken(self, slow: SlowRead, now: float, following: float = 0.0) -> None:
        """Register that `slow` was read, with whatever result; it is due again a period after it
        was due, but not before the tick due at `following`, nor twice in a row: a row has one value
        for it.
        """
        waited = (now - slow.last) / slow.period_s
        if waited > self.worst_periods:
            self.worst_periods = waited
        slow.last = now
        slow.due = max(slow.due + slow.period_s, now + slow.period_s / 2, following)
        self._waiting.remove(slow)
        heappush(self._coming, (slow.due, next(self._number), slow))

    def drop(self, slow: SlowRead) -> None:
        """Remove a reading that the station does not support."""
        self._coming = [one for one in self._coming if one[2] is not slow]
        heapify(self._coming)


def _urgency(slow: SlowRead) -> float:
    """Return its urgency: the smaller, the nearer to its ceiling."""
    return slow.due + slow.period_s
