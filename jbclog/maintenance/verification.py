"""Verifications of tips against an external thermometer, their file, and the ones that a run cites.

*Offset*: the thermometer's reading minus the station's own. *Deviation from the setpoint*: the
reading minus the selected temperature, if known. PASS: both are within the limit; FAIL: one is not.
The default limit is ±15 °C, as practitioners quote IPC J-STD-001, appendix A2 (selected temperature
within ±15 °C of the measured tip temperature; the standard's own text was not seen). The values are
compared without their uncertainty; the text reports a difference to the limit that is smaller. The
offset's expanded uncertainty (k = 2) contains the station's resolution and spread, and the
instrument's uncertainty if stated.

INVALID: the instrument was past its due date. The verification is kept, and no run can cite it.

The *proposed adjustment* is the present one minus the offset, in whole °C, within -50..50 (manual
002, W-Axy). No manual prints the sign of an adjustment; a positive one is assumed to raise the tip
temperature. So write it by hand, and verify again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from enum import StrEnum
from math import sqrt
from pathlib import Path
from statistics import fmean, stdev
from typing import Final

from jbclog.core.chain import Chain, Content
from jbclog.core.clock import utc_text
from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.files import Kind
from jbclog.core.json_files import decoder
from jbclog.core.operating_system import sync_folder
from jbclog.core.rows import TipCheck

# -- station reading -------------------------------------------------------------------------------
# The station's own temperature while a thermometer is at the tip: the mean of several readings of a
# stable tip.
#
# A tip is *stable* if the tool is working, there are at least `LEAST` readings, their range is at
# most `STABLE_C`, and the setpoint did not change. Readings come in whole °C (manuals 000 and 002,
# R-TT), so their mean is uncertain by at least 1/√12 °C.

STABLE_C = 3.0
LEAST = 8
STEP_C = 1.0


@dataclass(frozen=True, slots=True)
class Own:
    """The station's reading of its tip. `n` is 0 if a person read the display; None: not read."""

    temperature_c: float
    n: int = 0
    sd_c: float | None = None
    setpoint_c: float | None = None
    adjust_c: float | None = None
    tool_name: str | None = None
    model: str | None = None

    @property
    def uncertainty_c(self) -> float:
        """Standard uncertainty of `temperature_c`, from resolution and spread of the mean."""
        spread = (self.sd_c or 0.0) / sqrt(self.n) if self.n else 0.0
        return sqrt(STEP_C**2 / 12 + spread**2)


def unstable(
    readings: Sequence[float], states: Sequence[str], settings: Sequence[float]
) -> str | None:
    """Return why these readings do not represent the tip; None if they do."""
    other = next((state for state in states if state not in ("working", "on")), None)
    if other is not None:
        return f"the tool is in {other}, not working: its tip is not at its setpoint"
    if len(readings) < LEAST:
        return f"only {len(readings)} readings, at least {LEAST} required"
    if len(set(settings)) > 1:
        return (
            f"its setpoint changed during the readings, from {settings[0]:g} to {settings[-1]:g} °C"
        )
    span = max(readings) - min(readings)
    if span > STABLE_C:
        return (
            f"the tip is not stable: it changed by {span:g} °C during the readings, at most"
            f" {STABLE_C:g} °C allowed"
        )
    return None


def own_of(
    readings: Sequence[float],
    setpoint_c: float | None,
    adjust_c: float | None = None,
    tool: str | None = None,
    model: str | None = None,
) -> Own:
    """Return the mean of readings of a stable tip."""
    return Own(fmean(readings), len(readings), stdev(readings), setpoint_c, adjust_c, tool, model)


# -- verification ----------------------------------------------------------------------------------

LIMIT_C = 15.0
MOST_ADJUST_C = 50
COVERAGE_FACTOR = 2.0
POSSIBLE_C = (-20.0, 600.0)  # range of a soldering tip's temperature, hot air included
LIMITS_C = (0.5, 100.0)


class Result(StrEnum):
    PASS = "pass"
    FAIL = "fail"
    INVALID = "invalid"


@dataclass(frozen=True, slots=True)
class Given:
    """A person's entries: the thermometer's reading and its evidence. `instrument_u_c`: expanded
    uncertainty (k = 2).
    """

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
    """A line of the file: times ISO 8601 UTC, temperatures °C; `seq` and `prev_sha256` are set when
    it is added.
    """

    seq: int
    time: str
    station: str
    port: int
    tip: str
    tool_name: str | None
    model: str | None
    reading_c: float
    station_c: float
    station_n: int
    station_sd_c: float | None
    setpoint_c: float | None
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
        """Whether a run can cite it, passed or failed."""
        return self.result in (Result.PASS, Result.FAIL)


def verify(given: Given, own: Own, now: datetime) -> Verification:
    """Return the verification, not yet in the file. Raises `UsageError` for impossible values."""
    _expect_possible(given)
    offset = round(given.reading_c - own.temperature_c, 2)
    known = COVERAGE_FACTOR * sqrt(
        own.uncertainty_c**2 + ((given.instrument_u_c or 0.0) / COVERAGE_FACTOR) ** 2
    )
    result, text = _outcome(given, own, offset, known, now)
    return Verification(
        seq=0,
        time=utc_text(now),
        station=given.station,
        port=given.port,
        tip=given.tip,
        tool_name=own.tool_name,
        model=own.model,
        reading_c=given.reading_c,
        station_c=round(own.temperature_c, 2),
        station_n=own.n,
        station_sd_c=None if own.sd_c is None else round(own.sd_c, 3),
        setpoint_c=own.setpoint_c,
        adjust_c=own.adjust_c,
        offset_c=offset,
        uncertainty_c=round(known, 2),
        limit_c=given.limit_c,
        instrument=given.instrument,
        instrument_u_c=given.instrument_u_c,
        due=given.due.isoformat(),
        result=result.value,
        text=text,
        proposed_adjust_c=_proposal(own, offset, result),
        by=given.by,
        note=given.note,
    )


def _expect_possible(given: Given) -> None:
    if not POSSIBLE_C[0] <= given.reading_c <= POSSIBLE_C[1]:
        raise UsageError(
            f"--reading {given.reading_c:g}: must be {POSSIBLE_C[0]:g} to {POSSIBLE_C[1]:g} °C"
        )
    if not LIMITS_C[0] <= given.limit_c <= LIMITS_C[1]:
        raise UsageError(
            f"--limit {given.limit_c:g}: must be {LIMITS_C[0]:g} to {LIMITS_C[1]:g} °C"
        )
    if given.instrument_u_c is not None and not 0 < given.instrument_u_c <= LIMITS_C[1]:
        raise UsageError(
            f"--instrument-u {given.instrument_u_c:g}: must be above 0 and at most"
            f" {LIMITS_C[1]:g} °C"
        )


def _outcome(
    given: Given, own: Own, offset: float, known: float, now: datetime
) -> tuple[Result, str]:
    if given.due < now.astimezone(UTC).date():
        return (
            Result.INVALID,
            (
                f"The instrument was due for calibration on {given.due}: its reading is not valid,"
                " and no run can cite it."
            ),
        )
    deviations = {"from the station's own reading": offset}
    if own.setpoint_c is not None:
        deviations["from the setpoint"] = round(given.reading_c - own.setpoint_c, 2)
    listed = " and ".join(f"{value:+.1f} °C {what}" for what, value in deviations.items())
    worst = max(abs(value) for value in deviations.values())
    result = Result.PASS if worst <= given.limit_c else Result.FAIL
    is_near = abs(worst - given.limit_c) < known
    near = (
        f" The difference to the limit is within the uncertainty (±{known:.1f} °C)."
        if is_near
        else ""
    )
    return result, f"The tip is {listed}; ±{given.limit_c:g} °C allowed.{near}"


def _proposal(own: Own, offset: float, result: Result) -> int | None:
    """Return the adjustment that removes the offset; None: unknown, impossible or not needed."""
    if (
        own.adjust_c is None
        or result is Result.INVALID
        or abs(offset) < own.uncertainty_c * COVERAGE_FACTOR
    ):
        return None
    wanted = round(own.adjust_c - offset)
    return wanted if abs(wanted) <= MOST_ADJUST_C and wanted != own.adjust_c else None


def needed_adjust_c(one: Verification) -> int | None:
    """Return the adjustment that removes the offset; None if the present one is not known."""
    return None if one.adjust_c is None else round(one.adjust_c - one.offset_c)


# -- verifications file ----------------------------------------------------------------------------
# It lies in the folder of runs, which a line's recorders share. Each line holds its own SHA-256 and
# that of the line before; the first line that of the file's name (`core/chain.py`). Each
# run's manifest has the hashes of the lines that the run cites, so that lines missing at the end
# show.

NAME: Final = "verifications.jsonl"

Book = Content[Verification]
"""Every verification, oldest first, with the hash of its line; problems of the file."""


def keep(out: Path, one: Verification) -> tuple[Verification, str]:
    """Append a verification to the file in `out`; return it as written, and the new head.

    Adds nothing to a file whose chain does not hold. Raises `RecordError`.
    """
    damage = read_book(out).damage
    if damage:
        raise RecordError(
            f"{out / NAME}: {damage[0]}; nothing was added. Restore the file from a copy, or move"
            " it away"
        )
    try:
        if not out.is_dir():
            out.mkdir(parents=True)
            sync_folder(out.absolute().parent)
        ((head, kept),) = _chain(out).append(one)
    except OSError as error:
        raise RecordError(f"{out / NAME} cannot be written: {write_failure(error, out)}") from error
    return kept, head


def read_book(out: Path) -> Book:
    """Return every verification in the folder `out`; none without a file. Raises `RecordError`."""
    try:
        return _chain(out).read()
    except OSError as error:
        raise RecordError(f"{out / NAME} cannot be read: {error.strerror or error}") from error


_read_verification: Final = decoder(Verification)


def _chain(out: Path) -> Chain[Verification]:
    return Chain(out / NAME, Kind.VERIFICATIONS, _read_verification, what="verification")


# -- cited -----------------------------------------------------------------------------------------
# The verification that a run cites for each port: the last valid one, of the run's tip if it names
# one.

DAY_S = 86400.0
NONE, OTHER_TIP, UNREADABLE = "none", "other tip", "unreadable"


def last_valid(
    book: Book, station: str, port: int, tip: str | None = None, before: datetime | None = None
) -> Verification | None:
    """Return the last valid verification of this port, of `tip` if given, not after `before`; None
    without one.
    """
    fitting = (
        one
        for one in reversed(book.entries)
        if (one.station, one.port) == (station, port)
        and one.is_valid
        and (tip is None or one.tip == tip)
        and (before is None or datetime.fromisoformat(one.time) <= before)
    )
    return next(fitting, None)


def cited(
    out: Path,
    places: Iterable[tuple[str, int]],
    tips: Mapping[tuple[str, int], str | None],
    begin: datetime,
) -> list[TipCheck]:
    """Return the verifications that a run in `out` cites for each place (station, port), if it
    begins at `begin`. Never raises.
    """
    try:
        book = read_book(out)
    except RecordError as error:
        return [TipCheck(station, port, UNREADABLE, str(error)) for station, port in places]
    return [_one(book, station, port, tips.get((station, port)), begin) for station, port in places]


def _one(book: Book, station: str, port: int, tip: str | None, begin: datetime) -> TipCheck:
    if book.damage:
        return TipCheck(station, port, UNREADABLE, f"{NAME} is damaged: {book.damage[0]}.")
    found = last_valid(book, station, port, tip, begin)
    if found is not None:
        return _tip_check(book, found, begin, found.result, found.text)
    other = last_valid(book, station, port, None, begin)
    if other is not None:
        return _tip_check(
            book,
            other,
            begin,
            OTHER_TIP,
            f"Its tip is {tip}; the last verification was of tip {other.tip}.",
        )
    return TipCheck(station, port, NONE, "No valid verification of its tip is known.")


def _tip_check(book: Book, one: Verification, begin: datetime, state: str, text: str) -> TipCheck:
    days = round(
        (begin.astimezone(UTC) - datetime.fromisoformat(one.time)).total_seconds() / DAY_S, 3
    )
    seen = (
        one.time,
        max(days, 0.0),
        one.tip,
        one.instrument,
        one.offset_c,
        one.limit_c,
        one.adjust_c,
        one.seq,
        next(link for link, entry in book.lines if entry is one),
    )
    return TipCheck(one.station, one.port, state, text, *seen)


def places_of(book: Book, station: str) -> Sequence[int]:
    """Return the ports of a station that were ever verified."""
    return sorted({one.port for one in book.entries if one.station == station})
