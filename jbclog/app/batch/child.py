"""A job in its own process: ``python -m jbclog.app.batch.child JOB_DIR DESCRIPTOR``. Does the same
as `jbclog run`.

Inherits the open descriptor of its lock, and reports progress and result in the job's folder. Runs
in a session of its own, so that the end of the executor or of the terminal does not reach it.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from queue import Full, Queue
from typing import Final

from pydantic import TypeAdapter

from jbclog.app.batch.job_dir import JobDir, JobProgress, JobResult, PortProgress, PrefixedSource
from jbclog.app.batch.job_spec import JobSpec
from jbclog.app.run.run_record import Result
from jbclog.app.run.runner import carry_out
from jbclog.app.run.unit_feed import unit_after
from jbclog.core.errors import JbclogError
from jbclog.core.goal import JOINTS, Goal
from jbclog.core.outcome import Exit, in_order
from jbclog.core.rows import EventRow
from jbclog.core.states import StationOutcome
from jbclog.session.run.context import SessionContext
from jbclog.transport.typed_lines import open_source

SPEC: Final = TypeAdapter(JobSpec)
INTERRUPTED: Final = 130
WAITING_MOST: Final = 1000
UNIT_ENDS: Final = "unit.end"
CLOSE_S: Final = 2.0
BROKEN: Final = ("fail", "missing")
REASONS_MOST: Final = 3  # the manifest and the report have all of them


class JobObserver:
    """Writes progress and events to the job's folder in a thread, so that a hanging disk does not
    delay the run.

    Only the run's folder is written synchronously, because it must be known before any station is
    touched.
    """

    def __init__(self, job_dir: JobDir) -> None:
        self._job_dir = job_dir
        self._began = time.monotonic()
        self._units = 0
        self._unit: str | None = None
        self._waiting: Queue[Callable[[], None] | None] = Queue(WAITING_MOST)
        self._dropped = 0
        self._thread = threading.Thread(target=self._write_all, name="observer", daemon=True)
        self._thread.start()

    def begun(self, folder: Path) -> None:
        self._job_dir.set_run(folder)
        self._began = time.monotonic()

    def happened(self, event: EventRow) -> None:
        self._units += event.kind == UNIT_ENDS
        self._unit = unit_after(event, self._unit)
        self._put(lambda: self._job_dir.add_event(event))

    def second(self, contexts: list[SessionContext], goals: Sequence[Goal]) -> None:
        if self._waiting.empty():
            joints = next((goal.reached for goal in goals if goal.what == JOINTS), None)
            self._put(lambda: self._job_dir.set_progress(self._progress(contexts, joints)))

    def sealing(self) -> None:
        passed = time.monotonic() - self._began
        self._put(
            lambda: self._job_dir.set_progress(JobProgress(passed, "sealing", units=self._units))
        )

    def missed(self) -> int:
        """Return how many writes were dropped or failed."""
        return self._dropped

    def close(self) -> None:
        with suppress(Full):
            self._waiting.put(None, timeout=CLOSE_S)
        self._thread.join(CLOSE_S)

    def _progress(self, contexts: list[SessionContext], joints: int | None) -> JobProgress:
        counts = [
            context.state.count_readings(port)
            for context in contexts
            for port in [*context.state.ports]
        ]
        return JobProgress(
            passed_s=time.monotonic() - self._began,
            doing="recording" if any(context.state.ports for context in contexts) else "starting",
            alarms=sum(context.state.facts.alarms or 0 for context in contexts),
            ports=[
                port for context in contexts if context.state.connected for port in _ports(context)
            ],
            away=[
                context.name
                for context in contexts
                if context.state.ports
                and context.state.facts.outcome == StationOutcome.RUNNING
                and not context.state.connected
            ],
            units=self._units,
            unit=self._unit,
            joints=joints,
            due=sum(count.due for count in counts),
            obtained=sum(count.obtained for count in counts),
        )

    def _put(self, write: Callable[[], None]) -> None:
        try:
            self._waiting.put_nowait(write)
        except Full:
            self._dropped += 1

    def _write_all(self) -> None:
        while (write := self._waiting.get()) is not None:
            try:
                write()
            except Exception:  # a failure to show progress must not end the run
                self._dropped += 1


def _ports(context: SessionContext) -> list[PortProgress]:
    if context.state.facts.outcome != StationOutcome.RUNNING:
        return []
    return [_port(context, number) for number in context.state.ports]


def _port(context: SessionContext, number: int) -> PortProgress:
    port = context.state.ports[number]
    status = (
        None
        if port.status is None or port.states
        else context.state.family.status.state(port.status)
    )
    return PortProgress(
        context.name, number, port.temperature_c, context.state.setpoint_c(port), status
    )


def main(arguments: list[str]) -> int:
    """Run the process. `arguments`: the job's folder, and the descriptor of its lock."""
    job_dir, descriptor = JobDir(Path(arguments[0])), int(arguments[1])
    os.set_inheritable(descriptor, False)  # a guard outlives the job and must not hold its lock
    job_dir.sign(descriptor)
    try:
        result = _carry_out(job_dir)
    except JbclogError as error:
        result = JobResult(error.exit_code, findings=str(error).splitlines())
    except KeyboardInterrupt:  # no run has begun
        return INTERRUPTED
    with suppress(OSError):
        job_dir.set_result(result)
    return result.exit_code


def _carry_out(job_dir: JobDir) -> JobResult:
    spec = SPEC.validate_json(job_dir.spec())
    units = None if spec.units_from is None else open_source(spec.units_from)
    if units is not None and spec.first_unit is not None:
        units = PrefixedSource(units, spec.first_unit)
    observer = JobObserver(job_dir)
    try:
        return _result(carry_out(spec.job, observer, units=units, missed=observer.missed))
    finally:
        observer.close()


def _result(result: Result) -> JobResult:
    findings = [finding.text for finding in in_order(result.findings)]
    # findings of more severe codes explain why there is no verdict
    gives_reasons = result.exit_code is Exit.NOT_FINE
    broken = [
        rule for rule in result.manifest.verdict_rules if gives_reasons and rule["result"] in BROKEN
    ]
    reasons = [
        *dict.fromkeys(f"{rule['station'] or 'run'}: {rule['text']}".rstrip(".") for rule in broken)
    ]
    more = [f"{len(reasons) - REASONS_MOST} more reasons"] if len(reasons) > REASONS_MOST else []
    texts = [*findings, *reasons[:REASONS_MOST], *more]
    return JobResult(result.exit_code.value, result.manifest.verdict, texts, str(result.folder))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
