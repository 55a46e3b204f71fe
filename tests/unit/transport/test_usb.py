"""USB serial ports: which there are, by which name they last, and what holds their answers back."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from jbclog.transport import system_ports


@pytest.fixture
def plugged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two adapters, one of them with a lasting name, and a port on the board."""
    for name in ("ttyUSB0", "ttyUSB1", "ttyS0"):
        (tmp_path / name).touch()
    by_id = tmp_path / "by-id"
    by_id.mkdir()
    (by_id / "usb-FTDI_FT232R_A50285BI-if00-port0").symlink_to("../ttyUSB1")
    (by_id / "usb-gone").symlink_to("../ttyUSB9")
    ports = [
        SimpleNamespace(
            device=str(tmp_path / "ttyUSB1"), vid=0x0403, description="FT232R USB UART"
        ),
        SimpleNamespace(device=str(tmp_path / "ttyS0"), vid=None, description="ttyS0"),
        SimpleNamespace(device=str(tmp_path / "ttyUSB0"), vid=0x1A86, description=None),
    ]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: ports)
    return tmp_path


def test_only_usb_ports_are_found_by_their_lasting_names(plugged: Path) -> None:
    by_id = plugged / "by-id"
    assert system_ports.usb_ports(by_id) == [
        system_ports.UsbPort(str(plugged / "ttyUSB0"), str(plugged / "ttyUSB0"), ""),
        system_ports.UsbPort(
            str(plugged / "ttyUSB1"),
            str(by_id / "usb-FTDI_FT232R_A50285BI-if00-port0"),
            "FT232R USB UART",
        ),
    ]


def test_a_lasting_name_lasts(plugged: Path) -> None:
    by_id = plugged / "by-id"
    name = system_ports.lasting_name(str(plugged / "ttyUSB1"), by_id)
    assert system_ports.lasting_name(name, by_id) == name
    assert system_ports.lasting_name("/dev/ttyS0", by_id) == "/dev/ttyS0"
    assert system_ports.lasting_name("/dev/ttyS0", plugged / "no-such-folder") == "/dev/ttyS0"


def test_the_timer_is_that_of_the_device_behind_the_name(plugged: Path) -> None:
    timer = plugged / "timers" / "ttyUSB1" / "latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text("16\n")
    link = str(plugged / "by-id" / "usb-FTDI_FT232R_A50285BI-if00-port0")
    assert system_ports.latency_timer(link, plugged / "timers") == timer
    assert system_ports.latency_timer(str(plugged / "ttyUSB0"), plugged / "timers") is None
