"""`jbclog audit`: the stations' counters, what was worked, and what is due for maintenance."""

from __future__ import annotations

import getpass
import os
import signal
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, is_terminal, note, tell
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.cli.audit_end import End
    from jbclog.config.line import Line
    from jbclog.config.tasks_file import Task
    from jbclog.maintenance.counter_totals.observed import Observation
    from jbclog.maintenance.fleet import Finding

# -- audit files --------------------------------------------------------------------------------------------------------------
# Before an audit asks anything: the files that it will write can be where they are wanted, and take the place of nothing else.


def check_files(made: Mapping[str, Path | None], kept: Sequence[Path]) -> None:
    """`made` are the files that are written as a whole, by their options; `kept` those that nothing may be written over.

    Raises `UsageError`.
    """
    known = {os.path.realpath(path): str(path) for path in kept}
    for option, path in made.items():
        if path is not None:
            _check(option, path)
            if os.path.realpath(path) in known:
                raise UsageError(f"{option} {path}: that is {known[os.path.realpath(path)]}, which it would take the place of")
            known[os.path.realpath(path)] = option


def _check(option: str, path: Path) -> None:
    if str(path) == "-":
        raise UsageError(f"{option} -: give a file; --json writes everything to stdout")
    if not path.absolute().parent.is_dir():
        raise UsageError(f"{option} {path}: there is no folder {path.absolute().parent}")
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise UsageError(f"{option} {path}: that is a folder, a device or a link, and no plain file to be written anew")


# -- audit --------------------------------------------------------------------------------------------------------------------

LEDGER = typer.Option(None, "--ledger", metavar="FILE", help="The ledger: made where it is not there, only ever added to.")
LINES = typer.Option([], "--line", "-l", metavar="FILE", help="The line file; may be repeated.", show_default=False)
RUNS = typer.Option(None, "--runs", metavar="DIR", help="The runs: errors since last time, tip verifications.", show_default=False)
HTML = typer.Option(None, "--html", metavar="FILE", help="Write a page with a row per station.", show_default=False)
LINE_PLACE: Final = Path("/etc/jbclog/line.toml")
LEDGER_PLACE: Final = Path("/var/lib/jbclog/counters.jsonl")
"""What --print-timer shows where none is named."""


@ends_with_errors_told
def audit(
    line: list[Path] = LINES,
    ledger: Path | None = LEDGER,
    tasks: Path | None = typer.Option(
        None, "--tasks", metavar="FILE", help="Maintenance tasks: what has which life (TOML).", show_default=False
    ),
    runs: Path | None = RUNS,
    html: Path | None = HTML,
    csv: Path | None = typer.Option(None, "--csv", metavar="FILE", help="Write everything as CSV.", show_default=False),
    fail_on: str | None = typer.Option(
        None, "--fail-on", metavar="LIST", help="What ends with 1 or 3: overdue, due, soon, suspect, drift, unseen; or none."
    ),
    print_timer: bool = typer.Option(False, "--print-timer", help="Show how cron, systemd and Windows call it; ask nothing."),
    quiet: bool = typer.Option(False, "--quiet", "-q", help="Say nothing where the exit code is 0."),
    as_json: bool = options.AS_JSON,
) -> None:
    """Read the counters and say which maintenance is due.

    Made for a timer. Nothing but questions can go out, and none that clears anything. A counter counts when two of at most three
    reads agree. A station that a run has is not asked: its counters are taken from the run's record. What was read is put at the
    end of the ledger at once; what was worked since the first audit is summed over resets and roll-overs. With --runs, each error
    that a run saw counts once, at the next audit, and `jbclog verify` gives the date of the last verification.

    Ends with 1 where something is due or suspect, 3 where a station did not answer, 4 where the ledger is damaged or could not be
    written; what was read is shown all the same.

    \b
    Example:
      jbclog audit --line line.toml --ledger counters.jsonl --tasks profiles/tasks/bench.toml --runs runs --html audit.html
    """
    if print_timer:
        files = {"--ledger": ledger or LEDGER_PLACE, "--tasks": tasks, "--runs": runs, "--html": html, "--csv": csv}
        _tell_timers(line, files, fail_on)
        return
    if not line or ledger is None:
        raise UsageError("audit: give --line and --ledger")
    fatal = _findings(fail_on)
    lines = _lines(line)
    known = _tasks(tasks)
    check_files({"--html": html, "--csv": csv}, [ledger, *line, *([] if tasks is None else [tasks])])
    end = _audited(lines, ledger, known, fatal, runs)
    end.write(html, csv)
    if end.code or not quiet:
        end.tell(as_json=as_json)
    if end.code:
        raise typer.Exit(end.code)


# -- what is asked for ------------------------------------------------------------------------------------------------------


def _lines(paths: Sequence[Path]) -> list[Line]:
    """The line files, in which every station has a name of its own. Raises `UsageError`."""
    from jbclog.config.line import load_line

    lines = [load_line(path) for path in dict.fromkeys(paths)]
    seen: dict[str, Path] = {}
    for one in lines:
        other = seen.setdefault(one.name, one.path)
        if other != one.path:
            raise UsageError(f"{one.path} and {other} are both of a line {one.name!r}: their stations could not be told apart")
    return lines


def _tasks(path: Path | None) -> Sequence[Task]:
    """The maintenance tasks of the file; none without one. Raises `Problems`."""
    if path is None:
        return ()
    from jbclog.config.tasks_file import load_tasks

    return load_tasks(path)


def _findings(text: str | None) -> tuple[Finding, ...]:
    """What --fail-on names. Raises `UsageError`."""
    from jbclog.maintenance.fleet import USUAL, Finding

    if text is None:
        return USUAL
    names = [one.strip().lower() for one in text.split(",") if one.strip()]
    unknown = [name for name in names if name not in [*Finding, "none"]]
    if unknown or not names:
        raise UsageError(f"--fail-on {text}: give some of {', '.join(Finding)}, or none")
    return tuple(Finding(name) for name in names if name != "none")


# -- looking ----------------------------------------------------------------------------------------------------------------


def _audited(lines: Sequence[Line], ledger: Path, tasks: Sequence[Task], fail_on: Collection[Finding], runs: Path | None) -> End:
    from jbclog.app.audit.run_audit import audit_lines, fleet_audit
    from jbclog.app.audit.survey import AT_ONCE, Survey
    from jbclog.cli.audit_end import End
    from jbclog.transport.event_loop import Signals

    looking, heard = Survey(), []

    def stop(number: signal.Signals) -> None:
        heard.append(number)
        looking.stop()

    with Signals((signal.SIGINT, signal.SIGTERM)) as signals:
        signals.notify(stop)
        if is_terminal():
            note(f"asking {sum(len(one.stations) for one in lines)} stations, {AT_ONCE} at a time")
        audited = audit_lines(lines, ledger, looking, _note_unseen, runs)
    return End(fleet_audit(audited, lines, tasks, runs), audited.trouble, fail_on, next(iter(heard), None))


def _note_unseen(seen: Observation) -> None:
    if not seen.seen:
        note(f"{seen.station}: {seen.why}")


# -- timers -----------------------------------------------------------------------------------------------------------------


def _tell_timers(lines: Sequence[Path], files: Mapping[str, Path | None], fail_on: str | None) -> None:
    """The call with these very files, wherever it is called from."""
    from jbclog.app.audit.timers import Timed, program, timers_lines

    given = [("--line", path) for path in lines or [LINE_PLACE]]
    given += [(option, path) for option, path in files.items() if path is not None]
    words = [word for option, path in given for word in (option, str(path.absolute()))]
    words += ["--fail-on", fail_on] if fail_on else []
    written = [files["--ledger"] or LEDGER_PLACE, *(path for option in ("--html", "--csv") if (path := files[option]) is not None)]
    folders = dict.fromkeys(str(path.absolute().parent) for path in written)
    tell(*timers_lines(Timed(program(), tuple(words), tuple(folders), getpass.getuser())))
