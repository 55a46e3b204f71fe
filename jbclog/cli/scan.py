"""`jbclog scan`: who answers on these ports?"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell_json
from jbclog.cli.scan_wording import count_of, facts_of, tell_found, tell_no_ports, tell_progress
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.session.discovery.found import PortReport, ScanPlan

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
    from jbclog.app.discovery.scan_ports import search

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
    from jbclog.app.discovery.line_file import text_of

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
