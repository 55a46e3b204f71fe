"""`jbclog audit`: counters, hours worked and maintenance due."""

from __future__ import annotations

import os
import signal
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import is_terminal, note, reports_errors
from jbclog.core.errors import UsageError
from jbclog.core.text import count_text

if TYPE_CHECKING:
    from jbclog.app.audit.survey import Survey
    from jbclog.cli.audit_end import End
    from jbclog.config.line import Line
    from jbclog.config.tasks_file import Task
    from jbclog.maintenance.counter_totals.observed import Observation
    from jbclog.maintenance.fleet import Finding

# -- output files ----------------------------------------------------------------------------------


def check_files(made: Mapping[str, Path | None], kept: Sequence[Path]) -> None:
    """Check, before anything is sent, that each output file can be written and replaces no input.

    `made`: output files by option. `kept`: files that must not be overwritten. Raises `UsageError`.
    """
    known = {os.path.realpath(path): str(path) for path in kept}
    for option, path in made.items():
        if path is not None:
            _check(option, path)
            if os.path.realpath(path) in known:
                raise UsageError(
                    f"{option} {path}: would overwrite {known[os.path.realpath(path)]}"
                )
            known[os.path.realpath(path)] = option


def _check(option: str, path: Path) -> None:
    if str(path) == "-":
        raise UsageError(f"{option} -: give a file (--json writes to stdout)")
    if not path.absolute().parent.is_dir():
        raise UsageError(f"{option} {path}: no such folder: {path.absolute().parent}")
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise UsageError(f"{option} {path}: not a regular file (folder, device or link)")


# -- audit -----------------------------------------------------------------------------------------

LEDGER = typer.Option(
    ...,
    "--ledger",
    metavar="FILE",
    help="Counter ledger; created if missing, append-only.",
    show_default=False,
)
LINES = typer.Option(
    ..., "--line", "-l", metavar="FILE", help="Line file; repeatable.", show_default=False
)
RUNS = typer.Option(
    None,
    "--runs",
    metavar="DIR",
    help="Folder of runs, for errors and tip verifications.",
    show_default=False,
)
HTML = typer.Option(
    None,
    "--html",
    metavar="FILE",
    help="Write an HTML page, one row per station.",
    show_default=False,
)


@reports_errors
def audit(
    ctx: typer.Context,
    line: list[Path] = LINES,
    ledger: Path = LEDGER,
    tasks: Path | None = typer.Option(
        None,
        "--tasks",
        metavar="FILE",
        help="Maintenance tasks with their service intervals (TOML).",
        show_default=False,
    ),
    runs: Path | None = RUNS,
    html: Path | None = HTML,
    csv: Path | None = typer.Option(
        None, "--csv", metavar="FILE", help="Write all values as CSV.", show_default=False
    ),
    fail_on: str | None = typer.Option(
        None,
        "--fail-on",
        metavar="LIST",
        help="Findings that set the exit code: overdue,due,soon,suspect,drift,unseen; or none.",
    ),
    quiet: bool = typer.Option(False, "--quiet", "-q", help="Print nothing if the exit code is 0."),
    as_json: bool = options.AS_JSON,
) -> None:
    """Read the counters and report which maintenance is due.

    Intended for a timer. Sends only queries, and none that clears a value. Accepts a counter when
    two of at most three reads agree. Takes the counters of a station in use from its run's record.
    Appends the readings to the ledger and totals the use since the first audit. Asks once why a
    counter fell. With --runs, counts each error of a run once and shows the last tip verification.

    Exit code 1: something is due or suspect; 3: a station did not answer; 4: the ledger is damaged
    or cannot be written. The readings are shown in any case.

    \b
    Example:
      jbclog audit --line line.toml --ledger counters.jsonl --tasks profiles/tasks/bench.toml --runs runs --html audit.html
    """  # noqa: E501  # a command is copied as one line
    from jbclog.app.audit.survey import Survey

    fatal = _findings(fail_on)
    lines = _lines(line)
    known = _tasks(tasks)
    check_files(
        {"--html": html, "--csv": csv}, [ledger, *line, *([] if tasks is None else [tasks])]
    )
    survey = Survey(access=options.port_access(ctx))
    end = _audited(survey, lines, ledger, known, fatal, runs)
    end.write(html, csv)
    if end.code or not quiet:
        end.show(as_json=as_json)
    if end.code:
        raise typer.Exit(end.code)


# -- options ---------------------------------------------------------------------------------------


def _lines(paths: Sequence[Path]) -> list[Line]:
    """Return the lines. Raises `UsageError` if two files describe a line of the same name."""
    from jbclog.config.line import load_line

    lines = [load_line(path) for path in dict.fromkeys(paths)]
    seen: dict[str, Path] = {}
    for one in lines:
        other = seen.setdefault(one.name, one.path)
        if other != one.path:
            raise UsageError(
                f"{one.path} and {other} both name their line {one.name!r}; give each line its own"
                " name"
            )
    return lines


def _tasks(path: Path | None) -> Sequence[Task]:
    if path is None:
        return ()
    from jbclog.config.tasks_file import load_tasks

    return load_tasks(path)


def _findings(text: str | None) -> tuple[Finding, ...]:
    """Return the findings named by --fail-on. Raises `UsageError`."""
    from jbclog.maintenance.fleet import USUAL, Finding

    if text is None:
        return USUAL
    names = [one.strip().lower() for one in text.split(",") if one.strip()]
    unknown = [name for name in names if name not in [*Finding, "none"]]
    if unknown or not names:
        raise UsageError(f"--fail-on {text}: must be none, or some of {', '.join(Finding)}")
    return tuple(Finding(name) for name in names if name != "none")


# -- survey ----------------------------------------------------------------------------------------


def _audited(
    survey: Survey,
    lines: Sequence[Line],
    ledger: Path,
    tasks: Sequence[Task],
    fail_on: Collection[Finding],
    runs: Path | None,
) -> End:
    from jbclog.app.audit.run_audit import audit_lines, fleet_audit
    from jbclog.app.audit.survey import AT_ONCE
    from jbclog.cli.audit_end import End
    from jbclog.transport.signals import Signals

    received: list[signal.Signals] = []

    def stop(number: signal.Signals) -> None:
        received.append(number)
        survey.stop()

    with Signals((signal.SIGINT, signal.SIGTERM)) as signals:
        signals.notify(stop)
        if is_terminal():
            stations = count_text(sum(len(one.stations) for one in lines), "station")
            note(f"reading {stations}, {AT_ONCE} at a time")
        audited = audit_lines(lines, ledger, survey, _note_unseen, runs)
    return End(
        fleet_audit(audited, lines, tasks, runs),
        audited.trouble,
        fail_on,
        next(iter(received), None),
    )


def _note_unseen(seen: Observation) -> None:
    if not seen.seen:
        note(f"{seen.station}: {seen.why}")
