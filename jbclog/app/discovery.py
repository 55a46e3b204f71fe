"""Scans several ports in parallel; writes a line file of the stations found. Start with
`search`.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from jbclog.app.port_access import SYSTEM, PortAccess
from jbclog.config.line import (
    AUTO,
    Described,
    StationTable,
    is_path,
    line_comment,
    line_text,
    station_text,
)
from jbclog.config.schema import name_problem
from jbclog.core.errors import PortBusy
from jbclog.core.serial_line import LineFormat
from jbclog.record.port_owner import run_that_holds
from jbclog.session.discovery.port_scan import ScanControl, scan
from jbclog.session.discovery.probe import is_harmless
from jbclog.session.discovery.scan_plan import PortReport, ScanPlan, StationFound
from jbclog.transport.port import Port
from jbclog.transport.read_only import ReadOnly
from jbclog.transport.system_ports import lasting_name, processes_text, sharers_of

# -- scan ------------------------------------------------------------------------------------------
#
#     url -> ScanPlan -> open_port, reads only, counted -> blocking.run pulls `scan` -> PortReport
#
# Each port has its own thread: a scan spends most of its time waiting.

MOST_AT_ONCE = 64


OnReport = Callable[[PortReport], object]


def search(
    wanted: Sequence[tuple[str, ScanPlan]],
    on_report: OnReport = lambda _: None,
    access: PortAccess = SYSTEM,
) -> list[PortReport]:
    """Scan every URL by its plan; return the reports in the order of `wanted`.

    `on_report` is called in this thread with each report as it is done. Ctrl-C ends all scans
    within one response time.
    """
    controls = [ScanControl(plan.trials[0].line) for _, plan in wanted]
    with ThreadPoolExecutor(
        max_workers=max(1, min(len(wanted), MOST_AT_ONCE)), thread_name_prefix="scan"
    ) as pool:
        scans = [
            pool.submit(_scan, url, plan, control, access)
            for (url, plan), control in zip(wanted, controls, strict=True)
        ]
        try:
            for done in as_completed(scans):
                on_report(done.result())
        except BaseException:
            _stop(controls)
            raise
    return [one.result() for one in scans]


def _stop(controls: Iterable[ScanControl]) -> None:
    for control in controls:
        control.stop = True


def _scan(url: str, plan: ScanPlan, control: ScanControl, access: PortAccess) -> PortReport:
    report = PortReport(url)
    access.run(scan(plan, control, report), lambda: _open(report, control, access))
    return report


def _open(report: PortReport, control: ScanControl, access: PortAccess) -> Port:
    """Open a port for a scan: it passes harmless reads only, and counts them.

    A run keeps its stations also while a cable is out, and behind servers that accept a second
    client. A program that does not lock its port would lose the answers to the scan.
    """
    run = None if report.tried else run_that_holds(report.url)
    if run is not None:
        raise PortBusy(f"{report.url} is held by the run {run}; end that run, or wait for its end")
    sharers = [] if report.tried else sharers_of(report.url)
    if sharers:
        raise PortBusy(
            f"{report.url} is open in {processes_text(sharers)}; end that, or take another port",
            sharers[0],
        )
    return _Counted(
        ReadOnly(access.open_port(report.url, control.line), is_harmless), report, control.line
    )


class _Counted:
    """A port that counts the bytes that the system accepted, in its report."""

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


# -- line file -------------------------------------------------------------------------------------

NO_TOOL = (None, "none")


def text_of(reports: Sequence[PortReport], file: Path) -> str | None:
    """Return the text of a line file with every usable station, and incomplete ones as comments.

    None if there is neither.
    """
    stations = described(reports)
    name = file.stem if name_problem(file.stem) is None else "line"
    text = line_text(
        name,
        stations,
        "Found by jbclog scan. A station's recipe goes here, or on the command line.",
    )
    proposals = "".join(_proposal(report) for report in reports)
    return text + proposals if stations or proposals else None


def is_complete(reports: Sequence[PortReport]) -> bool:
    """Whether the line file has a usable station, and not only comments."""
    return any(report.station is not None and report.station.is_drivable for report in reports)


def _proposal(report: PortReport) -> str:
    """Return a station of unknown model as comments, because only a person can name its family."""
    found = report.station
    if (
        found is None
        or found.model is None
        or found.family is not None
        or found.robot_mode is False
        or found.trouble is not None
    ):
        return ""
    text = (
        f"Model {found.model} is unknown. If you know its family, enter it and remove the # from"
        " these lines."
    )
    table = _table("station-1", report.url, found, AUTO).model_copy(
        update={"family": "...", "model": found.model}
    )
    return line_comment(f"\n{text}\n{station_text(table)}")


def described(reports: Sequence[PortReport]) -> list[Described]:
    """Return the stations that jbclog can drive, numbered by their families."""
    numbers: Counter[str] = Counter()
    described = []
    for report in reports:
        if (
            report.station is not None
            and report.station.is_drivable
            and report.station.family is not None
        ):
            family = report.station.family.name
            numbers[family] += 1
            described.append(
                (
                    _table(f"{family}-{numbers[family]}", report.url, report.station, family),
                    _description(report, report.station),
                )
            )
    return described


def _table(name: str, url: str, found: StationFound, family: str) -> StationTable:
    turnaround = found.turnaround
    return StationTable(
        name=name,
        url=lasting_url(url),
        family=family,
        baudrate=found.line.baudrate,
        format=found.line.format,
        address=found.address if found.address is not None else False,
        ports=_ports(found),
        turnaround_ms=math.ceil(turnaround.median_ms * 10) / 10 if turnaround else None,
    )


def _ports(found: StationFound) -> tuple[int, ...] | None:
    """Return the ports with a tool, because a run refuses a named port without one. If there is no
    tool at all, return those that answer.
    """
    with_tool = tuple(port for port, tool in found.tool_names.items() if tool not in NO_TOOL)
    return with_tool or tuple(found.tool_names) or None


def lasting_url(url: str) -> str:
    """Return a URL that stays valid: a USB adapter by its own number, a path from the root."""
    return lasting_name(os.path.abspath(url)) if is_path(url) else url  # noqa: PTH100  # a link stays a link


def _description(report: PortReport, found: StationFound) -> str:
    parts = [
        found.model
        or (found.family.title if found.family else "a station that does not report its model")
    ]
    parts += [f"software {found.software}"] if found.software else []
    parts += [f"port {port} {tool or 'unknown tool'}" for port, tool in found.tool_names.items()]
    lines = [", ".join(parts)]
    lines += ["The server sets the line format."] if report.url.startswith("socket:") else []
    faster = found.turnaround.faster if found.turnaround else None
    lines += [f"{faster[0].upper()}{faster[1:]}."] if faster else []
    return "\n".join(lines)
