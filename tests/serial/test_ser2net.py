"""Whole runs through ser2net, an independent program: its server is killed during the run and
started again.

`ign_set_control` is an option of pyserial: a pseudo-terminal has no control lines, so the server
does not confirm them.
"""

from __future__ import annotations

import json
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pandas as pd
import pytest

from support.campaigns.awaited import MADE_SAFE_BY_GUARD
from support.command import RECIPE, WireLog, is_sampling, jbclog, only_run, started, until
from support.product import SimProcess, check_run, open_run

pytestmark = pytest.mark.skipif(shutil.which("ser2net") is None, reason="ser2net is not installed")

ACCEPTERS = {"socket": "tcp,127.0.0.1,{port}", "rfc2217": "telnet(rfc2217),tcp,127.0.0.1,{port}"}
LISTENING = "0A"  # in /proc/net/tcp
OUTAGE_S = 1.5
WORK = "WPS100000"
STATION = """
[line]
name = "networked"

[[station]]
name = "ucr-1"
url = "{url}"
family = "ucr"

[station.sim]
model = "UCR245"
tool = 9
"""


class Ser2net:
    """A server with one port for `device`; it can be killed and started repeatedly."""

    def __init__(self, folder: Path, scheme: str, device: Path) -> None:
        with socket.create_server(("127.0.0.1", 0)) as probe:
            port = probe.getsockname()[1]
        self.url = f"{scheme}://127.0.0.1:{port}" + (
            "?ign_set_control" if scheme == "rfc2217" else ""
        )
        self._configuration = folder / "ser2net.yaml"
        self._configuration.write_text(
            f"connection: &con\n  accepter: {ACCEPTERS[scheme].format(port=port)}\n  connector:"
            f" serialdev,{device},19200n81,local\n"
        )
        self.port = port
        self._running: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        command = ["ser2net", "-d", "-u", "-c", self._configuration]
        self._running = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        assert until(self._listens)

    def kill(self) -> None:
        if self._running is not None:
            self._running.send_signal(signal.SIGKILL)
            self._running.wait()
            self._running = None

    def _listens(self) -> bool:
        """Ask the system: a test connection would be the one client that the server accepts."""
        rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
        return any(
            int(row[1].split(":")[1], 16) == self.port and row[3] == LISTENING for row in rows
        )


@pytest.fixture(params=ACCEPTERS)
def networked(
    request: pytest.FixtureRequest, tmp_path: Path
) -> Iterator[tuple[Path, Ser2net, WireLog]]:
    """A virtual station on a pseudo-terminal behind ser2net, and a line file with its URL."""
    served, log = tmp_path / "served.toml", tmp_path / "wire.jsonl"
    served.write_text(STATION.format(url="ucr-1"))
    with SimProcess(served, tmp_path / "bench", log=log):
        server = Ser2net(tmp_path, request.param, tmp_path / "bench" / "ucr-1")
        server.start()
        line = tmp_path / "line.toml"
        line.write_text(STATION.format(url=server.url))
        try:
            yield line, server, WireLog(log)
        finally:
            server.kill()


def plain_recipe(folder: Path) -> Path:
    """Write the recipe without its acceptance limits, so that an outage does not change the
    verdict.
    """
    recipe = folder / "plain.toml"
    recipe.write_text(RECIPE.read_text().split("[acceptance]")[0])
    return recipe


def expect(run: subprocess.Popen[str], true: Callable[[], bool]) -> None:
    """Wait until `true`; on a time-out, fail with the output of the run."""
    if not until(true):
        run.kill()
        pytest.fail("\n".join(run.communicate(timeout=20)))


def test_a_run_outlives_its_server(
    networked: tuple[Path, Ser2net, WireLog], tmp_path: Path
) -> None:
    line, server, wire = networked
    runs = tmp_path / "runs"
    run = started("run", plain_recipe(tmp_path), "--line", line, "--out", runs, "--rate", "2")
    try:
        expect(run, lambda: is_sampling(runs))
        heated = wire.writes("ucr-1").count(WORK)
        server.kill()
        time.sleep(OUTAGE_S)
        server.start()
        expect(run, lambda: rows_after_outage(only_run(runs)) > 5)
        run.send_signal(signal.SIGINT)
        told, notes = run.communicate(timeout=200)
    finally:
        run.kill()
    assert run.returncode == 0, notes
    assert "Traceback" not in notes
    folder = Path(told.splitlines()[-1])
    assert check_run(folder) == []
    manifest = json.loads((folder / "manifest.json").read_text())
    (station,) = manifest["stations"]
    assert (station["outcome"], station["model"]) == ("completed", "UCR245")
    assert station["safe_state"] == {"1": "verified"}
    assert_rows_tell_the_outage(folder, station["outages"])
    assert wire.writes("ucr-1")[-1] == "WPS100001"
    assert wire.writes("ucr-1").count(WORK) == heated, "it was heated again after the outage"


def rows_after_outage(folder: Path) -> int:
    """Return the number of rows that an open run has after its station came back."""
    run = open_run(folder)
    events = run.events()
    back = events.loc[events["kind"] == "link.back", "time"]
    return int((run.samples(columns=["time"])["time"] > back.max()).sum()) if len(back) else 0


def assert_rows_tell_the_outage(folder: Path, outages: int) -> None:
    """There are rows before the outage, rows without values during it, and rows after it, on one
    grid without gaps, and its two events. On a busy computer the station may be lost once more, and
    the run may end before it is back again.
    """
    samples, events = pd.read_parquet(folder / "samples"), pd.read_parquet(folder / "events")
    assert (samples["tick"].diff().dropna() == 1).all()
    away = samples["quality"] == "disconnected"
    lost, back = (events.loc[events["kind"] == f"link.{it}", "time"] for it in ("lost", "back"))
    assert len(lost) == outages >= 1
    assert 1 <= len(back) >= outages - 1
    is_away_at_end = len(back) < outages
    ends = [*back, *events["time"].tail(1)][:outages]
    between = pd.Series(data=False, index=samples.index)
    for begin, end in zip(lost, ends, strict=True):
        assert begin < end
        between |= samples["time"].between(begin, end, inclusive="neither")
    assert away[between].all()
    assert away.sum() <= between.sum() + 2 * outages  # the tick in which it went, and came back
    # the tick in which it went may have been read
    assert samples.loc[away, "temperature_c"].isna().sum() >= away.sum() - outages
    assert not away.iloc[0]
    assert is_away_at_end or not away.iloc[-1]
    # before, away, after; one that is shorter than a tick may have no row
    assert 3 <= away.ne(away.shift()).cumsum().max() <= 1 + 2 * outages


def test_a_server_that_serves_somebody_else_is_told_without_a_traceback(
    networked: tuple[Path, Ser2net, WireLog], tmp_path: Path
) -> None:
    line, server, wire = networked
    with socket.create_connection(("127.0.0.1", server.port), timeout=5):
        ended = jbclog(
            "run", plain_recipe(tmp_path), "--line", line, "--out", tmp_path / "runs", "-d", "2s"
        )
    assert ended.returncode == 3
    assert "ucr-1: " in ended.stderr
    assert "Traceback" not in ended.stderr
    assert wire.writes("ucr-1") == []


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_guard_gets_through_the_server_too(
    networked: tuple[Path, Ser2net, WireLog], tmp_path: Path, number: signal.Signals
) -> None:
    line, _, wire = networked
    runs = tmp_path / "runs"
    run = started("run", plain_recipe(tmp_path), "--line", line, "--out", runs, "--rate", "2")
    try:
        expect(run, lambda: WORK in wire.writes("ucr-1"))
        run.send_signal(number)
        assert until(lambda: wire.writes("ucr-1")[-1] == "WPS100001")
        _, notes = run.communicate(timeout=200)
    finally:
        run.kill()
    assert "jbclog guard: ucr-1 port 1: the tool was " in notes
    # in a later round, where the computer stood still in the first
    actions = only_run(runs) / "guard.jsonl"
    assert until(lambda: f"{MADE_SAFE_BY_GUARD}, as read back: stand" in actions.read_text())
