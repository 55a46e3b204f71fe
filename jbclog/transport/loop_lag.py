"""Whether the loop comes round: a beat that is due at known moments, and by how much it came late.

What a session hears late may be the station's or the computer's. Only the loop knows: a beat waits for no station.
"""

from __future__ import annotations

import asyncio
from typing import Final

BEAT_S: Final = 0.05
NOTED_S: Final = 0.005  # timers of a machine with time to spare are not later than this


class Beat:
    """Beats on `loop` each `BEAT_S`. Sessions may live on a clock that goes `speed` times as fast, and are late on that."""

    def __init__(self, loop: asyncio.AbstractEventLoop, speed: float = 1.0) -> None:
        self._loop = loop
        self._speed = speed
        self._late_s = 0.0
        self._due_s = float("inf")  # in the loop's time

    def start(self) -> None:
        """Begin; to be called once, before the loop runs."""
        self._due_s = self._loop.time() + BEAT_S
        self._loop.call_at(self._due_s, self._beat)

    def late_s(self) -> float:
        """For how long the loop has not come round so far, all times together, in the sessions' seconds."""
        late = self._loop.time() - self._due_s
        return self._late_s + late * self._speed if late > NOTED_S else self._late_s

    def _beat(self) -> None:
        self._late_s = self.late_s()
        self._due_s = self._loop.time() + BEAT_S
        self._loop.call_at(self._due_s, self._beat)
