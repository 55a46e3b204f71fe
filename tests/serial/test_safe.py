"""`jbclog safe` on real pseudo-terminals: without a run, beside a run that responds, beside a run
that hangs, and with a port that another program has.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.command import is_sampling, jbclog, until
from support.faults.guarded import only_run, running
from support.invoked import invoked
from support.product import (
    SECURE_ALLOWED_S,
    SIM_HIBERNATION,
    SIM_WORKING,
    STAND,
    LineFormat,
    check_run,
    open_port,
    patch,
    read_manifest,
)
from support.readers.unit_file import command
from support.virtual.served_line import FOUR_TOOLS, Order, ServedLine

TOOLS = 6


@pytest.fixture
def line(tmp_path: Path) -> Iterator[ServedLine]:
    (tmp_path / "line").mkdir()
    with ServedLine(tmp_path / "line") as served:
        served.cool_soon()
        yield served


def put_to_work(line: ServedLine) -> None:
    for port in line.tools():
        port.order(SIM_WORKING, False)
    line.stations["ale-1"].plant.feeder.settings.feeder_mode = "continuous"
    line.stations["ale-1"].plant.feeder.start(time.monotonic())


def told(line: ServedLine, since: float) -> list[Order]:
    """Return the orders to the stations; all of them are safe."""
    orders = line.orders(since)
    assert [order for order in orders if not order.is_safe] == []
    return orders


@pytest.mark.usefixtures("unhurried")
def test_without_a_run_all_stations_at_once(line: ServedLine) -> None:
    put_to_work(line)
    asleep = line.stations["dde-2"].plant.ports[1]
    asleep.order(SIM_HIBERNATION, False)
    now = time.monotonic()
    ended = invoked("safe", "--line", line.path)
    assert (ended.exit_code, ended.stderr) == (0, "")
    assert len(ended.stdout.splitlines()) == TOOLS + 1
    assert "ale-1: feeder stopped" in ended.stdout
    places = {(order.station, order.port) for order in told(line, now)}
    assert places == {
        ("dde-1", 1),
        ("dde-1", 2),
        ("dde-2", 2),
        ("ucr-1", 1),
        ("ale-1", 0),
        ("ale-1", 1),
    }
    assert (line.at_work(), line.motor("ale-1"), asleep.doing.state) == (0, False, SIM_HIBERNATION)
    assert (
        max(order.at for order in told(line, now)) - min(order.at for order in told(line, now)) < 10
    )


def test_four_tools_that_heat_on_in_their_extractor_state_are_told_to_stand(tmp_path: Path) -> None:
    """The second tool cools and gets no order. On a busy machine its cooling may not show within
    the second that is allowed, and it gets the order as well; or the three seconds of a station end
    before everything is read back. Then the line is tried again.
    """
    for attempt in range(5):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        stood = ports_told_to_stand(folder)
        assert stood is None or stood >= {1, 3, 4}
        if stood == {1, 3, 4}:
            return
    pytest.fail("a tool that cools was told to stand, or one was not confirmed, each time")


def ports_told_to_stand(folder: Path) -> set[int] | None:
    """Return the ports with an order; None if a tool did not confirm in time and `safe` reported
    it.
    """
    with ServedLine(folder, FOUR_TOOLS) as line:
        tools = line.tools()
        for port in tools:
            port.tools[port.tool].sleep_delay, port.tools[port.tool].hibernation_delay = 5, 30
            port.order(SIM_WORKING, True)
        tools[1].character.extractor_cools = True
        tools[1].changed()
        before = time.monotonic()
        jbclog("safe", "--help")
        now = time.monotonic()
        ended = jbclog("safe", "--line", line.path)
        orders = line.orders(now)
    if ended.returncode == 5:
        assert "does not confirm it; it may be hot: switch the station off" in ended.stderr
        return None
    assert ended.returncode == 0, ended.stderr
    assert {order.value for order in orders} == {STAND}
    start_s = now - before  # of a process, on a machine that may be busy
    assert orders[-1].at - now < 2 * SECURE_ALLOWED_S + 2 * start_s
    ports = {order.port for order in orders}
    assert len(orders) < 2 * len(ports)  # one is repeated if its answer comes late
    return ports


@contextmanager
def sampling(line: ServedLine, out: Path, *more: str) -> Iterator[subprocess.Popen[str]]:
    """A run that has started sampling, and writes nothing more before its end."""
    with running(line, out, *more) as run:
        assert until(lambda: is_sampling(out))
        yield run


@pytest.mark.usefixtures("unhurried")
def test_a_run_that_holds_the_line_is_asked_to_end_and_its_record_is_whole(
    line: ServedLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch(monkeypatch, "safe_state.TERM_S", 60.0)  # it hangs no longer on a busy machine
    with sampling(line, tmp_path / "runs") as run:
        now = time.monotonic()
        ended = invoked("safe", "--line", line.path, "--json")
        run.communicate(timeout=200)
    facts, folder = json.loads(ended.stdout), only_run(tmp_path / "runs")
    assert ended.exit_code == 0, ended.stderr
    assert facts["runs"] == [{"run": folder.name, "folder": str(folder), "how": "asked"}]
    assert f"the run {folder} holds this line; it is ended with SIGTERM" in ended.stderr
    # the run had done it
    assert {tool["rested"] for station in facts["stations"] for tool in station["tools"]} == {True}
    assert told(line, now)
    assert line.at_work() == 0
    assert (read_manifest(folder).exit_status, check_run(folder)) == ("success", [])


@pytest.mark.parametrize("guard", [True, False], ids=["guarded", "alone"])
def test_a_run_that_hangs_is_ended(line: ServedLine, tmp_path: Path, guard: bool) -> None:
    with sampling(line, tmp_path / "runs", *([] if guard else ["--no-guard"])) as run:
        os.kill(run.pid, signal.SIGSTOP)
        now = time.monotonic()
        ended = jbclog("safe", "--line", line.path, "--json")
        assert run.wait(200) == -signal.SIGKILL
    facts = json.loads(ended.stdout)
    assert ended.returncode == 0, ended.stderr
    ends = [run["how"] for run in facts["runs"]]
    # a guard is faster, where it gets the processor
    assert ends in ([["asked"], ["killed"], []] if guard else [["killed"]])
    if not guard:  # which else makes them safe, before or meanwhile
        assert not any(tool["rested"] for station in facts["stations"] for tool in station["tools"])
    assert {order.at - now < 30 for order in told(line, now)} == {True}
    assert (line.at_work(), line.motor("ale-1")) == (0, False)


def test_the_service_does_it_when_its_run_was_killed_without_a_guard(
    line: ServedLine, tmp_path: Path
) -> None:
    with running(line, tmp_path / "runs", "--no-guard") as run:
        run.kill()
        run.communicate(timeout=200)
        assert line.at_work() == TOOLS
        _, *words = command("ExecStopPost")
        ended = jbclog(*(str(line.path) if "%i" in word else word for word in words))
    assert ended.returncode == 0, ended.stderr
    assert (line.at_work(), line.motor("ale-1")) == (0, False)


@pytest.mark.usefixtures("unhurried")
def test_a_port_in_foreign_hands_keeps_nobody_else_from_being_safe(
    line: ServedLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch(monkeypatch, "safe_state.CONNECT_S", 0.5)
    put_to_work(line)
    foreign = open_port(line.url("ucr-1"), LineFormat())
    try:
        ended = invoked("safe", "--line", line.path)
    finally:
        foreign.close()
    assert ended.exit_code == 5
    assert "ucr-1: NOT SAFE" in ended.stdout
    assert "is in use by" in ended.stderr
    assert "its tools may be hot: switch the station off" in ended.stderr
    assert line.at_work() == 1


@pytest.mark.usefixtures("unhurried")
@pytest.mark.parametrize("cools", [True, False])
def test_waiting_on_real_ports(
    line: ServedLine, monkeypatch: pytest.MonkeyPatch, cools: bool
) -> None:
    """Six tools with their heaters off cool down from 340 °C; one that is at work stays hot and is
    named.
    """
    patch(monkeypatch, "safe_state.COLD_EVERY_S", 0.3)
    patch(monkeypatch, "safe_state.COLD_WITHIN_S", 60.0 if cools else 2.0)
    for port in line.tools():
        port.order(SIM_HIBERNATION, False)
    if not cools:
        line.tools()[0].order(SIM_WORKING, False)
    ended = invoked("safe", "--line", line.path, "--wait", "--below", "310")
    assert ended.exit_code == (0 if cools else 1), ended.stderr
    if cools:
        assert ended.stdout.count("below 310 °C after") == TOOLS
        assert max(port.temperature() for port in line.tools()) < 310
    else:
        assert "error: dde-1 port 1: 3" in ended.stderr
        assert "not known to be below 310 °C after" in ended.stderr
