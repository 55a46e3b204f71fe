"""Reads all stations of some lines, eight serial lines at a time.

::

    SurveyTarget -> a run has its port? yes -> records.observed_in
                                        no  -> open_port, reads only -> blocking.run pulls `look`

Stations behind one port (with addresses) are read one after the other. A run that begins meanwhile
either finds the port in use, or has it, and then its record is read.
"""

from __future__ import annotations

import queue
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from threading import Event
from typing import Final

from jbclog.app.audit.questions import SurveyTarget, harmless_for, look
from jbclog.app.port_access import SYSTEM, PortAccess
from jbclog.core.clock import utc_ms
from jbclog.core.errors import (
    LinkError,
    PortBusy,
    StartRefused,
    StationError,
    unexpected_error_text,
)
from jbclog.core.io_requests import IoResult, Request, RunEnded, do, relay
from jbclog.core.serial_line import PortAddress, port_address
from jbclog.maintenance.counter_totals.observed import Observation
from jbclog.record.port_owner import run_of, run_that_holds
from jbclog.transport.port import Port
from jbclog.transport.read_only import ReadOnly
from jbclog.transport.system_ports import processes_text, sharers_of

AT_ONCE: Final = 8

Observed = Callable[[Observation], object]


class Survey:
    """The reads of one audit. `stop` ends them within one response time; observations made before
    are already reported.
    """

    def __init__(self, at_once: int = AT_ONCE, access: PortAccess = SYSTEM) -> None:
        self.access = access
        self._at_once = at_once
        self._stop = Event()
        self._done: queue.SimpleQueue[Observation | None] = queue.SimpleQueue()

    def stop(self) -> None:
        """Stop reading. Safe to call from anywhere, including a signal handler."""
        self._stop.set()

    @property
    def is_stopped(self) -> bool:
        return self._stop.is_set()

    def all(self, wanted: Sequence[SurveyTarget], observed: Observed) -> None:
        """Read each target; `observed` is called in this thread with each observation."""
        groups = _by_port(wanted)
        with ThreadPoolExecutor(
            max_workers=max(1, min(len(groups), self._at_once)), thread_name_prefix="audit"
        ) as pool:
            for group in groups:
                pool.submit(self._read_group, group)
            left = len(groups)
            try:
                while left:
                    done = self._done.get()
                    if done is None:
                        left -= 1
                    else:
                        observed(done)
            except BaseException:
                self.stop()
                raise

    def _read_group(self, group: Sequence[SurveyTarget]) -> None:
        try:
            for wanted in group:
                if self.is_stopped:
                    break
                with suppress(RunEnded):
                    self._done.put(self._read_safely(wanted))
        finally:
            self._done.put(None)

    def _read_safely(self, wanted: SurveyTarget) -> Observation:
        """Read one station; an internal error must not end the reads of the others."""
        try:
            return self._look(wanted)
        except RunEnded:
            raise
        except Exception as error:
            return wanted.unseen(
                self.utc(), f"internal error, {unexpected_error_text(error)} (please report it)"
            )

    def _look(self, wanted: SurveyTarget) -> Observation:
        run = run_that_holds(wanted.target.url)
        if run is not None:
            return self._in_run(run, wanted)
        try:
            seen = self._ask(wanted)
        except PortBusy as busy:
            known = None if busy.process is None else run_of(busy.process)
            run = known or run_that_holds(wanted.target.url)
            return (
                wanted.unseen(self.utc(), str(busy)) if run is None else self._in_run(run, wanted)
            )
        except (StartRefused, LinkError, StationError) as error:
            return wanted.unseen(self.utc(), str(error))
        if "://" not in wanted.target.url:
            return seen  # the lock of the port excludes runs
        # a run may have begun meanwhile, behind a server that accepts two clients
        run = run_that_holds(wanted.target.url)
        return seen if run is None else self._in_run(run, wanted)

    def _in_run(self, run: Path, wanted: SurveyTarget) -> Observation:
        from jbclog.app.audit.records import observed_in  # imports pandas, which only this needs

        return observed_in(run, wanted, self.access.now())

    def _ask(self, wanted: SurveyTarget) -> Observation:
        steps = relay(look(wanted, self._utc_of), self._unless_stopped)
        return self.access.run(steps, lambda: _open(wanted, self.access))

    def utc(self) -> str:
        """Return the current time in the format of the ledger."""
        return utc_ms(self.access.now())

    def _utc_of(self, moment: float) -> str:
        return utc_ms(self.access.utc_of(moment))

    async def _unless_stopped(self, request: Request) -> IoResult:
        if self.is_stopped:
            raise RunEnded("the audit was stopped")
        return await do(request)


def _by_port(wanted: Sequence[SurveyTarget]) -> list[list[SurveyTarget]]:
    """Group the targets behind one port, in order."""
    groups: list[tuple[PortAddress, list[SurveyTarget]]] = []
    for one in wanted:
        place = port_address(one.target.url)
        found = next((group for known, group in groups if known.is_at(place)), None)
        if found is None:
            groups.append((place, [one]))
        else:
            found.append(one)
    return [group for _, group in groups]


def _open(wanted: SurveyTarget, access: PortAccess) -> Port:
    """Open the port for harmless reads. Refuses a port that another program has open, because that
    program would lose its answers.
    """
    target = wanted.target
    sharers = sharers_of(target.url)
    if sharers:
        raise PortBusy(
            f"{target.url} is open in {processes_text(sharers)}; end that program", sharers[0]
        )
    return ReadOnly(access.open_port(target.url, target.line), harmless_for(target.family))
