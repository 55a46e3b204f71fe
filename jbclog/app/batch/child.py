"""A job in a process of its own: ``python -m jbclog.app.batch.child PAPERS DESCRIPTOR``. It does what `jbclog run` does.

It holds the lock of its papers, whose open descriptor it was given, and tells in them what people are to see. It is in a session
of its own: what happens to the executor, or to the terminal, does not happen to it.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import Full, Queue
from typing import Final

from pydantic import TypeAdapter

from jbclog.app.batch.job_dir import Carried, JobDir, Now, PortNow, Said
from jbclog.app.batch.job_spec import JobSpec
from jbclog.app.run.run_record import Result
from jbclog.app.run.runner import carry_out
from jbclog.core.errors import JbclogError
from jbclog.core.outcome import Exit, in_order
from jbclog.core.rows import EventRow
from jbclog.session.run.context import SessionContext
from jbclog.transport.typed_lines import open_source

ORDER: Final = TypeAdapter(JobSpec)
INTERRUPTED: Final = 130
WAITING_MOST: Final = 1000
RUNNING: Final = "running"
UNIT_ENDS: Final = "unit.end"
CLOSE_S: Final = 2.0
BROKEN: Final = ("fail", "missing")
REASONS_MOST: Final = 3  # all of them are in the manifest and the report


class Told:
    """An observer that tells in the job's papers, in a thread: a disk that hangs must not hold the run.

    Only that the run has begun is told at once: its papers must know its folder before any station is touched.
    """

    def __init__(self, papers: JobDir) -> None:
        self._papers = papers
        self._began = time.monotonic()
        self._units = 0
        self._waiting: Queue[Callable[[], None] | None] = Queue(WAITING_MOST)
        self._dropped = 0
        self._thread = threading.Thread(target=self._tell_on, name="observer", daemon=True)
        self._thread.start()

    def begun(self, folder: Path) -> None:
        self._papers.begun(folder)
        self._began = time.monotonic()

    def happened(self, event: EventRow) -> None:
        self._units += event.kind == UNIT_ENDS
        self._tell(lambda: self._papers.happened(event))

    def second(self, contexts: list[SessionContext]) -> None:
        if self._waiting.empty():
            self._tell(lambda: self._papers.tell(self._now(contexts)))

    def sealing(self) -> None:
        passed = time.monotonic() - self._began
        self._tell(lambda: self._papers.tell(Now(passed, "sealing", units=self._units)))

    def missed(self) -> int:
        """How much of what it was told it could not pass on."""
        return self._dropped

    def close(self) -> None:
        with suppress(Full):
            self._waiting.put(None, timeout=CLOSE_S)
        self._thread.join(CLOSE_S)

    def _now(self, contexts: list[SessionContext]) -> Now:
        return Now(
            passed_s=time.monotonic() - self._began,
            doing="recording" if any(context.ports for context in contexts) else "starting",
            alarms=sum(context.facts.alarms or 0 for context in contexts),
            ports=[port for context in contexts if context.connected for port in _ports(context)],
            away=[
                context.name for context in contexts if context.ports and context.facts.outcome == RUNNING and not context.connected
            ],
            units=self._units,
        )

    def _tell(self, told: Callable[[], None]) -> None:
        try:
            self._waiting.put_nowait(told)
        except Full:
            self._dropped += 1

    def _tell_on(self) -> None:
        while (told := self._waiting.get()) is not None:
            try:
                told()
            except Exception:  # the run goes on, whoever looks on
                self._dropped += 1


def _ports(context: SessionContext) -> list[PortNow]:
    if context.facts.outcome != RUNNING:
        return []
    return [_port(context, number) for number in context.ports]


def _port(context: SessionContext, number: int) -> PortNow:
    port = context.ports[number]
    status = None if port.status is None or port.states else context.family.status.state(port.status)
    return PortNow(context.name, number, port.temperature_c, context.set_c(port), status)


def main(arguments: list[str]) -> int:
    """The process. `arguments`: the folder of its papers, and the descriptor of their lock."""
    papers, descriptor = JobDir(Path(arguments[0])), int(arguments[1])
    os.set_inheritable(descriptor, False)  # a guard outlives the job, and must not look like it
    papers.sign(descriptor)
    try:
        said = _carry_out(papers)
    except JbclogError as error:
        said = Said(error.exit_code, findings=str(error).splitlines())
    except KeyboardInterrupt:  # nothing had begun
        return INTERRUPTED
    with suppress(OSError):
        papers.last_words(said)
    return said.exit_code


def _carry_out(papers: JobDir) -> Said:
    order = ORDER.validate_json(papers.job())
    units = None if order.units_from is None else open_source(order.units_from)
    if units is not None and order.first_unit is not None:
        units = Carried(units, order.first_unit)
    told = Told(papers)
    try:
        return _said(carry_out(order.job, told, units=units, missed=told.missed))
    finally:
        told.close()


def _said(result: Result) -> Said:
    findings = [finding.text for finding in in_order(result.findings)]
    is_told = result.exit_code is Exit.NOT_FINE  # worse ones say already why there is no better verdict
    broken = [rule for rule in result.manifest.verdict_rules if is_told and rule["result"] in BROKEN]
    reasons = [*dict.fromkeys(f"{rule['station'] or 'run'}: {rule['text']}".rstrip(".") for rule in broken)]
    more = [f"{len(reasons) - REASONS_MOST} more reasons"] if len(reasons) > REASONS_MOST else []
    return Said(result.exit_code.value, result.manifest.verdict, [*findings, *reasons[:REASONS_MOST], *more], str(result.folder))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
