"""`jbclog scan`: who answers on these ports?"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.core.serial_line import LineFormat
    from jbclog.session.discovery.found import PortReport, ScanPlan, StationFound, Turnaround

# -- scan wording -------------------------------------------------------------------------------------------------------------
# What a scan found, for the terminal and as facts: each port, who answers, what is wrong, and everything that was sent.

NOT_PROVEN = "not known until the first write"
NO_PORTS = "this computer has no USB serial port: plug the adapter in, or name the port: `jbclog scan /dev/ttyS0`"


def tell_progress(report: PortReport, *, quiet: bool) -> None:
    if not quiet:
        note(f"{report.url}: {_title(report)}")


def _title(report: PortReport) -> str:
    if report.station is None:
        return "no station" if report.tried else "not asked"
    found = report.station
    family = f"family {found.family.name}" if found.family else "of no known family"
    return f"{found.model}, {family}" if found.model else family if found.family else "a station that does not say its model"


def tell_no_ports(*, as_json: bool) -> None:
    if as_json:
        tell_json({"ports": [], "sent": [], "written": None, "finding": NO_PORTS})
    else:
        tell(NO_PORTS)


def tell_found(reports: list[PortReport], wanted: Path | None, written: Path | None) -> None:
    from jbclog.app.discovery import is_complete

    for report in reports:
        tell(*_lines(report))
        tell()
    tell(*_sent_lines(reports))
    if wanted and not written:
        tell()
        tell(f"not written: {wanted}; there is no station that a run could begin with")
    if written:
        tell()
        if is_complete(reports):
            tell(f"written: {written}. `jbclog plan RECIPE --line {written}` shows what a run would do.")
        else:
            tell(f"written: {written}, without a station yet: name the family in it, and take away the # before its lines.")


def _lines(report: PortReport) -> Iterator[str]:
    from jbclog.session.discovery.diagnosis import diagnose

    yield f"{report.url}  {_title(report)}"
    if report.station is not None:
        yield from (f"  {name:<11} {text}" for name, text in _station_lines(report.station))
    for finding in diagnose(report):
        yield f"  {'finding':<11} {finding.what}"
        yield f"  {'step':<11} {finding.step}"
    if report.untried:
        yield f"  {'not tried':<11} {', '.join(map(str, report.untried))}"


def _station_lines(found: StationFound) -> Iterator[tuple[str, str]]:
    addressing = f", {found.addressing}" if found.has_robot_mode else ""
    yield "line", f"{found.line}{addressing}"
    if found.has_robot_mode:
        yield "Robot mode", NOT_PROVEN if found.robot_mode is None else "off"
    else:
        yield "identity", "not told: it answers A as an OMEGA does"
    if found.software:
        yield "software", found.software
    if found.tools:
        yield "ports", "; ".join(f"{port} {_tool_text(tool)}" for port, tool in found.tools.items())
    if found.error:
        yield "error", found.error
    if found.not_answered:
        yield "no answer", ", ".join(name.replace("_", " ") for name in found.not_answered)
    if found.turnaround:
        yield "turnaround", _turnaround_text(found.turnaround)
        if found.turnaround.faster:
            yield "note", f"{found.turnaround.faster}; this does no harm"


def _tool_text(tool: str | None) -> str:
    return {None: "not told", "none": "no tool"}.get(tool, str(tool))


def _turnaround_text(turnaround: Turnaround) -> str:
    missed = turnaround.asked - turnaround.answered
    lost = f", {missed} of {turnaround.asked} not answered" if missed else ""
    return f"{turnaround.median_ms:.2f} ms median, {turnaround.p99_ms:.2f} ms at worst{lost}"


def _sent_lines(reports: Iterable[PortReport]) -> Iterator[str]:
    """What was sent, each question once with its bytes, how often, and at how many line formats."""
    from jbclog.session.discovery.probe import question_text

    sent = _sent(reports)
    number = sum(lines.total() for lines in sent.values())
    yield f"Sent {count_of(number, 'question')} and nothing else; nothing was written or cleared:"
    for data, lines in sent.items():
        at = next(iter(lines)) if len(lines) == 1 else f"{len(lines)} line formats"
        yield f"  {lines.total():>4} × {question_text(data)}, at {at}: {data.hex(' ')}"


def _sent(reports: Iterable[PortReport]) -> dict[bytes, Counter[LineFormat]]:
    """How often each question was sent at each line format."""
    sent: dict[bytes, Counter[LineFormat]] = {}
    for report in reports:
        for (line, data), count in report.sent.items():
            sent.setdefault(data, Counter())[line] += count
    return sent


def count_of(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def facts_of(reports: list[PortReport], written: Path | None) -> dict[str, object]:
    from jbclog.session.discovery.probe import question_text

    sent = [
        {"question": question_text(data), "hex": data.hex(), "line": str(line), "count": count}
        for data, lines in _sent(reports).items()
        for line, count in lines.items()
    ]
    return {"ports": [_port_facts(report) for report in reports], "sent": sent, "written": str(written) if written else None}


def _port_facts(report: PortReport) -> dict[str, object]:
    from jbclog.session.discovery.diagnosis import diagnose

    return {
        "url": report.url,
        "station": _station_facts(report.station) if report.station else None,
        "findings": [{"kind": one.kind, "where": one.where, "what": one.what, "step": one.step} for one in diagnose(report)],
        "tried": [str(line) for line in report.tried],
        "untried": [str(line) for line in report.untried],
        "garbage": {str(line): data.hex() for line, data in report.garbage.items()},
        "echo": report.echoed,
        "questions": sum(report.sent.values()),
        "seconds": round(report.seconds, 3),
    }


def _station_facts(found: StationFound) -> dict[str, object]:
    turnaround = found.turnaround
    return {
        "model": found.model,
        "family": found.family.name if found.family else None,
        "software": found.software,
        "baudrate": found.line.baudrate,
        "format": found.line.format,
        "address": found.address,
        "robot_mode": found.robot_mode,
        "refusal": found.refusal,
        "error": found.error,
        "tools": {str(port): tool for port, tool in found.tools.items()},
        "turnaround_ms": {"median": turnaround.median_ms, "p99": turnaround.p99_ms, "n": turnaround.answered}
        if turnaround
        else None,
        "faster_link": turnaround.faster if turnaround else None,
        "trouble": found.trouble,
        "not_taken": list(found.not_answered),
    }


# -- scan ---------------------------------------------------------------------------------------------------------------------

_ADDRESSES = re.compile(r"(\d{1,2})(?:-(\d{1,2}))?", re.ASCII)


@ends_with_errors_told
def scan(
    urls: list[str] = typer.Argument(
        None, metavar="[URL]...", help="Devices, socket://HOST:PORT or rfc2217://HOST:PORT. Default: every USB serial port."
    ),
    write: Path | None = typer.Option(None, "--write", "-w", metavar="FILE", help="Write a line file with what was found."),
    force: bool = typer.Option(False, "--force", help="Let --write replace a file."),
    thorough: bool = typer.Option(False, "--thorough", help="Try all 72 line formats of the older stations."),
    addresses: str | None = typer.Option(
        None, metavar="LIST", help="Ask these addresses too, such as 2,5 or 1-99. Usual: 1, none, 10.", show_default=False
    ),
    seconds: float | None = typer.Option(
        None, min=0.5, max=3600, metavar="S", help="Give up on a port after this many seconds.", show_default=False
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Find stations and the link settings that they answer at.

    Asks with and without addresses, at the usual rates and formats, and for OMEGA. Sends only questions that change and clear
    nothing, and lists them at the end. Leaves ports alone that are in use. Exit code 1: a named port has no station that jbclog
    can drive, or none was found.

    \b
    Example:
      jbclog scan /dev/ttyUSB0 --write line.toml
    """
    from jbclog.app.discovery import search

    _check_file(write, force=force)
    asked = _addresses(addresses)
    wanted = [(url, _plan(url, asked, thorough=thorough, seconds=seconds)) for url in _ports(urls)]
    if not wanted:
        tell_no_ports(as_json=as_json)
        raise typer.Exit(1)
    note(f"asking {count_of(len(wanted), 'port')}, at most {max(plan.seconds for _, plan in wanted):.0f} s each")
    reports = search(wanted, lambda report: tell_progress(report, quiet=as_json))
    written = _write(write, reports)
    if as_json:
        tell_json(facts_of(reports, written))
    else:
        tell_found(reports, write, written)
    if not _all_fine(reports, named=bool(urls)):
        raise typer.Exit(1)


# -- what is asked for ------------------------------------------------------------------------------------------------------


def _ports(urls: list[str] | None) -> list[str]:
    """The ports that are named, each once; every USB serial port where none is. Raises `UsageError`."""
    from jbclog.config.line import is_path, url_problem
    from jbclog.transport.system_ports import usb_ports

    if not urls:
        return [port.name for port in usb_ports()]
    known: dict[str, str] = {}
    for url in urls:
        problem = url_problem(url)
        if problem:
            raise UsageError(f"{problem}. A port is a device such as /dev/ttyUSB0, socket://HOST:PORT or rfc2217://HOST:PORT")
        known.setdefault(os.path.realpath(url) if is_path(url) else url, url)
    return list(known.values())


def _plan(url: str, addresses: tuple[int | None, ...], *, thorough: bool, seconds: float | None) -> ScanPlan:
    from jbclog.session.discovery.found import plan_for

    return plan_for(url, thorough=thorough, addresses=addresses, limit_s=seconds)


def _addresses(text: str | None) -> tuple[int | None, ...]:
    """The usual addresses and those of ``2,5`` or ``1-99``. Raises `UsageError`."""
    from jbclog.session.discovery.found import ADDRESSES

    found: dict[int | None, None] = dict.fromkeys(ADDRESSES)
    for part in text.split(",") if text else ():
        match = _ADDRESSES.fullmatch(part.strip())
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
        if not 1 <= first <= last <= 99:
            raise UsageError(f"--addresses {text}: give addresses from 1 to 99, such as 2,5 or 1-99")
        found |= dict.fromkeys(range(first, last + 1))
    return tuple(found)


def _check_file(write: Path | None, *, force: bool) -> None:
    """Before anything is sent: what is there is not overwritten by mistake."""
    if write is None:
        return
    if write.exists() and not (force and write.is_file()):
        raise UsageError(f"--write {write}: it is there already; take another name, or --force")
    if not write.absolute().parent.is_dir():
        raise UsageError(f"--write {write}: there is no folder {write.absolute().parent}")


def _write(write: Path | None, reports: list[PortReport]) -> Path | None:
    """The line file, written; None where there was nothing to write."""
    from jbclog.app.discovery import text_of

    text = None if write is None else text_of(reports, write)
    if write is None or text is None:
        return None
    try:
        write.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"--write {write}: cannot be written ({error.strerror})") from error
    return write


def _all_fine(reports: list[PortReport], *, named: bool) -> bool:
    fine = [report.station is not None and report.station.is_drivable for report in reports]
    return all(fine) if named else any(fine)
