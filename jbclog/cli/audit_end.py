"""The result of an audit: table, files and exit code."""

from __future__ import annotations

import signal
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from jbclog.app.audit.run_audit import STOPPED
from jbclog.cli.output import echo, echo_json, note, table_lines
from jbclog.core.disk_space import write_failure
from jbclog.core.durable_files import write_whole
from jbclog.core.errors import RecordError
from jbclog.core.text import clean
from jbclog.maintenance.counter_totals.observed import Standing
from jbclog.maintenance.due import State, TaskState
from jbclog.maintenance.fleet import ABSENT, Finding, FleetAudit, Meter, StationAudit, exit_code
from jbclog.report.audit.files import plain_audit, sheet_of
from jbclog.report.audit.overview import (
    STATES,
    DueRow,
    baseline,
    day,
    is_baseline,
    of_life,
    overview_of,
    percent,
    window,
)

if TYPE_CHECKING:
    from collections.abc import Callable

# -- table: the most urgent station first, below it what to do and what to check -------------------

NO_ERROR: Final = frozenset({"ok", "normal, ready"})
SHOWN: Final = "work_h"


def lines(audit: FleetAudit) -> list[str]:
    """Return the headline and the table, a line per row."""
    glance = overview_of(audit)
    several = len({one.line for one in audit.stations}) > 1
    rows = [
        cells
        for row in glance.rows
        for cells in _rows(row, f"{row.station.line}/" if several else "")
    ]
    next_steps = baseline(audit) if is_baseline(audit) else ()
    return [clean(" ".join(glance.headline[1:]).strip()), *next_steps, *table_lines((), rows)]


def _rows(row: DueRow, line: str) -> Iterator[tuple[str, str, str]]:
    yield (
        row.state[2].upper() if _is_bad(row) else row.state[2],
        f"{line}{row.station.station}",
        _station_text(row),
    )
    yield from (("", word, text) for word, text in _below(row))


def _is_bad(row: DueRow) -> bool:
    return not row.station.seen or (
        row.worst is not None and row.worst.state in (State.OVERDUE, State.DUE)
    )


def _station_text(row: DueRow) -> str:
    one, who = row.station, row.station.identity
    if not one.seen:
        return f"{one.why} (last seen: {day(one.last_seen)})"
    model = "" if who is None else " ".join(filter(None, (who.model or who.family, who.software)))
    worked = ", ".join(
        f"{_read(meter)} h (port {meter.port})" for meter in one.meters if meter.counter == SHOWN
    )
    source = (
        f"from {one.source.replace('run:', 'the run ', 1)}" if one.source.startswith("run:") else ""
    )
    return "  ".join(filter(None, (model, worked and f"worked {worked}", source)))


def _read(meter: Meter) -> str:
    return "?" if meter.read is None or meter.read.value is None else f"{meter.read.value:g}"


def _below(row: DueRow) -> Iterator[tuple[str, str]]:
    """Yield label and text: first what to do, then what to check."""
    one = row.station
    yield from (
        (STATES[task.state][2], _task(task))
        for task in row.tasks
        if task.state is not State.FINE or task.told_by
    )
    if one.question:
        yield "suspect", one.question
    yield from (
        ("suspect", f"{_place(doubt.port)}{doubt.counter}: {doubt.text}") for doubt in one.doubts
    )
    if one.seen:
        yield from (("unread", text) for text in map(_unread, one.meters) if text)
        yield from (("error", text) for text in _errors(one))
        yield from [("note", one.why)] if one.why else []
    yield from (("drift", f"{drift.name}: {drift.text}") for drift in one.drifts)
    yield from (("note", text) for text in one.notes)


def _task(task: TaskState) -> str:
    part = f" ({task.part})" if task.part else ""
    if task.percent is None:
        return (
            f"{_place(task.port)}{task.title or task.task}{part}: {task.why or 'not known'}"
            f" (interval: {_interval(task)})"
        )
    source = f"; {task.told_by}" if task.told_by else ""
    return (
        f"{_place(task.port)}{task.title or task.task}{part}: {percent(task.percent)},"
        f" {of_life(task)}; {_due(task)}{source}"
    )


def _interval(task: TaskState) -> str:
    return of_life(task).partition(" of ")[2]


def _due(task: TaskState) -> str:
    when = window(task)
    return (
        f"due between {when.replace(' to ', ' and ')}"
        if task.due is not None and task.due.p90 and task.due.p10
        else when
    )


def _unread(meter: Meter) -> str:
    read = meter.read
    if read is None or read.standing is Standing.OK or read.why == ABSENT:
        return ""
    if read.standing is Standing.MOVING:
        values = ", ".join(f"{value:g}" for value in read.values)
        return f"{_place(meter.port)}{meter.counter}: moving, {values}"
    return f"{_place(meter.port)}{meter.counter}: {read.why}"


def _errors(one: StationAudit) -> Iterator[str]:
    if one.errors is None:
        return
    if one.errors.station is not None and one.errors.station not in NO_ERROR:
        yield one.errors.station
    yield from (
        f"{_place(port)}{text}" for port, text in one.errors.ports.items() if text not in NO_ERROR
    )
    if one.errors.events:
        yield "since the last audit, from runs: " + ", ".join(
            f"{count} {kind}" for kind, count in one.errors.events.items()
        )


def _place(port: int | None) -> str:
    return "" if port is None else f"port {port} "


# -- end -------------------------------------------------------------------------------------------

SIGNALLED = 128


@dataclass(slots=True)
class End:
    """Result of an audit. `trouble`: errors of the ledger, of runs and of output files. `stopped`:
    the signal that ended it.
    """

    audit: FleetAudit
    trouble: list[str]
    fail_on: Collection[Finding]
    stopped: signal.Signals | None = None
    files: list[str] = field(default_factory=list)

    @property
    def code(self) -> int:
        """Most severe exit code (docs/reference/exit-codes.md): 4, 3, a signal, 1."""
        asked = tuple(one for one in self.audit.stations if one.why != STOPPED)
        found = exit_code(replace(self.audit, stations=asked), self.fail_on)
        if self.trouble:
            return RecordError.exit_code
        if self.stopped is not None and found < 3:
            return SIGNALLED + self.stopped
        return found

    def write(self, html: Path | None, csv: Path | None) -> None:
        """Write the output files, each whole or not at all."""
        if csv is not None:
            self._write(csv, sheet_of)
        if html is not None:
            self._write(html, _page)

    def _write(self, path: Path, make: Callable[[FleetAudit], str]) -> None:
        try:
            write_whole(path, make(self.audit).encode())
            self.files.append(str(path))
        except OSError as error:
            self.trouble.append(f"{path}: cannot write: {write_failure(error, path)}")

    def show(self, *, as_json: bool) -> None:
        """Print the result on stdout, errors and files on stderr."""
        if as_json:
            beside = {"trouble": self.trouble, "files": self.files}
            echo_json(plain_audit(self.audit) | beside | {"exit_code": self.code})
        else:
            echo(*lines(self.audit))
        for text in self.trouble:
            note(f"error: {text}")
        for path in self.files:
            note(f"written: {path}")


def _page(audit: FleetAudit) -> str:
    from jbclog.report.audit.page import page_of

    return page_of(audit)
