"""A job: one run as it was asked for, whoever asked. `jbclog run` builds one of its options, a batch one of each `[[job]]`.

Both come to `carry_out`: the run of a line's stations by hand is the batch of one job, without a queue around it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from jbclog.app.run.plan import Plan, RunOptions, make_plan
from jbclog.app.run.run_record import Observer, Result
from jbclog.app.run.runner import conduct
from jbclog.transport.typed_lines import Source


@dataclass(frozen=True, slots=True)
class Job:
    """What is to run, and the folder that its run's folder is made in."""

    wanted: RunOptions
    out: Path
    name: str = "run"

    def plan(self) -> Plan:
        """Everything read and checked, nothing sent. Raises `Problems` or `UsageError` with all that is wrong."""
        return make_plan(self.wanted)


def carry_out(
    job: Job,
    observer: Observer,
    *,
    units: Source | None = None,
    missed: Callable[[], int] = lambda: 0,
    planned: Callable[[Plan], None] = lambda plan: None,
) -> Result:
    """Check, run and record a job, in this process, whose last deed it is.

    `planned` is told what will be done before anything is. Raises `Problems` or `UsageError` (nothing was sent), `RecordError`
    (the record could not even be begun).
    """
    plan = job.plan()
    planned(plan)
    return conduct(plan, job.out, observer, missed=missed, is_last=True, units=units)
