"""The stations of a line: what each says of itself, held against what the line file says."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

from jbclog.app.discovery.scan_ports import Means, Told, search
from jbclog.app.doctor.ports import look_at_holder, look_at_timer, permission_step
from jbclog.app.doctor.result import Fine, Looked
from jbclog.config.line import AUTO, Line, StationSpec
from jbclog.protocol.commands.family import FAMILIES, OMEGA, Family
from jbclog.session.discovery.diagnosis import FIRMLY, diagnose
from jbclog.session.discovery.found import ADDRESSES, BY_SERVER, USUAL, Finding, PortReport, ScanPlan, StationFound, Trial

NO_TOOL = "none"


def look_at_stations(line: Line, told: Told = lambda _: None, means: Means | None = None) -> list[Looked]:
    """Ask every station of the line whose port nobody holds. Questions only, none that clears anything."""
    held = {spec.name: looked for spec in line.stations if (looked := look_at_holder(spec.name, spec.url)) is not None}
    free = [spec for spec in line.stations if spec.name not in held]
    reports = search([(spec.url, plan_for(spec)) for spec in free], told, means)
    asked = {spec.name: report for spec, report in zip(free, reports, strict=True)}
    return [
        one
        for spec in line.stations
        for one in ([held[spec.name]] if spec.name in held else list(compared(line, spec, asked[spec.name])))
    ]


def plan_for(spec: StationSpec) -> ScanPlan:
    """First as the line file says, then as stations usually are spoken to."""
    if spec.url.startswith("socket:"):
        return ScanPlan(tuple(dataclasses.replace(trial, line=spec.line_format) for trial in BY_SERVER), _addresses(spec))
    family = FAMILIES.get(spec.family)
    own = Trial(spec.line_format, asks_omega=family is not None and family.protocol == OMEGA)
    rest = tuple(trial for trial in USUAL if trial.line != spec.line_format or (trial.asks_omega and not own.asks_omega))
    return ScanPlan((own, *rest), _addresses(spec))


def _addresses(spec: StationSpec) -> tuple[int | None, ...]:
    return tuple(dict.fromkeys((spec.address, *ADDRESSES)))


def compared(line: Line, spec: StationSpec, report: PortReport) -> Iterator[Looked]:
    """What of this station is fine, or is not."""
    wrong = [_of_line(line, spec, finding) for finding in diagnose(report) if not _is_accepted(spec, report, finding)]
    if not wrong and report.station is not None:
        wrong = [finding for finding in _differences(line, spec, report.station) if finding is not None]
        wrong += [timer] if (timer := look_at_timer(spec.name, spec.url)) is not None else []
        wrong = wrong or [Fine("station", spec.name, _text(report.station))]
    yield from wrong


def _is_accepted(spec: StationSpec, report: PortReport, finding: Finding) -> bool:
    """Whether this is about a model name that no table has, and the line file accepts it."""
    return finding.kind == "station.unknown" and report.station is not None and report.station.model == spec.model


def _of_line(line: Line, spec: StationSpec, finding: Finding) -> Looked:
    """A finding of a port, as one of this station."""
    step = finding.step
    if finding.kind == "port.permission" and spec.is_device:
        step = permission_step(Path(spec.url))
    if finding.kind == "port.missing" and spec.is_relative:
        step = f"a relative url is a virtual station's: start `jbclog sim {line.path}`, and give the line file that it makes"
    return dataclasses.replace(finding, where=f"{spec.name} ({finding.where})", step=step)


def _text(found: StationFound) -> str:
    who = found.model or (found.family.title if found.family else "a station")
    speed = f" in {found.turnaround.median_ms:.1f} ms" if found.turnaround else ""
    speed += f" ({found.turnaround.faster})" if found.turnaround and found.turnaround.faster else ""
    tools = "; ".join(f"port {port} {tool or 'not told'}" for port, tool in found.tools.items())
    mode = "; Robot mode is not known until the first write" if found.has_robot_mode else ""
    return f"{who} answers at {found.line}{_addressing(found)}{speed}" + (f"; {tools}" if tools else "") + mode


def _addressing(found: StationFound) -> str:
    return f", {found.addressing}" if found.has_robot_mode else ""


# -- differences ------------------------------------------------------------------------------------------------------------


def _differences(line: Line, spec: StationSpec, found: StationFound) -> Iterator[Finding | None]:
    yield _line_format(line, spec, found)
    yield _address(line, spec, found)
    yield _family(line, spec, found)
    yield from _ports(line, spec, found)
    yield _station_error(spec, found)
    yield _lost(spec, found)


def _change(line: Line, spec: StationSpec, keys: str) -> str:
    return f"in {line.path}, station {spec.name}: set {keys}"


def _line_format(line: Line, spec: StationSpec, found: StationFound) -> Finding | None:
    if found.line == spec.line_format or spec.url.startswith("socket:"):
        return None
    what = f"it answers at {found.line}, and not at the line file's {spec.line_format}"
    keys = f'baudrate = {found.line.baudrate}, format = "{found.line.format}"'
    return Finding("line.format", spec.name, what, _change(line, spec, keys))


def _address(line: Line, spec: StationSpec, found: StationFound) -> Finding | None:
    if not found.has_robot_mode or found.address == spec.address:
        return None
    wanted = "without addresses" if spec.address is None else f"address {spec.address:02d}"
    keys = f"address = {'false' if found.address is None else found.address}"
    return Finding(
        "line.address", spec.name, f"it answers {_at(found)}, and not {wanted} as in the line file", _change(line, spec, keys)
    )


def _at(found: StationFound) -> str:
    return found.addressing if found.address is None else f"to {found.addressing}"


def _family(line: Line, spec: StationSpec, found: StationFound) -> Finding | None:
    if spec.model is not None:
        if found.model == spec.model:
            return None
        what = f"the line file accepts model {spec.model}; what answers is {found.model or 'one that says none'}"
        return Finding("line.model", spec.name, what, _change(line, spec, f'model = "{found.model}", or plug in the other cable'))
    if spec.family == AUTO or found.family is None or found.family.name == spec.family:
        return None
    what = f"the line file says family {spec.family}; what answers is {found.model or found.family.title}"
    return Finding(
        "line.family", spec.name, what, _change(line, spec, f'family = "{found.family.name}", or plug in the other cable')
    )


def _ports(line: Line, spec: StationSpec, found: StationFound) -> Iterator[Finding]:
    """The ports that a run would want, without a tool or not there at all."""
    wanted = spec.ports or _printed_ports(found.family) or tuple(found.tools)
    missing = [port for port in wanted if port not in found.tools] if found.tools else []
    empty = [port for port in wanted if found.tools.get(port) == NO_TOOL]
    rest = [port for port in wanted if port not in (*missing, *empty)]
    keys = f"ports = {rest}" if rest else "ports = [...] to those that it has"
    if missing:
        what = f"it has no port {_listed(missing)}, which the line file names"
        yield Finding("line.ports", spec.name, what, _change(line, spec, keys))
    if empty:
        step = f"put a tool in, or {_change(line, spec, keys)}" if rest else "put a tool in"
        yield Finding("tool.missing", spec.name, f"no tool in port {_listed(empty)}; a run refuses to start without", step)


def _printed_ports(family: Family | None) -> tuple[int, ...] | None:
    return None if family is None else family.ports


def _listed(ports: list[int]) -> str:
    return ", ".join(map(str, ports))


def _station_error(spec: StationSpec, found: StationFound) -> Finding | None:
    if found.error is None:
        return None
    return Finding("station.error", spec.name, f"the station reports: {found.error}", "look it up in the station's manual")


def _lost(spec: StationSpec, found: StationFound) -> Finding | None:
    turnaround = found.turnaround
    if turnaround is not None and turnaround.answered == turnaround.asked:
        return None
    answered, asked = (turnaround.answered, turnaround.asked) if turnaround else (0, 1)
    what = f"{asked - answered} of {asked} questions were not answered"
    return Finding("line.noisy", spec.name, what, FIRMLY)
