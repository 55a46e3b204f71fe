"""Whether a recorder is alive, and its clock, from the time it writes into its lock file with each
commit.
"""

from __future__ import annotations

from typing import Final

from jbclog.core.clock import Clock

ALIVE_S: Final = 1.5  # a recorder commits every 0.8 s
DELAYED_S: Final = 3.0


class Heartbeat:
    """Tracks a recorder's commits. `see` takes, at each poll, the begin of the last commit (seconds
    since 1970 UTC, recorder's clock) and its duration.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._commit_s: float | None = None
        self._base_s = 0.0  # the recorder's clock when `_commit_s` was first seen
        self._seen_at = clock.monotonic()

    def see(self, commit_s: float | None, took_s: float) -> None:
        if commit_s is None or commit_s == self._commit_s:
            return
        ended_s = commit_s + took_s
        # only the wall clock gives the age of the first commit; a later one has just ended
        self._base_s = max(ended_s, self._clock.utc()) if self._commit_s is None else ended_s
        self._commit_s, self._seen_at = commit_s, self._clock.monotonic()

    @property
    def age_s(self) -> float | None:
        """Seconds since the last commit began; None before the first."""
        if self._commit_s is None:
            return None
        return max(self._base_s - self._commit_s, 0.0) + self._clock.monotonic() - self._seen_at

    @property
    def waited_s(self) -> float:
        """Seconds since this follower started or last saw a new commit."""
        return self._clock.monotonic() - self._seen_at

    @property
    def is_alive(self) -> bool:
        """Whether there was a commit just now. False does not prove that the recorder is dead."""
        age = self.age_s
        return age is not None and age < ALIVE_S

    def recorder_us(self) -> float | None:
        """Return the recorder's clock, UTC in µs; None before its first commit."""
        return (
            None
            if self._commit_s is None
            else (self._base_s + self._clock.monotonic() - self._seen_at) * 1e6
        )
