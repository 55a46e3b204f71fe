"""Carries out one run on real ports: the checks before it, its guard, then its recorder.

The guard needs a tenth of a second to start. It starts before most of the recorder is imported, and
the recorder waits for it (`recorder.py`).
"""

from __future__ import annotations

import gc
import signal
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jbclog.app.run.options import RunOptions
from jbclog.app.run.plan import Plan, make_plan
from jbclog.core.clock import SystemClock
from jbclog.core.errors import JbclogError, RecordError, Unsafe, cause
from jbclog.core.operating_system import expect_epoll
from jbclog.core.outcome import CUT_SHORT, tools_text
from jbclog.guard.supervisor import RunGuard
from jbclog.record.folder import create_run
from jbclog.record.port_owner import why_held
from jbclog.record.seal_child import SEAL_S
from jbclog.transport.cpu_limit import cpu_limit
from jbclog.transport.opening import allow_ports
from jbclog.transport.signals import Signals

if TYPE_CHECKING:  # imported while the guard starts
    from jbclog.app.run.recorder import Recorder
    from jbclog.app.run.run_record import Observer, Result
    from jbclog.transport.typed_lines import LineSource

FREEZING = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)


def conduct(
    plan: Plan,
    out: Path,
    observer: Observer,
    *,
    seal_every_s: float = SEAL_S,
    missed: Callable[[], int] = lambda: 0,
    is_last: bool = False,
    units: LineSource | None = None,
) -> Result:
    """Run `plan` and record it below `out`. `missed` returns how many notes the observer could not
    show.

    SIGINT, SIGTERM and SIGHUP (not under `nohup`) end the run in good order, from the first moment
    on; a second one, or one while sealing, has no effect. Ctrl-Z and a terminal's job control have
    no effect: a stopped recorder would leave its tools hot. With `is_last` the process only shows
    the result afterwards, and no signal ends that early.

    Serials of units are read from `units` during the run.

    A run that cannot start, because another one holds a port or there is no process for its guard,
    is recorded as such. Raises `RecordError` if the record cannot begin, `UsageError` on a system
    that cannot record.
    """
    expect_epoll()
    with Signals(heard(), FREEZING, stay_ignored=is_last) as signals:
        held = why_held({station.spec.name: station.spec.url for station in plan.stations})
        if held:
            from jbclog.app.run.run_record import RunRecord

            return RunRecord(plan, out, observer, SystemClock()).refuse(held)
        allow_ports(len(plan.stations))  # the guard's limit, too
        folder, guarding = create_run(out, plan.line.name, SystemClock().utc()), RunGuard()
        with ExitStack() as on_error:
            on_error.callback(guarding.end)
            if plan.wanted.guard:
                guarding.begin(folder)
            from jbclog.app.run.recorder import Recorder

            run = Recorder(plan, out, observer, seal_every_s, missed, units, folder, guarding)
            on_error.pop_all()
        gc.freeze()  # what is imported stays; a pass over it would delay the first answers
        gc.enable()  # `jbclog run` imports without it
        return _conduct(run, out, signals)


def _conduct(run: Recorder, out: Path, signals: Signals) -> Result:
    """Conduct `run`. If the system refuses a resource at the end, the error says what is known of
    the tools, because there is no manifest then.
    """
    try:
        return run.conduct(signals)
    except JbclogError:
        raise
    except (OSError, ImportError, MemoryError) as error:
        text = (
            f"the record could not be finished ({cause(error)}); `jbclog recover {out}` does that;"
            f" {tools_text(run.stations)}"
        )
        raise (Unsafe if any(facts.unsafe for facts in run.stations) else RecordError)(
            text
        ) from error


def heard() -> list[signal.Signals]:
    """Return the signals that end a run in good order; under `nohup` it outlives its terminal."""
    has_nohup = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return [number for number in CUT_SHORT if not (has_nohup and number is signal.SIGHUP)]


# -- job -------------------------------------------------------------------------------------------
# A job is one requested run: `jbclog run` builds it from its options, a batch from a `[[job]]`.
# Both call `carry_out`.


@dataclass(frozen=True, slots=True)
class Job:
    """A run to be made, and the parent of its run's folder."""

    wanted: RunOptions
    out: Path
    name: str = "run"

    def plan(self) -> Plan:
        """Read and check everything; send nothing. Raises `Problems`, `UsageError` with all
        mistakes.
        """
        return make_plan(self.wanted)


def carry_out(
    job: Job,
    observer: Observer,
    *,
    units: LineSource | None = None,
    missed: Callable[[], int] = lambda: 0,
    planned: Callable[[Plan], None] = lambda plan: None,
) -> Result:
    """Check, run and record a job, as the last action of this process.

    `planned` gets the plan before anything is sent. Raises `Problems` or `UsageError` (nothing was
    sent), `RecordError` (the record could not begin).
    """
    plan = job.plan()
    planned(plan)
    with cpu_limit():
        result = conduct(plan, job.out, observer, missed=missed, is_last=True, units=units)
    # imported only now: hours of recording need none
    from jbclog.app.run.derive import start_derive

    start_derive(result.folder, result.manifest)
    return result
