"""Carries out an audit, from line files to observations.

::

    line files -> SurveyTarget -> Survey, eight serial lines at a time -> the ledger, as each
    observation comes

Each observation is in the ledger at once, so that it is kept however the audit ends. A ledger that
is damaged or cannot be written does not change what the audit reports.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from jbclog.app.audit.questions import SurveyTarget
from jbclog.app.audit.records import PastRuns, past_runs, verified, with_never
from jbclog.app.audit.survey import Observed, Survey
from jbclog.app.connection import target_of
from jbclog.config.line import Line, StationSpec
from jbclog.config.tasks_file import Task
from jbclog.core.chain import sha256
from jbclog.core.errors import RecordError
from jbclog.maintenance.counter_totals.observed import Entry, Fact, Observation
from jbclog.maintenance.fleet import FleetAudit
from jbclog.maintenance.fleet_of_ledger import fleet_of
from jbclog.maintenance.ledger import Book, add, auditing, read_book, written
from jbclog.maintenance.station_errors import counted_until

SHOWN: Final = 5
STOPPED: Final = "the audit was stopped before this station was read"


@dataclass(slots=True)
class Audited:
    """The result of an audit. `seen` has an observation of every station of the lines.

    `kept` are those added to the ledger, `unkept` those that could not be; `book` is the ledger
    with them. `verified` has the verifications beside the runs. `trouble` lists the problems with
    all of these, `of_ledger` those with the ledger as a whole.
    """

    time: str
    book: Book
    seen: list[Observation] = field(default_factory=list)
    kept: list[Entry] = field(default_factory=list)
    unkept: list[Observation] = field(default_factory=list)
    verified: list[Fact] = field(default_factory=list)
    trouble: list[str] = field(default_factory=list)
    of_ledger: list[str] = field(default_factory=list)

    def ledger_fails(self, error: RecordError) -> None:
        """Take note that the ledger cannot be read or written."""
        self.trouble.append(str(error))
        self.of_ledger.append(str(error))


def audit_lines(
    lines: Sequence[Line],
    ledger: Path,
    survey: Survey,
    observed: Observed,
    runs: Path | None = None,
) -> Audited:
    """Read every station of `lines`; call `observed` with each observation. `runs` is the folder of
    their runs.

    Raises `AuditInProgress` if another audit uses this ledger; then nothing was read.
    """
    audited = Audited(survey.utc(), Book(ledger))
    with ExitStack() as held:
        try:
            held.enter_context(auditing(ledger))
        # without a lock nothing can be written; the observations are still reported
        except RecordError as error:
            audited.ledger_fails(error)
        audited.book = _read(ledger, audited)
        audited.trouble += _wrong_with(audited.book)
        wanted = _wanted(lines, audited)
        past = _past(runs, wanted, audited)

        def take(seen: Observation) -> None:
            seen = past.with_errors(seen)
            audited.seen.append(seen)
            _keep(ledger, seen, audited)
            observed(seen)

        survey.all(wanted, take)
        _keep_the_rest(ledger, audited)
    if audited.kept:  # a ledger of years is read only once
        head = sha256(written(audited.kept[-1]))
        audited.book = replace(
            audited.book, entries=[*audited.book.entries, *audited.kept], head=head
        )
    audited.seen += list(_not_asked(wanted, audited))
    return audited


def _read(ledger: Path, audited: Audited) -> Book:
    try:
        return read_book(ledger)
    except RecordError as error:
        audited.ledger_fails(error)
        return audited.book


def _wrong_with(book: Book) -> Sequence[str]:
    if book.is_sound or book.is_foreign:  # reported when nothing can be written
        return ()
    more = len(book.wrong) - SHOWN
    return [
        *book.sentences[:SHOWN],
        *([f"{book.path}: {more} other lines are wrong"] if more > 0 else []),
    ]


def _keep(ledger: Path, seen: Observation, audited: Audited) -> None:
    try:
        audited.book.expect_ledger()
        audited.kept += add(ledger, [seen])
    except RecordError:  # the disk may be full for a moment: tried again at the end
        audited.unkept.append(seen)


def _keep_the_rest(ledger: Path, audited: Audited) -> None:
    unkept, audited.unkept = audited.unkept, []
    if unkept:
        try:
            audited.book.expect_ledger()
            audited.kept += add(ledger, unkept)
        except RecordError as error:
            audited.unkept = unkept
            audited.ledger_fails(error)


def _wanted(lines: Sequence[Line], audited: Audited) -> list[SurveyTarget]:
    looks: dict[tuple[str, str], list[Observation]] = {}
    for one in audited.book.observations:
        if one.seen:
            looks.setdefault((one.line, one.station), []).append(one)
    return [
        SurveyTarget(
            audited.time,
            line.name,
            target_of(line, station.name),
            counted_until(looks.get((line.name, station.name), []), audited.time),
        )
        for line, station in _stations(lines)
    ]


def _past(runs: Path | None, wanted: Sequence[SurveyTarget], audited: Audited) -> PastRuns:
    """Read the folder of runs, before any station is read."""
    if runs is None:
        return PastRuns()
    places = [(one.line, one.target.name) for one in wanted]
    audited.verified, wrong = verified(runs, places)
    since = {
        place: one.since for place, one in zip(places, wanted, strict=True) if one.since is not None
    }
    past = past_runs(runs, since, audited.time)
    audited.trouble += [*wrong, *past.trouble]
    return past


def _not_asked(wanted: Sequence[SurveyTarget], audited: Audited) -> Iterator[Observation]:
    """Return observations of the stations that the audit did not reach. None is in the ledger."""
    asked = {(one.line, one.station) for one in audited.seen}
    return (
        one.unseen(audited.time, STOPPED)
        for one in wanted
        if (one.line, one.target.name) not in asked
    )


def fleet_audit(
    audited: Audited, lines: Sequence[Line], tasks: Sequence[Task], runs: Path | None = None
) -> FleetAudit:
    """Evaluate the audit with all that the ledger and the folder `runs` have of these stations."""
    watts = {
        (line.name, station.name): station.rated_power_w
        for line in lines
        for station in line.stations
        if station.rated_power_w is not None
    }
    order = {
        (line.name, station.name): place for place, (line, station) in enumerate(_stations(lines))
    }
    seen = sorted(audited.seen, key=lambda one: order[one.line, one.station])
    tasks = tasks if runs is None else with_never(tasks, runs)
    found = fleet_of(
        audited.book, seen, audited.time, tasks, watts, [*audited.unkept, *audited.verified]
    )
    return replace(found, not_kept=tuple(audited.of_ledger))


def _stations(lines: Sequence[Line]) -> Iterator[tuple[Line, StationSpec]]:
    return ((line, station) for line in lines for station in line.stations)
