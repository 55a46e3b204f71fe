"""Virtual stations in a child process, on real pseudo-terminals and TCP; the client is pyserial."""

from __future__ import annotations

import fcntl
import json
import os
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest

import serial
from support.command import PROFILES, RECIPE, until
from support.product import (
    INTERRUPTED_SIM,
    SIM_OF_DYING_PARENT,
    Frame,
    SimProcess,
    UsageError,
    load_line,
)

READ_MS = 27 * 10 / 19200 * 1000  # 14.06 ms: eleven characters there and sixteen back
TIOCGEXCL = 0x80045440
READ = Frame("R", "TT1", 0, 1).encode()


def line_file(folder: Path, *stations: str) -> Path:
    """Write a line file of these tables, each beginning with its URL."""
    path = folder / "bench.toml"
    tables = (
        f'[[station]]\nname = "s{n}"\nfamily = "dde"\nurl = {text}\n'
        for n, text in enumerate(stations, 1)
    )
    path.write_text('[line]\nname = "bench"\n' + "".join(tables))
    return path


def opened(line: Path, station: str) -> serial.SerialBase:
    """Open a station's port as a client that waits long enough for a busy machine."""
    return serial.serial_for_url(load_line(line).station(station).url, 19200, timeout=60)


def asked(port: serial.SerialBase, question: bytes = READ, count: int = 16) -> bytes:
    port.write(question)
    return bytes(port.read(count))


def is_exclusive(path: Path) -> bool:
    """Whether the terminal is locked for all users but root; tests run as root."""
    with path.open("rb", buffering=0) as probe:
        return bool(struct.unpack("i", fcntl.ioctl(probe.fileno(), TIOCGEXCL, b"\0" * 4))[0])


def test_a_paced_exchange_takes_what_its_bytes_take_and_hardly_more(tmp_path: Path) -> None:
    line = line_file(tmp_path, '"s1"\n[station.sim]\nturnaround_ms = 0')
    with SimProcess(line, tmp_path / "sim") as sim, opened(sim.line_path, "s1") as port:
        asked(port)
        took_ms = [took(port) for _ in range(100)]
        # others have the processors, too: one exchange without them shows it
        while min(took_ms) >= READ_MS + 1.0 and len(took_ms) < 2000:
            took_ms.append(took(port))
    assert READ_MS <= min(took_ms) < READ_MS + 1.0


def took(port: serial.SerialBase) -> float:
    """Return the duration of an exchange in ms."""
    begun = time.monotonic()
    assert len(asked(port)) == 16
    return (time.monotonic() - begun) * 1000


def test_the_turnaround_comes_on_top(tmp_path: Path) -> None:
    line = line_file(tmp_path, '"s1"\n[station.sim]\nturnaround_ms = 5')
    with SimProcess(line, tmp_path / "sim") as sim, opened(sim.line_path, "s1") as port:
        begun = time.monotonic()
        assert len(asked(port)) == 16
        assert time.monotonic() - begun >= (READ_MS + 5) / 1000


def test_stations_are_linked_where_their_urls_say_and_nowhere_else(tmp_path: Path) -> None:
    device = tmp_path / "device"
    device.write_text("left alone")
    line = line_file(tmp_path, '"a/b"', f'"{device}"', '"socket://localhost:1"')
    with SimProcess(line, tmp_path / "sim") as sim:
        served = load_line(sim.line_path)
        assert [station.url for station in served.stations] == [
            str(tmp_path / "sim" / name) for name in ("a/b", "s2", "s3")
        ]
        assert all(Path(station.url).is_symlink() for station in served.stations)
        for station in served.stations:
            with opened(sim.line_path, station.name) as port:
                assert asked(port, Frame("R", "SMN", 0, 1).encode())[5:-2] == b"ASMN  DDE"
    assert device.read_text() == "left alone"
    assert not any(Path(station.url).is_symlink() for station in served.stations)


def test_the_line_file_for_the_run_says_what_the_original_says(tmp_path: Path) -> None:
    extra = (
        'address = false\nbaudrate = 9600\nformat = "8E1"\nports = [2]\nturnaround_ms = 1.5\nrecipe'
        ' = "r.toml"\nrated_power_w = 90'
    )
    line = line_file(tmp_path, f'"s1"\n{extra}', '"s2"')
    with SimProcess(line, tmp_path / "sim") as sim:
        served, original = load_line(sim.line_path), load_line(line)
    same = {
        "name",
        "family",
        "baudrate",
        "format",
        "address",
        "ports",
        "turnaround_ms",
        "recipe",
        "rated_power_w",
    }
    assert served.name == original.name
    for one, other in zip(served.stations, original.stations, strict=True):
        assert one.model_dump(include=same) == other.model_dump(include=same)


@pytest.mark.skipif(
    os.geteuid() != 0,
    reason="only root may open a terminal that a client has marked as its own and left",
)
def test_a_client_that_closes_leaves_the_port_to_the_next(tmp_path: Path) -> None:
    with SimProcess(line_file(tmp_path, '"s1"'), tmp_path / "sim") as sim:
        with opened(sim.line_path, "s1") as port:
            fcntl.ioctl(port.fileno(), termios.TIOCEXCL)
            asked(port, Frame("W", "ST100330", 0, 1).encode(), 11)
            path = Path(str(port.port))
        assert until(lambda: not is_exclusive(path))
        with opened(sim.line_path, "s1") as port:
            assert asked(port, Frame("R", "ST1", 0, 1).encode())[5:-2] == b"AST100330"


def test_a_dropout_hangs_up_and_comes_back_on_the_same_link(tmp_path: Path) -> None:
    fault = "[[station.sim.fault]]\nkind = 'dropout'\nat_s = 0.3\nfor_s = 4.0"
    line = line_file(tmp_path, f'"s1"\n{fault}', '"s2"')
    with SimProcess(line, tmp_path / "sim") as sim:
        link = tmp_path / "sim" / "s1"
        with opened(sim.line_path, "s1") as port, opened(sim.line_path, "s2") as other:
            begun = time.monotonic()
            port.write(READ)  # the answer is lost where it comes so late as the dropout
            hung_up = select.poll()
            hung_up.register(port.fileno(), 0)
            assert hung_up.poll(60_000)
            assert time.monotonic() - begun >= 0.3
            with pytest.raises(OSError, match=r".*"):
                os.write(port.fileno(), READ)
            assert not link.is_symlink()
            assert len(asked(other)) == 16
        assert until(link.is_symlink)
        assert time.monotonic() - begun >= 4.3
        with opened(sim.line_path, "s1") as port:
            assert len(asked(port)) == 16


def test_tcp_serves_a_port_for_each_station_and_one_client_at_a_time(tmp_path: Path) -> None:
    fault = "[[station.sim.fault]]\nkind = 'dropout'\nat_s = 0.3\nfor_s = 0.3"
    with SimProcess(
        line_file(tmp_path, f'"s1"\n{fault}', '"s2"'), tmp_path / "sim", tcp="127.0.0.1:0"
    ) as sim:
        urls = [station.url for station in load_line(sim.line_path).stations]
        assert all(url.startswith("socket://127.0.0.1:") for url in urls)
        assert len(set(urls)) == 2
        with opened(sim.line_path, "s1") as port, opened(sim.line_path, "s2") as other:
            begun = time.monotonic()
            assert len(asked(port)) == 16
            assert time.monotonic() - begun >= READ_MS / 1000
            with opened(sim.line_path, "s2") as second, pytest.raises(serial.SerialException):
                second.read(1)
            assert len(asked(other)) == 16
            with pytest.raises(serial.SerialException):
                port.read(1)
        assert until(lambda: _answers(sim.line_path, "s1"))


def _answers(line: Path, station: str) -> bool:
    try:
        with opened(line, station) as port:
            return len(asked(port)) == 16
    except serial.SerialException:
        return False


def test_the_wire_is_written_down_on_request(tmp_path: Path) -> None:
    log = tmp_path / "wire.jsonl"
    with (
        SimProcess(line_file(tmp_path, '"s1"'), tmp_path / "sim", log=log) as sim,
        opened(sim.line_path, "s1") as port,
    ):
        asked(port, Frame("W", "ST100330", 0, 1).encode(), 11)
    notes = [json.loads(text) for text in log.read_text().splitlines()]
    assert [(note["station"], note["kind"], note["text"]) for note in notes] == [
        ("s1", "question", "0001WST100330"),
        ("s1", "answer", "0100AST1"),
    ]
    assert notes[1]["t"] - notes[0]["t"] >= (16 + 11) * 10 / 19200
    assert bytes.fromhex(notes[1]["hex"]) == Frame("A", "ST1", 1, 0).encode()


def test_a_file_in_the_way_is_left_alone_and_named(tmp_path: Path) -> None:
    folder = tmp_path / "sim"
    folder.mkdir()
    (folder / "s2").write_text("mine")
    with (
        pytest.raises(UsageError, match="s2 is there already"),
        SimProcess(line_file(tmp_path, '"s1"', '"s2"'), folder),
    ):
        pass
    assert (folder / "s2").read_text() == "mine"
    assert not (folder / "s1").is_symlink()


@pytest.mark.parametrize("urls", [('"s2"', '"/dev/null"'), ('"line.toml"',)])
def test_two_uses_of_one_path_are_an_error(tmp_path: Path, urls: tuple[str, ...]) -> None:
    with (
        pytest.raises(UsageError, match="has another use"),
        SimProcess(line_file(tmp_path, *urls), tmp_path / "sim"),
    ):
        pass


def test_it_does_not_overwrite_the_line_file_that_it_serves(tmp_path: Path) -> None:
    line = line_file(tmp_path, '"s1"').rename(tmp_path / "line.toml")
    before = line.read_text()
    with pytest.raises(UsageError, match="would be overwritten"), SimProcess(line, tmp_path):
        pass
    assert line.read_text() == before


def test_a_wrong_line_file_is_an_error_with_its_reason(tmp_path: Path) -> None:
    line = line_file(tmp_path, '"s1"\n[station.sim]\nturnaround = 3')
    with pytest.raises(UsageError, match="turnaround"), SimProcess(line, tmp_path / "sim"):
        pass


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_in_good_order(tmp_path: Path, number: signal.Signals) -> None:
    command = [
        sys.executable,
        "-m",
        "jbclog.sim",
        str(line_file(tmp_path, '"s1"')),
        "--dir",
        str(tmp_path / "sim"),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as serving:
        assert serving.stdout is not None
        assert serving.stdout.readline().strip() == str(tmp_path / "sim" / "line.toml")
        serving.send_signal(number)
        assert serving.wait(120) == 0
    assert not (tmp_path / "sim" / "s1").is_symlink()


def test_a_signal_that_interrupts_no_wait_ends_it_as_well() -> None:
    """A signal just before a wait does not interrupt it; here another thread receives it."""
    assert subprocess.run([sys.executable, "-c", INTERRUPTED_SIM], timeout=120).returncode == 0


def test_it_ends_when_its_parent_dies(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-c",
        SIM_OF_DYING_PARENT,
        str(line_file(tmp_path, '"s1"')),
        str(tmp_path / "sim"),
    ]
    told = subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
    assert told.returncode == -signal.SIGKILL
    assert int(told.stdout) > 0
    assert until(lambda: not (tmp_path / "sim" / "s1").is_symlink())


def test_hundreds_of_stations_fit_into_a_small_soft_limit(tmp_path: Path) -> None:
    line = line_file(tmp_path, *(f'"s{n}"' for n in range(1, 301)))
    command = [
        "sh",
        "-c",
        'ulimit -S -n 256 && exec "$@"',
        "sh",
        sys.executable,
        "-m",
        "jbclog.sim",
        str(line),
        "--dir",
        str(tmp_path),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as serving:
        assert serving.stdout is not None
        assert serving.stdout.readline().strip()
        with opened(tmp_path / "line.toml", "s300") as port:
            assert len(asked(port)) == 16
        serving.terminate()
        assert serving.wait(120) == 0


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("bench.toml", f"jbclog run {RECIPE} --line {{served}} --duration 3m"),
        ("dme.toml", "jbclog run --line {served} --duration 3m"),
    ],
)
def test_the_command_that_records_the_served_line_is_shown(
    tmp_path: Path, line: str, hint: str
) -> None:
    """`tests/line/test_profiles.py` runs these commands to an accepted record."""
    command = [sys.executable, "-m", "jbclog", "sim", PROFILES / "lines" / line]
    command += ["--dir", tmp_path / "sim"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as serving:
        assert serving.stderr is not None
        assert "ready; stop with Ctrl-C. In another terminal:" in serving.stderr.readline()
        assert serving.stderr.readline().strip() == hint.format(served=tmp_path / "sim/line.toml")
        serving.send_signal(signal.SIGINT)
        serving.wait(120)
