"""`jbclog read` and `jbclog write` on real pseudo-terminals, beside a real run."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.command import RECIPE, WireLog, expect_terminated, is_sampling, started, until
from support.invoked import invoked
from support.product import SimProcess

pytestmark = pytest.mark.usefixtures("patient")

Bench = tuple[Path, WireLog]


def test_a_value_is_read_and_written(bench: Bench) -> None:
    line, wire = bench
    read = ("read", "dde-1", "selected_temperature", "--port", "2", "--line", line)
    assert invoked(*read).stdout == "350 °C\n"
    ended = invoked("write", "dde-1", "selected_temperature", "300", "--port", "2", "--line", line)
    assert (ended.exit_code, ended.stdout) == (
        0,
        "selected_temperature of port 2: 300 °C, confirmed (350 °C before)\n",
    )
    assert (
        json.loads(
            invoked(
                "read", "dde-1", "selected_temperature", "-p", "2", "--json", "--line", line
            ).stdout
        )["value"]
        == 300
    )
    assert wire.writes("dde-1") == ["WST200300"]


def test_while_a_run_holds_the_station_it_is_refused_and_the_run_named(
    bench: Bench, tmp_path: Path
) -> None:
    line, wire = bench
    out = tmp_path / "runs"
    run = started("run", RECIPE, "--line", line, "--out", out, "-d", "600s", "-s", "ucr-1")
    try:
        assert until(lambda: is_sampling(out))
        (folder,) = out.iterdir()
        write = ("write", "ucr-1", "status", "stand", "--line", line)
        dangerous = ("write", "ucr-1", "restart", "--yes-i-mean", "ucr-1", "--line", line)
        for words in (("read", "ucr-1", "model", "--line", line), write, dangerous):
            ended = invoked(*words)
            assert ended.exit_code == 3
            assert f"runs/{folder.name} holds this station; nothing was sent" in ended.stderr
        # the run has nothing to do with it
        assert invoked("read", "ale-1", "model", "--line", line).stdout == "ALE\n"
        expect_terminated(run)
    finally:
        run.kill()
        run.communicate(timeout=200)
    assert "WRST00000" not in wire.writes("ucr-1")
    # it was only held meanwhile
    assert invoked("read", "ucr-1", "model", "--line", line).exit_code == 0


@pytest.fixture
def one_station(tmp_path: Path) -> Iterator[SimProcess]:
    source = tmp_path / "source.toml"
    source.write_text(
        '[line]\nname = "l"\n[[station]]\nname = "ucr-1"\nurl = "ucr-1"\nfamily = "ucr"\n'
    )
    with SimProcess(source, tmp_path / "bench") as stations:
        yield stations


def test_a_run_holds_its_station_while_the_cable_is_out_too(
    one_station: SimProcess, tmp_path: Path
) -> None:
    out, line, adapter = tmp_path / "runs", one_station.line_path, tmp_path / "bench" / "ucr-1"
    run = started("run", RECIPE, "--line", line, "--out", out, "-d", "600s")
    try:
        assert until(lambda: is_sampling(out))
        adapter.unlink()  # the name of a pulled adapter is gone, and its open port is dead
        assert one_station.pid is not None
        os.kill(one_station.pid, signal.SIGKILL)
        ended = invoked("write", "ucr-1", "status", "stand", "--line", line)
        assert (ended.exit_code, "holds this station; nothing was sent" in ended.stderr) == (
            3,
            True,
        )
    finally:
        run.terminate()
        run.communicate(timeout=200)
    ended = invoked("write", "ucr-1", "status", "stand", "--line", line)
    assert (ended.exit_code, "no such port; check that it is plugged in" in ended.stderr) == (
        3,
        True,
    )
