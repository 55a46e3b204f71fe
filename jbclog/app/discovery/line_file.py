"""From what a scan found to a line file that runs as it is."""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from jbclog.config.line import AUTO, Described, StationTable, is_path, line_comment, line_text, station_text
from jbclog.config.schema import NAME_PATTERN
from jbclog.session.discovery.found import PortReport, StationFound
from jbclog.transport.system_ports import lasting_name

NO_TOOL = (None, "none")


def text_of(reports: Sequence[PortReport], file: Path) -> str | None:
    """The text of a line file with every station that a run could begin with, and those to be completed as comments.

    None where there is neither.
    """
    stations = _described([report for report in reports if report.station is not None and report.station.is_drivable])
    name = file.stem if re.fullmatch(NAME_PATTERN, file.stem) else "line"
    text = line_text(name, stations, "Found by jbclog scan. A station's recipe goes here, or on the command line.")
    proposals = "".join(_proposal(report) for report in reports)
    return text + proposals if stations or proposals else None


def is_complete(reports: Sequence[PortReport]) -> bool:
    """Whether the line file has a station that a run could begin with, and not proposals alone."""
    return any(report.station is not None and report.station.is_drivable for report in reports)


def _proposal(report: PortReport) -> str:
    """A station whose model no table has, as comments: nobody but a person can name its family."""
    found = report.station
    if found is None or found.model is None or found.family is not None or found.robot_mode is False or found.trouble is not None:
        return ""
    said = f"Model {found.model} is in no table. If you know what it is: name the family, and take away the # before these lines."
    table = _table("station-1", report.url, found, AUTO).model_copy(update={"family": "...", "model": found.model})
    return line_comment(f"\n{said}\n{station_text(table)}")


def _described(reports: Sequence[PortReport]) -> list[Described]:
    numbers: Counter[str] = Counter()
    described = []
    for report in reports:
        if report.station is not None and report.station.family is not None:
            family = report.station.family.name
            numbers[family] += 1
            described.append(
                (_table(f"{family}-{numbers[family]}", report.url, report.station, family), _said(report, report.station))
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
    """The ports with a tool: a run refuses a named port without one. Where there is no tool at all, those that answer."""
    with_tool = tuple(port for port, tool in found.tools.items() if tool not in NO_TOOL)
    return with_tool or tuple(found.tools) or None


def lasting_url(url: str) -> str:
    """The url as a line file best has it: a USB adapter by its own number, a path from the root."""
    return lasting_name(os.path.abspath(url)) if is_path(url) else url  # noqa: PTH100  # a link stays a link


def _said(report: PortReport, found: StationFound) -> str:
    parts = [found.model or (found.family.title if found.family else "a station that does not say its model")]
    parts += [f"software {found.software}"] if found.software else []
    parts += [f"port {port} {tool or 'not told'}" for port, tool in found.tools.items()]
    said = [", ".join(parts)]
    said += ["The line format is the server's."] if report.url.startswith("socket:") else []
    faster = found.turnaround.faster if found.turnaround else None
    said += [f"{faster[0].upper()}{faster[1:]}."] if faster else []
    return "\n".join(said)
