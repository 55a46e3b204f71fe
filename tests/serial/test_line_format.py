"""A pseudo-terminal has no bit rate, but keeps the settings of its client; virtual stations check
them.
"""

from __future__ import annotations

from pathlib import Path

import pytest

import serial
from support.product import Frame, SimProcess, load_line

READ = Frame("R", "SMN", 0, 1).encode()
UNPACED = "[station.sim]\nwire = false\n"
ANSWER = b"\x020100ASMN  DDE\x03"


def line_file(folder: Path, *formats: tuple[int, str]) -> Path:
    path = folder / "bench.toml"
    stations = (
        f'[[station]]\nname = "s{n}"\nfamily = "dde"\nurl = "s{n}"\nbaudrate = {rate}\nformat ='
        f' "{form}"\n{UNPACED}'
        for n, (rate, form) in enumerate(formats, 1)
    )
    path.write_text('[line]\nname = "bench"\n' + "".join(stations))
    return path


def asked(url: str, baudrate: int, form: str = "8N1", seconds: float = 20.0) -> bytes:
    """Return the answer within `seconds`; the wait ends early with its last byte."""
    with serial.serial_for_url(
        url, baudrate, parity=form[1], stopbits=int(form[2]), timeout=seconds
    ) as port:
        port.write(READ)
        return bytes(port.read(len(ANSWER) + 1))


NO_ANSWER_S = 0.15


def test_only_a_client_at_the_stations_rate_is_answered(tmp_path: Path) -> None:
    formats = [(1200, "8N1"), (19200, "8N1"), (250000, "8E1"), (500000, "8N2"), (115200, "8O1")]
    with SimProcess(line_file(tmp_path, *formats), tmp_path / "sim") as sim:
        for station in load_line(sim.line_path).stations:
            assert asked(station.url, station.baudrate, station.format)[:-1] == ANSWER
            assert asked(station.url, 38400, station.format, NO_ANSWER_S) == b""
            assert asked(station.url, station.baudrate, station.format)[:-1] == ANSWER


@pytest.mark.parametrize(
    ("client", "understood"), [("8N1", True), ("8N2", True), ("8E1", True), ("8O1", False)]
)
def test_of_parity_a_terminal_tells_only_the_odd_one(
    tmp_path: Path, client: str, understood: bool
) -> None:
    """Linux clears PARENB on pseudo-terminals and keeps PARODD, so even and none look the same."""
    with SimProcess(line_file(tmp_path, (19200, "8N1")), tmp_path / "sim") as sim:
        url = load_line(sim.line_path).station("s1").url
        heard = asked(url, 19200, client, 20.0 if understood else NO_ANSWER_S)
        assert (heard[:-1] == ANSWER) is understood


def asked_and_changed(url: str) -> bytes:
    """Return the bytes after the change of rate; empty if a busy machine had not read the question
    by then, or had already answered it.
    """
    with serial.serial_for_url(url, 9600, timeout=0.3) as port:
        port.write(READ)
        port.timeout = 0.1  # the question is read by then, and its answer not sent yet
        came_before = port.read(1)
        port.baudrate = 19200
        if came_before or port.in_waiting:
            return b""
        port.timeout = 1.0
        return port.read(64)


def test_a_terminal_at_a_wrong_rate_hears_garbage(tmp_path: Path) -> None:
    """The question is sent at the right rate, and the client changes to another one before the
    answer.
    """
    slow = line_file(tmp_path, (9600, "8N1"))
    slow.write_text(slow.read_text().replace("wire = false", "wire = false\nturnaround_ms = 400"))
    with SimProcess(slow, tmp_path / "sim") as sim:
        url = load_line(sim.line_path).station("s1").url
        garbage = next((heard for _ in range(10) if (heard := asked_and_changed(url))), b"")
    assert garbage
    assert b"ASMN" not in garbage
