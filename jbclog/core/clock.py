"""Two clocks, never mixed: a monotonic one that everything is timed by, and UTC that people read.

Durations, due times and time-outs use `monotonic()`, in seconds. UTC is only ever derived from it by
an offset, so that a stepped wall clock neither moves a sample nor turns a duration negative.

Where the system has one (Linux), the monotonic clock is the one that goes on while the machine is suspended: tips stay hot
meanwhile, and a recorder that was not there has to say so. All that a run is timed by reads it through `elapsed`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Protocol


def _elapsed() -> Callable[[], float]:
    """Python's own monotonic clock stands still in a suspended Linux."""
    try:
        boot: int = time.CLOCK_BOOTTIME
        time.clock_gettime(boot)
    except (AttributeError, OSError):
        return time.monotonic
    return partial(time.clock_gettime, boot)


elapsed: Callable[[], float] = _elapsed()
"""Seconds on a clock that never goes back, nor stands still where the system has such a one."""


class Clock(Protocol):
    """What the rooms may know of time."""

    def monotonic(self) -> float:
        """Seconds on a clock that never goes back."""

    def utc(self) -> float:
        """Seconds since 1970 UTC, as the host believes now."""


class SystemClock:
    """The host's clocks."""

    monotonic = staticmethod(elapsed)
    utc = staticmethod(time.time)


class FastClock:
    """The host's clocks as if time went `speed` times as fast from now on: for a recorded run that is served so."""

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self._began, self._utc = elapsed(), time.time()

    def monotonic(self) -> float:
        return self._began + (elapsed() - self._began) * self.speed

    def utc(self) -> float:
        return self._utc + self.monotonic() - self._began

    def elapsed_at(self, moment: float) -> float:
        """What `elapsed` says at that monotonic moment."""
        return self._began + (moment - self._began) / self.speed


class VirtualClock:
    """A clock that stands still until it is told to go on; for tests and for the virtual driver."""

    def __init__(self, monotonic: float = 1000.0, utc: float = 1_790_000_000.0) -> None:
        self._monotonic = monotonic
        self._utc = utc

    def monotonic(self) -> float:
        return self._monotonic

    def utc(self) -> float:
        return self._utc

    def advance_to(self, moment: float) -> None:
        """Go on to `moment` (monotonic seconds); a moment in the past changes nothing."""
        ahead = moment - self._monotonic
        if ahead > 0:
            self._monotonic = moment
            self._utc += ahead

    def step_utc(self, seconds: float) -> None:
        """Step the wall clock alone, as an operator or NTP would."""
        self._utc += seconds


class UtcOffset:
    """Turns monotonic moments into UTC microseconds by an offset that only `check` renews.

    Between checks every row of a run has the same offset, so rows cannot overtake each other.
    """

    STEP_S = 0.5  # a larger change is a step (docs/reference/faults.md, F-20); a smaller one is drift and is followed

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.offset = clock.utc() - clock.monotonic()

    def micros(self, moment: float) -> int:
        """UTC microseconds since 1970 of a monotonic `moment`."""
        return round((moment + self.offset) * 1e6)

    def check(self) -> float:
        """Follow the wall clock; give the size of a step in seconds, 0.0 where there was none."""
        now = self._clock.utc() - self._clock.monotonic()
        change, self.offset = now - self.offset, now
        return change if abs(change) > self.STEP_S else 0.0
