"""Ports of this computer as the system sees them, without opening any: there, allowed, free."""

from __future__ import annotations

import getpass
import os
import re
from pathlib import Path

from jbclog.app.doctor.result import Fine, Looked
from jbclog.record.port_owner import run_of, run_that_holds
from jbclog.session.discovery.found import Finding
from jbclog.transport.system_ports import UsbPort, in_words, in_words_all, latency_timer, locker_of, sharers_of

NONE_PLUGGED = "no USB serial port is plugged in"
GROUPS = ("dialout", "uucp", "tty", "plugdev")  # that systems give serial ports to; who is in another may do more than that
RULES = "/etc/udev/rules.d/60-jbclog.rules"
QUICK_MS = 2  # a timer of this much or less costs nothing that counts


def look_at_usb_port(port: UsbPort) -> Looked:
    """Whether this user could open it, and nobody else has it."""
    device = Path(port.device)
    if not os.access(device, os.R_OK | os.W_OK):
        return Finding("port.permission", port.name, "your user may not open it", permission_step(device))
    return look_at_holder(port.name, port.device) or Fine("port", port.name, f"{port.title or 'USB serial port'}, free and allowed")


def look_at_holder(where: str, url: str) -> Looked | None:
    """Who holds the port: a run, which is as it should be, or somebody else; None where nobody does."""
    run = run_that_holds(url)
    process = locker_of(url)
    run = run or (run_of(process) if process is not None else None)
    if run is not None:
        return Fine("port.run", where, f"the run {run} records it; it was not disturbed")
    if process is not None and process != os.getpid():
        return Finding("port.busy", where, f"it is in use by {in_words(process)}", "end that program")
    sharers = sharers_of(url)
    if sharers:
        what = f"it is open in {in_words_all(sharers)} too, which keeps nobody out: of what comes, each gets a part"
        return Finding("port.shared", where, what, "end that program")
    return None


def permission_step(device: Path) -> str:
    """How this user comes to open `device`: by its group, where that is one of serial ports; else by a rule that gives it one."""
    group = _group(device)
    if group in GROUPS:
        return f"`sudo adduser {_user()} {group}`, then log in anew"
    name = Path(os.path.realpath(device)).name
    rule = f'KERNEL=="{re.sub(r"[0-9]+$", "*", name)}", GROUP="{GROUPS[0]}", MODE="0660"'
    return (
        f"give it to the group {GROUPS[0]} (`echo '{rule}' | sudo tee {RULES}`, then plug it in anew) "
        f"and join that (`sudo adduser {_user()} {GROUPS[0]}`, then log in anew)"
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


def look_at_timer(where: str, device: str) -> Finding | None:
    """Whether the adapter still holds answers back although it has been told not to; to be looked at behind an opening."""
    timer = latency_timer(device)
    try:
        held_ms = int(timer.read_text()) if timer else 0
    except (OSError, ValueError):
        return None
    if held_ms <= QUICK_MS:
        return None
    what = f"its USB adapter holds each answer back for up to {held_ms} ms, which halves the rate"
    return Finding("port.latency", where, what, f"`echo 1 | sudo tee {timer}`")
