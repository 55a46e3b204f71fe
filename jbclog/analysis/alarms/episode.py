"""One alarm from its onset to its end, both known only as an interval between two readings."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from typing import Final

from jbclog.analysis.alarms.definition import Side

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
