"""Ports that are flooded from the start, or when a recorder dies: each command reports it in time,
and safe orders are sent.

By default one command is tried; ``pytest -n0 -m campaign tests/serial/test_flooded.py`` tries all.
"""

from __future__ import annotations

import json
import re
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pytest

from support.campaigns.awaited import (
    ITS_LINK_FLOODED,
    LINK_FLOODED,
    MADE_SAFE_BY_GUARD,
    NOT_CONFIRMED_TO_GUARD,
)
from support.command import WireLog, jbclog, started, until
from support.links.flooders import Flooded, Flooders
from support.product import SimProcess, bytes_of_capture, reproduction
from support.virtual.lines import line
from support.virtual.virtual_run import RECIPE

FOR_EVER = 1e6
MOST_MB = 400


@dataclass(frozen=True)
class Bench:
    """A served line of two stations, the first of them flooded."""

    line: Path
    recipe: Path
    url: str
    wire: WireLog


@contextmanager
def bench(
    folder: Path, transport: str, shape: str, after: str = "", begin_s: float = 0.0
) -> Iterator[Bench]:
    (folder / "source.toml").write_text(line("", ""))
    (folder / "recipe.toml").write_text(RECIPE + 'on_difference = "continue"\n')
    log = folder / "wire.jsonl"
    with SimProcess(folder / "source.toml", folder / "sim", log=log) as sim:
        near = str(folder / "near") if transport == "pty" else ""
        plan = Flooded(
            near, str(folder / "sim" / "dde-1"), shape, 0.0, begin_s, FOR_EVER, after=after
        )
        with Flooders(folder / "flooders.json", [plan]) as served:
            text = re.sub(
                r'(name = "dde-1"\n(?:.*\n)*?url = )".*?"',
                rf'\1"{served.urls[0]}"',
                sim.line_path.read_text(),
            )
            flooded = folder / "sim" / "flooded.toml"
            flooded.write_text(text)
            yield Bench(flooded, folder / "recipe.toml", served.urls[0], WireLog(log))


def told(wire: WireLog, station: str) -> set[str]:
    return {text for text in wire.writes(station) if text.startswith("WPS")}


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("transport", "shape"),
    [("tcp", "noise"), ("tcp", "another model's answers"), ("pty", "copies of an answer")],
)
def test_what_is_flooded_from_the_start_is_said_to_be_so(
    transport: str, shape: str, tmp_path: Path
) -> None:
    with bench(tmp_path, transport, shape) as made:
        began = time.monotonic()
        scanned = jbclog("scan", made.url)
        assert LINK_FLOODED in scanned.stdout + scanned.stderr
        assert scanned.returncode != 0
        examined = jbclog("doctor", "--line", made.line)
        assert "dde-1" in examined.stdout
        assert LINK_FLOODED in examined.stdout
        assert examined.returncode == 1
        run = jbclog(
            "run", made.recipe, "--line", made.line, "--out", tmp_path / "runs", "-d", "5s"
        )
        assert run.returncode == 3
        assert f"dde-1: {LINK_FLOODED}" in run.stderr
        read = jbclog("read", "dde-1", "tip_temperature", "--line", made.line)
        assert read.returncode == 3
        assert LINK_FLOODED in read.stderr
        assert made.wire.writes("dde-1") == []
        assert time.monotonic() - began < 60  # five starts of Python, on a busy machine
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024 < MOST_MB


def test_safe_tells_a_flooded_station_and_does_not_call_it_safe(tmp_path: Path) -> None:
    with bench(tmp_path, "pty", "copies of the safe state") as made:
        ended = jbclog("safe", "--line", made.line, "--json")
        assert told(made.wire, "dde-1") == {"WPS100001", "WPS200001"}
        assert ended.returncode == 5
        flooded, other = json.loads(ended.stdout)["stations"]
        assert [tool["state"] for tool in flooded["tools"]] == [None, None]
        assert all("its link is flooded" in tool["problem"] for tool in flooded["tools"]), flooded
        assert {tool["state"] for tool in other["tools"]} <= {
            "stand",
            "sleep",
            "hibernation",
            "extractor",
        }


@pytest.mark.campaign
def test_a_guard_tells_a_flooded_station_and_the_others_in_time(tmp_path: Path) -> None:
    with bench(tmp_path, "tcp", "all answers in turn", after="WPS2", begin_s=1.0) as made:
        run = started(
            "run", made.recipe, "--line", made.line, "--out", tmp_path / "runs", "--rate", "5"
        )
        try:
            assert until(lambda: "WPS200000" in told(made.wire, "dde-2"), 20)
            time.sleep(2.5)  # it is flooded by now
            run.kill()
            killed = time.monotonic()
            assert until(lambda: told(made.wire, "dde-2") >= {"WPS100001", "WPS200001"}, 10)
            assert time.monotonic() - killed < 5
            assert until(lambda: told(made.wire, "dde-1") >= {"WPS100001", "WPS200001"}, 10)
            assert time.monotonic() - killed < 8
        finally:
            run.kill()
    _, said = run.communicate(timeout=60)
    assert f"dde-2 port 1: the tool {MADE_SAFE_BY_GUARD}" in said
    assert f"dde-1 port 1: the tool {NOT_CONFIRMED_TO_GUARD} {ITS_LINK_FLOODED}" in said


@pytest.mark.campaign
def test_the_capture_of_a_flood_is_bounded_and_lived_through_again(tmp_path: Path) -> None:
    with bench(tmp_path, "tcp", "noise", after="WPS2", begin_s=1.0) as made:
        run = jbclog(
            "run",
            made.recipe,
            "--line",
            made.line,
            "--out",
            tmp_path / "runs",
            "-d",
            "6s",
            "--rate",
            "5",
            "--capture",
        )
    folder = Path(run.stdout.splitlines()[-1])
    assert 0 < bytes_of_capture(folder, "dde-1") < 300_000
    events = pd.read_parquet(folder / "events")
    assert (events["kind"] == "link.flooded").sum() == 1
    again = jbclog(*reproduction(folder, tmp_path / "again"))
    assert again.returncode == 0, again.stderr
