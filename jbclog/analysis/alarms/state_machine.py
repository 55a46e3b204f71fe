"""One alarm on samples: definition, states and episodes (ISA-18.2).

::

    normal --beyond--> pending --beyond for the on-delay--> active
    active --back--> clearing --back for the off-delay--> normal

Limit and delay are the station's, as read back (`settings`), so that its flags and our samples are
judged by the same limits. An alarm whose limit or delay is off or unknown is not evaluated.

Delays count observed time: between two consecutive readings. A gap changes no state and pauses a
delay, so it neither raises nor clears. A reading that does not count (tool not working, alarm off)
ends an episode at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum
from math import isfinite
from typing import Final

from jbclog.core.clock import utc_of


class Side(StrEnum):
    """The exceeded limit."""

    HIGH = "high"
    LOW = "low"


LIMIT: Final = {Side.HIGH: "alarm_high_limit", Side.LOW: "alarm_low_limit"}
DELAY: Final = {Side.HIGH: "alarm_high_delay", Side.LOW: "alarm_low_delay"}
SETPOINTS: Final = frozenset(["selected_temperature", "selected_air_temperature"])
WATCHED: Final = frozenset([*LIMIT.values(), *DELAY.values(), *SETPOINTS])
"""Settings that the evaluation needs, by their names in `settings`."""

TOLERANCE_S: Final = 1e-6  # rounding of sums of periods
RETURNED: Final = "returned"
NOT_WORKING: Final = "not working"
TOOL_CHANGED: Final = "tool changed"
SWITCHED_OFF: Final = "switched off"
"""Reasons for the end of an episode; `end_reason` in the table of alarms."""


class Condition(Enum):
    """Result of one reading for one alarm."""

    GAP = "gap"  # not read
    # the tool does not work or has not reached its setpoint, or the alarm is off
    NOT_COUNTED = "not counted"
    BEYOND = "beyond"
    IN_BAND = "in band"  # within the limit, but not by the deadband
    BACK = "back"


@dataclass(frozen=True, slots=True)
class Rules:
    """Parameters of the evaluation beside a station's limit and delay.

    `dead_band_c`: how far within the limit a reading counts as back. `off_delay_s`: how long it
    must stay back; None: as long as the on-delay. `stale_s`: after this time without a reading it
    is uncertain whether the alarm is still active.
    """

    dead_band_c: float = 2.0
    off_delay_s: float | None = None
    stale_s: float = 60.0


@dataclass(frozen=True, slots=True)
class Definition:
    """One alarm of one port, in °C and seconds."""

    side: Side
    limit_c: float
    on_delay_s: float = 0.0
    off_delay_s: float = 0.0
    dead_band_c: float = 0.0

    def condition(self, value: float) -> Condition:
        """Return the condition for a reading that counts; a reading at the limit is not beyond
        it.
        """
        excess = value - self.limit_c if self.side is Side.HIGH else self.limit_c - value
        if excess > 0:
            return Condition.BEYOND
        return Condition.BACK if excess <= -self.dead_band_c else Condition.IN_BAND

    def without_delays(self) -> Definition:
        """Return the same limit without delays and deadband: every sampled excursion counts."""
        return Definition(self.side, self.limit_c)


def definition_of(side: Side, settings: dict[str, float | None], rules: Rules) -> Definition | None:
    """Return the alarm that the station's settings define; None if it is off or not known."""
    limit, delay = settings.get(LIMIT[side]), settings.get(DELAY[side])
    if limit is None or delay is None:
        return None
    return Definition(
        side,
        limit,
        delay,
        delay if rules.off_delay_s is None else rules.off_delay_s,
        rules.dead_band_c,
    )


def number_of(text: str | None) -> float | None:
    """Return the number in a setting such as ``380`` or ``0.50 s``; None: off or not known.
    ``inf``, as a damaged setting may have, is none.
    """
    try:
        number = float(str(text).split(" ", 1)[0])
    except ValueError:
        return None
    return number if isfinite(number) else None


class Detector(StrEnum):
    """Detector of an episode: A the station by its flag, B our samples with delays and deadband, C
    every sampled excursion.
    """

    STATION = "A"
    SAMPLES = "B"
    AFTERWARDS = "C"


class State(StrEnum):
    """Whether an episode is active at the end of the record; independent of acknowledgement."""

    ACTIVE = "active"
    CLEARED = "cleared"
    UNCERTAIN = "uncertain"  # active at the last reading, too long ago


@dataclass(slots=True)
class Episode:
    """One alarm from start to end, each known as an interval between two readings. Times are UTC
    microseconds, temperatures °C.

    - `onset_earliest_us`, `onset_us`: last reading without the alarm, first reading with it
    - `end_earliest_us`, `end_us`: last reading with the alarm, first reading without it
    - `raised_us`: when it became known: for A when the flag was read, for B at the end of the delay
    - `cleared_us`: when its end became known
    - `peak_c`: the sampled peak
    - `is_uncertain`: nothing was read for so long that it may have ended and begun again
    - `is_confirmed`: for A, a temperature supports the flag
    - `stepped_us`: clock steps between onset and end
    - `unread_us`: unread time between onset and end; `unread_before_us`: right before the onset
    """

    station: str
    port: int
    side: Side
    detector: Detector
    onset_earliest_us: int
    onset_us: int
    limit_c: float | None
    on_delay_s: float | None = None
    raised_us: int | None = None
    peak_c: float | None = None
    end_earliest_us: int | None = None
    end_us: int | None = None
    cleared_us: int | None = None
    end_reason: str | None = None
    is_lost: bool = False  # not read for too long, and not since
    is_uncertain: bool = False
    is_confirmed: bool = True
    stepped_us: int = 0
    unread_us: int = 0
    unread_before_us: int = 0

    @property
    def id(self) -> str:
        """Reproducible name: detector, side, station, port and onset."""
        return (
            f"{self.detector}-{self.side}-{self.station}-p{self.port}-{moment_text(self.onset_us)}"
        )

    @property
    def state(self) -> State:
        if self.end_us is not None:
            return State.CLEARED
        return State.UNCERTAIN if self.is_lost else State.ACTIVE

    @property
    def seconds(self) -> float | None:
        """Time from the first reading with the alarm to the first without it; None before its
        end.
        """
        return (
            None if self.end_us is None else (self.end_us - self.onset_us - self.stepped_us) / 1e6
        )

    @property
    def seconds_least(self) -> float | None:
        """`seconds` without the unread time; None before its end, and if all of it was read."""
        seconds = self.seconds
        if seconds is None or not self._has_unread:
            return None
        return max(seconds - self.unread_us / 1e6, 0.0)

    @property
    def seconds_most(self) -> float | None:
        """`seconds` with the unread time right before the onset; None as `seconds_least`."""
        seconds = self.seconds
        if seconds is None or not self._has_unread:
            return None
        return seconds + self.unread_before_us / 1e6

    @property
    def _has_unread(self) -> bool:
        return self.unread_us > 0 or self.unread_before_us > 0

    def see(self, value: float) -> None:
        """Update `peak_c` with a reading."""
        if self.peak_c is None or (
            value > self.peak_c if self.side is Side.HIGH else value < self.peak_c
        ):
            self.peak_c = value

    def end(self, earliest_us: int, latest_us: int, known_us: int, reason: str) -> None:
        """End the episode between two readings; the end became known at `known_us`."""
        self.end_earliest_us, self.end_us, self.cleared_us, self.end_reason = (
            earliest_us,
            latest_us,
            known_us,
            reason,
        )
        self.is_lost = False


def moment_text(micros: int) -> str:
    """Return a UTC time for use in a name: ``20261121T013205.123Z``."""
    return f"{utc_of(micros):%Y%m%dT%H%M%S}.{micros // 1000 % 1000:03d}Z"


class Phase(Enum):
    """State of a `Machine`; in the phases active and clearing an episode is raised."""

    NORMAL = "normal"
    PENDING = "pending"
    ACTIVE = "active"
    CLEARING = "clearing"


class Transition(Enum):
    """A reported change of an episode; the value is the last part of the event's kind."""

    RAISED = "raised"
    CLEARED = "cleared"
    UNCERTAIN = "uncertain"


Report = tuple[Transition, Episode]

_GAP, _OFF, _BEYOND, _BAND, _BACK = Condition
_NORMAL, _PENDING, _ACTIVE, _CLEARING = Phase

NEXT: Final = {
    _NORMAL: {_GAP: _NORMAL, _OFF: _NORMAL, _BEYOND: _PENDING, _BAND: _NORMAL, _BACK: _NORMAL},
    _PENDING: {_GAP: _PENDING, _OFF: _NORMAL, _BEYOND: _PENDING, _BAND: _NORMAL, _BACK: _NORMAL},
    _ACTIVE: {_GAP: _ACTIVE, _OFF: _NORMAL, _BEYOND: _ACTIVE, _BAND: _ACTIVE, _BACK: _CLEARING},
    _CLEARING: {_GAP: _CLEARING, _OFF: _NORMAL, _BEYOND: _ACTIVE, _BAND: _ACTIVE, _BACK: _CLEARING},
}
"""Phase and condition -> next phase. At the end of its delay, pending becomes active, and clearing
becomes normal.
"""


class Machine:
    """One alarm of one port by one detector. `definition` None: the alarm is off, or not known."""

    __slots__ = (
        "_end",
        "_observed_s",
        "_unread_us",
        "definition",
        "detector",
        "episode",
        "phase",
        "port",
        "side",
        "station",
    )

    def __init__(self, station: str, port: int, side: Side, detector: Detector) -> None:
        self.station, self.port, self.side, self.detector = station, port, side, detector
        self.definition: Definition | None = None
        self.phase = _NORMAL
        self.episode: Episode | None = None  # pending, active or clearing
        self._observed_s = 0.0
        self._end = (0, 0, RETURNED, 0)
        self._unread_us = 0  # since the onset

    @property
    def is_raised(self) -> bool:
        """Whether an episode was raised and has not cleared."""
        return self.phase is _ACTIVE or self.phase is _CLEARING

    def step(
        self,
        condition: Condition,
        elapsed_s: float,
        before_us: int,
        now_us: int,
        value: float,
        reason: str = RETURNED,
        unread_us: int = 0,
    ) -> Report | None:
        """Process the reading at `now_us` and return the change it makes, or None.

        The previous reading was at `before_us`; `elapsed_s` of the time between them was observed,
        or `unread_us` of it was not read. `reason` is the end reason for a reading that does not
        count.
        """
        if condition is _GAP:
            return None
        before, after = self.phase, NEXT[self.phase][condition]
        self._observed_s = self._observed_s + elapsed_s if after is before else 0.0
        self._unread_us += unread_us
        if before is _NORMAL and after is _PENDING:
            self._begin(before_us, now_us, unread_us)
        if before is _ACTIVE and after is not _ACTIVE:
            why = reason if condition is _OFF else RETURNED
            self._end = before_us, now_us, why, self._unread_us
        self.phase = self._after_delay(after)
        if self.episode is None:
            return None
        self.episode.is_lost = False
        if condition is _BEYOND:
            self.episode.see(value)
        return self._report(self.episode, before, now_us)

    def step_clock(self, size_us: int) -> None:
        """Follow a step of the wall clock: later readings have times of the new clock."""
        if self.episode is not None:
            self.episode.stepped_us += size_us
        earliest, latest, reason, unread_us = self._end
        self._end = earliest + size_us, latest + size_us, reason, unread_us

    def _begin(self, before_us: int, now_us: int, unread_us: int) -> None:
        assert self.definition is not None
        limit, delay = self.definition.limit_c, self.definition.on_delay_s
        self.episode = Episode(
            self.station, self.port, self.side, self.detector, before_us, now_us, limit, delay
        )
        self.episode.unread_before_us = unread_us
        self._unread_us = 0

    def _after_delay(self, phase: Phase) -> Phase:
        """Return the phase, or the next one if its delay is over."""
        if (
            self.definition is not None
            and phase is _PENDING
            and self._observed_s >= self.definition.on_delay_s - TOLERANCE_S
        ):
            return _ACTIVE
        if (
            self.definition is not None
            and phase is _CLEARING
            and self._observed_s >= self.definition.off_delay_s - TOLERANCE_S
        ):
            return _NORMAL
        return phase

    def _report(self, episode: Episode, before: Phase, now_us: int) -> Report | None:
        if self.phase is _ACTIVE and episode.raised_us is None:
            episode.raised_us = now_us
            return Transition.RAISED, episode
        if self.phase is not _NORMAL:
            return None
        self.episode = None
        if before is _PENDING:
            return None
        earliest, latest, reason, episode.unread_us = self._end
        episode.end(earliest, latest, now_us, reason)
        return Transition.CLEARED, episode
