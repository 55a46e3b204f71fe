"""Take-over: make the tools of all leased stations safe at once, a thread for each, by the rules of
`session.safety`.

A station is identified before anything is written, because another adapter may be plugged in by
now; one that does not answer may get an order all the same (`continuity.py`). Each result goes to
the action log and to stderr as soon as it is known.
"""

from __future__ import annotations

import _thread
import time
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event
from typing import Final

from jbclog.core.errors import UsageError, unexpected_error_text
from jbclog.core.serial_line import LineFormat
from jbclog.core.states import SafetyResult
from jbclog.core.text import count_text
from jbclog.guard.action_log import ActionLog, show
from jbclog.guard.blind_orders import BlindOrders
from jbclog.guard.continuity import Continuity, is_mixed
from jbclog.guard.identifying import identify
from jbclog.guard.lease import StationLease, families_leased
from jbclog.protocol.client.make import client_for
from jbclog.protocol.commands.family import FAMILIES
from jbclog.session.safety.secure import secure
from jbclog.session.safety.tools import SafetyTask, ToolSafety
from jbclog.transport import blocking
from jbclog.transport.device import device_of
from jbclog.transport.opening import allow_ports, open_port
from jbclog.transport.port import Port

INFO, WARNING, ERROR, CRITICAL = "info", "warning", "error", "critical"
HOT = "it may be hot: switch the station off"
NOT_CONFIRMED = "was ordered into its safe state by the guard and does not confirm it"
FLOODED = "(its link is flooded)"
OPENING = 5  # descriptors of a port while it is being opened
ENDED_S = 8.0  # a hanging driver must not delay the results of the other ports
BEGUN_S: Final = 0.5  # for a thread to begin on a busy machine; if both begin, only one works
LOOK_S: Final = 0.005
Problems = dict[str, dict[int, str]]
"""What is not safe, by station and port; 0 for the whole station."""
OTHER_LEASES_S: Final = 0.2  # for the leases of other runs, whose disks may hang


class TakeOver:
    """Makes safe what these leases hold, and logs it. `left`: leases that still hold something.
    `problems`: why.

    `again`: a repeated attempt; failures are not logged twice. `spare`: leave tools alone that are
    at rest; so are those of a station where one was when it was last read. `flooded`: stations
    already ordered over a flooded link; with repeated orders a tool would never sleep.
    `continuity`: for orders to stations that do not answer; None: they get none.
    """

    def __init__(
        self,
        stations: Sequence[StationLease],
        action_log: ActionLog,
        *,
        again: bool = False,
        spare: bool = False,
        flooded: Collection[str] = (),
        continuity: Continuity | None = None,
    ) -> None:
        self.flooded = set(flooded)
        self.problems: Problems = {}
        self._left = {station.name: station for station in stations if station.holds}
        self._action_log = action_log
        self._again = again
        self._spare = spare
        self._continuity = continuity
        self._elsewhere = FamiliesElsewhere(action_log.folder)

    @property
    def left(self) -> list[StationLease]:
        return list(self._left.values())

    def run(self) -> list[StationLease]:
        """Make all stations safe; return the leases that still hold something."""
        stations, end = self.left, time.monotonic() + ENDED_S
        with suppress(UsageError):  # some ports then need a second attempt
            allow_ports(OPENING * len(stations))
        if self._continuity is not None:
            self._elsewhere.begin()
        threads = [OnceInThread(partial(self._one, station)) for station in stations]
        for thread in threads:
            thread.begin()
        for thread in threads:
            thread.do_unless_begun()
        for thread in threads:
            thread.await_done(max(end - time.monotonic(), 0.0))
        return self.left

    def _one(self, lease: StationLease) -> None:
        blind = self._blind_orders(lease)
        ordered_before = 0 if blind is None else blind.count
        try:
            task = self._secured_with_retry(lease, blind)
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
        if blind is not None and blind.found_other is not None:
            text = f"on {lease.url} there is now {blind.found_other}; it gets no orders"
            self._report(lease, "identity.changed", CRITICAL, text, is_news=True)
        for tool in task.tools:
            if tool.is_safe and tool.status is not None:
                self._report_safe(lease, task, tool)
            elif blind is not None and blind.ordered(tool.port) is not None:
                is_news = blind.count > ordered_before
                self._report_ordered(lease, task, tool, blind, is_news=is_news)
            else:
                self._report_unsafe(lease, task, tool, blind)
        if task.feeds:
            text, is_news = "the guard could not stop the feeder; switch the station off", False
            if blind is not None and blind.count:
                times, is_news = count_text(blind.count, "time"), blind.count > ordered_before
                text = (
                    f"the feeder's stop was ordered {times}, not confirmed; switch the station off"
                )
            self._report(lease, "safety.not_safe", CRITICAL, text, is_news=is_news)

    def _blind_orders(self, lease: StationLease) -> BlindOrders | None:
        if self._continuity is None:
            return None
        return BlindOrders(lease, self._continuity, self._is_mixed)

    def _is_mixed(self) -> bool:
        assert self._continuity is not None
        return is_mixed(self._continuity.families, self._elsewhere.get())

    def _secured_with_retry(self, lease: StationLease, blind: BlindOrders | None) -> SafetyTask:
        """Try twice: a failure of this program may be temporary, for example refused memory."""
        try:
            return self._secured(lease, blind)
        except Exception:
            return self._secured(lease, blind)

    def _secured(self, lease: StationLease, blind: BlindOrders | None) -> SafetyTask:
        task = self._task(lease)
        if blind is not None:
            task.prove = lambda: blind.prove(task)

        def opened() -> Port:
            port = _open(lease)
            if blind is not None:
                blind.device = device_of(lease.url, port.fileno())
            return port

        blocking.run(secure(task), opened, sleep=time.sleep)
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
            lambda: identify(client, lease),
            is_proven=False,
            spare=self._spare
            or (self._continuity is not None and self._continuity.may_rest(lease)),
            is_stranger=lease.name in self.flooded,
        )

    def _report_safe(self, lease: StationLease, task: SafetyTask, tool: ToolSafety) -> None:
        assert tool.status is not None
        text = "was put in its safe state by the guard"
        if tool.was_spared:
            text = "was in its safe state already"
        why, severity = (f"; {tool.fell_back}", WARNING) if tool.fell_back else ("", INFO)
        state = task.family.status.shown(tool.status)
        text = f"the tool {text}, as read back: {state}{why}"
        self._report(lease, "safety.safe_state", severity, text, tool.port)

    def _report_ordered(
        self,
        lease: StationLease,
        task: SafetyTask,
        tool: ToolSafety,
        blind: BlindOrders,
        *,
        is_news: bool,
    ) -> None:
        """Report a tool that was ordered without an answer of its station."""
        ordered = blind.ordered(tool.port)
        assert ordered is not None
        word, times = ordered
        if task.flood is None:
            state = task.family.status.shown(word)
            text = (
                f"the station does not answer: {state} was ordered {count_text(times, 'time')},"
                " not confirmed"
            )
        else:
            text = f"the tool {NOT_CONFIRMED} {FLOODED}"
        if blind.was_mixed:
            text += "; on a line of mixed families that does not count as safe"
        self._report(
            lease,
            "safety.not_safe",
            CRITICAL,
            f"{text}; {HOT}",
            tool.port,
            orders=times,
            is_news=is_news,
        )

    def _report_unsafe(
        self, lease: StationLease, task: SafetyTask, tool: ToolSafety, blind: BlindOrders | None
    ) -> None:
        what = NOT_CONFIRMED if tool.reached == SafetyResult.SENT else "could not be made safe"
        what += "" if task.flood is None else f" {FLOODED}"
        why = "" if blind is None else blind.why_not(tool.port)
        if why and not tool.was_ordered:
            what += f", and got no order: {why}"
        self._report(lease, "safety.not_safe", CRITICAL, f"the tool {what}; {HOT}", tool.port)

    def _report(
        self,
        lease: StationLease,
        kind: str,
        severity: str,
        text: str,
        port: int | None = None,
        *,
        orders: int | None = None,
        is_news: bool = False,
    ) -> None:
        if severity == CRITICAL:
            self.problems.setdefault(lease.name, {})[port or 0] = text
        if self._again and severity == CRITICAL and not is_news:
            return
        self._action_log.write(
            kind, severity, f"{text[0].upper()}{text[1:]}.", lease.name, port, orders
        )
        show(f"{lease.name if port is None else f'{lease.name} port {port}'}: {text}")


def _format(lease: StationLease) -> LineFormat:
    return LineFormat(lease.baudrate, lease.format)


def _open(lease: StationLease) -> Port:
    return open_port(lease.url, _format(lease))


class FamiliesElsewhere:
    """The families of other runs' leases, looked at in a thread for `OTHER_LEASES_S`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._found: set[str] | None = None
        self._is_done = Event()
        self._until = 0.0

    def begin(self) -> None:
        self._until = time.monotonic() + OTHER_LEASES_S
        with suppress(RuntimeError, MemoryError):
            _thread.start_new_thread(self._look, ())

    def get(self) -> set[str] | None:
        """Return them when they are known; None if they are not in time."""
        self._is_done.wait(max(self._until - time.monotonic(), 0.0))
        return self._found

    def _look(self) -> None:
        self._found = families_leased(self._folder)
        self._is_done.set()


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
