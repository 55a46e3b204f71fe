"""A recorder is killed or frozen while a station hears and its answers are lost: the guard orders
what was proven, tells the truth about it, and orders nothing else.

Assertions use what the virtual stations took and their physics.
"""

from __future__ import annotations

import json
import os
import pty
import random
import re
import signal
import subprocess
import time
import tty
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import pytest

from support.command import is_sampling, jbclog, recipe_text, started, until
from support.faults.guarded import (
    ON_THE_WIRE_S,
    TOLD_S,
    TOOLS,
    Blow,
    actions_in,
    begun,
    ended,
    guard_of,
    only_run,
)
from support.product import (
    ACTION_LOG_FILE,
    EXTRACTOR,
    MOST_ORDERS,
    ORDER_FOR_S,
    PROVEN_FOR_S,
    SIM_HIBERNATION,
    SIM_SLEEP,
    SIM_STAND,
    SIM_WORKING,
    Reply,
    SafetyResult,
    UnsafeError,
    read_manifest,
    recover_run,
)
from support.virtual.served_line import LINE, RECIPE, ServedLine

pytestmark = pytest.mark.usefixtures("own_state")

Loss = Callable[[bytes], bytes]


def all_of_them(_: bytes) -> bytes:
    return b""


def nine_in_ten(data: bytes) -> bytes:
    return bytes(byte for byte in data if random.random() < 0.1)


def garbled(data: bytes) -> bytes:
    """Strike one bit of the data, so that the check byte is wrong."""
    return data[:-3] + bytes([data[-3] ^ 1]) + data[-2:]


def _lossy(
    receive: Callable[[bytes, float], list[Reply]], loss: Loss, data: bytes, now: float
) -> list[Reply]:
    replies = [(reply.at, loss(reply.data)) for reply in receive(data, now)]
    return [Reply(at, data) for at, data in replies if data]


@contextmanager
def lost(line: ServedLine, loss: Loss, *names: str) -> Iterator[None]:
    """Lose answers of these stations, of all if none is named, and keep their questions."""
    stations = [line.stations[name] for name in names or line.stations]
    for station in stations:
        station.receive = partial(_lossy, station.receive, loss)  # type: ignore[method-assign]
    try:
        yield
    finally:
        for station in stations:
            del station.receive  # type: ignore[method-assign]


@pytest.fixture
def line(tmp_path: Path) -> Iterator[ServedLine]:
    (tmp_path / "line").mkdir()
    with ServedLine(tmp_path / "line") as served:
        yield served


def at_work(line: ServedLine, out: Path, tools: int = TOOLS) -> subprocess.Popen[str]:
    """A run whose tools are at work, each status read."""
    run = begun(line, out)
    assert until(lambda: line.at_work() == tools), run.communicate(timeout=5)
    time.sleep(1.5)
    return run


def struck(run: subprocess.Popen[str], number: signal.Signals = signal.SIGKILL) -> tuple[Blow, int]:
    """Strike a recorder; return the guard that it leaves, too."""
    guard = guard_of(run.pid)
    assert guard is not None
    return Blow.strike(run, number), guard


@contextmanager
def ended_guard(guard: int) -> Iterator[None]:
    """End a guard, which would try for ten minutes."""
    try:
        yield
    finally:
        with suppress(ProcessLookupError):
            os.kill(guard, signal.SIGKILL)


def problems(folder: Path) -> dict[str, str]:
    """The last critical sentence about each tool, as in the guard's log."""
    rows = map(json.loads, filter(None, (folder / ACTION_LOG_FILE).read_text().splitlines()))
    return {
        f"{row['station']} port {row['port']}": row["text"]
        for row in rows
        if row["severity"] == "critical" and row["port"] is not None
    }


HOT = "not confirmed; it may be hot: switch the station off."
ORDERED = f"The station does not answer: stand was ordered {MOST_ORDERS} times, {HOT}"


@pytest.mark.parametrize(
    ("loss", "number"),
    [
        (all_of_them, signal.SIGKILL),
        (all_of_them, signal.SIGSTOP),
        (nine_in_ten, signal.SIGKILL),
        (garbled, signal.SIGKILL),
    ],
)
def test_every_tool_is_ordered_to_stand_at_most_three_times_and_none_is_called_safe(
    line: ServedLine, tmp_path: Path, loss: Loss, number: signal.Signals
) -> None:
    run = at_work(line, tmp_path / "runs")
    blow, guard = struck(run, number)
    with ended_guard(guard), lost(line, loss):
        # a robot may start the feeder again before its tool stands: the next order stops it
        assert until(lambda: line.at_work() == 0 and not line.motor("ale-1"), 60.0)
        assert time.monotonic() - blow.at < TOLD_S
        ended(run)
        folder = only_run(tmp_path / "runs")
        assert until(lambda: {*problems(folder).values()} == {ORDERED}, 20.0), problems(folder)
        time.sleep(max(blow.at + ORDER_FOR_S + 2.0 - time.monotonic(), 0.0))
    assert len(problems(folder)) == TOOLS
    orders = [order for order in line.orders(blow.at) if order.at > blow.at + ON_THE_WIRE_S]
    assert [order for order in orders if not order.is_safe] == []
    counts = Counter((order.station, order.port) for order in orders)
    assert {*counts.values()} <= {MOST_ORDERS, MOST_ORDERS - 1}  # the first may come at once
    recovery = recover_run(folder)
    manifest = read_manifest(folder)
    assert not recovery.is_safe
    assert manifest.exit_code == UnsafeError.exit_code
    states = [state for facts in manifest.stations for state in facts.safe_state.values()]
    assert states == [SafetyResult.SENT] * TOOLS
    assert f"stand was ordered {MOST_ORDERS} times, not confirmed" in str(manifest.stations)


@pytest.mark.parametrize(
    "state", [SIM_SLEEP, SIM_HIBERNATION, SIM_STAND], ids=["sleep", "hibernation", "stand"]
)
def test_a_tool_that_rests_is_not_ordered(tmp_path: Path, state: int) -> None:
    """The recipe leaves the tools as they are: all at work but one."""
    (tmp_path / "line").mkdir()
    recipe = RECIPE.replace('status = "working"\n', "").replace("= 350", "= 340")
    with ServedLine(tmp_path / "line", recipe=recipe) as line:
        for port in line.tools():
            port.order(SIM_WORKING, False)
        resting = line.stations["ucr-1"].plant.ports[1]
        resting.order(state, False)
        run = at_work(line, tmp_path / "runs", TOOLS - 1)
        assert until(lambda: is_sampling(tmp_path / "runs"))
        time.sleep(1.5)
        blow, guard = struck(run)
        with ended_guard(guard), lost(line, all_of_them):
            assert until(lambda: line.at_work() == 0, 60.0)
            folder = only_run(tmp_path / "runs")
            assert until(lambda: "ucr-1 port 1" in problems(folder))
            orders = line.orders(blow.at)
        ended(run)
        assert resting.doing.state == state
    assert [order for order in orders if order.station == "ucr-1"] == []
    assert "got no order: it was last read in" in problems(folder)["ucr-1 port 1"]


def test_a_tool_that_rests_is_not_woken_where_all_answer(tmp_path: Path) -> None:
    (tmp_path / "line").mkdir()
    recipe = RECIPE.replace('status = "working"\n', "").replace("= 350", "= 340")
    with ServedLine(tmp_path / "line", recipe=recipe) as line:
        for port in line.tools():
            port.order(SIM_WORKING, False)
        resting = line.stations["dde-1"].plant.ports[1]
        resting.order(SIM_SLEEP, False)
        run = at_work(line, tmp_path / "runs", TOOLS - 1)
        assert until(lambda: is_sampling(tmp_path / "runs"))
        time.sleep(1.5)
        blow, _ = struck(run)
        ended(run)
        assert line.at_work() == 0
        orders = {(order.station, order.port) for order in line.orders(blow.at)}
        assert resting.doing.state == SIM_SLEEP
    assert ("dde-1", 2) in orders
    assert ("dde-1", 1) not in orders


def test_a_station_that_fell_silent_long_before_is_not_ordered(
    line: ServedLine, tmp_path: Path
) -> None:
    """20 s before the kill it is still proven, 32 s before it is not; both are written down."""
    run = at_work(line, tmp_path / "runs")
    with lost(line, all_of_them, "ucr-1"):
        time.sleep(PROVEN_FOR_S - 20.0 + 2.0)
        with lost(line, all_of_them, "dde-1"):
            time.sleep(20.0)
            blow, guard = struck(run)
            with ended_guard(guard):
                assert until(lambda: line.at_work() == 1, 60.0)
                time.sleep(4.0)
                orders = {order.station for order in line.orders(blow.at)}
                folder = only_run(tmp_path / "runs")
                assert until(lambda: "ucr-1 port 1" in problems(folder))
    ended(run)
    assert orders == {"dde-1", "dde-2", "ale-1"}
    told = problems(folder)
    assert "was ordered" in told["dde-1 port 1"]
    assert re.search(
        r"got no order: it last answered 3\d s ago, more than 30 s", told["ucr-1 port 1"]
    )


MIXED = """
[line]
name = "mixed"

[[station]]
name = "jtse-1"
url = "jtse-1"
family = "jtse"
[station.sim]
tool = 1

[[station]]
name = "ucr-1"
url = "ucr-1"
family = "ucr"
[station.sim]
tool = 9
"""


def test_on_a_mixed_line_only_what_heats_nothing_is_sent(tmp_path: Path) -> None:
    (tmp_path / "line").mkdir()
    recipe = recipe_text("only-ucr", "ucr", more="[sampling]\nrate_hz = 5\n")
    with ServedLine(tmp_path / "line", MIXED, recipe) as line:
        run = started(
            "run",
            line.recipe,
            "--line",
            line.path,
            "--out",
            tmp_path / "runs",
            "--station",
            "ucr-1",
        )
        assert until(lambda: line.at_work() == 1), run.communicate(timeout=5)
        time.sleep(1.5)
        blow, guard = struck(run)
        with ended_guard(guard), lost(line, all_of_them):
            assert until(lambda: line.at_work() == 0, 60.0)
            time.sleep(3.0)
            folder = only_run(tmp_path / "runs")
            assert until(lambda: "ucr-1 port 1" in problems(folder))
            values = {order.value for order in line.orders(blow.at + ON_THE_WIRE_S)}
        ended(run)
    assert values == {EXTRACTOR}
    assert "does not count as safe" in problems(folder)["ucr-1 port 1"]


def test_another_device_behind_the_name_gets_nothing(line: ServedLine, tmp_path: Path) -> None:
    """The line is served again, on new pseudo-terminals of the same names."""
    run = at_work(line, tmp_path / "runs")
    run.send_signal(signal.SIGSTOP)  # it does not see the new ones
    taken: list[int] = []
    for name in line.stations:
        link = Path(line.url(name))
        far, near = pty.openpty()
        tty.setraw(near)
        link.unlink()
        link.symlink_to(os.ttyname(near))
        os.set_blocking(far, False)
        taken.append(far)
    _, guard = struck(run)
    with ended_guard(guard):
        folder = only_run(tmp_path / "runs")
        assert until(lambda: len(problems(folder)) == TOOLS, 30.0)
        heard = []
        for far in taken:
            with suppress(BlockingIOError):
                heard.append(os.read(far, 65536))
    ended(run)
    assert heard
    assert all(b"WPS" not in data and b"WSTP" not in data for data in heard)
    assert {"not known to be the same device" in text for text in problems(folder).values()} == {
        True
    }


def of_age(hours: int) -> str:
    counters = f"[station.sim]\ncounters = {{plugged_hours = {hours}}}\n"
    return LINE.replace("[station.sim]\n", counters)


@pytest.mark.parametrize(("hours", "is_ordered"), [(1200, True), (900, False)])
def test_behind_another_device_a_station_of_the_same_model_is_told_by_its_hours(
    tmp_path: Path, hours: int, is_ordered: bool
) -> None:
    """Each name leads to a station of the same model and software that answers."""
    for name in ("line", "others"):
        (tmp_path / name).mkdir()
    with (
        ServedLine(tmp_path / "line", of_age(1200)) as line,
        ServedLine(tmp_path / "others", of_age(hours)) as others,
    ):
        run = at_work(line, tmp_path / "runs")
        run.send_signal(signal.SIGSTOP)  # it does not see the others
        for name in line.stations:
            link = Path(line.url(name))
            link.unlink()
            link.symlink_to(Path(others.url(name)).readlink())
        _, guard = struck(run)
        with ended_guard(guard):
            folder = only_run(tmp_path / "runs")
            if is_ordered:
                assert until(lambda: len(ordered_tools(others)) == TOOLS, 30.0)
            else:
                assert until(lambda: len(problems(folder)) == TOOLS, 30.0)
                time.sleep(2.0)
        ended(run)
        assert bool(ordered_tools(others)) is is_ordered
        asked = {name: station.log.reads for name, station in others.stations.items()}
    assert min(asked.values()) > 0
    if not is_ordered:
        why = "there is now a DDE with 900 plugged hours on port 1, not the one with 1200"
        assert f"got no order: on {line.url('dde-1')} {why}" in problems(folder)["dde-1 port 1"]
        actions = [(kind, severity) for kind, severity, _, _ in actions_in(folder)]
        assert actions.count(("identity.changed", "critical")) == len(line.stations)


def ordered_tools(line: ServedLine) -> set[tuple[str, int]]:
    """The tools that got an order; a feeder is no tool."""
    return {(order.station, order.port) for order in line.orders() if order.name == "status"}


# -- jbclog safe -----------------------------------------------------------------------------------


def test_safe_while_the_guard_is_at_work_gives_one_answer(line: ServedLine, tmp_path: Path) -> None:
    run = at_work(line, tmp_path / "runs")
    with lost(line, all_of_them, "ucr-1"):
        blow, guard = struck(run)
        with ended_guard(guard):
            ended_safe = jbclog("safe", "--line", line.path)
            took_s = time.monotonic() - blow.at
            orders = Counter(
                (order.station, order.port)
                for order in line.orders(blow.at + ON_THE_WIRE_S)
                if order.station == "ucr-1"
            )
    ended(run)
    print(took_s, ended_safe.stdout, ended_safe.stderr, orders)
    assert ended_safe.returncode == 5
    assert "python3" not in ended_safe.stderr
    assert "in use by" not in ended_safe.stderr
    assert "dde-1 port 1" in ended_safe.stdout
    assert re.search(
        r"the guard of the run .* says: port 1: .* stand was ordered \d times", ended_safe.stderr
    )
    assert max(orders.values()) <= MOST_ORDERS


SAFE_LATER_S = 2.0  # beside a guard at work


def test_safe_beside_the_guard_takes_little_longer_than_on_free_ports(
    line: ServedLine, tmp_path: Path
) -> None:
    """The guard could not reach one station; then all answer, and it is about to try again."""
    run = at_work(line, tmp_path / "runs")
    with lost(line, all_of_them, "ucr-1"):
        _, guard = struck(run)
        folder = only_run(tmp_path / "runs")
        assert until(lambda: "ucr-1 port 1" in problems(folder), 30.0)
    with ended_guard(guard):
        beside_guard_s = safe_s(line)
    ended(run)
    for tool in line.tools():
        tool.order(SIM_WORKING, False)
    free_s = safe_s(line)
    assert beside_guard_s <= free_s + SAFE_LATER_S
    assert line.at_work() == 0


def safe_s(line: ServedLine) -> float:
    """How long `jbclog safe` takes, which must reach all tools."""
    begun_at = time.monotonic()
    assert jbclog("safe", "--line", line.path).returncode == 0
    return time.monotonic() - begun_at
