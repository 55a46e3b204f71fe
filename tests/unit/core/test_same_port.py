"""Whether two urls are one port."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.core.serial_line import is_one_port, port_address


@pytest.mark.parametrize(
    ("url", "other"),
    [
        ("socket://127.0.0.1:7400", "socket://localhost:7400"),
        ("socket://127.0.0.1:7400", "socket://[::1]:7400"),
        ("socket://LOCALHOST:7400", "socket://localhost:7400"),
        ("SOCKET://localhost:7400", "socket://localhost:07400/"),
        ("socket://localhost:7400?logging=debug", "socket://localhost:7400"),
        ("rfc2217://localhost:7400?poll_modem", "socket://127.0.0.1:7400"),
        ("socket://Nowhere.invalid:7400", "socket://nowhere.invalid:7400"),
        ("/dev/jbc-1", "/dev/../dev/jbc-1"),
    ],
)
def test_one_port(url: str, other: str) -> None:
    assert is_one_port(url, other)
    assert is_one_port(other, url)


@pytest.mark.parametrize(
    ("url", "other"),
    [
        ("socket://localhost:7400", "socket://localhost:7401"),
        ("socket://192.0.2.1:7400", "socket://192.0.2.2:7400"),
        ("socket://nowhere.invalid:7400", "socket://elsewhere.invalid:7400"),
        ("socket://localhost:7400", "/dev/jbc-1"),
        ("socket://localhost:nothing", "socket://localhost:else"),
        ("/dev/jbc-1", "/dev/jbc-2"),
        ("COM3", "COM4"),
        ("/dev/jbc\0-1", "/dev/jbc-1"),
        ("/dev/jbc\ud800", "/dev/jbc-1"),
    ],
)
def test_two_ports(url: str, other: str) -> None:
    assert not is_one_port(url, other)


def test_links_to_devices_are_followed(tmp_path: Path) -> None:
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyUSB0")
    assert is_one_port(str(tmp_path / "by-id"), str(tmp_path / "ttyUSB0"))


def test_no_host_is_resolved_for_another_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socket.getaddrinfo", pytest.fail)
    assert not port_address("socket://slow.example:1").is_at(
        port_address("socket://other.example:2")
    )
    assert port_address("socket://slow.example:1").is_at(port_address("socket://slow.example:1"))
