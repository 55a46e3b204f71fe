"""The state machine of one alarm: what it is, what a reading says, what it is then.

::

    normal --beyond--> pending --beyond for the on delay--> active --back--> clearing --back for the off delay--> normal

Delays are measured in time that was observed: between two readings that follow each other. A gap changes no state and
stops the clock of a delay, so that it neither raises nor clears. What does not count ends everything at once.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from jbclog.analysis.alarms.definition import Condition, Definition, Side
from jbclog.analysis.alarms.episode import RETURNED, Detector, Episode


class Phase(Enum):
    NORMAL = "normal"
    PENDING = "pending"
    ACTIVE = "active"
    CLEARING = "clearing"


class News(Enum):
    """What a step told of an episode."""

    RAISED = "raised"
    CLEARED = "cleared"
    UNCERTAIN = "uncertain"


Told = tuple[News, Episode]

_GAP, _OFF, _BEYOND, _BAND, _BACK = Condition
_NORMAL, _PENDING, _ACTIVE, _CLEARING = Phase

NEXT: Final = {
    _NORMAL: {_GAP: _NORMAL, _OFF: _NORMAL, _BEYOND: _PENDING, _BAND: _NORMAL, _BACK: _NORMAL},
    _PENDING: {_GAP: _PENDING, _OFF: _NORMAL, _BEYOND: _PENDING, _BAND: _NORMAL, _BACK: _NORMAL},
    _ACTIVE: {_GAP: _ACTIVE, _OFF: _NORMAL, _BEYOND: _ACTIVE, _BAND: _ACTIVE, _BACK: _CLEARING},
    _CLEARING: {_GAP: _CLEARING, _OFF: _NORMAL, _BEYOND: _ACTIVE, _BAND: _ACTIVE, _BACK: _CLEARING},
}
"""Phase and condition to the next phase. Pending and clearing are left for active and normal once their delay is over."""

TOLERANCE_S: Final = 1e-6  # of sums of periods


class Machine:
    """One alarm of one port by one detector. `definition` None: the alarm is off, or not known."""

    __slots__ = ("_end", "_observed_s", "definition", "detector", "episode", "phase", "port", "side", "station")

    def __init__(self, station: str, port: int, side: Side, detector: Detector) -> None:
        self.station, self.port, self.side, self.detector = station, port, side, detector
        self.definition: Definition | None = None
        self.phase = _NORMAL
        self.episode: Episode | None = None  # pending, active or clearing
        self._observed_s = 0.0
        self._end = (0, 0, RETURNED)

    @property
    def stands(self) -> bool:
        """Whether it was raised and has not cleared."""
        return self.phase is _ACTIVE or self.phase is _CLEARING

    def step(
        self, condition: Condition, elapsed_s: float, before_us: int, now_us: int, value: float, reason: str = RETURNED
    ) -> Told | None:
        """Take a reading: `elapsed_s` of observed time after the one before it; what is new, or None.

        `reason` is why it does not count, where it does not.
        """
        if condition is _GAP:
            return None
        was, then = self.phase, NEXT[self.phase][condition]
        self._observed_s = self._observed_s + elapsed_s if then is was else 0.0
        if was is _NORMAL and then is _PENDING:
            self._begin(before_us, now_us)
        if was is _ACTIVE and then is not _ACTIVE:
            self._end = before_us, now_us, reason if condition is _OFF else RETURNED
        self.phase = self._ripe(then)
        if self.episode is None:
            return None
        self.episode.is_lost = False
        if condition is _BEYOND:
            self.episode.see(value)
        return self._told(self.episode, was, now_us)

    def step_clock(self, size_us: int) -> None:
        """The wall clock was stepped: what is to come is by the new one."""
        if self.episode is not None:
            self.episode.stepped_us += size_us
        earliest, latest, reason = self._end
        self._end = earliest + size_us, latest + size_us, reason

    def _begin(self, before_us: int, now_us: int) -> None:
        assert self.definition is not None
        limit, delay = self.definition.limit_c, self.definition.on_delay_s
        self.episode = Episode(self.station, self.port, self.side, self.detector, before_us, now_us, limit, delay)

    def _ripe(self, phase: Phase) -> Phase:
        """The phase itself, or what it becomes where its delay is over."""
        if self.definition is not None and phase is _PENDING and self._observed_s >= self.definition.on_delay_s - TOLERANCE_S:
            return _ACTIVE
        if self.definition is not None and phase is _CLEARING and self._observed_s >= self.definition.off_delay_s - TOLERANCE_S:
            return _NORMAL
        return phase

    def _told(self, episode: Episode, was: Phase, now_us: int) -> Told | None:
        if self.phase is _ACTIVE and episode.raised_us is None:
            episode.raised_us = now_us
            return News.RAISED, episode
        if self.phase is not _NORMAL:
            return None
        self.episode = None
        if was is _PENDING:
            return None
        earliest, latest, reason = self._end
        episode.end(earliest, latest, now_us, reason)
        return News.CLEARED, episode
