"""Recorder and guard both gone, or a full disk: tools left hot are reported, found again, and
reported once more when they are safe at last.

Assertions use what the virtual stations received, and the records of all runs involved.
"""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pandas as pd
import pytest

from support.campaigns.awaited import LEFT_HOT_NOTED
from support.command import jbclog, until
from support.faults.guarded import (
    TOOLS,
    Blow,
    ended,
    events,
    guard_that_is_there,
    only_run,
    running,
    told_after,
)
from support.faults.small_disk import small_disk
from support.product import (
    LEASES_FILE,
    RECORDED_ACTION_LOG,
    StationLease,
    check_run,
    open_run,
    read_annotations,
    read_leases,
    read_manifest,
    registered_runs,
    settle_leases,
    write_leases,
)
from support.virtual.served_line import ServedLine

pytestmark = pytest.mark.usefixtures("own_state")
HOT_C = 300


@pytest.fixture
def line(tmp_path: Path) -> Iterator[ServedLine]:
    (tmp_path / "line").mkdir()
    with ServedLine(tmp_path / "line") as served:
        served.cool_soon()
        yield served


@pytest.fixture
def left_hot(line: ServedLine, tmp_path: Path) -> Path:
    """The folder of a run whose recorder and guard were both killed: all tools are at work."""
    with running(line, tmp_path / "runs") as run:
        folder = only_run(tmp_path / "runs")
        assert until(
            lambda: (
                len(read_leases(folder)) == 4 and all(lease.ports for lease in read_leases(folder))
            )
        )
        assert until(lambda: was_read(folder) == TOOLS)
        os.kill(run.pid, signal.SIGSTOP)
        os.kill(guard_that_is_there(run.pid), signal.SIGKILL)
        run.kill()
        ended(run)
    assert line.at_work() == TOOLS, "somebody has saved them already"
    return folder


def was_read(folder: Path) -> int:
    """Return the number of tools with a temperature in the stored rows of a run in progress."""
    samples = open_run(folder).samples().dropna(subset="temperature_c")
    return int((samples.groupby(["station", "port"])["temperature_c"].max() >= HOT_C).sum())


def annotated(folder: Path) -> list[tuple[str, str]]:
    """Return author and kind of each annotation of a sealed run."""
    return sorted({(said.who, said.kind) for said in read_annotations(folder).said})


def test_it_is_in_its_own_record_and_made_safe_at_the_next_start_whatever_its_folder(
    line: ServedLine, left_hot: Path, tmp_path: Path
) -> None:
    assert jbclog("recover", left_hot.parent).returncode == 5
    told = pd.read_parquet(left_hot / "events").set_index("kind").loc["safety.not_known"]
    assert len(told) == TOOLS + 1  # and the feeder
    tools = told["text"][told["port"].notna()]
    assert all("it may be hot" in text for text in tools)
    assert any("Last read 3" in text and "°C, working at" in text for text in tools)
    assert read_manifest(left_hot).exit_code == 5
    assert check_run(left_hot) == []
    now, out = time.monotonic(), tmp_path / "another"
    again = jbclog(
        "run",
        line.recipe,
        "--line",
        line.path,
        "--out",
        out,
        "-d",
        "1s",
        "-s",
        "dde-1",
        "-s",
        "ale-1",
        "--json",
    )
    first = {(order.station, order.port): order for order in reversed(line.orders(now))}
    assert all(order.is_safe for order in first.values())
    assert first.keys() == {("dde-1", 1), ("dde-1", 2), ("ale-1", 0), ("ale-1", 1)}
    new = Path(json.loads(again.stdout)["folder"])
    left = pd.read_parquet(new / "events").set_index("kind").loc["guard.left_over"]
    assert (
        left["text"]
        == f"Run {left_hot.name} ended without making the tools of ale-1, dde-1 safe; every tool is"
        " in its safe state now."
    )
    # on ports that this run did not use
    assert {lease.name for lease in read_leases(left_hot)} == {"dde-2", "ucr-1"}
    assert annotated(left_hot) == [
        ("jbclog run", "guard.left_over"),
        ("jbclog run", "safety.safe_state"),
    ]
    assert check_run(left_hot) == []  # the sealed run is unchanged


@pytest.mark.campaign
def test_safe_closes_what_was_left_and_tells_it(line: ServedLine, left_hot: Path) -> None:
    assert jbclog("recover", left_hot).returncode == 5
    done = jbclog("safe", "--line", line.path)
    assert done.returncode == 0, done.stderr
    assert line.at_work() == 0
    assert f"run {left_hot} {LEFT_HOT_NOTED}" in done.stderr
    assert not (left_hot / LEASES_FILE).exists()
    assert registered_runs() == ([], [])
    assert annotated(left_hot) == [
        ("jbclog safe", "guard.left_over"),
        ("jbclog safe", "safety.safe_state"),
    ]
    assert len(read_annotations(left_hot).said) == TOOLS + 1
    assert check_run(left_hot) == []
    assert jbclog("recover", left_hot).returncode == 0


@pytest.mark.campaign
def test_what_was_made_safe_before_the_record_was_recovered_is_in_its_events(
    line: ServedLine, left_hot: Path
) -> None:
    assert jbclog("safe", "--line", line.path).returncode == 0
    assert jbclog("recover", left_hot).returncode == 0
    assert events(left_hot).count("safety.safe_state") == TOOLS
    assert "safety.not_known" not in events(left_hot)
    assert {
        state for facts in read_manifest(left_hot).stations for state in facts.safe_state.values()
    } == {"verified"}


# -- a disk that is not mounted --------------------------------------------------------------------


def test_a_run_on_a_disk_that_is_not_mounted_is_named(tmp_path: Path) -> None:
    lease = StationLease(
        "dde-1", "/dev/ttyX", 19200, "8N1", 1, "dde", "DDE", "1.0", "stand", (1,), False
    )
    with small_disk(tmp_path / "disk", "1m") as disk:
        folder = disk / "run"
        folder.mkdir()
        write_leases(folder, [lease])
        assert registered_runs() == ([folder], [])
    assert (tmp_path / "disk").is_dir()
    ((away, why),) = registered_runs().away
    assert (away, "is not there, and its disk may not be mounted" in why) == (folder, True)
    (left,) = settle_leases(tmp_path, ["/dev/ttyX"], lambda _: False)
    assert not left.is_safe
    assert "whether run run left tools hot is not known" in left.text


# -- a full disk -----------------------------------------------------------------------------------


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    with small_disk(tmp_path / "disk", "48m") as place:
        yield place


def filled(disk: Path) -> Path:
    """A file that leaves no byte free."""
    ballast = disk / "ballast"
    with ballast.open("wb", buffering=0) as file:
        for size in (1 << 20, 4096):
            with suppress(OSError):  # no space for another one
                while True:
                    file.write(b"x" * size)
    return ballast


@pytest.mark.campaign
@pytest.mark.timeout(900)
@pytest.mark.parametrize("trials", [10])
def test_what_was_done_is_written_down_although_the_disk_is_full(
    line: ServedLine, disk: Path, trials: int, counted: Callable[..., None]
) -> None:
    for trial in range(trials):
        out, began = disk / str(trial), time.monotonic()
        with running(line, out) as run:
            folder = only_run(out)
            ballast = filled(disk)
            blow = Blow.strike(run, signal.SIGKILL)
            ended(run)
        assert told_after(line, began, blow) > 0
        assert (folder / RECORDED_ACTION_LOG).read_text().count("safety.safe_state") == TOOLS
        ballast.unlink()
        assert jbclog("recover", folder).returncode == 0
        assert events(folder).count("safety.safe_state") == TOOLS
        assert "guard.took_over" in events(folder)
        assert check_run(folder) == []
    counted(deaths_on_a_full_disk=trials, take_overs_untold=0, tools_left_hot=0)
