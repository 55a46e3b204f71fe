"""A monotonic clock for all timing, and UTC for display and records.

Durations, due times and time-outs use `monotonic()`, in seconds. UTC is a fixed offset from it, so
a stepped wall clock neither moves a sample nor makes a duration negative. On Linux the monotonic
clock includes suspension, because tips stay hot meanwhile.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Final, Protocol

from jbclog.core.operating_system import boot_clock

UTC_FORMAT: Final = "%Y-%m-%dT%H:%M:%S.%fZ"


def utc_of(micros: int) -> datetime:
    """Convert microseconds since 1970 to UTC without rounding."""
    seconds, rest = divmod(micros, 1_000_000)
    return datetime.fromtimestamp(seconds, UTC).replace(microsecond=rest)


def utc_micros(text: str) -> int:
    """Return microseconds since 1970 of a time as in the record."""
    since = datetime.fromisoformat(text) - datetime(1970, 1, 1, tzinfo=UTC)
    return since // timedelta(microseconds=1)


def utc_text(moment: datetime) -> str:
    """Format a time as in the record: ``2026-11-21T01:30:00.123456Z``."""
    return moment.astimezone(UTC).strftime(UTC_FORMAT)


def utc_ms(moment: datetime) -> str:
    """Format a time as in ledgers: ``2026-11-21T01:30:00.123+00:00``."""
    return moment.astimezone(UTC).isoformat(timespec="milliseconds")


elapsed: Callable[[], float] = boot_clock()
"""Monotonic seconds, including suspension where the system counts it."""


class Clock(Protocol):
    def monotonic(self) -> float:
        """Seconds on a clock that never steps back."""

    def utc(self) -> float:
        """Seconds since 1970 UTC by the host's wall clock."""


class SystemClock:
    monotonic = staticmethod(elapsed)
    utc = staticmethod(time.time)


class VirtualClock:
    """A clock that moves only by `advance_to`; for tests and the virtual driver."""

    def __init__(self, monotonic: float = 1000.0, utc: float = 1_790_000_000.0) -> None:
        self._monotonic = monotonic
        self._utc = utc

    def monotonic(self) -> float:
        return self._monotonic

    def utc(self) -> float:
        return self._utc

    def advance_to(self, moment: float) -> None:
        """Advance to `moment` (monotonic seconds); ignore a moment in the past."""
        ahead = moment - self._monotonic
        if ahead > 0:
            self._monotonic = moment
            self._utc += ahead


class UtcOffset:
    """The run's own clock: UTC by the host's clock at the start, plus the time elapsed since.

    It never jumps. `check` only looks for steps of the host's clock, which is then `host_micros`.
    """

    # a larger change is a step (docs/reference/faults.md, F-20); smaller ones add up
    STEP_S = 0.5

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.offset = clock.utc() - clock.monotonic()
        self._host_offset = self.offset

    def micros(self, moment: float) -> int:
        """Convert a monotonic `moment` to the run's time, UTC microseconds since 1970."""
        return round((moment + self.offset) * 1e6)

    def host_micros(self, moment: float) -> int:
        """Convert a monotonic `moment` to the host's clock as it was at the last step."""
        return round((moment + self._host_offset) * 1e6)

    def check(self) -> float:
        """Return the size of a new step of the host's clock in seconds; 0.0 for none."""
        now = self._clock.utc() - self._clock.monotonic()
        step = round(now - self._host_offset, 6)
        if abs(step) <= self.STEP_S:
            return 0.0
        self._host_offset += step
        return step
