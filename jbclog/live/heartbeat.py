"""Whether a recorder lives, and what its clock shows now, by the time that it writes into its lock
with each commit.
"""

from __future__ import annotations

from typing import Final

from jbclog.core.clock import Clock

ALIVE_S: Final = 1.5  # between two commits a recorder takes 0.8 s
DELAYED_S: Final = 3.0


class Heartbeat:
    """`see` takes when the last commit began, in seconds since 1970 UTC by the recorder's clock,
    and how long it took, at each poll.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._commit_s: float | None = None
        self._base_s = 0.0  # the recorder's clock when `_commit_s` was seen first
        self._seen_at = clock.monotonic()

    def see(self, commit_s: float | None, took_s: float) -> None:
        if commit_s is None or commit_s == self._commit_s:
            return
        ended_s = commit_s + took_s
        # of the first one only the wall clock says how old it is; a later one has just ended
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
        """Seconds since this follower last saw something new, or began."""
        return self._clock.monotonic() - self._seen_at

    @property
    def is_alive(self) -> bool:
        """Whether there was a commit just now; False does not mean that the recorder is dead."""
        age = self.age_s
        return age is not None and age < ALIVE_S

    def recorder_us(self) -> float | None:
        """Return the recorder's clock, UTC in µs; None before its first commit."""
        return (
            None
            if self._commit_s is None
            else (self._base_s + self._clock.monotonic() - self._seen_at) * 1e6
        )
