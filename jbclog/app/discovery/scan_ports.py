"""Scans of several ports side by side: the composition root of `scan`, and of what `doctor` asks of a line.

::

    url -> ScanPlan -> open_port, questions only, counted -> drive.blocking pulls finding.scan -> PortReport

Each port has a thread of its own: a scan waits nearly all the time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Final

from jbclog.core.clock import Clock, SystemClock
from jbclog.core.errors import PortBusy
from jbclog.core.wire import LineFormat
from jbclog.record.port_owner import run_that_holds
from jbclog.session.discovery.found import PortReport, ScanPlan
from jbclog.session.discovery.probe import is_harmless
from jbclog.session.discovery.scan import Dial, scan
from jbclog.transport import blocking
from jbclog.transport.opening import open_port
from jbclog.transport.port import Port
from jbclog.transport.read_only import ReadOnly
from jbclog.transport.system_ports import in_words_all, sharers_of

MOST_AT_ONCE = 64


@dataclass(frozen=True, slots=True)
class Means:
    """How ports are opened and time passes; tests have their own."""

    open_port: Callable[[str, LineFormat], Port]
    sleep: Callable[[float], None]
    clock: Clock


SYSTEM: Final = Means(open_port, time.sleep, SystemClock())

Told = Callable[[PortReport], object]


def search(wanted: Sequence[tuple[str, ScanPlan]], told: Told = lambda _: None, means: Means | None = None) -> list[PortReport]:
    """Scan every url by its plan; `told` is called, in this thread, with each report as it is done. In the order of `wanted`.

    Ctrl-C ends all scans within one answer's time.
    """
    by = means or SYSTEM
    dials = [Dial(plan.trials[0].line) for _, plan in wanted]
    with ThreadPoolExecutor(max_workers=max(1, min(len(wanted), MOST_AT_ONCE)), thread_name_prefix="scan") as pool:
        scans = [pool.submit(_scan, url, plan, dial, by) for (url, plan), dial in zip(wanted, dials, strict=True)]
        try:
            for done in as_completed(scans):
                told(done.result())
        except BaseException:
            _stop(dials)
            raise
    return [one.result() for one in scans]


def _stop(dials: Iterable[Dial]) -> None:
    for dial in dials:
        dial.stop = True


def _scan(url: str, plan: ScanPlan, dial: Dial, means: Means) -> PortReport:
    report = PortReport(url)
    blocking.run(scan(plan, dial, report), lambda: _open(report, dial, means), sleep=means.sleep, clock=means.clock)
    return report


def _open(report: PortReport, dial: Dial, means: Means) -> Port:
    """The port as a scan may use it: it lets harmless questions through and counts them.

    A run holds its stations also while a cable is out, and behind servers that would take a second client. A program that
    does not keep others out would lose what is answered here.
    """
    run = None if report.tried else run_that_holds(report.url)
    if run is not None:
        raise PortBusy(f"{report.url} belongs to the run {run}; wait for its end, or end it")
    sharers = [] if report.tried else sharers_of(report.url)
    if sharers:
        raise PortBusy(f"{report.url} is open in {in_words_all(sharers)}; end that, or take another port", sharers[0])
    return _Counted(ReadOnly(means.open_port(report.url, dial.line), is_harmless), report, dial.line)


class _Counted:
    """A port that counts what is sent in its report: what was handed to the system, not what was meant to be."""

    def __init__(self, port: Port, report: PortReport, line: LineFormat) -> None:
        self._report = report
        self._line = line
        self.url = port.url
        self.fileno = port.fileno
        self.read_now = port.read_now
        self.read = port.read
        self.close = port.close
        self._write = port.write

    def write(self, data: bytes) -> None:
        self._write(data)
        self._report.sent[self._line, data] += 1
