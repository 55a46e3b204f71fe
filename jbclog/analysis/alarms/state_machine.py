"""Alarms on samples: definition, arming, states and episodes (ISA-18.2).

::

    normal --beyond--> pending --beyond for the on delay--> active --back--> clearing --back for the off delay--> normal

Delays are measured in time that was observed: between two readings that follow each other. A gap changes no state and
stops the clock of a delay, so that it neither raises nor clears. What does not count ends everything at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import Enum, StrEnum
from typing import Final

# -- definition ---------------------------------------------------------------------------------------------------------------
# An alarm on samples: a limit, an on-delay, a deadband and an off-delay.
#
# Limit and delay are the station's, as read back (`settings`), so that both sides speak of the same thing. What no station
# holds is in `Rules`. An alarm whose limit or delay is off or not known is not evaluated.


class Side(StrEnum):
    """Which limit is passed."""

    HIGH = "high"
    LOW = "low"


class Condition(Enum):
    """What one reading says of one alarm."""

    GAP = "gap"  # nothing: it was not read
    NOT_COUNTED = "not counted"  # the tool does not work, has not come to its setting yet, or the alarm is off
    BEYOND = "beyond"
    IN_BAND = "in band"  # within the limit, and not yet by the dead band
    BACK = "back"


@dataclass(frozen=True, slots=True)
class Rules:
    """What the evaluation of samples adds to a station's limit and delay.

    `dead_band_c`: so far within the limit a reading must be to count as back. `off_delay_s`: so long must it be back; None is
    as long as the delay of the alarm. `stale_s`: without a reading for so long it is uncertain whether an alarm still stands.
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
        """What a reading of a tool that counts says. At the limit is not beyond it."""
        excess = value - self.limit_c if self.side is Side.HIGH else self.limit_c - value
        if excess > 0:
            return Condition.BEYOND
        return Condition.BACK if excess <= -self.dead_band_c else Condition.IN_BAND


LIMIT: Final = {Side.HIGH: "alarm_high_limit", Side.LOW: "alarm_low_limit"}
DELAY: Final = {Side.HIGH: "alarm_high_delay", Side.LOW: "alarm_low_delay"}
SETPOINTS: Final = frozenset(["selected_temperature", "selected_air_temperature"])
WATCHED: Final = frozenset([*LIMIT.values(), *DELAY.values(), *SETPOINTS])
"""The settings that an evaluation follows, by their names in `settings`."""


def number(text: str | None) -> float | None:
    """A setting as a number, ``380``, ``0.50 s``; None where it is off or not known."""
    try:
        return float(str(text).split(" ", 1)[0])
    except ValueError:
        return None


def defined(side: Side, held: dict[str, float | None], rules: Rules) -> Definition | None:
    """The alarm by what the station holds; None where it is off or not known."""
    limit, delay = held.get(LIMIT[side]), held.get(DELAY[side])
    if limit is None or delay is None:
        return None
    return Definition(side, limit, delay, delay if rules.off_delay_s is None else rules.off_delay_s, rules.dead_band_c)


def bare(definition: Definition | None) -> Definition | None:
    """The same limit without delays and dead band: every excursion that was sampled."""
    return None if definition is None else Definition(definition.side, definition.limit_c)


# -- arming -------------------------------------------------------------------------------------------------------------------
# An alarm counts once the tool has first reached its setpoint, by the same rows as in the session.
#
# The same rule as `session/run/watch.py` (docs/reference/exit-codes.md): at work, and
# within ±10 °C of the setting, or passed through it
# from one reading to the next, or found hotter than it and not cooling for ten seconds.

BAND_C: Final = 10
COOLS_WITHIN_S: Final = 10.0
WORKING: Final = frozenset(["working", "on"])


class Arrival:
    """Whether the tool in one port has come to its setting. A tool that was changed has not."""

    __slots__ = ("_above", "before_c", "has_come")

    def __init__(self) -> None:
        self.has_come = False
        self.before_c: float | None = None  # the reading before
        self._above: tuple[float, float] | None = None  # since when it is hotter than its setting, and how hot it was then

    def forget(self) -> None:
        """The tool was changed."""
        self.has_come, self._above = False, None

    def see(self, seconds: float, value: float, setting: float | None, *, works: bool) -> None:
        """Take a reading in °C at `seconds`."""
        if setting is not None and works and not self.has_come:
            self.has_come = self._enters(value, setting) or self._stays_above(seconds, value, setting)
            self._note_above(seconds, value, setting)
        self.before_c = value

    def _enters(self, value: float, setting: float) -> bool:
        passed = self.before_c is not None and (self.before_c < setting) != (value < setting)
        return passed or abs(value - setting) <= BAND_C

    def _stays_above(self, seconds: float, value: float, setting: float) -> bool:
        if value <= setting + BAND_C or self._above is None:
            return False
        since, then = self._above
        return seconds - since >= COOLS_WITHIN_S and value >= then

    def _note_above(self, seconds: float, value: float, setting: float) -> None:
        if value <= setting + BAND_C:
            self._above = None
        elif self._above is None or seconds - self._above[0] >= COOLS_WITHIN_S:
            self._above = seconds, value


# -- episode ------------------------------------------------------------------------------------------------------------------
# One alarm from start to end, each known as an interval between two readings.

_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


class Detector(StrEnum):
    """Who says so: A the station, by its flag; B our samples with delays and dead band; C every sampled excursion."""

    STATION = "A"
    SAMPLES = "B"
    AFTERWARDS = "C"


class State(StrEnum):
    """Whether it stands at the end of what is known. Whether it was acknowledged is a question of its own."""

    ACTIVE = "active"
    CLEARED = "cleared"
    UNCERTAIN = "uncertain"  # it stood when it was last read, too long ago


RETURNED: Final = "returned"
NOT_WORKING: Final = "not working"
TOOL_CHANGED: Final = "tool changed"
SWITCHED_OFF: Final = "switched off"


@dataclass(slots=True)
class Episode:
    """Times are UTC microseconds, temperatures °C.

    It began after `onset_earliest_us` (the last reading without it) and at `onset_us` at the latest (the first reading with
    it); it ended after `end_earliest_us`, at `end_us` at the latest. `raised_us` is when it was known: with B its delay was
    over, with A its flag was read. `peak_c` is the farthest that was sampled. `cleared_us`: when its end was known.
    `is_uncertain`: for some time in between nothing was read for so long that it may have ended and begun again.
    `is_confirmed`: for A, that a temperature which was read bears the flag out.
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
    is_lost: bool = False  # nothing was read of it for too long, and not since
    is_uncertain: bool = False
    is_confirmed: bool = True
    stepped_us: int = 0  # by how much the wall clock was stepped between its onset and its end

    @property
    def id(self) -> str:
        """Its name, the same however often it is computed: detector, side, station, port and the moment of its onset."""
        return f"{self.detector}-{self.side}-{self.station}-p{self.port}-{moment_text(self.onset_us)}"

    @property
    def state(self) -> State:
        if self.end_us is not None:
            return State.CLEARED
        return State.UNCERTAIN if self.is_lost else State.ACTIVE

    @property
    def seconds(self) -> float | None:
        """From the first reading with it to the first without it; None while it stands."""
        return None if self.end_us is None else (self.end_us - self.onset_us - self.stepped_us) / 1e6

    def see(self, value: float) -> None:
        """Take a reading into `peak_c`."""
        if self.peak_c is None or (value > self.peak_c if self.side is Side.HIGH else value < self.peak_c):
            self.peak_c = value

    def end(self, earliest_us: int, latest_us: int, known_us: int, reason: str) -> None:
        """It is over: between these two readings, as was known at `known_us`."""
        self.end_earliest_us, self.end_us, self.cleared_us, self.end_reason = earliest_us, latest_us, known_us, reason
        self.is_lost = False


def moment_text(micros: int) -> str:
    """``20261121T013205.123Z``: a moment in a name."""
    moment = _EPOCH + timedelta(microseconds=micros)
    return f"{moment:%Y%m%dT%H%M%S}.{micros // 1000 % 1000:03d}Z"


# -- state machine ------------------------------------------------------------------------------------------------------------


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
