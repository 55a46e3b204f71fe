"""A monotonic clock that times everything, and UTC for people.

Durations, due times and time-outs use `monotonic()`, in seconds. UTC is derived from it by an
offset, so that a stepped wall clock neither moves a sample nor makes a duration negative. On Linux
the monotonic clock includes time in which the machine was suspended, because tips stay hot
meanwhile.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from typing import Final, Protocol

UTC_FORMAT: Final = "%Y-%m-%dT%H:%M:%S.%fZ"


def utc_of(micros: int) -> datetime:
    """Return microseconds since 1970 as UTC, exactly."""
    seconds, rest = divmod(micros, 1_000_000)
    return datetime.fromtimestamp(seconds, UTC).replace(microsecond=rest)


def utc_text(moment: datetime) -> str:
    """Format a time as in records: ``2026-11-21T01:30:00.123456Z``."""
    return moment.astimezone(UTC).strftime(UTC_FORMAT)


def utc_ms(moment: datetime) -> str:
    """Format a time as in ledgers: ``2026-11-21T01:30:00.123+00:00``."""
    return moment.astimezone(UTC).isoformat(timespec="milliseconds")


def _elapsed() -> Callable[[], float]:
    """Return the boot-time clock: `time.monotonic` excludes suspension on Linux."""
    try:
        boot: int = time.CLOCK_BOOTTIME
        time.clock_gettime(boot)
    except (AttributeError, OSError):
        return time.monotonic
    return partial(time.clock_gettime, boot)


elapsed: Callable[[], float] = _elapsed()
"""Seconds on a clock that never steps back and includes suspension where the system can count
it.
"""


class Clock(Protocol):
    def monotonic(self) -> float:
        """Seconds on a clock that never steps back."""

    def utc(self) -> float:
        """Seconds since 1970 UTC by the host's wall clock."""


class SystemClock:
    monotonic = staticmethod(elapsed)
    utc = staticmethod(time.time)


class VirtualClock:
    """A clock that stands still until `advance_to`; for tests and the virtual driver."""

    def __init__(self, monotonic: float = 1000.0, utc: float = 1_790_000_000.0) -> None:
        self._monotonic = monotonic
        self._utc = utc

    def monotonic(self) -> float:
        return self._monotonic

    def utc(self) -> float:
        return self._utc

    def advance_to(self, moment: float) -> None:
        """Advance to `moment` (monotonic seconds); a moment in the past changes nothing."""
        ahead = moment - self._monotonic
        if ahead > 0:
            self._monotonic = moment
            self._utc += ahead


class UtcOffset:
    """Converts monotonic seconds to UTC microseconds by an offset that only `check` renews.

    Between checks all rows have the same offset, so their order stays.
    """

    # a larger change is a step (docs/reference/faults.md, F-20); a smaller one is drift
    STEP_S = 0.5

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.offset = clock.utc() - clock.monotonic()

    def micros(self, moment: float) -> int:
        """Convert a monotonic `moment` to UTC microseconds since 1970."""
        return round((moment + self.offset) * 1e6)

    def check(self) -> float:
        """Renew the offset; return the size of a step in seconds, 0.0 for none."""
        now = self._clock.utc() - self._clock.monotonic()
        change, self.offset = now - self.offset, now
        return change if abs(change) > self.STEP_S else 0.0
