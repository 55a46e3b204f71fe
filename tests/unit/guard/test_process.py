"""The guard as a process: light, quick, alone, and missed at once when it is gone."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from support.campaigns.awaited import HAS_A_GUARD
from support.command import until
from support.faults.guarded import guard_process
from support.product import (
    IMPORT_GUARD,
    LEASE_LOCK,
    LEASES_FILE,
    PACKAGE,
    PATIENT_GUARD,
    RENEW_S,
    RUN_LOCK,
    UNANSWERED_MOST,
    WATCH_BEAT,
    GuardLost,
    GuardProcess,
    GuardSupervisor,
    StartRefused,
    StationLease,
    patch,
    read_leases,
)

HEAVY = (
    "pydantic",
    "pyarrow",
    "pandas",
    "numpy",
    "asyncio",
    "typer",
    "rich",
    "sqlite3",
    "tomllib",
    "multiprocessing",
    "http",
    "hashlib",  # OpenSSL
    "subprocess",
)
PACKAGES = (
    "record",
    "session.run",
    "session.scheduler",
    "config",
    "analysis",
    "sim",
    "cli",
    "app",
    "core.rows",
)


def lease(number: int) -> StationLease:
    """A station that is not there."""
    return StationLease(
        f"dde-{number}",
        f"/dev/no{number}",
        19200,
        "8N1",
        1,
        "dde",
        "DDE",
        "1.0",
        "stand",
        (1, 2),
        False,
    )


# which nobody can save, nor takes long to find out
UNKNOWN = replace(lease(1), family="of a later version")


class PatientGuard(subprocess.Popen[bytes]):
    """A guard that waits ten minutes for a silent recorder, and for a slow disk."""

    def __init__(self, command: list[str], **how: Any) -> None:
        place = command.index("-m")
        assert command[place + 1] == "jbclog.guard"
        super().__init__([*command[:place], "-c", PATIENT_GUARD, *command[place + 2 :]], **how)


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is tested here is none of the limits of time, but for those that a test names."""
    patient = SimpleNamespace(**{**vars(subprocess), "Popen": PatientGuard})
    patch(monkeypatch, "supervisor.subprocess", patient)
    patch(monkeypatch, "supervisor.READY_S", 100.0)
    patch(monkeypatch, "supervisor.END_S", 100.0)


def until_it(guard: GuardProcess | None, true: Callable[[], bool]) -> bool:
    """Wait, and renew meanwhile."""
    assert guard is not None
    return until(lambda: guard._send(WATCH_BEAT) or true())  # type: ignore[func-returns-value]


@pytest.fixture
def guard(tmp_path: Path) -> Iterator[GuardProcess]:
    made = GuardProcess(tmp_path)
    made.await_ready()
    yield made
    made.kill()


# -- what it costs ---------------------------------------------------------------------------------


def test_it_imports_next_to_nothing() -> None:
    names = (*HEAVY, *(f"jbclog.{name}" for name in PACKAGES))
    code = (  # coverage, where it is measured, has loaded some before
        f"import sys\nbefore = {{*sys.modules}}\n{IMPORT_GUARD}\n"
        f"print(*[name for name in {names!r} if name in sys.modules.keys() - before])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=200
    )
    assert done.stdout.split() == []


def test_a_file_of_the_users_does_not_pass_for_a_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("serial", "json", "select"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('not me')")
    monkeypatch.chdir(tmp_path)
    guard = GuardProcess(tmp_path)
    guard.await_ready()
    guard.end()


# -- its life --------------------------------------------------------------------------------------


def test_it_leaves_nothing_behind_when_all_is_done(guard: GuardProcess, tmp_path: Path) -> None:
    guard.lease(lease(1))
    assert until_it(guard, lambda: read_leases(tmp_path) == [lease(1)])
    assert (tmp_path / LEASE_LOCK).exists()
    guard.end()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_no_signal_that_ends_a_run_ends_it(guard: GuardProcess, number: signal.Signals) -> None:
    os.kill(guard.pid, number)
    guard.renew()
    assert guard._can_be_read_within(60.0)
    assert guard._has_answered()  # what came after the signal; an ended one would be lost
    assert os.getsid(guard.pid) == guard.pid != os.getsid(0)  # nor what a terminal does


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_nor_does_one_that_comes_while_it_is_started(
    number: signal.Signals, tmp_path: Path
) -> None:
    guard = GuardProcess(tmp_path)
    os.kill(guard.pid, number)  # long before its program is read
    guard.await_ready()
    guard.end()


def test_one_that_does_not_start_says_so(tmp_path: Path) -> None:
    guard = GuardProcess(tmp_path / "not there")
    with pytest.raises(StartRefused, match="--no-guard"):
        guard.await_ready()


def test_one_that_cannot_lock_its_folder_says_why_in_a_sentence(tmp_path: Path) -> None:
    # as a full disk would, this refuses the lock's file
    (tmp_path / LEASE_LOCK).symlink_to(tmp_path / "elsewhere")
    command = [sys.executable, "-m", "jbclog.guard", str(tmp_path), "--recorder", str(os.getpid())]
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False, timeout=200
    )
    assert done.returncode == 4
    assert "the guard cannot be set up: " in done.stderr
    assert "Traceback" not in done.stderr


def test_one_that_was_killed_is_missed_at_the_next_renewal(guard: GuardProcess) -> None:
    guard.renew()
    os.kill(guard.pid, signal.SIGKILL)
    assert until(lambda: not _renews(guard), 1.0)


def test_one_that_stands_still_is_missed_although_its_pipe_takes_everything(
    guard: GuardProcess,
) -> None:
    guard.renew()
    assert until(guard._has_answered)
    os.kill(guard.pid, signal.SIGSTOP)
    renewed = 0
    while _renews(guard):
        renewed += 1
    assert UNANSWERED_MOST - 1 <= renewed <= UNANSWERED_MOST + 1


def test_one_that_never_answers_is_missed_within_a_second_and_a_quarter(
    guard: GuardProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And not before four renewals have stayed without an answer."""
    monkeypatch.setattr(guard, "_has_answered", lambda: False)
    renewed = 0
    while _renews(guard):
        renewed += 1
    assert renewed == 4
    assert (renewed + 1) * RENEW_S <= 1.25


def test_one_that_answers_is_never_taken_for_one_that_stands_still(guard: GuardProcess) -> None:
    for _ in range(3 * UNANSWERED_MOST):
        guard.renew()
        assert guard._can_be_read_within(60.0)
    for _ in range(UNANSWERED_MOST - 1):  # nor one that is a little late
        guard.renew()
    guard.renew()


def _renews(guard: GuardProcess) -> bool:
    try:
        guard.renew()
    except GuardLost:
        return False
    return True


def test_a_line_of_any_size_fits_while_it_is_starting(tmp_path: Path) -> None:
    guard = GuardProcess(tmp_path)
    os.kill(guard.pid, signal.SIGSTOP)
    for number in range(500):
        guard.lease(lease(number))
    os.kill(guard.pid, signal.SIGCONT)
    assert until_it(guard, lambda: len(read_leases(tmp_path)) == 500)
    guard.end()


def test_what_is_told_again_is_not_sent_again(
    guard: GuardProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = []
    monkeypatch.setattr(guard, "_send", sent.append)
    for _ in range(3):
        guard.lease(lease(1))
    assert len(sent) == 1


def test_a_recorder_that_failed_waits_until_it_has_been_taken_over(
    guard: GuardProcess, tmp_path: Path
) -> None:
    (tmp_path / RUN_LOCK).touch()
    guard.lease(UNKNOWN)
    guard.take_over()
    assert "because the recorder failed" in (tmp_path / "guard.jsonl").read_text()
    assert read_leases(tmp_path) == [UNKNOWN]  # it goes on trying


def test_one_that_took_over_leaves_no_process_that_nobody_awaits(tmp_path: Path) -> None:
    guard = GuardProcess(tmp_path)
    guard.await_ready()
    guard.take_over()  # it holds nothing, so it ends at once
    assert until(lambda: guard._process.returncode is not None)


# -- one after the other ---------------------------------------------------------------------------


def test_a_second_one_waits_for_the_first_and_watches_then(
    guard: GuardProcess, tmp_path: Path
) -> None:
    second = guard_process(tmp_path)
    assert second.stdin is not None
    assert second.stdout is not None
    os.set_blocking(second.stdout.fileno(), False)
    time.sleep(0.5)
    assert second.stdout.read() is None  # not ready: it is not the one
    guard.kill()
    assert until(lambda: second.stdout.read(6) == b"ready\n")  # type: ignore[union-attr]
    second.stdin.write(b"end\n")
    second.communicate(timeout=60)
    assert second.returncode == 0


@pytest.mark.campaign
def test_a_second_one_ends_where_the_first_goes_on(guard: GuardProcess, tmp_path: Path) -> None:
    second = guard_process(tmp_path)
    _, said = second.communicate(timeout=200)
    assert second.returncode == 4
    assert HAS_A_GUARD.encode() in said
    assert _renews(guard)


def test_leases_told_to_one_that_had_not_begun_to_watch_are_kept(tmp_path: Path) -> None:
    """A guard that replaces another one, and whose recorder dies before it is there: the leases are
    in its pipe.
    """
    code = (
        "import os, pathlib, sys; sys.path[:0] = sys.argv[2:]; from support.faults.guarded import"
        " guard_process; "
    )
    code += "guard = guard_process(pathlib.Path(sys.argv[1])); "
    code += (
        "guard.stdin.write(sys.stdin.buffer.read()); guard.stdin.flush(); print(guard.pid,"
        " flush=True); os._exit(0)"
    )
    (tmp_path / RUN_LOCK).touch()
    support = str(Path(__file__).parents[2])
    command = [sys.executable, "-c", code, str(tmp_path), support]
    done = subprocess.run(
        command,
        input=UNKNOWN.to_json().encode() + b"\n",
        check=True,
        timeout=200,
        stdout=subprocess.PIPE,
    )
    assert until(
        lambda: (
            (tmp_path / "guard.jsonl").exists()
            and "guard.took_over" in (tmp_path / "guard.jsonl").read_text()
        ),
        60,
    )
    os.kill(int(done.stdout), signal.SIGKILL)  # else it goes on trying for ten minutes


# -- replaced --------------------------------------------------------------------------------------


def test_the_next_one_is_told_all_leases(tmp_path: Path) -> None:
    told: list[tuple[str, str]] = []
    supervisor = GuardSupervisor(tmp_path, lambda kind, text: told.append((kind, text)))
    for number in range(3):
        supervisor.lease(lease(number))
    first = supervisor.pid
    assert first is not None
    os.kill(first, signal.SIGKILL)
    os.waitid(os.P_PID, first, os.WEXITED | os.WNOWAIT)  # it writes no more
    (tmp_path / LEASES_FILE).unlink(missing_ok=True)
    assert until(lambda: supervisor.renew() or supervisor.pid != first)
    names = {"dde-0", "dde-1", "dde-2"}
    assert until_it(supervisor._guard, lambda: {one.name for one in read_leases(tmp_path)} == names)
    assert [kind for kind, _ in told] == ["guard.lost"]
    supervisor.end()
    assert list(tmp_path.iterdir()) == []
    assert supervisor.pid is None
    for what in (
        supervisor.end,
        supervisor.take_over,
        supervisor.renew,
        lambda: supervisor.lease(lease(1)),
    ):  # there is nobody any more
        what()
    assert [kind for kind, _ in told] == ["guard.lost"]


def test_a_guard_is_replaced_however_often_it_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    supervisor = GuardSupervisor(tmp_path, lambda kind, text: told.append(text))
    supervisor.end()
    patch(monkeypatch, "supervisor.GuardProcess", _Lost)
    supervisor._guard = _Lost(tmp_path)  # type: ignore[assignment]
    for _ in range(50):
        supervisor.renew()
    assert isinstance(supervisor._guard, _Lost)
    assert told == ["The guard was lost (gone) and is being replaced."] * 50


class _Lost:
    """A guard that is never there."""

    def __init__(self, *_: object) -> None: ...

    def identify(self, *_: object) -> None: ...

    def renew(self) -> None:
        raise GuardLost("gone")

    def kill(self) -> None: ...


# -- the pipe --------------------------------------------------------------------------------------


def test_no_other_child_of_the_recorder_has_the_pipe(guard: GuardProcess) -> None:
    """While any process has its writing end the recorder's death would not be seen."""
    assert not os.get_inheritable(guard._pipe)
    pipe = os.readlink(f"/proc/self/fd/{guard._pipe}")  # noqa: PTH115  # no file
    command = [sys.executable, "-S", "-c", "print(flush=True); input()"]
    child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        assert child.stdout is not None
        child.stdout.readline()  # it has begun: until then it closes descriptors
        held = [os.readlink(entry.path) for entry in os.scandir(f"/proc/{child.pid}/fd")]  # noqa: PTH115
        assert pipe not in held
    finally:
        child.communicate(b"\n")


def test_nothing_in_the_package_forks_or_hands_all_descriptors_over() -> None:
    forking = re.compile(
        r'os\.fork|forkpty|multiprocessing\.(?!get_context\("spawn"\))|from'
        r" multiprocessing|close_fds=False|posix_spawn|os\.exec"
    )
    files = PACKAGE.rglob("*.py")
    assert [path.name for path in files if forking.search(path.read_text(encoding="utf-8"))] == []


def test_the_lease_is_closed_at_the_end_whatever_became_of_the_guard(tmp_path: Path) -> None:
    """Else the next start finds tools hot that are safe. A guard that was refused memory at its
    last step left it open.
    """
    supervisor = GuardSupervisor(tmp_path, lambda kind, text: None)
    supervisor.lease(UNKNOWN)
    assert until_it(supervisor._guard, (tmp_path / LEASES_FILE).exists)
    assert supervisor.pid is not None
    os.kill(supervisor.pid, signal.SIGKILL)
    supervisor.end()
    assert not (tmp_path / LEASES_FILE).exists()


def test_a_lease_that_was_handed_over_is_the_guard_s(tmp_path: Path) -> None:
    supervisor = GuardSupervisor(tmp_path, lambda kind, text: None)
    supervisor.lease(UNKNOWN)
    assert until_it(supervisor._guard, (tmp_path / LEASES_FILE).exists)
    assert supervisor._guard is not None
    supervisor._guard._process.kill()  # before it has made anything safe
    supervisor._guard._process.wait()
    supervisor.take_over()
    supervisor.end()
    assert [one.name for one in read_leases(tmp_path)] == [UNKNOWN.name]
