"""One device and another behind the same name."""

from __future__ import annotations

import os
import pty
from pathlib import Path

import pytest

from jbclog.transport.device import PortDevice, device_of


def test_a_server_is_its_host_and_port() -> None:
    found = device_of("socket://Terminal:4001?logging=debug", None)
    assert found == device_of("socket://terminal:4001", None) == PortDevice("terminal:4001")
    assert found != device_of("socket://terminal:4002", None)


@pytest.mark.parametrize("url", ["loop://", "/dev/ttyUSB0"])
def test_what_cannot_be_known_is_none(url: str) -> None:
    assert device_of(url, None) is None
    reading, writing = os.pipe()
    try:
        assert device_of("/dev/ttyUSB0", reading) is None
    finally:
        os.close(reading)
        os.close(writing)


def test_a_terminal_stays_the_same_while_it_is_used_and_another_is_another() -> None:
    far, near = pty.openpty()
    further, other = pty.openpty()
    try:
        before = device_of(os.ttyname(near), near)
        os.write(far, b"x")
        again = os.open(os.ttyname(near), os.O_RDWR | os.O_NOCTTY)
        assert before is not None
        assert device_of(os.ttyname(near), again) == before
        assert device_of(os.ttyname(other), other) != before
        os.close(again)
    finally:
        for descriptor in (far, near, further, other):
            os.close(descriptor)


def test_an_adapter_has_its_number_at_the_bus_and_its_serial_number(tmp_path: Path) -> None:
    far, near = pty.openpty()
    try:
        number = os.fstat(near).st_rdev
        adapter = tmp_path / "usb1" / "1-4"
        terminal = adapter / "1-4:1.0" / "ttyUSB0" / "tty" / "ttyUSB0"
        terminal.mkdir(parents=True)
        for name, text in (("devnum", "17"), ("busnum", "1"), ("serial", "FT1")):
            (adapter / name).write_text(f"{text}\n")
        link = tmp_path / f"{os.major(number)}:{os.minor(number)}"
        link.symlink_to(terminal)
        found = device_of("/dev/ttyUSB0", near, tmp_path)
        assert found is not None
        assert (found.usb, found.serial) == ("1-17", "FT1")
        (adapter / "devnum").write_text("18\n")  # plugged out and in again
        assert device_of("/dev/ttyUSB0", near, tmp_path) != found
    finally:
        os.close(far)
        os.close(near)
