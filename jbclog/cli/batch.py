"""`jbclog batch`: a queue of jobs."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.options import Color
from jbclog.cli.output import echo_json, note, reports_errors
from jbclog.cli.streams import never_wait
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.app.batch.executor import BatchExecutor
    from jbclog.cli.batch_progress import Lines


@reports_errors
def batch(
    jobs: Path = typer.Argument(..., metavar="JOBS", help="Jobs file.", show_default=False),
    resume: bool = typer.Option(
        False,
        "--resume",
        help="Resume an interrupted batch; never start a new one.",
    ),
    anew: bool = typer.Option(
        False, "--anew", help="Discard an interrupted batch and start a new one."
    ),
    line: Path | None = typer.Option(
        None,
        "--line",
        "-l",
        metavar="FILE",
        help="Line file; overrides the one in the jobs file.",
        show_default=False,
    ),
    out: Path = options.OUT,
    color: Color = options.COLOR,
    as_json: bool = options.AS_JSON,
) -> None:
    """Run a queue of jobs on the stations of a line.

    Jobs on the same station run one after another, jobs on different stations in parallel. Each job
    is a run with its own folder. Checks every file before the first job starts. Ctrl-C ends the
    running jobs and makes their tools safe. To resume an interrupted batch, run the same command; a
    job that was cut off is recorded again as a new run. Prints a table of the jobs.

    \b
    Example:
      jbclog batch profiles/batches/night.toml
    """
    from jbclog.app.batch.executor import LOOK_EVERY_S, Timing
    from jbclog.app.batch.job_spec import plan_batch
    from jbclog.app.batch.journal import home_of
    from jbclog.app.batch.resume import prepare
    from jbclog.app.batch.single_batch import hold
    from jbclog.cli.batch_progress import beginning, facts, intentions, local, print_table, shown_by
    from jbclog.config.jobs_file import load_jobs

    if resume and anew:
        raise UsageError("--resume continues a batch, --anew discards it: give only one of them")
    never_wait()
    timing = Timing(time.time, lambda: time.sleep(LOOK_EVERY_S))
    plan = plan_batch(load_jobs(jobs, line), out)
    for text in plan.notes:
        note(f"note: {text}")
    with hold(home_of(out, jobs), jobs, local(time.time())):
        prepared = prepare(plan, out, timing, resume=resume, anew=anew)
        note(*beginning(prepared), *(intentions(prepared) if resume else ()))
        shown = shown_by(prepared, color, quiet=as_json)
        executor = prepared.executor(shown, timing)
        code = _carry_out(executor, shown)
        if as_json:
            echo_json(facts(prepared, out, code))
        else:
            print_table(prepared, out)
            note(f"journal: {prepared.journal.path}; exit code {code}")
        executor.finish()
        note(prepared.state.closing)
    raise typer.Exit(code)


def _carry_out(executor: BatchExecutor, shown: Lines) -> int:
    """Run the batch and return its exit code. A later signal does not cut off the summary."""
    from jbclog.app.run.runner import heard
    from jbclog.transport.signals import Signals

    with Signals(heard(), stay_ignored=True) as signals:
        signals.notify(executor.interrupt)
        try:
            return executor.work().value
        finally:
            shown.close()
