"""`jbclog scan`: find stations on serial and network ports."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import echo, echo_json, note, reports_errors
from jbclog.core.disk_space import write_failure
from jbclog.core.errors import UsageError
from jbclog.core.text import count_text

if TYPE_CHECKING:
    from jbclog.core.serial_line import LineFormat
    from jbclog.session.discovery.scan_plan import PortReport, ScanPlan, StationFound, Turnaround

# -- result ----------------------------------------------------------------------------------------

NOT_PROVEN = "not known until the first write"
NO_PORTS = (
    "no USB serial port found: plug the adapter in, or name the port: `jbclog scan /dev/ttyS0`"
)


def print_progress(report: PortReport, *, quiet: bool) -> None:
    if not quiet:
        note(f"{report.url}: {_title(report)}")


def _title(report: PortReport) -> str:
    if report.station is None:
        return "no station" if report.tried else "not scanned"
    found = report.station
    family = f"family {found.family.name}" if found.family else "unknown family"
    return (
        f"{found.model}, {family}"
        if found.model
        else family
        if found.family
        else "a station that reports no model"
    )


def print_no_ports(*, as_json: bool) -> None:
    if as_json:
        echo_json({"ports": [], "sent": [], "written": None, "finding": NO_PORTS})
    else:
        echo(NO_PORTS)


def print_found(
    reports: list[PortReport], wanted: Path | None, written: Path | None, *, verbose: bool
) -> None:
    from jbclog.app.discovery import is_complete

    for report in reports:
        echo(*_lines(report, verbose=verbose))
        echo("")
    echo(*_sent_lines(reports, verbose=verbose))
    if wanted and not written:
        echo("")
        echo(f"not written: {wanted}; no station that jbclog can drive")
    if written:
        echo("")
        if is_complete(reports):
            echo(f"written: {written}. Next: jbclog plan RECIPE --line {written}")
        else:
            echo(
                f"written: {written}, no station active yet: enter the family and remove the #"
                " before its lines."
            )


def _lines(report: PortReport, *, verbose: bool) -> Iterator[str]:
    from jbclog.session.discovery.diagnosis import diagnose

    yield f"{report.url}  {_title(report)}"
    if report.station is not None:
        yield from (f"  {name:<11} {text}" for name, text in _station_lines(report.station))
    for finding in diagnose(report):
        yield f"  {'finding':<11} {finding.what}"
        yield f"  {'step':<11} {finding.step}"
    if verbose:
        for line, data in report.garbage.items():
            yield f"  {'bytes':<11} at {line}: {data.hex(' ')}"
    if report.untried:
        yield f"  {'not tried':<11} {', '.join(map(str, report.untried))}"


def _station_lines(found: StationFound) -> Iterator[tuple[str, str]]:
    addressing = f", {found.addressing}" if found.has_robot_mode else ""
    yield "line", f"{found.line}{addressing}"
    if found.has_robot_mode:
        yield "Robot mode", NOT_PROVEN if found.robot_mode is None else "off"
    else:
        yield "identity", "not reported: it answers A as an OMEGA does"
    if found.software:
        yield "software", found.software
    if found.tool_names:
        yield (
            "ports",
            "; ".join(f"{port} {_tool_text(tool)}" for port, tool in found.tool_names.items()),
        )
    if found.error:
        yield "error", found.error
    if found.not_answered:
        yield "no answer", ", ".join(name.replace("_", " ") for name in found.not_answered)
    if found.turnaround:
        yield "response", _turnaround_text(found.turnaround)
        if found.turnaround.faster:
            yield "note", f"{found.turnaround.faster} (harmless)"


def _tool_text(tool: str | None) -> str:
    return {None: "not reported", "none": "no tool"}.get(tool, str(tool))


def _turnaround_text(turnaround: Turnaround) -> str:
    missed = turnaround.asked - turnaround.answered
    lost = f", {missed} of {turnaround.asked} not answered" if missed else ""
    return f"{turnaround.median_ms:.2f} ms median, {turnaround.p99_ms:.2f} ms 99th percentile{lost}"


def _sent_lines(reports: Iterable[PortReport], *, verbose: bool) -> Iterator[str]:
    """Yield how many queries were sent; with `verbose` each, with its bytes, count and number of
    line formats.
    """
    from jbclog.session.discovery.probe import question_text

    sent = _sent(reports)
    number = sum(lines.total() for lines in sent.values())
    noun = "query" if number == 1 else "queries"
    summary = f"Sent {number} {noun}; wrote and cleared nothing"
    if not verbose:
        yield f"{summary} (--verbose lists them)."
        return
    yield f"{summary}:"
    for data, lines in sent.items():
        at = next(iter(lines)) if len(lines) == 1 else f"{len(lines)} line formats"
        yield f"  {lines.total():>4} × {question_text(data)}, at {at}: {data.hex(' ')}"


def _sent(reports: Iterable[PortReport]) -> dict[bytes, Counter[LineFormat]]:
    """Return how often each query was sent at each line format."""
    sent: dict[bytes, Counter[LineFormat]] = {}
    for report in reports:
        for (line, data), count in report.sent.items():
            sent.setdefault(data, Counter())[line] += count
    return sent


def facts_of(reports: list[PortReport], written: Path | None) -> dict[str, object]:
    from jbclog.session.discovery.probe import question_text

    sent = [
        {"question": question_text(data), "hex": data.hex(), "line": str(line), "count": count}
        for data, lines in _sent(reports).items()
        for line, count in lines.items()
    ]
    return {
        "ports": [_port_facts(report) for report in reports],
        "sent": sent,
        "written": str(written) if written else None,
    }


def _port_facts(report: PortReport) -> dict[str, object]:
    from jbclog.session.discovery.diagnosis import diagnose

    return {
        "url": report.url,
        "station": _station_facts(report.station) if report.station else None,
        "findings": [
            {"kind": one.kind, "where": one.where, "what": one.what, "step": one.step}
            for one in diagnose(report)
        ],
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
        "tool_names": {str(port): tool for port, tool in found.tool_names.items()},
        "turnaround_ms": (
            {"median": turnaround.median_ms, "p99": turnaround.p99_ms, "n": turnaround.answered}
            if turnaround
            else None
        ),
        "faster_link": turnaround.faster if turnaround else None,
        "trouble": found.trouble,
        "not_taken": list(found.not_answered),
    }


# -- scan ------------------------------------------------------------------------------------------

_ADDRESSES = re.compile(r"(\d{1,2})(?:-(\d{1,2}))?", re.ASCII)


@reports_errors
def scan(
    ctx: typer.Context,
    urls: list[str] = typer.Argument(
        None,
        metavar="URL",
        help="Device, socket://HOST:PORT or rfc2217://HOST:PORT; default: USB serial ports.",
    ),
    write: Path | None = typer.Option(
        None, "--write", "-w", metavar="FILE", help="Line file to write."
    ),
    force: bool = typer.Option(False, "--force", help="Overwrite the file of --write."),
    thorough: bool = typer.Option(
        False, "--thorough", help="Try all 72 line formats of the older stations."
    ),
    addresses: str | None = typer.Option(
        None,
        metavar="LIST",
        help="More addresses, such as 2,5 or 1-99; default: 1, none, 10.",
        show_default=False,
    ),
    seconds: float | None = typer.Option(
        None,
        min=0.5,
        max=3600,
        metavar="S",
        help="Time limit per port, in seconds.",
        show_default=False,
    ),
    verbose: bool = typer.Option(
        False, "--verbose", help="List each query, and bytes that are no answer."
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Find stations and their link settings.

    Tries the usual baud rates, formats and addresses, and the OMEGA protocol. Sends only queries
    that change and clear nothing. Skips ports in use. Exit code 1: a
    named port has no station that jbclog can drive, or no station was found.

    \b
    Example:
      jbclog scan /dev/ttyUSB0 --write line.toml
    """
    from jbclog.app.discovery import search

    _check_file(write, force=force)
    asked = _addresses(addresses)
    wanted = [(url, _plan(url, asked, thorough=thorough, seconds=seconds)) for url in _ports(urls)]
    if not wanted:
        print_no_ports(as_json=as_json)
        raise typer.Exit(1)
    note(
        f"scanning {count_text(len(wanted), 'port')},"
        f" {max(plan.seconds for _, plan in wanted):.0f} s each at most"
    )
    reports = search(
        wanted, lambda report: print_progress(report, quiet=as_json), options.port_access(ctx)
    )
    written = _write(write, reports)
    if as_json:
        echo_json(facts_of(reports, written))
    else:
        print_found(reports, write, written, verbose=verbose)
    if not _all_fine(reports, named=bool(urls)):
        raise typer.Exit(1)


# -- options ---------------------------------------------------------------------------------------


def _ports(urls: list[str] | None) -> list[str]:
    """Return the named ports without duplicates, or every USB serial port. Raises `UsageError`."""
    from jbclog.config.line import is_path, url_problem
    from jbclog.transport.system_ports import usb_ports

    if not urls:
        return [port.name for port in usb_ports()]
    known: dict[str, str] = {}
    for url in urls:
        problem = url_problem(url)
        if problem:
            raise UsageError(
                f"{problem}. A port is a device such as /dev/ttyUSB0, socket://HOST:PORT or"
                " rfc2217://HOST:PORT"
            )
        known.setdefault(os.path.realpath(url) if is_path(url) else url, url)
    return list(known.values())


def _plan(
    url: str, addresses: tuple[int | None, ...], *, thorough: bool, seconds: float | None
) -> ScanPlan:
    from jbclog.session.discovery.scan_plan import plan_for

    return plan_for(url, thorough=thorough, addresses=addresses, limit_s=seconds)


def _addresses(text: str | None) -> tuple[int | None, ...]:
    """Return the default addresses and those of ``2,5`` or ``1-99``. Raises `UsageError`."""
    from jbclog.session.discovery.scan_plan import ADDRESSES

    found: dict[int | None, None] = dict.fromkeys(ADDRESSES)
    for part in text.split(",") if text else ():
        match = _ADDRESSES.fullmatch(part.strip())
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
        if not 1 <= first <= last <= 99:
            raise UsageError(f"--addresses {text}: must be 1 to 99, such as 2,5 or 1-99")
        found |= dict.fromkeys(range(first, last + 1))
    return tuple(found)


def _check_file(write: Path | None, *, force: bool) -> None:
    """Raise `UsageError`, before anything is sent, if the file exists or its folder does not."""
    if write is None:
        return
    if write.exists() and not (force and write.is_file()):
        raise UsageError(f"--write {write}: exists; give another name or --force")
    if not write.absolute().parent.is_dir():
        raise UsageError(f"--write {write}: no such folder: {write.absolute().parent}")


def _write(write: Path | None, reports: list[PortReport]) -> Path | None:
    """Write the line file and return its path; None without a station."""
    from jbclog.app.discovery import text_of

    text = None if write is None else text_of(reports, write)
    if write is None or text is None:
        return None
    try:
        write.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"--write {write}: cannot write: {write_failure(error, write)}") from error
    return write


def _all_fine(reports: list[PortReport], *, named: bool) -> bool:
    fine = [report.station is not None and report.station.is_drivable for report in reports]
    return all(fine) if named else any(fine)
