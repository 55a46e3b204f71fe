"""Checks this machine and the stations of a line, and suggests one step for each finding. Start
with `examine`.
"""

from __future__ import annotations

import ctypes
import dataclasses
import errno
import getpass
import os
import re
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from jbclog.app.discovery import search
from jbclog.app.port_access import SYSTEM, PortAccess
from jbclog.config.line import AUTO, Line, StationSpec
from jbclog.core.disk_space import FEW_FILES, lacks_inodes, mount_point, write_failure
from jbclog.core.durable_files import write_whole
from jbclog.core.operating_system import limit_bytes
from jbclog.guard.open_leases import LIST_STEP, about_list
from jbclog.protocol.commands.family import FAMILIES, OMEGA
from jbclog.record.port_owner import run_of, run_that_holds
from jbclog.session.discovery.diagnosis import FIRMLY, diagnose
from jbclog.session.discovery.scan_plan import (
    ADDRESSES,
    BY_SERVER,
    USUAL,
    PortReport,
    ScanFinding,
    ScanPlan,
    StationFound,
    Trial,
)
from jbclog.transport.system_ports import (
    UsbPort,
    latency_timer,
    locker_of,
    process_text,
    processes_named,
    processes_text,
    sharers_of,
    usb_ports,
)


@dataclass(frozen=True, slots=True)
class Fine:
    """A check without a finding; `kind` and `where` are those that its finding would have."""

    kind: str
    where: str
    what: str


Looked = Fine | ScanFinding


# -- clock -----------------------------------------------------------------------------------------

WHERE = "clock"
STEP = "synchronise it with a time server: `sudo timedatectl set-ntp true`"
RELEASED = datetime(2026, 1, 1, tzinfo=UTC)  # no record is older than this program
UNSYNCHRONISED = 5  # TIME_ERROR of adjtimex(2)
TIMEX_BYTES = 256  # struct timex has 208


def look_at_clock(utc_s: float, is_kept: bool | None) -> Looked:
    """Check the clock. `utc_s`: its time, seconds since 1970; `is_kept`: whether it is
    synchronised, None if unknown.
    """
    now = datetime.fromtimestamp(utc_s, UTC)
    if now < RELEASED:
        return ScanFinding(
            "clock.wrong", WHERE, f"it shows {now:%Y-%m-%d %H:%M} UTC, which is wrong", STEP
        )
    if is_kept is False:
        return ScanFinding(
            "clock.unkept",
            WHERE,
            "it is not synchronised with a time server: times in records may be wrong",
            STEP,
        )
    return Fine("clock", WHERE, f"{now:%Y-%m-%d %H:%M} UTC" + (", synchronised" if is_kept else ""))


def clock_is_kept() -> bool | None:
    """Return whether the kernel calls the clock synchronised; None if it does not report it."""
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(TIMEX_BYTES))
    except (OSError, AttributeError, TypeError):  # another system
        return None
    return None if state < 0 else bool(state != UNSYNCHRONISED)


def look_at_memory() -> Fine:
    """Return the limit of memory that a command which reads records sets on itself."""
    limit = limit_bytes()
    text = "no limit: this system has none" if limit is None else f"at most {limit / 1e9:.1f} GB"
    return Fine("memory", "memory", f"commands that read records use {text}")


# -- disk ------------------------------------------------------------------------------------------

LEAST_FREE = 500_000_000  # bytes: some days of a few stations, journals included
PROBE_BYTES = 4096


def look_at_folder(out: Path) -> list[Looked]:
    """Check whether a run can be recorded below `out`, which need not exist."""
    folder = nearest(out)
    try:
        _write_test_file(folder)
        free = shutil.disk_usage(folder).free
    except OSError as error:
        return [
            ScanFinding(
                "disk.no_write",
                str(out),
                f"no file can be written in {folder}: {write_failure(error, folder)}",
                _step(error, folder),
            )
        ]
    if lacks_inodes(folder):
        what = f"the disk has fewer than {FEW_FILES} inodes left; a run needs more"
        step = f"remove old files from the disk at {mount_point(folder)} (`df -i`)"
        return [ScanFinding("disk.inodes", str(out), what, step)]
    return [_space(out, free)]


def nearest(out: Path) -> Path:
    """Return `out`, or the nearest parent folder that exists."""
    return next(place for place in (out.absolute(), *out.absolute().parents) if place.exists())


def _write_test_file(folder: Path) -> None:
    """Write, sync, rename and remove a file, as a run does."""
    probe = folder / f".jbclog-doctor-{os.getpid()}"
    try:
        write_whole(probe, bytes(PROBE_BYTES))
    finally:
        probe.unlink(missing_ok=True)


def _step(error: OSError, folder: Path) -> str:
    if error.errno == errno.ENOSPC:
        return f"free space on the disk of {folder}"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"let your user write there: `sudo chown $USER {folder}`"
    return "record on another disk: `--out DIR`"


def _space(out: Path, free: int) -> Looked:
    if free < LEAST_FREE:
        what = (
            f"only {free / 1e6:.0f} MB free; a station with two ports at 10 Hz writes about 30 MB"
            " a day"
        )
        return ScanFinding(
            "disk.space", str(out), what, f"free space on the disk of {nearest(out)}"
        )
    return Fine("disk", str(out), f"writable, {free / 1e9:.1f} GB free")


# -- open leases -----------------------------------------------------------------------------------


def look_at_lease_list(out: Path) -> Looked:
    """Check whether the next run, also with another `--out`, would find tools left hot."""
    is_listed, text = about_list(nearest(out))
    if not is_listed:
        return ScanFinding("guard.list", "open leases", f"they {text}", LIST_STEP)
    return Fine("guard.list", "open leases", f"they {text or 'can be listed'}")


# -- ports -----------------------------------------------------------------------------------------
# Nothing here opens a port.

NONE_PLUGGED = "no USB serial port is connected"
# groups of serial ports; other groups give more rights than that
GROUPS = ("dialout", "uucp", "tty", "plugdev")
RULES = "/etc/udev/rules.d/60-jbclog.rules"
MODEM_MANAGER = "ModemManager"
MODEM_RULES = "/etc/udev/rules.d/60-jbclog-no-modem.rules"
KEEP_MODEM_MANAGER_AWAY = (
    'keep it away from serial adapters: `echo \'SUBSYSTEM=="tty", ENV{ID_MM_PORT_IGNORE}="1"\' |'
    f" sudo tee {MODEM_RULES} && sudo udevadm control --reload`, then plug the adapter in again"
)
QUICK_MS = 2  # a timer up to this costs no rate


def look_at_usb_port(port: UsbPort) -> Looked:
    """Check whether this user may open the port and no other program has it."""
    device = Path(port.device)
    if not os.access(device, os.R_OK | os.W_OK):
        return ScanFinding(
            "port.permission",
            port.name,
            "your user has no permission to open it",
            permission_step(device),
        )
    return look_at_holder(port.name, port.device) or Fine(
        "port", port.name, f"{port.title or 'USB serial port'}, free and allowed"
    )


def look_at_holder(where: str, url: str) -> Looked | None:
    """Return who has the port open: a run (fine), or another program; None if nobody."""
    run = run_that_holds(url)
    process = locker_of(url)
    run = run or (run_of(process) if process is not None else None)
    if run is not None:
        return Fine("port.run", where, f"in use by the run {run}; not touched")
    if process is not None and process != os.getpid():
        return ScanFinding(
            "port.busy", where, f"it is in use by {process_text(process)}", "end that program"
        )
    sharers = sharers_of(url)
    if sharers:
        what = (
            f"{processes_text(sharers)} also has it open without a lock: each program gets only a"
            " part of the data"
        )
        step = "end that program"
        if set(sharers) & set(processes_named(MODEM_MANAGER)):
            step = KEEP_MODEM_MANAGER_AWAY
        return ScanFinding("port.shared", where, what, step)
    return None


def permission_step(device: Path) -> str:
    """Return how this user gets access to `device`: by joining its group if that is one for serial
    ports, else by a udev rule.
    """
    group = _group(device)
    if group in GROUPS:
        return f"`sudo adduser {_user()} {group}`, then log in again"
    name = Path(os.path.realpath(device)).name
    rule = f'KERNEL=="{re.sub(r"[0-9]+$", "*", name)}", GROUP="{GROUPS[0]}", MODE="0660"'
    return (
        f"give it to the group {GROUPS[0]} (`echo '{rule}' | sudo tee {RULES}`, then plug it in"
        f" again) and join that (`sudo adduser {_user()} {GROUPS[0]}`, then log in again)"
    )


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "$USER"


def _group(device: Path) -> str:
    try:
        return device.group()
    except (KeyError, OSError, RuntimeError):  # Windows has no groups
        return "dialout"


def look_at_timer(where: str, device: str) -> ScanFinding | None:
    """Check whether the adapter still delays answers after it was set not to; call after the port
    was opened.
    """
    timer = latency_timer(device)
    try:
        held_ms = int(timer.read_text()) if timer else 0
    except (OSError, ValueError):
        return None
    if held_ms <= QUICK_MS:
        return None
    what = f"its USB adapter delays each answer by up to {held_ms} ms, which halves the rate"
    return ScanFinding("port.latency", where, what, f"`echo 1 | sudo tee {timer}`")


# -- stations --------------------------------------------------------------------------------------

NO_TOOL = "none"


def look_at_stations(line: Line, access: PortAccess = SYSTEM) -> list[Looked]:
    """Check every station of the line whose port is free. Sends only reads that clear nothing."""
    held = {
        spec.name: looked
        for spec in line.stations
        if (looked := look_at_holder(spec.name, spec.url)) is not None
    }
    free = [spec for spec in line.stations if spec.name not in held]
    reports = search([(spec.url, plan_for(spec)) for spec in free], access=access)
    asked = {spec.name: report for spec, report in zip(free, reports, strict=True)}
    return [
        one
        for spec in line.stations
        for one in (
            [held[spec.name]] if spec.name in held else list(compared(line, spec, asked[spec.name]))
        )
    ]


def plan_for(spec: StationSpec) -> ScanPlan:
    """Return a plan that tries the settings of the line file first, then the usual ones."""
    if spec.url.startswith("socket:"):
        return ScanPlan(
            tuple(dataclasses.replace(trial, line=spec.line_format) for trial in BY_SERVER),
            _addresses(spec),
        )
    family = FAMILIES.get(spec.family)
    own = Trial(spec.line_format, asks_omega=family is not None and family.protocol == OMEGA)
    rest = tuple(
        trial
        for trial in USUAL
        if trial.line != spec.line_format or (trial.asks_omega and not own.asks_omega)
    )
    return ScanPlan((own, *rest), _addresses(spec))


def _addresses(spec: StationSpec) -> tuple[int | None, ...]:
    return tuple(dict.fromkeys((spec.address, *ADDRESSES)))


def compared(line: Line, spec: StationSpec, report: PortReport) -> Iterator[Looked]:
    """Yield what is fine with this station, or its findings."""
    wrong = [
        _of_line(line, spec, finding)
        for finding in diagnose(report)
        if not _is_accepted(spec, report, finding)
    ]
    if not wrong and report.station is not None:
        wrong = [
            finding for finding in _differences(line, spec, report.station) if finding is not None
        ]
        wrong += [timer] if (timer := look_at_timer(spec.name, spec.url)) is not None else []
        wrong = wrong or [Fine("station", spec.name, _text(report.station))]
    yield from wrong


def _is_accepted(spec: StationSpec, report: PortReport, finding: ScanFinding) -> bool:
    """Whether the finding is an unknown model that the line file accepts."""
    return (
        finding.kind == "station.unknown"
        and report.station is not None
        and report.station.model == spec.model
    )


def _of_line(line: Line, spec: StationSpec, finding: ScanFinding) -> Looked:
    """Convert a finding about a port to one about this station."""
    step = finding.step
    if finding.kind == "port.permission" and spec.is_device:
        step = permission_step(Path(spec.url))
    if finding.kind == "port.missing" and spec.is_relative:
        step = (
            f"a relative url is a virtual station's: start `jbclog sim {line.path}` and use the"
            " line file that it creates"
        )
    return dataclasses.replace(finding, where=f"{spec.name} ({finding.where})", step=step)


def _text(found: StationFound) -> str:
    who = found.model or (found.family.title if found.family else "a station")
    speed = f" in {found.turnaround.median_ms:.1f} ms" if found.turnaround else ""
    speed += f" ({found.turnaround.faster})" if found.turnaround and found.turnaround.faster else ""
    tools = "; ".join(
        f"port {port} {tool or 'unknown tool'}" for port, tool in found.tool_names.items()
    )
    addressing = f", {found.addressing}" if found.has_robot_mode else ""
    mode = "; Robot mode is not known until the first write" if found.has_robot_mode else ""
    return (
        f"{who} answers at {found.line}{addressing}{speed}" + (f"; {tools}" if tools else "") + mode
    )


# -- differences -----------------------------------------------------------------------------------


def _differences(
    line: Line, spec: StationSpec, found: StationFound
) -> Iterator[ScanFinding | None]:
    yield _line_format(line, spec, found)
    yield _address(line, spec, found)
    yield _family(line, spec, found)
    yield from _ports(line, spec, found)
    yield _station_error(spec, found)
    yield _lost(spec, found)


def _change(line: Line, spec: StationSpec, keys: str) -> str:
    return f"in {line.path}, station {spec.name}: set {keys}"


def _line_format(line: Line, spec: StationSpec, found: StationFound) -> ScanFinding | None:
    if found.line == spec.line_format or spec.url.startswith("socket:"):
        return None
    what = f"it answers at {found.line}; the line file has {spec.line_format}"
    keys = f'baudrate = {found.line.baudrate}, format = "{found.line.format}"'
    return ScanFinding("line.format", spec.name, what, _change(line, spec, keys))


def _address(line: Line, spec: StationSpec, found: StationFound) -> ScanFinding | None:
    if not found.has_robot_mode or found.address == spec.address:
        return None
    wanted = "without addresses" if spec.address is None else f"address {spec.address:02d}"
    keys = f"address = {'false' if found.address is None else found.address}"
    return ScanFinding(
        "line.address",
        spec.name,
        f"it answers {_at(found)}; the line file has {wanted}",
        _change(line, spec, keys),
    )


def _at(found: StationFound) -> str:
    return found.addressing if found.address is None else f"to {found.addressing}"


def _family(line: Line, spec: StationSpec, found: StationFound) -> ScanFinding | None:
    if spec.model is not None:
        if found.model == spec.model:
            return None
        what = (
            f"the line file accepts model {spec.model}; the station reports"
            f" {found.model or 'no model'}"
        )
        return ScanFinding(
            "line.model",
            spec.name,
            what,
            _change(line, spec, f'model = "{found.model}", or plug in the other cable'),
        )
    if spec.family == AUTO or found.family is None or found.family.name == spec.family:
        return None
    what = (
        f"the line file has family {spec.family}; the station is"
        f" {found.model or found.family.title}"
    )
    return ScanFinding(
        "line.family",
        spec.name,
        what,
        _change(line, spec, f'family = "{found.family.name}", or plug in the other cable'),
    )


def _ports(line: Line, spec: StationSpec, found: StationFound) -> Iterator[ScanFinding]:
    """Find ports that a run needs and that have no tool or do not exist."""
    printed = found.family and found.family.ports
    wanted = spec.ports or printed or tuple(found.tool_names)
    missing = [port for port in wanted if port not in found.tool_names] if found.tool_names else []
    empty = [port for port in wanted if found.tool_names.get(port) == NO_TOOL]
    rest = [port for port in wanted if port not in (*missing, *empty)]
    keys = f"ports = {rest}" if rest else "ports = [...] to those that it has"
    if missing:
        what = f"it has no port {_listed(missing)}, but the line file lists it"
        yield ScanFinding("line.ports", spec.name, what, _change(line, spec, keys))
    if empty:
        step = f"insert a tool, or {_change(line, spec, keys)}" if rest else "insert a tool"
        yield ScanFinding(
            "tool.missing",
            spec.name,
            f"no tool in port {_listed(empty)}; a run does not start without one",
            step,
        )


def _listed(ports: list[int]) -> str:
    return ", ".join(map(str, ports))


def _station_error(spec: StationSpec, found: StationFound) -> ScanFinding | None:
    if found.error is None:
        return None
    return ScanFinding(
        "station.error",
        spec.name,
        f"the station reports: {found.error}",
        "look it up in the station's manual",
    )


def _lost(spec: StationSpec, found: StationFound) -> ScanFinding | None:
    turnaround = found.turnaround
    if turnaround is not None and turnaround.answered == turnaround.asked:
        return None
    answered, asked = (turnaround.answered, turnaround.asked) if turnaround else (0, 1)
    what = f"{asked - answered} of {asked} reads were not answered"
    return ScanFinding("line.noisy", spec.name, what, FIRMLY)


# -- examine ---------------------------------------------------------------------------------------


def examine(line: Line | None, out: Path, access: PortAccess = SYSTEM) -> list[Looked]:
    """Check this machine and the stations of `line`; without a line, the USB ports, without opening
    them.
    """
    looked = [
        *look_at_folder(out),
        look_at_clock(time.time(), clock_is_kept()),
        look_at_lease_list(out),
    ]
    looked += look_at_modem_manager()
    looked += _usb() if line is None else look_at_stations(line, access)
    return [*looked, look_at_memory()]


def _usb() -> list[Looked]:
    ports: list[Looked] = [look_at_usb_port(port) for port in usb_ports()]
    return ports or [Fine("port", "USB", NONE_PLUGGED)]


def look_at_modem_manager() -> list[Looked]:
    """Warn of ModemManager, which opens each new serial adapter and asks it for a modem."""
    running = processes_named(MODEM_MANAGER)
    if not running:
        return []
    what = (
        f"{processes_text(running)} opens each serial adapter that is plugged in, and takes answers"
        " of the station for some 30 s"
    )
    return [ScanFinding("port.modem_manager", "USB", what, KEEP_MODEM_MANAGER_AWAY)]
