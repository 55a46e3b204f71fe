"""Recorders really killed or frozen: the guard puts every tool that they touched in its safe state.

Assertions use what the virtual stations received and their physics, never our record; further
assertions check that the record agrees. Each failure prints its seed.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support import program
from support.command import until
from support.faults import slow_disk
from support.faults.guarded import (
    TOLD_S,
    TOOLS,
    Blow,
    begun,
    ended,
    events,
    full_pipe,
    guard_of,
    guard_that_is_there,
    only_run,
    running,
    told_after,
)
from support.product import (
    EXTRACTOR,
    GUARD_DOES_NOT_START,
    LEASES_FILE,
    MAIN,
    RECORDER_HUNG_S,
    SECURE_ALLOWED_S,
    STAND,
    Manifest,
    check_run,
    open_run,
    read_manifest,
    recover_run,
)
from support.virtual.served_line import EXTRACTING, FOUR_TOOLS, ServedLine

pytestmark = pytest.mark.usefixtures("own_state")
BLOWS = 200
BUSY_S = 60.0
# after the first question: settings are being written, tools put to work, the first samples taken
EARLY_S = 1.2
LATE_S = 3.0
MISSED_S = 1.25  # until a stopped guard is noticed
STARTED_S = 0.75  # until the next one runs, also on a busy machine
SEED = random.randrange(1 << 32)


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedLine]:
    """Four stations, the feeder of one of them running whenever its tool works; they live through
    all tests here.
    """
    with ServedLine(tmp_path_factory.mktemp("line")) as served:
        yield served


def recovered(folder: Path) -> Manifest:
    """Return the manifest of a run that was cut off; `recover` and `check` agree about it."""
    recover_run(folder)
    assert check_run(folder) == []
    return read_manifest(folder)


# -- ordered in time -------------------------------------------------------------------------------


def struck(
    line: ServedLine, out: Path, number: signal.Signals, is_time: Callable[[float], bool]
) -> tuple[float, bool]:
    """Run, strike, examine the stations and the record; return the seconds until the tools were
    ordered to stand, and whether the feeder was running.

    `is_time` gets the seconds since the first question. The guard leaves a recorder alone that
    froze before its first write, because nothing is hot; so a freeze counts from the first write.
    """
    questions, began = line.questions(), time.monotonic()
    run = begun(line, out)
    try:
        first = (
            line.questions
            if number == signal.SIGKILL
            else lambda: questions + len(line.orders(began))
        )
        assert until(lambda: first() > questions or run.poll() is not None, 60.0)
        assert run.poll() is None, run.communicate(timeout=5)
        asked = time.monotonic()
        while not is_time(time.monotonic() - asked):
            time.sleep(0.002)
        fed, blow = line.motor("ale-1"), Blow.strike(run, number)
        notes = ended(run)
    finally:
        run.kill()
    assert run.returncode == -signal.SIGKILL, notes
    seconds = told_after(line, began, blow)
    assert not line.motor("ale-1")
    manifest = recovered(only_run(out))
    assert ("guard.took_over" in events(only_run(out))) == (seconds > 0)
    assert [facts.unsafe for facts in manifest.stations if facts.unsafe] == []
    assert {state for facts in manifest.stations for state in facts.safe_state.values()} <= {
        "verified"
    }
    assert not (only_run(out) / LEASES_FILE).exists()
    return seconds, fed


def times(
    line: ServedLine, folder: Path, number: signal.Signals, seed: int, count: int, latest_s: float
) -> list[float]:
    """Strike at random moments; return the seconds of each order."""
    rng, told, fed = random.Random(seed), [], 0
    for trial in range(count):
        moment = latest_s * rng.random()
        print(f"seed {seed}, trial {trial}: {number.name} after {moment:.3f} s")
        seconds, was_feeding = struck(
            line, folder / str(trial), number, lambda passed, at=moment: passed >= at
        )  # type: ignore[misc]
        came = f"all told after {seconds:.3f} s" if seconds else "nothing was hot yet"
        print(f"    {came}, feeder running: {was_feeding}", flush=True)
        told.append(seconds)
        fed += was_feeding
    print(f"{count} times {number.name}: feeder running {fed} times")
    return told


@pytest.mark.parametrize(
    ("number", "count"), [(signal.SIGKILL, 2), (signal.SIGSTOP, 1)], ids=["kill", "stop"]
)
def test_every_tool_that_was_touched_is_told_to_stand(
    line: ServedLine, tmp_path: Path, number: signal.Signals, count: int
) -> None:
    assert len(times(line, tmp_path, number, SEED, count, EARLY_S)) == count


def test_a_feeder_that_runs_is_stopped_first(line: ServedLine, tmp_path: Path) -> None:
    seconds, fed = struck(
        line, tmp_path, signal.SIGKILL, lambda passed: passed > 10 or line.motor("ale-1")
    )
    assert fed
    assert 0 < seconds < RECORDER_HUNG_S


@pytest.mark.campaign
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["kill", "stop"])
def test_every_tool_is_told_to_stand_two_hundred_times(
    line: ServedLine, tmp_path: Path, number: signal.Signals, counted: Callable[..., None]
) -> None:
    """``pytest -m campaign -n0 tests/faults/test_guard.py -k two_hundred``: some 25 minutes; the
    last line has the figures. Two hundred strikes on a recorder that had put something to work;
    earlier ones are counted separately.
    """
    told: list[float] = []
    while (hot := sorted(seconds for seconds in told if seconds)) == [] or len(hot) < BLOWS:
        told += times(
            line, tmp_path / str(len(told)), number, SEED + len(told), BLOWS - len(hot), LATE_S
        )
    found = {"blows while hot": len(hot), "blows before": len(told) - len(hot), "left hot": 0}
    found |= {
        "ms to the last tool, median": ms(hot, 0.5),
        "99 %": ms(hot, 0.99),
        "worst": ms(hot, 1.0),
    }
    counted(**{f"{number.name} {name}": figure for name, figure in found.items()})


def ms(sorted_s: list[float], share: float) -> int:
    return round(1000 * sorted_s[min(int(len(sorted_s) * share), len(sorted_s) - 1)])


def test_four_tools_that_accept_the_extractor_state_and_heat_on_are_told_to_stand(
    tmp_path: Path,
) -> None:
    """All are ordered, watched together, and ordered to stand within three seconds of the first
    order.
    """
    (tmp_path / "line").mkdir()
    with ServedLine(tmp_path / "line", FOUR_TOOLS, EXTRACTING) as line:
        run = begun(line, tmp_path / "runs")
        try:
            assert until(lambda: line.at_work() == 4), run.communicate(timeout=5)
            blow = Blow.strike(run, signal.SIGKILL)
            ended(run)
        finally:
            run.kill()
        folder = only_run(tmp_path / "runs")
        assert until(lambda: not (folder / LEASES_FILE).exists())
        by_port = {
            port: [order.value for order in line.orders(blow.at) if order.port == port]
            for port in (1, 2, 3, 4)
        }
        orders = line.orders(blow.at)
    # the recorder's last may still be on its way
    orders = [order for order in orders if order.value in (EXTRACTOR, STAND)]
    assert {port: values[-2:] for port, values in by_port.items()} == {
        port: [EXTRACTOR, STAND] for port in (1, 2, 3, 4)
    }
    assert orders[-1].at - orders[0].at < SECURE_ALLOWED_S
    assert orders[-1].at - blow.at < TOLD_S
    recovered(folder)
    texts = list(open_run(folder).events().query("kind == 'safety.safe_state'")["text"])
    assert len(texts) == 4
    assert all(
        text.endswith("as read back: stand; extractor was read back, but the tool did not cool.")
        for text in texts
    )


HOT_AIR = """
[line]
name = "air"

[[station]]
name = "jtse-1"
url = "jtse-1"
family = "jtse"
[station.sim]
tool = 1
"""
BLOWING = """
[recipe]
name = "blowing"
revision = 1
families = ["jtse"]

[air]
suction = "on"

[run]
status = "on"
"""


@pytest.mark.parametrize(("policy", "word"), [("keep", (0, 0, 1, 1, 0)), ("off", (0, 0, 0, 1, 0))])
def test_a_part_that_hangs_on_hot_air_is_not_let_go_unless_the_recipe_says_so(
    tmp_path: Path, policy: str, word: tuple[int, ...]
) -> None:
    """The lease carries the last confirmed digit: the guard reads no status before its order."""
    (tmp_path / "line").mkdir()
    with ServedLine(tmp_path / "line", HOT_AIR, f'{BLOWING}safe_suction = "{policy}"\n') as line:
        run = begun(line, tmp_path / "runs")
        try:
            assert until(
                lambda: (
                    line.orders()
                    and (tmp_path / "runs").exists()
                    and (only_run(tmp_path / "runs") / LEASES_FILE).exists()
                )
            )
            time.sleep(1.0)
            blow = Blow.strike(run, signal.SIGKILL)
            ended(run)
        finally:
            run.kill()
        assert until(lambda: not (only_run(tmp_path / "runs") / LEASES_FILE).exists())
        assert {order.value for order in line.orders(blow.at)} == {word}


# -- no action without a cause ---------------------------------------------------------------------


def assert_left_alone(
    line: ServedLine, run: subprocess.Popen[str], out: Path, since: float
) -> None:
    """The guard has not taken over, and does not until the run has ended in order."""
    assert [order for order in line.orders(since) if order.is_safe] == []
    run.terminate()
    notes = ended(run)
    assert run.returncode in (0, 1), notes  # its normal end: no duration was stated
    folder = only_run(out)
    assert {"guard.took_over", "guard.lost"} & set(events(folder)) == set()
    assert read_manifest(folder).guard == "on"
    assert check_run(folder) == []


@contextmanager
def busy() -> Iterator[None]:
    """Run four processes per available processor that use it all the time."""
    count = 4 * len(os.sched_getaffinity(0))
    spinning = [
        subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"]) for _ in range(count)
    ]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()


@pytest.mark.campaign
@pytest.mark.timeout(600)
def test_a_machine_with_four_times_the_work_and_a_stalling_disk_is_no_reason(
    line: ServedLine, tmp_path: Path, counted: Callable[..., None]
) -> None:
    """Both together, for a minute; `test_watch.py` has a hundred hours of jitter on a virtual
    clock.
    """
    with slow_run(line, tmp_path, BUSY_S) as run:
        now = time.monotonic()
        with busy():
            time.sleep(BUSY_S)
        assert_left_alone(line, run, tmp_path, now)
    counted(
        seconds_of_fourfold_load_and_stalls=round(BUSY_S), false_take_overs=0, false_replacements=0
    )


@pytest.fixture
def _on_one_processor() -> Iterator[None]:
    """Keep everything that this thread starts on one processor, which makes a machine busy in half
    the time of two.
    """
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    yield
    os.sched_setaffinity(0, before)


@pytest.mark.usefixtures("_on_one_processor")
def test_neither_a_busy_machine_nor_a_terminal_that_is_held_is_a_reason(
    line: ServedLine, tmp_path: Path
) -> None:
    reading, stderr = full_pipe()
    command = [
        sys.executable,
        "-c",
        MAIN,
        "run",
        line.recipe,
        "--line",
        line.path,
    ]
    run = subprocess.Popen(
        [*map(str, command), "--out", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
        process_group=0,  # in an orphaned group, as that of a job in CI, nothing is stopped
    )
    os.close(stderr)
    try:
        assert until(lambda: line.at_work() == TOOLS)
        run.send_signal(signal.SIGTSTP)  # Ctrl-Z
        run.send_signal(signal.SIGTTOU)
        with busy():
            time.sleep(RECORDER_HUNG_S + 0.5)
        assert line.at_work() == TOOLS
        run.terminate()
        assert until(lambda: read_manifest(only_run(tmp_path)).state == "sealed")
        with os.fdopen(reading, "rb") as read_again:
            read_again.read()
        assert run.wait(10) in (0, 1)
    finally:
        run.kill()
        run.communicate()
    assert check_run(only_run(tmp_path)) == []


@pytest.mark.campaign
def test_a_disk_that_stalls_is_no_reason(line: ServedLine, tmp_path: Path) -> None:
    with slow_run(line, tmp_path, 4.0) as run:
        now = time.monotonic()
        time.sleep(2 * slow_disk.STALL_S)
        assert_left_alone(line, run, tmp_path, now)


@contextmanager
def slow_run(line: ServedLine, out: Path, seconds: float) -> Iterator[subprocess.Popen[str]]:
    """A run that has put all tools to work, on a disk whose syncs take 1.5 s for that long."""
    command = [
        *program("faults.slow_disk"),
        seconds,
        "run",
        line.recipe,
        "--line",
        line.path,
        "--out",
        out,
    ]
    run = subprocess.Popen(
        list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert until(lambda: line.at_work() == TOOLS)
        yield run
    finally:
        run.kill()


# -- the guard itself ------------------------------------------------------------------------------


def test_a_guard_that_is_killed_is_replaced_and_the_next_one_saves_as_well(
    line: ServedLine, tmp_path: Path
) -> None:
    began = time.monotonic()
    with running(line, tmp_path) as run:
        folder, first = only_run(tmp_path), guard_that_is_there(run.pid)
        os.kill(first, signal.SIGKILL)
        assert until(lambda: "guard.lost" in list(open_run(folder).events()["kind"]))
        second = guard_that_is_there(run.pid, not_this=first)
        os.kill(second, signal.SIGKILL)
        guard_that_is_there(run.pid, not_this=second)
        blow = Blow.strike(run, signal.SIGKILL)  # the third may not even have begun to watch
        ended(run)
    assert told_after(line, began, blow) > 0
    assert recovered(folder).guard == "lost"
    assert {"guard.lost", "guard.took_over"} <= set(events(folder))


def test_a_guard_that_is_stopped_is_replaced_within_five_quarters_of_a_second(
    line: ServedLine, tmp_path: Path
) -> None:
    """The stopped guard is killed, so that it does nothing when resumed; the next one protects the
    tools as well.
    """
    began = time.monotonic()
    with running(line, tmp_path) as run:
        first = guard_that_is_there(run.pid)
        os.kill(first, signal.SIGSTOP)
        stopped = time.monotonic()
        assert until(lambda: guard_of(run.pid) not in (first, None))
        took = time.monotonic() - stopped
        assert not Path(f"/proc/{first}").exists()
        blow = Blow.strike(run, signal.SIGKILL)  # at once: it may not even have begun to watch
        ended(run)
    assert took < MISSED_S + STARTED_S
    assert told_after(line, began, blow) > 0


def test_where_no_guard_can_be_started_nothing_is(line: ServedLine, tmp_path: Path) -> None:
    command, before = (
        [
            sys.executable,
            "-c",
            GUARD_DOES_NOT_START,
            "run",
            line.recipe,
            "--line",
            line.path,
            "--out",
            tmp_path,
        ],
        line.questions(),
    )
    ended = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, timeout=200, check=False
    )
    assert (ended.returncode, line.questions()) == (3, before)
    assert {facts.outcome for facts in read_manifest(only_run(tmp_path)).stations} == {"refused"}
    assert (
        "the guard did not start; its reason stands above. --no-guard runs without one"
        in ended.stderr
    )


def test_a_fault_of_the_program_leaves_nothing_hot_and_its_record_whole(
    line: ServedLine, tmp_path: Path
) -> None:
    command = [
        *program("faults.broken_session"),
        "ale-1",
        "run",
        line.recipe,
        "--line",
        line.path,
        "--out",
        tmp_path,
    ]
    now = time.monotonic()
    run = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, timeout=200, check=False
    )
    assert (line.at_work(), line.motor("ale-1")) == (0, False)
    safe = dict.fromkeys(
        order.name for order in line.orders(now) if order.station == "ale-1" and order.is_safe
    )
    # on a busy machine one of them may be ordered again
    assert list(safe) == ["stop_feeding", "status"]
    assert run.returncode == 4, run.stderr
    folder = only_run(tmp_path)
    assert check_run(folder) == []
    assert [kind for kind in events(folder) if kind in ("run.failed", "guard.took_over")] == [
        "run.failed",
        "guard.took_over",
    ]
    (ale,) = (facts for facts in read_manifest(folder).stations if facts.name == "ale-1")
    assert ale.safe_state == {1: "verified"}
    assert not (folder / LEASES_FILE).exists()


def test_the_first_process_of_a_container_says_that_its_guard_ends_with_it(
    line: ServedLine, tmp_path: Path
) -> None:
    apart = ["unshare", "--pid", "--fork", "--mount-proc"]
    if (
        shutil.which("unshare") is None
        or subprocess.run([*apart, "true"], capture_output=True, check=False).returncode
    ):
        pytest.skip("unshare (as root) is needed for processes that are numbered anew")
    command = [
        *apart,
        sys.executable,
        "-c",
        MAIN,
        "run",
        line.recipe,
        "--line",
        line.path,
    ]
    subprocess.run(
        [*map(str, command), "--out", str(tmp_path), "-d", "1s", "-s", "ucr-1"],
        capture_output=True,
        timeout=200,
        check=False,
    )
    assert [kind for kind in events(only_run(tmp_path)) if kind.startswith("guard.")] == [
        "guard.weak"
    ]


def test_without_a_guard_the_record_says_so_and_nobody_comes(
    line: ServedLine, tmp_path: Path
) -> None:
    with running(line, tmp_path, "--no-guard") as run:
        assert guard_of(run.pid) is None
        now = time.monotonic()
        run.terminate()
        ended(run)
    # the run itself does it
    assert {order.station for order in line.orders(now) if order.is_stand} == set(line.stations)
    assert read_manifest(only_run(tmp_path)).guard == "none"
    assert "guard.none" in events(only_run(tmp_path))
