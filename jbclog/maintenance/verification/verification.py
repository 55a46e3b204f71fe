"""One verification of a tip against an external thermometer, with the station's own reading.

*Offset*: the thermometer's reading minus the station's own. *Deviation from the setting*: the reading minus the selected
temperature, where that is known. PASS where both are within the limit, either way; FAIL where one is not. The limit is ±15 °C
where none is stated: what practitioners quote of IPC J-STD-001, appendix A2 (selected temperature within ±15 °C of the measured
tip temperature; the standard's own text was not seen). The figures are compared as they are, without their uncertainty; where
that reaches over the limit, it is said. The expanded uncertainty (k = 2) of the offset is made of the station's steps and
spread, and of the instrument's own where it is stated; where it is not, so it says.

INVALID where the instrument was past its due date on the day: it is kept, and no run stands on it. (A verification cannot be
*failed* by an instrument that proves nothing, either.)

The *proposal* is the present adjustment less the offset, in whole °C, within -50..50 (manual 002, W-Axy). No manual prints which
way an adjustment acts; it is taken to raise the tip. So it is a proposal to be looked at, written by hand, and verified again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from enum import StrEnum
from math import sqrt
from statistics import fmean, stdev

from jbclog.core.errors import UsageError

# -- station reading ----------------------------------------------------------------------------------------------------------
# The station's own temperature while a thermometer is at the tip: the mean of several readings of a tip that stands still.
#
# The tip *stands still* where it works, at least `LEAST` readings are there, the greatest and the least of them are no more than
# `STILL_C` apart, and the setting was the same before and after them. Readings come in whole °C (manuals 000 and 002, R-TT), which
# puts a floor of 1/√12 °C under what their mean can be known to.

STILL_C = 3.0
LEAST = 8
STEP_C = 1.0


@dataclass(frozen=True, slots=True)
class Own:
    """What the station said of its tip. `n` is 0 where a person read its display; what was not read is None."""

    temperature_c: float
    n: int = 0
    sd_c: float | None = None
    set_c: float | None = None
    adjust_c: float | None = None
    tool: str | None = None
    model: str | None = None

    @property
    def uncertainty_c(self) -> float:
        """The standard uncertainty of `temperature_c`: its steps, and the spread of its mean."""
        spread = (self.sd_c or 0.0) / sqrt(self.n) if self.n else 0.0
        return sqrt(STEP_C**2 / 12 + spread**2)


def unstable(readings: Sequence[float], states: Sequence[str], settings: Sequence[float]) -> str | None:
    """Why these readings cannot stand for the tip, in a sentence; None where they can."""
    other = next((state for state in states if state not in ("working", "on")), None)
    if other is not None:
        return f"the tool is in {other}, not working: its tip is not at its setting"
    if len(readings) < LEAST:
        return f"only {len(readings)} of its readings came; it takes {LEAST}"
    if len(set(settings)) > 1:
        return f"its setting was changed meanwhile, from {settings[0]:g} to {settings[-1]:g} °C"
    span = max(readings) - min(readings)
    if span > STILL_C:
        return f"the tip does not stand still: it moved by {span:g} °C while it was read, {STILL_C:g} °C are allowed"
    return None


def own_of(
    readings: Sequence[float], set_c: float | None, adjust_c: float | None = None, tool: str | None = None, model: str | None = None
) -> Own:
    """The mean of readings of a tip that stands still."""
    return Own(fmean(readings), len(readings), stdev(readings), set_c, adjust_c, tool, model)


# -- verification -------------------------------------------------------------------------------------------------------------

LIMIT_C = 15.0
MOST_ADJUST_C = 50
COVERAGE_FACTOR = 2.0
POSSIBLE_C = (-20.0, 600.0)  # what a thermometer can say of a soldering tip, hot air included
LIMITS_C = (0.5, 100.0)


class Result(StrEnum):
    PASS = "pass"
    FAIL = "fail"
    INVALID = "invalid"


@dataclass(frozen=True, slots=True)
class Given:
    """What a person brings: the thermometer's reading and what it can be believed by. `instrument_u_c` is expanded (k = 2)."""

    station: str
    port: int
    reading_c: float
    instrument: str
    due: date
    tip: str
    by: str
    limit_c: float = LIMIT_C
    instrument_u_c: float | None = None
    note: str = ""


@dataclass(frozen=True, slots=True)
class Verification:
    """As it is kept: times ISO 8601 UTC, temperatures °C; `seq` and `prev_sha256` are the file's (`book`)."""

    seq: int
    time: str
    station: str
    port: int
    tip: str
    tool: str | None
    model: str | None
    reading_c: float
    station_c: float
    station_n: int
    station_sd_c: float | None
    set_c: float | None
    adjust_c: float | None
    offset_c: float
    uncertainty_c: float
    limit_c: float
    instrument: str
    instrument_u_c: float | None
    due: str
    result: str
    text: str
    proposed_adjust_c: int | None
    by: str
    note: str
    prev_sha256: str = ""

    @property
    def is_valid(self) -> bool:
        """Whether a run can stand on it, well or badly."""
        return self.result in (Result.PASS, Result.FAIL)


def verify(given: Given, own: Own, now: datetime) -> Verification:
    """How it comes out; nothing is kept yet. Raises `UsageError` for what no thermometer says of a tip."""
    _expect_possible(given)
    offset = round(given.reading_c - own.temperature_c, 2)
    known = COVERAGE_FACTOR * sqrt(own.uncertainty_c**2 + ((given.instrument_u_c or 0.0) / COVERAGE_FACTOR) ** 2)
    result, text = _outcome(given, own, offset, known, now)
    return Verification(
        0,
        now.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ"),
        given.station,
        given.port,
        given.tip,
        own.tool,
        own.model,
        given.reading_c,
        round(own.temperature_c, 2),
        own.n,
        None if own.sd_c is None else round(own.sd_c, 3),
        own.set_c,
        own.adjust_c,
        offset,
        round(known, 2),
        given.limit_c,
        given.instrument,
        given.instrument_u_c,
        given.due.isoformat(),
        result.value,
        text,
        _proposal(own, offset, result),
        given.by,
        given.note,
    )


def _expect_possible(given: Given) -> None:
    if not POSSIBLE_C[0] <= given.reading_c <= POSSIBLE_C[1]:
        raise UsageError(f"--reading {given.reading_c:g}: a tip has {POSSIBLE_C[0]:g} to {POSSIBLE_C[1]:g} °C")
    if not LIMITS_C[0] <= given.limit_c <= LIMITS_C[1]:
        raise UsageError(f"--limit {given.limit_c:g}: give °C from {LIMITS_C[0]:g} to {LIMITS_C[1]:g}")
    if given.instrument_u_c is not None and not 0 < given.instrument_u_c <= LIMITS_C[1]:
        raise UsageError(f"--instrument-u {given.instrument_u_c:g}: give °C above 0 and up to {LIMITS_C[1]:g}")


def _outcome(given: Given, own: Own, offset: float, known: float, now: datetime) -> tuple[Result, str]:
    if given.due < now.astimezone(UTC).date():
        return Result.INVALID, f"The instrument was due on {given.due}: what it says proves nothing, and no run can stand on it."
    away = {"from the station's own reading": offset}
    if own.set_c is not None:
        away["from the setting"] = round(given.reading_c - own.set_c, 2)
    told = " and ".join(f"{value:+.1f} °C {what}" for what, value in away.items())
    worst = max(abs(value) for value in away.values())
    result = Result.PASS if worst <= given.limit_c else Result.FAIL
    near = f" That is nearer to the limit than it is known (±{known:.1f} °C)." if abs(worst - given.limit_c) < known else ""
    return result, f"The tip is {told}; ±{given.limit_c:g} °C allowed.{near}"


def _proposal(own: Own, offset: float, result: Result) -> int | None:
    """The adjustment that would bring the two together; None where it is not known, or none is needed."""
    if own.adjust_c is None or result is Result.INVALID or abs(offset) < own.uncertainty_c * COVERAGE_FACTOR:
        return None
    wanted = round(own.adjust_c - offset)
    return wanted if abs(wanted) <= MOST_ADJUST_C and wanted != own.adjust_c else None


def needed_adjust_c(one: Verification) -> int | None:
    """The adjustment that it would take, within what a station takes or not; None where the present one is not known."""
    return None if one.adjust_c is None else round(one.adjust_c - one.offset_c)
