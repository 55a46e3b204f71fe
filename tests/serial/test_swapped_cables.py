"""Cables of two stations that are swapped, at the start and in mid-run, behind a real terminal
server; and units that nothing on the link tells apart.
"""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.command import RECIPE, until
from support.product import SimProcess, load_line, names_of_open_run, open_run


class TerminalServer:
    """Two TCP ports, each led on to a station; `swap` exchanges the cables behind them."""

    def __init__(self, targets: list[tuple[str, int]]) -> None:
        self._targets = targets
        self._open: list[socket.socket] = []
        self._listening = [socket.create_server(("127.0.0.1", 0)) for _ in targets]
        self.urls = [f"socket://127.0.0.1:{one.getsockname()[1]}" for one in self._listening]
        for number in range(len(targets)):
            threading.Thread(target=self._accept, args=(number,), daemon=True).start()

    def swap(self) -> None:
        self._targets.reverse()
        for connection in self._open:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def end(self) -> None:
        for connection in (*self._listening, *self._open):
            connection.close()

    def _accept(self, number: int) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._listening[number].accept()
                far = socket.create_connection(self._targets[number])
                self._open += [near, far]
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=_copy, args=(source, sink), daemon=True).start()


def _copy(source: socket.socket, sink: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while data := source.recv(4096):
            sink.sendall(data)
    for end in (source, sink):
        with contextlib.suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)


STATION = (
    '[[station]]\nname = "{}"\nurl = "{}"\nfamily = "{}"\n[station.sim]\njoints_per_minute = 0\n'
)


def line_text(*stations: tuple[str, str, str]) -> str:
    return '[line]\nname = "bench"\n' + "".join(STATION.format(*one) for one in stations)


@pytest.fixture(params=[("dde", "ucr"), ("dde", "dde")], ids=["two families", "twins"])
def bench(
    tmp_path: Path, request: pytest.FixtureRequest
) -> Iterator[tuple[TerminalServer, list[str]]]:
    """A terminal server before two virtual stations, and their families."""
    families = list(request.param)
    names = [f"{family}-{number}" for number, family in enumerate(families, 1)]
    line = tmp_path / "sim.toml"
    stations = zip(names, names, families, strict=True)
    line.write_text(line_text(*stations))
    with SimProcess(line, tmp_path / "ports", tcp="127.0.0.1:0") as served:
        urls = [station.url for station in load_line(served.line_path).stations]
        targets = [("127.0.0.1", int(url.rpartition(":")[2])) for url in urls]
        server = TerminalServer(targets)
        stations = zip(names, server.urls, families, strict=True)
        (tmp_path / "line.toml").write_text(line_text(*stations))
        yield server, families
        server.end()


def started(folder: Path, seconds: int) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "jbclog", "run", RECIPE, "--line", folder / "line.toml"]
    command += ["--out", folder / "runs", "--duration", f"{seconds}s"]
    return subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def run_folder(folder: Path) -> Path:
    (run,) = (folder / "runs").iterdir()
    return run


def test_swapped_before_the_start(tmp_path: Path, bench: tuple[TerminalServer, list[str]]) -> None:
    server, families = bench
    server.swap()
    _, notes = started(tmp_path, 2).communicate(timeout=120)
    if families[0] == families[1]:
        assert "look swapped" not in notes
        return
    last = [line for line in notes.splitlines() if line.startswith("exit 3: ")]
    assert len(last) == 2
    assert all("the cables of dde-1 and ucr-2 look swapped" in line for line in last)
    events = open_run(run_folder(tmp_path)).events()
    refused = events[events["kind"] == "station.refused"]["text"]
    assert not any("model = " in text.partition("; ")[0] for text in refused)


def test_swapped_in_mid_run(tmp_path: Path, bench: tuple[TerminalServer, list[str]]) -> None:
    server, families = bench
    running = started(tmp_path, 8)
    assert until(lambda: any(map(names_of_open_run, tmp_path.glob("runs/*"))))
    time.sleep(3.0)
    server.swap()
    _, notes = running.communicate(timeout=120)
    events = open_run(run_folder(tmp_path)).events()
    kinds = list(events["kind"])
    if families[0] != families[1]:
        assert kinds.count("identity.swapped") == 2
        ends = [line for line in notes.splitlines() if line.startswith("exit ")]
        assert sum("the cables of dde-1 and ucr-2 look swapped" in line for line in ends) == 2
        assert "not reachable" not in notes
        return
    # twins answer alike: the run goes on, and says what it cannot know
    assert kinds.count("link.back") == 2
    doubts = events[events["kind"] == "identity.not_known"]["text"]
    assert sorted(doubts.str.extract(r"tells it from (dde-\d)")[0]) == ["dde-1", "dde-2"]
    back = events[events["kind"] == "link.back"]["text"].iloc[0]
    assert "model, software version and plugged hours as before" in back
