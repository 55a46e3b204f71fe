"""What doctor says of disk, clock and ports, each finding with its step."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from collections import namedtuple
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from jbclog.app import doctor
from jbclog.app.discovery import search
from jbclog.app.doctor import (
    MODEM_MANAGER,
    Fine,
    Looked,
    clock_is_kept,
    look_at_clock,
    look_at_folder,
    look_at_holder,
    look_at_modem_manager,
    look_at_timer,
    look_at_usb_port,
    permission_step,
)
from jbclog.core.errors import PortBusy
from jbclog.session.discovery.scan_plan import ScanFinding, ScanPlan
from jbclog.transport.system_ports import UsbPort
from support.command import until
from support.links.far_ends import terminal

NOW = 1_795_000_000.0  # November 2026
Usage = namedtuple("Usage", "total used free")


def finding(looked: Looked | None) -> ScanFinding:
    assert isinstance(looked, ScanFinding)
    return looked


# -- disk ------------------------------------------------------------------------------------------


def test_a_folder_that_is_not_there_yet_is_fine_and_is_not_made(tmp_path: Path) -> None:
    (looked,) = look_at_folder(tmp_path / "new" / "runs")
    assert isinstance(looked, Fine)
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "runs").touch()
    (looked,) = look_at_folder(tmp_path / "runs" / "below")
    assert finding(looked).kind == "disk.no_write"
    assert "--out DIR" in finding(looked).step


@pytest.mark.parametrize(
    ("number", "step"),
    [
        (errno.EACCES, "sudo chown $USER"),
        (errno.EROFS, "--out DIR"),
        (errno.ENOSPC, "free space"),
        (errno.EIO, "--out DIR"),
    ],
)
def test_no_write_access(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, step: str
) -> None:
    def refuse(path: Path, data: bytes) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(doctor, "write_whole", refuse)
    (looked,) = look_at_folder(tmp_path)
    assert os.strerror(number) in finding(looked).what
    assert step in finding(looked).step


def test_little_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        doctor.shutil, "disk_usage", lambda path: Usage(10**12, 10**12, 123_000_000)
    )
    (looked,) = look_at_folder(tmp_path)
    assert finding(looked).kind == "disk.space"
    assert "only 123 MB" in finding(looked).what


# -- clock -----------------------------------------------------------------------------------------


def test_a_clock_that_is_kept() -> None:
    assert look_at_clock(NOW, True) == Fine("clock", "clock", "2026-11-18 11:06 UTC, synchronised")
    assert isinstance(look_at_clock(NOW, None), Fine)


@pytest.mark.parametrize(
    ("utc_s", "kept", "kind"), [(0.0, True, "clock.wrong"), (NOW, False, "clock.unkept")]
)
def test_a_clock_that_is_not(utc_s: float, kept: bool, kind: str) -> None:
    looked = finding(look_at_clock(utc_s, kept))
    assert looked.kind == kind
    assert "timedatectl set-ntp true" in looked.step


def test_the_kernel_is_asked() -> None:
    assert clock_is_kept() in (True, False, None)


# -- ports -----------------------------------------------------------------------------------------


def usb(device: Path) -> UsbPort:
    return UsbPort(str(device), "/dev/serial/by-id/usb-FTDI", "FT232R")


def test_a_port_that_is_free(tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB0"
    device.touch()
    assert look_at_usb_port(usb(device)) == Fine(
        "port", "/dev/serial/by-id/usb-FTDI", "FT232R, free and allowed"
    )


def test_a_port_that_this_user_may_not_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = tmp_path / "ttyUSB0"
    device.touch()
    monkeypatch.setattr(doctor.os, "access", lambda path, mode: False)
    monkeypatch.setattr(Path, "group", lambda path: "uucp")
    monkeypatch.setattr(doctor.getpass, "getuser", lambda: "rossi")
    looked = finding(look_at_usb_port(usb(device)))
    assert (looked.kind, looked.step) == (
        "port.permission",
        "`sudo adduser rossi uucp`, then log in again",
    )


def test_a_port_that_somebody_else_has_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = tmp_path / "ttyUSB0"
    device.touch()
    monkeypatch.setattr(doctor, "locker_of", lambda url: os.getppid())
    looked = finding(look_at_holder("dde-1", str(device)))
    assert looked.kind == "port.busy"
    assert f"process {os.getppid()}" in looked.what


OPENS = (
    "import os, sys; os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print('open', flush=True);"
    " sys.stdin.read()"
)
BOTH_ENDS = (
    "import os, sys; far, near = os.openpty(); print(os.ttyname(near), flush=True);"
    " sys.stdin.read()"
)


@contextmanager
def another_program(script: str, *words: str) -> Iterator[tuple[int, str]]:
    """A process that runs `script` meanwhile: its number and the first line that it says."""
    with subprocess.Popen(
        [sys.executable, "-c", script, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as one:
        assert one.stdout is not None
        try:
            yield one.pid, one.stdout.readline().strip()
        finally:
            one.kill()


def test_a_port_that_another_program_has_open_without_a_lock() -> None:
    with terminal() as far, another_program(OPENS, far.url) as (process, _):
        looked = finding(look_at_holder("dde-1", far.url))
        assert looked.kind == "port.shared"
        assert f"process {process} (" in looked.what
        (report,) = search([(far.url, ScanPlan(limit_s=0.5))])
        assert isinstance(report.broken, PortBusy)
        assert f"process {process}" in str(report.broken)
        assert report.sent.total() == 0


def test_modem_manager_is_named_with_the_rule_that_keeps_it_away(tmp_path: Path) -> None:
    named = tmp_path / MODEM_MANAGER
    named.symlink_to(shutil.which("sleep") or "/bin/sleep")
    assert look_at_modem_manager() == []
    with (
        terminal() as far,
        open(far.url, "rb+", buffering=0) as port,  # noqa: PTH123  # a device
        subprocess.Popen([named, "60"], stdin=port, close_fds=True) as process,
    ):
        assert until(lambda: look_at_modem_manager() != [])
        (machine,) = look_at_modem_manager()
        port.close()
        shared = finding(look_at_holder("dde-1", far.url))
        process.kill()
    for looked in (finding(machine), shared):
        assert f"process {process.pid} (ModemManager)" in looked.what
        assert 'ENV{ID_MM_PORT_IGNORE}="1"' in looked.step
    assert (finding(machine).kind, shared.kind) == ("port.modem_manager", "port.shared")


def test_the_program_behind_a_pseudo_terminal_does_not_share_it() -> None:
    with another_program(BOTH_ENDS) as (_, url):
        assert look_at_holder("dde-1", url) is None


@pytest.mark.parametrize("group", ["root", "wheel", "audio"])
def test_nobody_is_told_to_join_a_group_that_may_do_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, group: str
) -> None:
    monkeypatch.setattr(Path, "group", lambda path: group)
    monkeypatch.setattr(doctor.getpass, "getuser", lambda: "rossi")
    step = permission_step(tmp_path / "ttyUSB0")
    assert f"adduser rossi {group}" not in step
    assert 'KERNEL=="ttyUSB*", GROUP="dialout", MODE="0660"' in step
    assert "`sudo adduser rossi dialout`" in step


def test_a_run_that_holds_a_port_is_no_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        doctor, "run_that_holds", lambda url: Path("runs/20261121T013000Z-bench-k7qd")
    )
    looked = look_at_holder("dde-1", "/dev/ttyUSB0")
    assert isinstance(looked, Fine)
    assert "runs/20261121T013000Z-bench-k7qd" in looked.what


@pytest.mark.parametrize(
    ("held_ms", "is_slow"), [("16\n", True), ("1\n", False), ("nonsense", False)]
)
def test_an_adapter_that_holds_answers_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, held_ms: str, is_slow: bool
) -> None:
    timer = tmp_path / "latency_timer"
    timer.write_text(held_ms)
    monkeypatch.setattr(doctor, "latency_timer", lambda device: timer)
    looked = look_at_timer("dde-1", "/dev/ttyUSB0")
    assert (looked is not None) is is_slow
    if is_slow:
        slow = finding(looked)
        assert (slow.kind, slow.step) == ("port.latency", f"`echo 1 | sudo tee {timer}`")
