"""Take-over: make the tools of all leased stations safe at once, a thread for each, by the rules of
`session.safety`.

A station is identified before anything is written, because another adapter may be plugged in by
now. Each result goes to the action log and to stderr as soon as it is known.
"""

from __future__ import annotations

import _thread
import time
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Final

from jbclog.core.errors import Refusal, UsageError, unexpected_error_text
from jbclog.core.io_requests import Steps
from jbclog.core.serial_line import LineFormat
from jbclog.core.states import SafetyResult
from jbclog.guard.action_log import ActionLog, show
from jbclog.guard.lease import StationLease
from jbclog.protocol.client.interface import Client
from jbclog.protocol.client.make import client_for
from jbclog.protocol.commands.family import FAMILIES
from jbclog.session.safety.secure import secure
from jbclog.session.safety.tools import SafetyTask, ToolSafety
from jbclog.transport import blocking
from jbclog.transport.opening import allow_ports, open_port
from jbclog.transport.port import Port

INFO, WARNING, ERROR, CRITICAL = "info", "warning", "error", "critical"
HOT = "it may be hot: switch the station off"
OPENING = 5  # descriptors of a port while it is being opened
ENDED_S = 8.0  # a hanging driver must not delay the results of the other ports
BEGUN_S: Final = 0.5  # for a thread to begin on a busy machine; if both begin, only one works
LOOK_S: Final = 0.005


class TakeOver:
    """Makes safe what these leases hold, and logs it. `left`: leases that still hold something.

    `again`: a repeated attempt; failures are not logged twice. `spare`: leave tools alone that are
    at rest. `flooded`: stations already ordered over a flooded link; with repeated orders a tool
    would never sleep.
    """

    def __init__(
        self,
        stations: Sequence[StationLease],
        action_log: ActionLog,
        *,
        again: bool = False,
        spare: bool = False,
        flooded: Collection[str] = (),
    ) -> None:
        self.flooded = set(flooded)
        self._left = {station.name: station for station in stations if station.holds}
        self._action_log = action_log
        self._again = again
        self._spare = spare

    @property
    def left(self) -> list[StationLease]:
        return list(self._left.values())

    def run(self) -> list[StationLease]:
        """Make all stations safe; return the leases that still hold something."""
        stations, end = self.left, time.monotonic() + ENDED_S
        with suppress(UsageError):  # some ports then need a second attempt
            allow_ports(OPENING * len(stations))
        threads = [OnceInThread(partial(self._one, station)) for station in stations]
        for thread in threads:
            thread.begin()
        for thread in threads:
            thread.do_unless_begun()
        for thread in threads:
            thread.await_done(max(end - time.monotonic(), 0.0))
        return self.left

    def _one(self, lease: StationLease) -> None:
        try:
            task = self._secured_with_retry(lease)
        except Exception as error:  # one station's failure must not stop the others
            self._report(
                lease,
                "guard.failed",
                CRITICAL,
                f"the guard failed, {unexpected_error_text(error)}; {HOT}",
            )
            return
        if task.flood is not None and all(tool.reached == SafetyResult.SENT for tool in task.tools):
            self.flooded.add(lease.name)
        self._update(lease, task)
        for tool in task.tools:
            self._report_tool(lease, task, tool)
        if task.feeds:
            self._report(
                lease,
                "safety.not_safe",
                CRITICAL,
                "the guard could not stop the feeder; switch the station off",
            )

    def _secured_with_retry(self, lease: StationLease) -> SafetyTask:
        """Try twice: a failure of this program may be temporary, for example refused memory."""
        try:
            return self._secured(lease)
        except Exception:
            return self._secured(lease)

    def _secured(self, lease: StationLease) -> SafetyTask:
        task = self._task(lease)
        blocking.run(secure(task), lambda: _open(lease), sleep=time.sleep)
        return task

    def _update(self, lease: StationLease, task: SafetyTask) -> None:
        remaining = replace(
            lease,
            ports=tuple(tool.port for tool in task.tools if not tool.is_safe),
            feeds=task.feeds,
        )
        if remaining.holds:
            self._left[lease.name] = remaining
        else:
            del self._left[lease.name]

    def _task(self, lease: StationLease) -> SafetyTask:
        family = FAMILIES[lease.family]
        client = client_for(family, _format(lease), lease.address)
        tools = [ToolSafety(port, suction=port in lease.suction) for port in lease.ports]
        return SafetyTask(
            client,
            family,
            lease.safe_state,
            tools,
            lease.feeds,
            lambda: _is_same_station(client, lease),
            is_proven=False,
            spare=self._spare,
            is_stranger=lease.name in self.flooded,
        )

    def _report_tool(self, lease: StationLease, task: SafetyTask, tool: ToolSafety) -> None:
        if tool.is_safe and tool.status is not None:
            state = task.family.status.shown(tool.status)
            text = (
                "was in its safe state already"
                if tool.was_spared
                else "was put in its safe state by the guard"
            )
            why, severity = (f"; {tool.fell_back}", WARNING) if tool.fell_back else ("", INFO)
            self._report(
                lease,
                "safety.safe_state",
                severity,
                f"the tool {text}, as read back: {state}{why}",
                tool.port,
            )
            return
        what = (
            "was ordered into its safe state by the guard and does not confirm it"
            if tool.reached == SafetyResult.SENT
            else "could not be made safe"
        )
        what += "" if task.flood is None else " (its link is flooded)"
        self._report(lease, "safety.not_safe", CRITICAL, f"the tool {what}; {HOT}", tool.port)

    def _report(
        self, lease: StationLease, kind: str, severity: str, text: str, port: int | None = None
    ) -> None:
        if self._again and severity == CRITICAL:
            return
        self._action_log.write(kind, severity, f"{text[0].upper()}{text[1:]}.", lease.name, port)
        show(f"{lease.name if port is None else f'{lease.name} port {port}'}: {text}")


def _format(lease: StationLease) -> LineFormat:
    return LineFormat(lease.baudrate, lease.format)


def _open(lease: StationLease) -> Port:
    return open_port(lease.url, _format(lease))


def _is_same_station(client: Client, lease: StationLease) -> Steps[bool]:
    """Return True if the station answers the leased model and, if there is one, the leased
    software.
    """
    family = FAMILIES[lease.family]
    commands = family.commands
    if not (lease.model_accepted or family.proves(lease.model or "")):
        return False
    if (yield from client.read(commands["model"])) != lease.model:
        return False
    if lease.software is None:
        return True
    try:
        return (yield from client.read(commands["software_version"])) == lease.software
    except Refusal:
        return False


class OnceInThread:
    """Does `work` once: in a thread, or in the caller's if none begins.

    `threading.Thread.start` waits forever for a thread that is refused memory before it begins.
    """

    def __init__(self, work: Callable[[], None]) -> None:
        self._work = work
        self._taken = _thread.allocate_lock()
        self._running = _thread.allocate_lock()
        self._running.acquire()

    def begin(self) -> None:
        """Start a thread, without waiting for it."""
        with suppress(RuntimeError, MemoryError):
            _thread.start_new_thread(self._do, ())

    def do_unless_begun(self) -> None:
        """Do the work here if no thread begins within `BEGUN_S`."""
        end = time.monotonic() + BEGUN_S
        while not self._taken.locked() and time.monotonic() < end:
            time.sleep(LOOK_S)
        self._do()

    def await_done(self, seconds: float) -> None:
        """Wait until the work is done, or time is up."""
        self._running.acquire(timeout=seconds)

    def _do(self) -> None:
        if self._taken.acquire(blocking=False):
            try:
                self._work()
            finally:
                self._running.release()
