"""`jbclog batch`: a queue of jobs."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.cli.streams import never_wait
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.app.batch.executor import BatchExecutor
    from jbclog.cli.batch_progress import Lines, Screen


@ends_with_errors_told
def batch(
    jobs: Path = typer.Argument(..., metavar="JOBS", help="The jobs file.", show_default=False),
    resume: bool = typer.Option(
        False,
        "--resume",
        help="Resume what was interrupted, and show first what will be done; never begins anew.",
    ),
    anew: bool = typer.Option(False, "--anew", help="Give up a batch that was interrupted, and begin a new one."),
    line: Path | None = typer.Option(
        None,
        "--line",
        "-l",
        metavar="FILE",
        help="The line file, in place of the jobs file's.",
        show_default=False,
    ),
    out: Path = options.OUT,
    as_json: bool = options.AS_JSON,
) -> None:
    """Run a queue of jobs on the stations of a line.

    In turn on one station, side by side on different ones; each job is a run with a folder of its own. Every file is checked
    before the first job begins. Ctrl-C ends the jobs that run, with their tools safe. Start a batch that was interrupted
    or killed again, and it resumes; a job that was half done is recorded again as a new run. On stdout: a table of the jobs,
    their results, and their runs' folders.

    \b
    Example:
      jbclog batch profiles/batches/night.toml
    """
    from jbclog.app.batch.executor import LOOK_EVERY_S, Timing
    from jbclog.app.batch.job_spec import plan_batch
    from jbclog.app.batch.journal import NAME, home_of
    from jbclog.app.batch.resume import prepare
    from jbclog.app.batch.single_batch import hold
    from jbclog.cli.batch_progress import beginning, facts, intentions, local, shown_by, table
    from jbclog.config.job_order import SystemZone
    from jbclog.config.jobs_file import load_jobs

    if resume and anew:
        raise UsageError("--resume goes on, --anew gives up what there is: give one of the two")
    never_wait()
    means = Timing(time.time, lambda: time.sleep(LOOK_EVERY_S))
    orders = plan_batch(load_jobs(jobs, line), out)
    for text in orders.notes:
        note(f"note: {text}")
    with hold(home_of(out, jobs), jobs, local(time.time())):
        shift = prepare(orders, out, means, SystemZone(), resume=resume, anew=anew)
        for text in (*beginning(shift), *(intentions(shift) if resume else ())):
            note(text)
        shown = shown_by(shift, quiet=as_json)  # a table from here on
        executor = shift.executor(shown, means)
        code = _carry_out(executor, shown)
        if as_json:
            tell_json(facts(shift, out, code))
        else:
            tell(*table(shift, out))
            note(f"journal: {shift.journal.folder / NAME}; exit code {code}")
        executor.finish()
        note(shift.state.closing)
    raise typer.Exit(code)


def _carry_out(executor: BatchExecutor, shown: Lines | Screen) -> int:
    """As far as it goes; give the exit code. What follows are last words, which no signal ends."""
    from jbclog.app.run.runner import heard
    from jbclog.transport.event_loop import Signals

    with Signals(heard(), stay_ignored=True) as signals:
        signals.notify(executor.interrupt)
        try:
            return executor.work().value
        finally:
            shown.close()
