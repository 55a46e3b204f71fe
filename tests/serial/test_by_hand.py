"""`jbclog read` and `jbclog write` on real pseudo-terminals, beside a real run."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from jbclog.sim.process import SimProcess
from support.command import RECIPE, WireLog, is_sampling, jbclog, started, until
from support.invoked import invoked

Bench = tuple[Path, WireLog]
OUTAGE = "[[station.sim.fault]]\nkind = 'dropout'\nat_s = 8\nfor_s = 3600\n"


def test_a_value_is_read_and_written(bench: Bench) -> None:
    line, wire = bench
    assert (
        jbclog("read", "dde-1", "selected_temperature", "--port", "2", "--line", line).stdout
        == "350 °C\n"
    )
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
    run = started("run", RECIPE, "--line", line, "--out", out, "-d", "60s", "-s", "ucr-1")
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
    finally:
        run.terminate()
        _, notes = run.communicate(timeout=200)
    assert run.returncode == 143, notes
    assert "WRST00000" not in wire.writes("ucr-1")
    # it was only held meanwhile
    assert invoked("read", "ucr-1", "model", "--line", line).exit_code == 0


@pytest.fixture
def leaving(tmp_path: Path) -> Iterator[Path]:
    """A station that is unplugged eight seconds after its first question, and stays so; the line
    file for a run.
    """
    source = tmp_path / "source.toml"
    source.write_text(
        '[line]\nname = "l"\n[[station]]\nname = "ucr-1"\nurl = "ucr-1"\nfamily ='
        f' "ucr"\n[station.sim]\n{OUTAGE}'
    )
    with SimProcess(source, tmp_path / "bench") as stations:
        yield stations.line_path


def test_a_run_holds_its_station_while_the_cable_is_out_too(leaving: Path, tmp_path: Path) -> None:
    out = tmp_path / "runs"
    run = started("run", RECIPE, "--line", leaving, "--out", out, "-d", "60s")
    try:
        assert until(lambda: is_sampling(out))
        # the port is gone, and the run waits for it
        assert until(lambda: not (leaving.parent / "ucr-1").exists())
        ended = invoked("write", "ucr-1", "status", "stand", "--line", leaving)
        assert (ended.exit_code, "holds this station; nothing was sent" in ended.stderr) == (
            3,
            True,
        )
    finally:
        run.terminate()
        run.communicate(timeout=200)
    ended = invoked("write", "ucr-1", "status", "stand", "--line", leaving)
    assert (ended.exit_code, "no such port; check that it is plugged in" in ended.stderr) == (
        3,
        True,
    )
