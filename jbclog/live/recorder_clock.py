"""The recorder's clock, and whether it lives, from the marks in the journal.

A recorder writes a mark after each commit, and every 0.6 s if there is nothing to commit. Its time
is that before which everything is on the disk.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from jbclog.core.clock import Clock

ALIVE_S: Final = 1.5
DELAYED_S: Final = 3.0
MEMORY_S: Final = 60.0  # older marks do not count: clocks drift


class RecorderClock:
    """Follows the time of a recorder's marks. `see` takes that of the newest one, in s since 1970
    UTC.

    A mark is seen some time after it was written. So its clock is ahead of this one by the most
    that a mark has shown within a minute.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._mark_s: float | None = None
        self._ahead_s: deque[tuple[float, float]] = deque()  # when it was seen, and by how much
        self._most_ahead_s = 0.0
        self._is_guess = False  # how old the first mark is only the wall clock says
        self._seen_at = clock.monotonic()

    def see(self, mark_s: float | None) -> None:
        """Take the time of the newest mark; None if there is none yet."""
        before = self._mark_s
        if mark_s is None or mark_s == before:
            return
        now = self._clock.monotonic()
        if before is None:
            self._is_guess = True
            self._ahead_s.append((now, max(mark_s, self._clock.utc()) - now))
        else:
            if self._is_guess or mark_s < before:  # its clock was set back
                self._is_guess = False
                self._ahead_s.clear()
            self._ahead_s.append((now, mark_s - now))
        while now - self._ahead_s[0][0] > MEMORY_S:
            self._ahead_s.popleft()
        self._most_ahead_s = max(ahead_s for _, ahead_s in self._ahead_s)
        self._mark_s = mark_s
        self._seen_at = now

    @property
    def now_s(self) -> float | None:
        """The recorder's clock now, in s since 1970 UTC; None before its first mark."""
        if self._mark_s is None:
            return None
        return self._clock.monotonic() + self._most_ahead_s

    @property
    def age_s(self) -> float | None:
        """Seconds since the time of the last mark; None before the first."""
        if self._mark_s is None or self.now_s is None:
            return None
        return self.now_s - self._mark_s

    @property
    def waited_s(self) -> float:
        """Seconds since this began, or since a mark was seen."""
        return self._clock.monotonic() - self._seen_at

    @property
    def is_alive(self) -> bool:
        """Whether there was a mark just now. False does not prove that the recorder is dead."""
        age = self.age_s
        return age is not None and age < ALIVE_S
