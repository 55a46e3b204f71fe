"""`jbclog scan` and `jbclog doctor` on real terminals and TCP, with virtual stations and with other
devices.
"""

from __future__ import annotations

import fcntl
import json
import os
import select
import shutil
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.command import BENCH, RECIPE, WireLog, is_sampling, jbclog, started, until
from support.invoked import invoked
from support.links.far_ends import Terminal, terminal
from support.product import (
    LineFormat,
    PortBusy,
    PortReport,
    ScanPlan,
    SimProcess,
    Trial,
    diagnose,
    load_line,
    open_run,
    search_ports,
)

Bench = tuple[Path, WireLog]
NAMES = ("dde-1", "dde-2", "ucr-1", "ale-1")
TRIALS = 5
"""A scan waits 0.3 s for an answer; a busy machine sometimes takes longer, and then another trial
follows.
"""
TCGETS2 = 0x802C542A
SHORT = ScanPlan(
    (Trial(LineFormat()), Trial(LineFormat(250000, "8E1"), listens_s=0.5)), addresses=(1, None)
)


def urls(line: Path) -> list[str]:
    return [station.url for station in load_line(line).stations]


def test_what_a_scan_writes_runs_as_it_is(bench: Bench, tmp_path: Path) -> None:
    line, wire = bench
    file = tmp_path / "found.toml"
    scan = jbclog("scan", *urls(line), "--write", file, "--json")
    assert scan.returncode == 0, scan.stderr
    found = json.loads(scan.stdout)
    assert [port["station"]["model"] for port in found["ports"]] == ["DDE", "DDE", "UCR245", "ALE"]
    assert all(port["station"]["turnaround_ms"]["median"] > 0.9 for port in found["ports"])
    assert not any(wire.writes(name) for name in NAMES)
    assert sum(one["count"] for one in found["sent"]) == sum(
        len(wire.questions(name)) for name in NAMES
    )
    run = jbclog(
        "run",
        RECIPE,
        "--line",
        file,
        "--out",
        tmp_path / "runs",
        "-d",
        "1s",
        "--rate",
        "fit",
        "-s",
        "ucr-1",
        "--json",
    )
    assert json.loads(run.stdout)["safe_state"]["ucr-1"] == {"1": "verified"}


def test_a_file_that_is_there_is_kept_and_nothing_is_sent(bench: Bench, tmp_path: Path) -> None:
    line, wire = bench
    file = tmp_path / "line.toml"
    file.write_text("mine")
    scan = jbclog("scan", *urls(line), "--write", file)
    assert (scan.returncode, scan.stdout) == (2, "")
    assert "exists; give another name" in scan.stderr
    assert file.read_text() == "mine"
    assert not any(wire.questions(name) for name in NAMES)
    assert jbclog("scan", urls(line)[0], "--write", file, "--force").returncode == 0
    assert load_line(file).stations[0].name == "dde-1"


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("/dev/null", "--addresses", "0-5"), "must be 1 to 99"),
        (("/dev/null", "--write", "no/such/folder/line.toml"), "no such folder"),
        (("/dev/null", "--seconds", "0"), "'--seconds'"),
    ],
)
def test_wrong_usage(arguments: tuple[str, ...], why: str) -> None:
    ended = jbclog("scan", *arguments)
    assert ended.returncode == 2
    assert why in ended.stderr


def test_a_run_is_not_disturbed_by_either(bench: Bench, tmp_path: Path) -> None:
    line, wire = bench
    run = started(
        "run",
        RECIPE,
        "--line",
        line,
        "--out",
        tmp_path / "runs",
        "-s",
        "ucr-1",
        "--rate",
        "2",
        "--capture",
    )
    try:
        assert until(lambda: is_sampling(tmp_path / "runs"))
        ucr = load_line(line).station("ucr-1").url
        scan = jbclog("scan", ucr, "--json")
        (port,) = json.loads(scan.stdout)["ports"]
        assert scan.returncode == 1
        assert (port["findings"][0]["kind"], port["questions"]) == ("port.busy", 0)
        (folder,) = (tmp_path / "runs").iterdir()
        assert f"is held by the run {folder}" in port["findings"][0]["what"]
        doctor = json.loads(jbclog("doctor", "--line", line, "--out", tmp_path, "--json").stdout)
        looked = {one["where"]: one for one in doctor["looked"]}
        assert looked["ucr-1"]["kind"] == "port.run"
        assert looked["ucr-1"]["step"] is None
        assert looked["dde-1"]["kind"] == "station"
    finally:
        run.terminate()
        run.communicate(timeout=200)
    assert "RSMN" in wire.questions("dde-1")
    asked = open_run(folder).wire("ucr-1")["what"].eq("sent").sum()
    # all of them are the run's own; a station that is late hears the last ones after its end
    assert until(lambda: len(wire.questions("ucr-1")) >= asked)
    assert len(wire.questions("ucr-1")) == asked


def test_a_station_behind_a_tcp_server(tmp_path: Path) -> None:
    with SimProcess(BENCH, tmp_path / "bench", tcp="127.0.0.1:0") as sim:
        url = urls(sim.line_path)[2]
        for _ in range(TRIALS):
            scan = jbclog("scan", url, "--write", tmp_path / "line.toml", "--force")
            if scan.returncode == 0:
                break
        assert scan.returncode == 0, scan.stdout
        assert "UCR245, family ucr" in scan.stdout
        assert load_line(tmp_path / "line.toml").stations[0].url == url


# in pyserial, of Python 3.11
@pytest.mark.filterwarnings("ignore:set(Daemon|Name)\\(\\) is deprecated:DeprecationWarning")
@pytest.mark.skipif(shutil.which("ser2net") is None, reason="ser2net is not installed")
def test_the_line_format_behind_ser2net_is_found(tmp_path: Path) -> None:
    """ser2net starts at 19200 8N1. The scan sets the rate over RFC 2217, and the station uses the
    settings of its terminal.
    """
    file = tmp_path / "bench.toml"
    station = (
        '[[station]]\nname = "ucr-1"\nurl = "ucr-1"\nfamily = "ucr"\nbaudrate ='
        " 38400\n[station.sim]\n"
    )
    file.write_text(f'[line]\nname = "bench"\n{station}')
    with (
        SimProcess(file, tmp_path / "bench") as sim,
        ser2net(tmp_path, Path(urls(sim.line_path)[0]).resolve()) as url,
    ):
        plan = ScanPlan((Trial(LineFormat()), Trial(LineFormat(38400))), addresses=(1,))
        for _ in range(TRIALS):
            (report,) = search_ports([(url, plan)])
            if report.station is not None:
                break
    assert report.station is not None, report
    assert (report.station.model, report.station.line) == ("UCR245", LineFormat(38400))


@contextmanager
def ser2net(folder: Path, device: Path) -> Iterator[str]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    file = folder / "ser2net.yaml"
    accepter, connector = (
        f"telnet(rfc2217),tcp,127.0.0.1,{port}",
        f"serialdev,{device},19200n81,local",
    )
    file.write_text(f"connection: &con\n  accepter: {accepter}\n  connector: {connector}\n")
    with subprocess.Popen(
        ["ser2net", "-d", "-u", "-c", file], stderr=subprocess.DEVNULL
    ) as running:
        try:
            assert until(
                lambda: f":{port:04X} 00000000:0000 0A" in Path("/proc/net/tcp").read_text()
            )
            # a pseudo-terminal has no control lines
            yield f"rfc2217://127.0.0.1:{port}?ign_set_control"
        finally:
            running.kill()


def test_no_usb_port_is_said_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("serial.tools.list_ports.comports", list)
    said = invoked("scan")
    assert said.exit_code == 1
    assert said.stdout.startswith("no USB serial port found: plug the adapter in")


# -- what is no station ----------------------------------------------------------------------------


@contextmanager
def answered(reply: Callable[[bytes, int], bytes], every_s: float = 0.1) -> Iterator[Terminal]:
    """A far end that sends `reply(bytes received, rate set by the client)`, also after a while
    without any bytes.
    """
    over = threading.Event()

    def serve(far: Terminal) -> None:
        while not over.is_set():
            ready, _, _ = select.select([far.far], [], [], every_s)
            data = b""
            if ready:
                try:
                    data = os.read(far.far, 4096)
                except OSError:  # no client just now
                    over.wait(0.01)
                    continue
            if said := reply(data, rate_of(far.far)):
                os.write(far.far, said)

    with terminal() as far:
        os.set_blocking(far.far, False)
        thread = threading.Thread(target=serve, args=(far,))
        thread.start()
        try:
            yield far
        finally:
            over.set()
            thread.join()


def rate_of(descriptor: int) -> int:
    rate: int = struct.unpack_from("I", fcntl.ioctl(descriptor, TCGETS2, bytes(44)), 40)[0]
    return rate


def scanned(far: Terminal, shows: Callable[[PortReport], bool] = lambda _: True) -> PortReport:
    """Scan a terminal until the report `shows` the device, at most `TRIALS` times. The kernel
    reuses numbers of terminals, so a recorder of another test that searches for its lost port may
    hold this one for a moment.
    """
    for _ in range(TRIALS):
        for _ in range(20):
            (report,) = search_ports([(far.url, SHORT)])
            if not isinstance(report.broken, PortBusy):
                break
            time.sleep(0.2)
        if shows(report):
            break
    return report


def test_a_loop_back() -> None:
    with answered(lambda data, rate: data) as far:
        report = scanned(far, lambda report: report.echoed)
    assert [finding.kind for finding in diagnose(report)] == ["line.echo"]


def test_a_station_in_its_binary_protocol() -> None:
    with answered(lambda data, rate: b"\x15" if rate == 250000 and not data else b"") as far:
        report = scanned(far, lambda report: report.binary is not None)
    assert [finding.kind for finding in diagnose(report)] == ["robot_mode.binary"]
    assert report.binary == LineFormat(250000, "8E1")


def test_nobody() -> None:
    with terminal() as far:
        report = scanned(far)
        assert [finding.kind for finding in diagnose(report)] == ["line.silent"]
        assert far.heard().startswith(b"\x020001RSMN\x03\x02\x02RSMN\x03\x03")


def test_the_terminal_is_opened_at_each_format() -> None:
    rates = set()

    def note(data: bytes, rate: int) -> bytes:
        if data:
            rates.add(rate)
        return b""

    with answered(note) as far:
        scanned(far, lambda _: len(rates) > 1)
    assert rates == {19200, 250000}


def heard_of(far: Terminal) -> bytes:
    """Return the bytes of a client; empty while there is none."""
    try:
        return far.heard(0.1)
    except OSError:
        return b""


def test_ctrl_c_ends_a_scan_soon() -> None:
    with terminal() as far:
        scan = started("scan", far.url)
        assert until(lambda: heard_of(far))
        scan.send_signal(2)
        _, said = scan.communicate(timeout=200)
    assert scan.returncode == 130
    assert "Traceback" not in said
