"""Take-over on real pseudo-terminals: which tools are made safe, which are left alone, what is
tried again.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from support.command import until
from support.product import (
    ACTION_LOG_FILE,
    IMPATIENT_GUARD,
    LEASES_FILE,
    RECORDER_THAT_DIES,
    RUN_LOCK,
    SIM_SLEEP,
    SIM_STAND,
    SIM_WORKING,
    WATCH_FAILED,
    ActionLog,
    Continuity,
    Inquiries,
    LeaseWriter,
    LeftOver,
    LineFormat,
    Port,
    PortBusy,
    StationLease,
    TakeOver,
    guard_lock,
    open_for_guard,
    open_port,
    patch,
    registered_runs,
    retry_orders,
    settle_leases,
    write_leases,
)
from support.virtual.served_line import ServedLine

pytestmark = pytest.mark.usefixtures("own_state")


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedLine]:
    with ServedLine(tmp_path_factory.mktemp("line")) as line:
        yield line


@pytest.fixture
def line(served: ServedLine) -> ServedLine:
    """A line with all tools at work and the feeder running."""
    for port in served.tools():
        port.order(SIM_WORKING, False)
    feeder = served.stations["ale-1"].plant.feeder
    feeder.settings.feeder_mode = "continuous"
    feeder.start(time.monotonic())
    return served


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A folder of a run that was cut off."""
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / RUN_LOCK).touch()
    return folder


def lease(line: ServedLine, name: str) -> StationLease:
    """Return the lease of a run that put all tools of a station to work."""
    device = line.stations[name].device
    ports = tuple(line.stations[name].plant.ports)
    family, software = (
        device.family.name,
        (device.identity.software if "software_version" in device.family.commands else None),
    )
    return StationLease(
        name,
        line.url(name),
        19200,
        "8N1",
        1,
        family,
        device.identity.model,
        software,
        "stand",
        ports,
        name == "ale-1",
    )


def all_leases(line: ServedLine) -> list[StationLease]:
    return [lease(line, name) for name in line.stations]


def told(run: Path) -> list[tuple[str, str | None, int | None]]:
    """Return the lines of the action log, without their times."""
    lines = (
        (run / ACTION_LOG_FILE).read_text().splitlines() if (run / ACTION_LOG_FILE).exists() else []
    )
    return [
        (row["kind"], row["station"], row["port"]) for row in map(json.loads, filter(None, lines))
    ]


@pytest.fixture
def retried_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    patch(monkeypatch, "guard.RETRY_EVERY_S", 0.1)


@pytest.fixture
def quick(retried_soon: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Give up soon what does not succeed; the time is too short for tests that must succeed on a
    busy machine.
    """
    patch(monkeypatch, "secure.ALLOWED_S", 1.5)


@pytest.mark.usefixtures("unhurried")
def test_every_line_at_once(line: ServedLine, run: Path) -> None:
    began = time.monotonic()
    assert TakeOver(all_leases(line), ActionLog(run)).run() == []
    assert (line.at_work(), line.motor("ale-1")) == (0, False)
    orders = line.orders(began)
    assert {order.station for order in orders} == set(line.stations)
    assert max(order.at for order in orders) - began < 10
    # on a busy machine an answer may come late, and the order is repeated
    assert sorted(row[1:] for row in told(run)) == sorted(
        {(o.station, o.port) for o in orders if o.is_stand}
    )  # type: ignore[type-var]


@pytest.mark.parametrize(
    "other",
    [
        {"model": "NAE"},
        {"software": "0000001"},
        {"model": None},
        {"address": 7},
        {"baudrate": 9600},
    ],
    ids=["model", "software", "nameless", "address", "rate"],
)
@pytest.mark.usefixtures("quick")
def test_another_station_is_not_written_to(
    line: ServedLine, run: Path, other: dict[str, object]
) -> None:
    began = time.monotonic()
    stranger = replace(lease(line, "dde-1"), **other)  # type: ignore[arg-type]
    assert TakeOver([stranger], ActionLog(run)).run() == [stranger]
    assert line.orders(began) == []
    assert told(run) == [("safety.not_safe", "dde-1", 1), ("safety.not_safe", "dde-1", 2)]
    assert time.monotonic() - began < 30


@pytest.mark.parametrize("accepted", [True, False])
def test_an_accepted_name_is_acted_upon_where_the_run_has_borne_it_out(
    line: ServedLine, run: Path, accepted: bool
) -> None:
    identity, began = line.stations["dde-1"].device.identity, time.monotonic()
    own, identity.model = identity.model, "DIE"
    try:
        held = replace(lease(line, "dde-1"), model="DIE", model_accepted=accepted)
        assert TakeOver([held], ActionLog(run)).run() == ([] if accepted else [held])
        assert bool(line.orders(began)) == accepted
    finally:
        identity.model = own


@pytest.mark.parametrize("key", ["model_accepted", "suction"])
def test_a_lease_without_a_key_is_not_read(line: ServedLine, key: str) -> None:
    """No release wrote one: a lease says all that a take-over needs."""
    written = json.loads(lease(line, "dde-1").to_json())
    assert StationLease.from_json(json.dumps(written)) == lease(line, "dde-1")
    del written[key]
    with pytest.raises(ValueError, match=f"missing keys {key}"):
        StationLease.from_json(json.dumps(written))


@pytest.mark.usefixtures("unhurried")
def test_one_that_cannot_be_saved_keeps_nobody_else(line: ServedLine, run: Path) -> None:
    broken = replace(lease(line, "dde-2"), family="of a later version")
    assert TakeOver([broken, lease(line, "dde-1"), lease(line, "ale-1")], ActionLog(run)).run() == [
        broken
    ]
    assert line.at_work() == 3
    assert ("guard.failed", "dde-2", None) in told(run)


@pytest.mark.usefixtures("unhurried")
def test_a_port_that_is_let_go_late_is_waited_for(
    line: ServedLine, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A killed recorder may end late: here at the third try to open its port."""
    port, refused, opened = open_port(line.url("ucr-1"), LineFormat()), [], open_for_guard

    def tried(held: StationLease) -> Port:
        try:
            return opened(held)
        except PortBusy:
            refused.append(held.name)
            if len(refused) == 3:
                port.close()
            raise

    patch(monkeypatch, "takeover._open", tried)
    assert TakeOver([lease(line, "ucr-1")], ActionLog(run)).run() == []
    assert refused == 3 * ["ucr-1"]


@pytest.mark.usefixtures("unhurried")
def test_where_the_system_gives_no_threads_it_is_done_one_after_the_other(
    line: ServedLine, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_more(*_: object) -> None:
        raise RuntimeError("can't start new thread")

    leases = all_leases(line)
    with monkeypatch.context() as meanwhile:
        meanwhile.setattr("_thread.start_new_thread", no_more)
        taking_over = TakeOver(leases, ActionLog(run))
        assert taking_over.run() == []
    assert line.at_work() == 0


@pytest.mark.usefixtures("unhurried")
def test_what_rests_is_spared_where_that_is_asked(line: ServedLine, run: Path) -> None:
    line.stations["dde-1"].plant.ports[1].order(SIM_SLEEP, False)
    began = time.monotonic()
    assert TakeOver([lease(line, "dde-1")], ActionLog(run), spare=True).run() == []
    assert {(order.station, order.port) for order in line.orders(began)} == {("dde-1", 2)}
    assert line.stations["dde-1"].plant.ports[1].doing.state == SIM_SLEEP
    assert line.stations["dde-1"].plant.ports[2].doing.state == SIM_STAND


# -- tried again -----------------------------------------------------------------------------------


def unplugged(line: ServedLine, name: str) -> Callable[[], object]:
    """Remove a port's name, as if its adapter was pulled; return a function that restores it."""
    path = Path(line.url(name))
    aside = path.rename(path.with_name(f"{name}-away"))
    return lambda: aside.rename(path)


def retried(
    run: Path, left: list[StationLease], lease_writer: LeaseWriter, action_log: ActionLog
) -> None:
    with Inquiries(run) as inquiries:
        retry_orders(run, left, (), Continuity(), inquiries, lease_writer, action_log)


@pytest.mark.usefixtures("retried_soon")
def test_a_cable_that_is_put_back_is_enough(line: ServedLine, run: Path) -> None:
    plug_in = unplugged(line, "dde-1")
    action_log = ActionLog(run)
    lease_writer = LeaseWriter(run, action_log)
    left = TakeOver(all_leases(line), action_log).run()
    assert [station.name for station in left] == ["dde-1"]
    before = told(run)
    lease_writer.put(left)
    lease_writer.settle(60.0)
    threading.Timer(0.7, plug_in).start()
    retried(run, left, lease_writer, action_log)
    assert (line.at_work(), (run / LEASES_FILE).exists()) == (0, False)
    # no word of failures
    assert sorted(told(run)[len(before) :]) == [
        ("safety.safe_state", "dde-1", 1),
        ("safety.safe_state", "dde-1", 2),
    ]


@contextmanager
def failed_recorders_guard(line: ServedLine, run: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Start a guard in a child process, and let it take over dde-1."""
    command = [sys.executable, "-c", IMPATIENT_GUARD, str(run), "--recorder", str(os.getpid())]
    guard = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    try:
        assert guard.stdin is not None
        guard.stdin.write(f"{lease(line, 'dde-1').to_json()}\n{WATCH_FAILED}\n".encode())
        guard.stdin.flush()
        yield guard
    finally:
        guard.kill()
        guard.communicate()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_recorder_that_dies_as_soon_as_the_next_guard_is_there(
    line: ServedLine, run: Path, number: signal.Signals
) -> None:
    """The next guard has the leases, although the recorder has written nothing to it since."""
    command = [sys.executable, "-c", RECORDER_THAT_DIES, str(run), str(int(number))]
    asked = f"{lease(line, 'dde-1').to_json()}\n"
    recorder = subprocess.run(command, input=asked, text=True, timeout=200, stdout=subprocess.PIPE)
    assert recorder.returncode == -signal.SIGKILL
    assert until(lambda: line.at_work() == 4)
    assert until(lambda: ("guard.took_over", None, None) in told(run))


def test_a_lease_stays_open_where_what_was_done_could_not_be_written_down(
    line: ServedLine, run: Path
) -> None:
    (run / ACTION_LOG_FILE).mkdir()
    with failed_recorders_guard(line, run) as guard:
        assert guard.wait(100) == 0
    assert line.at_work() == 4
    assert (run / LEASES_FILE).exists()


def test_a_guards_process_goes_on_until_the_cable_is_back(line: ServedLine, run: Path) -> None:
    plug_in = unplugged(line, "dde-1")
    with failed_recorders_guard(line, run) as guard:
        assert until(lambda: ("guard.took_over", None, None) in told(run))
        assert line.at_work() == 6
        plug_in()
        assert guard.wait(100) == 0
    assert (line.at_work(), (run / LEASES_FILE).exists()) == (4, False)
    assert sorted(told(run)[-2:]) == [
        ("safety.safe_state", "dde-1", 1),
        ("safety.safe_state", "dde-1", 2),
    ]
    assert not (run / ACTION_LOG_FILE).read_bytes().endswith(b"\n\n")  # its room is given back


@pytest.mark.usefixtures("quick")
def test_it_ends_when_somebody_else_has_seen_to_it(line: ServedLine, run: Path) -> None:
    def see_to_it() -> None:
        with guard_lock(run, 60.0):
            write_leases(run, [])

    plug_in = unplugged(line, "dde-1")
    try:
        lease_writer = LeaseWriter(run, ActionLog(run))
        left = [lease(line, "dde-1")]
        lease_writer.put(left)
        lease_writer.settle(60.0)
        threading.Timer(0.5, see_to_it).start()
        began = time.monotonic()
        retried(run, left, lease_writer, ActionLog(run))
        assert time.monotonic() - began < 30
    finally:
        plug_in()


@pytest.mark.usefixtures("quick")
def test_it_ends_when_time_is_up(
    line: ServedLine, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch(monkeypatch, "guard.RETRY_FOR_S", 0.5)
    stranger = replace(lease(line, "dde-1"), model="NAE")
    retried(run, [stranger], LeaseWriter(run, ActionLog(run)), ActionLog(run))
    assert line.at_work() == 6


# -- what was left at the next start ---------------------------------------------------------------


@pytest.mark.usefixtures("unhurried")
def test_what_was_left_is_dealt_with_on_the_ports_that_are_asked_for(
    line: ServedLine, run: Path
) -> None:
    write_leases(run, all_leases(line))
    asleep = line.stations["dde-2"].plant.ports[1]
    asleep.order(SIM_SLEEP, False)
    began = time.monotonic()
    device = str(Path(line.url("ucr-1")).resolve())  # by another name than the lease's
    (left,) = settle_leases(run.parent, {device, line.url("dde-2")}, lambda folder: False)
    assert (left.is_safe, left.text) == (
        True,
        "Run run ended without making the tools of dde-2, ucr-1 safe; every tool is in its safe"
        " state now.",
    )
    assert line.at_work() == 3
    assert ("dde-2", 1) not in {(order.station, order.port) for order in line.orders(began)}, (
        "it would wake to be told to stand"
    )
    assert ("safety.safe_state", "dde-2", 1) in told(run)
    assert settle_leases(run.parent, {line.url("dde-2")}, lambda folder: False) == []


@pytest.mark.usefixtures("unhurried")
def test_what_another_out_left_is_found_and_one_that_cannot_be_written_down_stays_open(
    line: ServedLine, run: Path, tmp_path: Path
) -> None:
    write_leases(run, [lease(line, "dde-2")])
    (run / ACTION_LOG_FILE).mkdir()  # nothing can be written there
    for _ in range(2):
        (left,) = settle_leases(tmp_path / "another out", {line.url("dde-2")}, lambda folder: False)
        assert left.is_safe
    (run / ACTION_LOG_FILE).rmdir()
    assert (
        len(settle_leases(tmp_path / "another out", {line.url("dde-2")}, lambda folder: False)) == 1
    )
    assert not (run / LEASES_FILE).exists()
    assert registered_runs() == ([], [])


@pytest.mark.usefixtures("unhurried")
def test_of_many_that_come_at_once_one_makes_safe_what_was_left(
    line: ServedLine, run: Path
) -> None:
    """Two guards never both write: the second one finds nothing to do."""
    assert at_once(line, run, 8) == 1


@pytest.mark.campaign
@pytest.mark.timeout(900)
def test_of_many_that_come_at_once_one_makes_safe_what_was_left_a_hundred_times(
    line: ServedLine, tmp_path: Path, counted: Callable[..., None]
) -> None:
    one = 0
    for trial in range(100):
        for port in line.tools():
            port.order(SIM_WORKING, False)
        (folder := tmp_path / f"run-{trial}").mkdir()
        one += at_once(line, folder, 8)
    print(f"100 times 8 at once: one of them wrote {one} times, two never")
    assert one == 100
    counted(times_eight_at_once=100, by_two=0, by_none=0)


def at_once(line: ServedLine, folder: Path, count: int) -> int:
    """Return how many of them made the tools safe. By the stations' own log, every tool got its
    order, and not from two.

    On a busy machine one late answer causes a repeated order; two guards would repeat each.
    """
    write_leases(folder, all_leases(line))
    began, urls = time.monotonic(), {line.url(name) for name in line.stations}
    done: list[LeftOver] = []
    threads = [
        threading.Thread(
            target=lambda: done.extend(settle_leases(folder.parent, urls, lambda folder: False))
        )
        for _ in range(count)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    places = [(order.station, order.port) for order in line.orders(began) if order.is_stand]
    assert len(set(places)) == len(line.tools())
    assert len(places) < 2 * len(line.tools())
    assert line.at_work() == 0
    return len(done)


def test_a_run_that_goes_on_is_left_alone_at_once(line: ServedLine, run: Path) -> None:
    write_leases(run, all_leases(line))
    began = time.monotonic()
    assert settle_leases(run.parent, {line.url("dde-2")}, lambda folder: True) == []
    assert (line.orders(began), time.monotonic() - began < 10) == ([], True)


def test_a_guard_that_is_just_taking_over_is_waited_for(
    line: ServedLine, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is done at the fourth request for its lock."""
    write_leases(run, all_leases(line))
    guard, began = ExitStack(), time.monotonic()
    refused: list[Path] = []
    guard.enter_context(guard_lock(run))

    def asked(folder: Path) -> AbstractContextManager[None]:
        if len(refused) == 3:
            write_leases(run, [])
            guard.close()
        refused.append(folder)
        return guard_lock(folder)

    patch(monkeypatch, "open_leases.guard_lock", asked)
    assert settle_leases(run.parent, {line.url("dde-2")}, lambda folder: False) == []
    assert (line.orders(began), len(refused)) == ([], 4)


@pytest.mark.usefixtures("quick")
def test_what_could_not_be_made_safe_is_told_and_kept_for_the_next_start(
    line: ServedLine, run: Path
) -> None:
    stranger = replace(lease(line, "dde-1"), model="NAE")
    write_leases(run, [stranger])
    (left,) = settle_leases(run.parent, {stranger.url}, lambda folder: False)
    assert not left.is_safe
    assert "not every tool could be made safe" in left.text
    assert (run / LEASES_FILE).exists()
    assert told(run)[-1][0] == "guard.left_over"
