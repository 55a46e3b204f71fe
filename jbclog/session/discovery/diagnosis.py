"""Turn a port's scan into findings: why no station can be driven, and the step that fixes it."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator

from jbclog.core.errors import LinkError, LinkFlooded, PortBusy, PortForbidden, PortMissing
from jbclog.core.serial_line import LineFormat
from jbclog.core.text import count_text
from jbclog.protocol.commands.family import FAMILIES, accept_line
from jbclog.protocol.frame import Frame, FrameReader
from jbclog.session.discovery.port_scan import address_of
from jbclog.session.discovery.probe import MOST_KEPT
from jbclog.session.discovery.scan_plan import (
    ADDRESSES,
    THOROUGH,
    PortReport,
    ScanFinding,
    StationFound,
    plan_for,
)

SWITCH_ON = "switch Robot mode on in the station's menu"
IS_IT_ON = "check that the station is on and that Robot mode is on in its menu; if so, "
# docs/reference/contradictions.md, B-2
EXCHANGE = f"{IS_IT_ON}exchange transmit and receive in the cable (RJ12: pins 3 and 4)"
ALL = tuple(range(1, 100))
BREAKS: tuple[tuple[type[LinkError], str], ...] = (
    (PortBusy, "port.busy"),
    (PortForbidden, "port.permission"),
    (PortMissing, "port.missing"),
    (LinkFlooded, "link.flooded"),
    (LinkError, "port.broken"),
)
FIRMLY = "push both plugs fully in, and keep the cable away from power lines"
PLUG_IN = "unplug the adapter and plug it in again, or start the server behind it"


def diagnose(report: PortReport) -> list[ScanFinding]:
    """Return the problems of this port; empty for a station that a run could start with."""
    if report.broken is not None:
        return [_broken(report.url, report.broken)]
    if report.station is not None:
        if report.station.is_drivable:
            return []
        return [_not_drivable(report.url, report.station, report.asked)]
    if report.stopped:
        return []
    return [_no_station(report)]


def _broken(url: str, error: LinkError) -> ScanFinding:
    """Split the message of a `transport` error at its semicolon into problem and step."""
    kind = next(word for error_class, word in BREAKS if isinstance(error, error_class))
    what, _, step = str(error).removeprefix(url).lstrip(": ").partition("; ")
    return ScanFinding(kind, url, what, step or PLUG_IN)


def _not_drivable(url: str, station: StationFound, asked: Collection[int | None]) -> ScanFinding:
    def finding(kind: str, does: str, step: str) -> ScanFinding:
        answers = f"a station answers at {station.line}, {station.addressing}"
        return ScanFinding(kind, url, f"{answers}, {does}", step)

    refusal, trouble = station.refusal, station.trouble
    if station.contradicts:
        return finding("line.noisy", f"and gives a different answer each time: {trouble}", FIRMLY)
    if station.robot_mode is False:
        return finding("robot_mode.off", "and refuses: Robot mode is off (N 5)", SWITCH_ON)
    if station.address is not None and station.address not in asked and (refusal or trouble):
        does = f"but not reliably: {trouble}"
        if refusal:
            does = f"and refuses questions to other addresses ({refusal})"
        step = (
            f"scan that address: `jbclog scan {url} --addresses {station.address}`; in the line"
            f" file, set `address = {station.address}`"
        )
        return finding("line.address", does, step)
    if refusal is not None:
        does = f"and does not report its model ({refusal})"
        step = "set the address in its menu to the usual one (01, or none), and scan again"
        return finding("station.refuses", does, step)
    if trouble is not None:
        return finding("station.silent", f"but not reliably: {trouble}", "push its plug fully in")
    driven = ", ".join(name for name, family in FAMILIES.items() if family.models)
    return finding(
        "station.unknown",
        f"and reports model {station.model!r}, which jbclog does not know",
        f"if you know what it is, name its family in the line file ({driven}), and add"
        f" {accept_line(str(station.model))}",
    )


def _no_station(report: PortReport) -> ScanFinding:
    """Return why no station answers, by the strongest evidence."""
    url = report.url
    if report.binary is not None:
        what = (
            f"the data at {report.binary} looks like JBC's binary protocol: the station is not in"
            " Robot mode"
        )
        return ScanFinding("robot_mode.binary", url, what, SWITCH_ON)
    if report.flood is not None:
        return _broken(url, report.flood)
    if report.echoed:
        what = (
            "each question comes back unchanged, without an answer: a loopback plug, or an RS-485"
            " adapter with echo"
        )
        return ScanFinding(
            "line.echo", url, what, "remove the loopback plug, or use an RS-232 adapter"
        )
    heard = list(dict.fromkeys(_heard_addresses(report)))
    if heard:
        return _other_address(report, *heard[0])
    if report.garbage:
        return ScanFinding(
            "line.format",
            url,
            f"data arrives, but fits no line format that was tried: {_heard(report)}",
            _next_try(report),
        )
    if report.untried:
        step = f"give it more time: `jbclog scan {url}{_options(report)}` without --seconds"
        return ScanFinding(
            "scan.cut",
            url,
            f"nothing answers in {_formats(report)}; the time ran out before the rest was tried",
            step,
        )
    return ScanFinding(
        "line.silent", url, f"nothing answers in {_formats(report)}", _untried(report)
    )


def _heard_addresses(report: PortReport) -> Iterator[tuple[LineFormat, int]]:
    """Yield line format and station address of complete JBC frames that matched no request."""
    for line, data in report.garbage.items():
        for found in FrameReader().feed(data):
            if isinstance(found, Frame) and (address := address_of(found)) is not None:
                yield line, address


def _other_address(report: PortReport, line: LineFormat, address: int) -> ScanFinding:
    """Handle a JBC frame from another address: the line format is right, but the station was not
    tried or is not identified.
    """
    url, number = report.url, f"{address:02d}"
    kind = {
        10: " (solder feeders, by manual 004)",
        20: " (fume extractors, by manual 004)",
    }.get(address, "")
    if address in report.asked:
        what = (
            f"a frame from address {number}{kind} arrived at {line}, but the question for the model"
            " got no answer"
        )
        step = "connect a station that jbclog drives; this one does not report its model"
        return ScanFinding("station.refuses", url, what, step)
    asked = ", ".join("none" if one is None else f"{one:02d}" for one in report.asked)
    what = (
        f"a frame from address {number}{kind} arrived at {line}; the addresses asked were {asked}"
    )
    numbers = _ranges(
        [*(one for one in report.asked if one is not None and one not in ADDRESSES), address]
    )
    step = (
        f"scan that address: `jbclog scan {url} --addresses {numbers}`; in the line file, set"
        f" `address = {address}`"
    )
    return ScanFinding("line.address", url, what, step)


def _untried(report: PortReport) -> str:
    """Suggest untried formats and addresses: likelier than crossed wires, and no soldering
    needed.
    """
    if _is_thorough(report) and set(ALL) <= set(report.asked):
        return EXCHANGE
    thorough = "" if _is_by_server(report) else " --thorough"
    plan = plan_for(
        report.url, thorough=True, addresses=tuple(dict.fromkeys((*ADDRESSES, *ALL))), limit_s=None
    )
    what = "every address" if _is_by_server(report) else "every line format and address"
    minutes = math.ceil(plan.seconds / 60)
    return (
        f"{IS_IT_ON}try {what} (at most {minutes} min): `jbclog scan {report.url}{thorough}"
        " --addresses 1-99`"
    )


def _is_by_server(report: PortReport) -> bool:
    """Return True if a server decides on the line format."""
    return report.url.startswith("socket:")


def _is_thorough(report: PortReport) -> bool:
    """Return True if every line format was tried or planned."""
    return _is_by_server(report) or len(report.tried) + len(report.untried) >= len(THOROUGH)


def _options(report: PortReport) -> str:
    """Return this scan's command line options, without port and time."""
    numbers = [number for number in report.asked if number is not None and number not in ADDRESSES]
    thorough = " --thorough" if _is_thorough(report) and not _is_by_server(report) else ""
    return f"{thorough} --addresses {_ranges(numbers)}" if numbers else thorough


def _ranges(numbers: list[int]) -> str:
    """Format numbers for --addresses: ``2,5-7``."""
    found: list[list[int]] = []
    for number in sorted(numbers):
        if found and number == found[-1][-1] + 1:
            found[-1][1:] = [number]
        else:
            found.append([number])
    return ",".join("-".join(map(str, ends)) for ends in found)


def _heard(report: PortReport) -> str:
    """Say how much came and at which line format; the bytes are in the report."""
    line, data = next(iter(report.garbage.items()))
    more = " or more" if len(data) >= MOST_KEPT else ""
    return f"{count_text(len(data), 'byte')}{more} at {line}"


def _next_try(report: PortReport) -> str:
    if _is_by_server(report):
        return "set the server behind this port to the line format in the station's menu"
    if _is_thorough(report):
        return "check what is connected there: its data fits no line format that a station can have"
    return (
        "look up the line format in the station's menu, or try them all: `jbclog scan --thorough"
        f" {report.url}`"
    )


def _formats(report: PortReport) -> str:
    tried = report.tried
    if len(tried) == 1:
        return (
            "the server's line format" if _is_by_server(report) else f"the line format {tried[0]}"
        )
    return f"{len(tried)} line formats ({', '.join(map(str, tried[:3]))}, …)"
