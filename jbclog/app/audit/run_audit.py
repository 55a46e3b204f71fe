"""An audit from its line files to what it saw: the composition root of `jbclog audit`.

::

    line files -> Wanted -> counting.Looking, eight wires at a time -> the ledger, as each comes

What was seen is in the ledger as soon as it was seen, so that whatever ends the audit leaves it there. A ledger that is damaged
or cannot be written takes nothing from what is told.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from jbclog.app import connection
from jbclog.app.audit.questions import SurveyTarget
from jbclog.app.audit.records import PastRuns, past_runs, verified, with_never
from jbclog.app.audit.survey import Looking, Told
from jbclog.config.line import Line, StationSpec
from jbclog.config.tasks_file import Task
from jbclog.core.durable_files import sha256
from jbclog.core.errors import RecordError
from jbclog.maintenance.counter_totals.observed import Entry, Fact, Observation
from jbclog.maintenance.fleet import FleetAudit
from jbclog.maintenance.fleet_of_ledger import fleet_of
from jbclog.maintenance.ledger import Book, add, auditing, read_book, written
from jbclog.maintenance.use import counted_until

MOST_TOLD: Final = 5
STOPPED: Final = "the audit was stopped before it was asked"


@dataclass(slots=True)
class Audited:
    """What came of it. `seen` has an observation of every station of the lines.

    `kept` are those that were put in the ledger, `unkept` those that could not be; `book` is the ledger with them. `verified` is
    what the verifications beside the runs tell. `trouble` says what is wrong with all of these.
    """

    time: str
    book: Book
    seen: list[Observation] = field(default_factory=list)
    kept: list[Entry] = field(default_factory=list)
    unkept: list[Observation] = field(default_factory=list)
    verified: list[Fact] = field(default_factory=list)
    trouble: list[str] = field(default_factory=list)


def audit_lines(lines: Sequence[Line], ledger: Path, looking: Looking, told: Told, runs: Path | None = None) -> Audited:
    """Look at every station of `lines`; `told` is called with each as it was seen. `runs` is the folder of their runs.

    Raises `AuditGoesOn` where another audit is at work with this ledger; then nothing was asked.
    """
    audited = Audited(utc(), Book(ledger))
    with ExitStack() as held:
        try:
            held.enter_context(auditing(ledger))
        except RecordError as error:  # where no lock can be made no ledger can be written; what is seen is told all the same
            audited.trouble.append(str(error))
        audited.book = _read(ledger, audited)
        audited.trouble += _wrong_with(audited.book)
        wanted = _wanted(lines, audited)
        past = _past(runs, wanted, audited)

        def take(seen: Observation) -> None:
            seen = past.with_errors(seen)
            audited.seen.append(seen)
            _keep(ledger, seen, audited)
            told(seen)

        looking.all(wanted, take)
        _keep_the_rest(ledger, audited)
    if audited.kept:  # a ledger of years is read but once
        head = sha256(written(audited.kept[-1]))
        audited.book = replace(audited.book, entries=[*audited.book.entries, *audited.kept], head=head)
    audited.seen += list(_not_asked(wanted, audited))
    return audited


def utc() -> str:
    """Now, as the ledger has times."""
    return datetime.fromtimestamp(connection.means.clock.utc(), UTC).isoformat(timespec="milliseconds")


def _read(ledger: Path, audited: Audited) -> Book:
    try:
        return read_book(ledger)
    except RecordError as error:
        audited.trouble.append(str(error))
        return audited.book


def _wrong_with(book: Book) -> Sequence[str]:
    if book.is_sound or book.is_foreign:  # which is said when nothing can be kept
        return ()
    more = len(book.sentences) - MOST_TOLD
    return [*book.sentences[:MOST_TOLD], *([f"{book.path}: {more} other lines of it are wrong"] if more > 0 else [])]


def _keep(ledger: Path, seen: Observation, audited: Audited) -> None:
    try:
        audited.book.expect_ledger()
        audited.kept += add(ledger, [seen])
    except RecordError:  # a disk may be full for a moment; it is tried again
        audited.unkept.append(seen)


def _keep_the_rest(ledger: Path, audited: Audited) -> None:
    unkept, audited.unkept = audited.unkept, []
    if unkept:
        try:
            audited.book.expect_ledger()
            audited.kept += add(ledger, unkept)
        except RecordError as error:
            audited.unkept = unkept
            audited.trouble.append(str(error))


def _wanted(lines: Sequence[Line], audited: Audited) -> list[SurveyTarget]:
    looks: dict[tuple[str, str], list[Observation]] = {}
    for one in audited.book.observations:
        if one.seen:
            looks.setdefault((one.line, one.station), []).append(one)
    return [
        SurveyTarget(
            audited.time,
            line.name,
            connection.target_of(line, station.name),
            counted_until(looks.get((line.name, station.name), []), audited.time),
        )
        for line, station in _stations(lines)
    ]


def _past(runs: Path | None, wanted: Sequence[SurveyTarget], audited: Audited) -> PastRuns:
    """What the folder of runs tells, before any station is asked."""
    if runs is None:
        return PastRuns()
    places = [(one.line, one.target.name) for one in wanted]
    audited.verified, wrong = verified(runs, places)
    since = {place: one.since for place, one in zip(places, wanted, strict=True) if one.since is not None}
    past = past_runs(runs, since, audited.time)
    audited.trouble += [*wrong, *past.trouble]
    return past


def _not_asked(wanted: Sequence[SurveyTarget], audited: Audited) -> Iterator[Observation]:
    """Those that the audit did not come to. They are no observations, and not in the ledger."""
    asked = {(one.line, one.station) for one in audited.seen}
    return (one.unseen(audited.time, STOPPED) for one in wanted if (one.line, one.target.name) not in asked)


def fleet_audit(audited: Audited, lines: Sequence[Line], tasks: Sequence[Task], runs: Path | None = None) -> FleetAudit:
    """All that follows from it, and from all that the ledger and the folder `runs` have of these stations."""
    watts = {
        (line.name, station.name): station.rated_power_w
        for line in lines
        for station in line.stations
        if station.rated_power_w is not None
    }
    order = {(line.name, station.name): place for place, (line, station) in enumerate(_stations(lines))}
    seen = sorted(audited.seen, key=lambda one: order[one.line, one.station])
    tasks = tasks if runs is None else with_never(tasks, runs)
    return fleet_of(audited.book, seen, audited.time, tasks, watts, [*audited.unkept, *audited.verified])


def _stations(lines: Sequence[Line]) -> Iterator[tuple[Line, StationSpec]]:
    return ((line, station) for line in lines for station in line.stations)
