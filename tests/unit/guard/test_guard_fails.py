"""A guard that breaks: it begins again where nobody else comes, and leaves it to the next one where
the recorder lives.
"""

from __future__ import annotations

import errno
import json
import os
import select
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from support.product import (
    ACTION_LOG_FILE,
    DEATH_S,
    DYING_S,
    GUARD_READY,
    GUARD_TRIES,
    LEASES_FILE,
    RECORDER_HUNG_S,
    ActionLog,
    Continuity,
    GuardLost,
    Inquiries,
    LeaseWriter,
    Recorder,
    StationLease,
    Verdict,
    Watch,
    close_lease,
    elapsed,
    guard_run,
    patch,
    read_leases,
    retry_orders,
    take_over_run,
    watch_recorder,
    write_leases,
)

LEASE = StationLease(
    "dde-1", "/dev/no1", 19200, "8N1", 1, "dde", "DDE", "1.0", "stand", (1, 2), False
)
NOTHING = StationLease(
    "dde-2", "/dev/no2", 19200, "8N1", 1, "dde", "DDE", "1.0", "stand", (), False
)


class Other(Recorder):
    """A recorder that lives or is gone."""

    def __init__(self, is_gone: bool) -> None:
        self._gone = is_gone

    def is_gone_within(self, seconds: float) -> bool:
        assert seconds < 1.0  # its tools are hot all the while
        return self._gone


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    told: list[str] = []
    patch(monkeypatch, "guard.show", told.append)
    return told


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Where the recorder reads."""
    read, write = os.pipe()
    patch(monkeypatch, "guard.STDOUT", write)
    yield read
    for descriptor in (read, write):
        with suppress(OSError):
            os.close(descriptor)


def guarded(
    monkeypatch: pytest.MonkeyPatch,
    folder: Path,
    recorder: Recorder,
    faults: int,
    *,
    failed: bool = False,
    silent_s: float = 0.0,
) -> tuple[object, int]:
    """What `_guard` gives, and how often it watched, where its first `faults` watches break."""
    watched: list[Watch] = []

    def watch(one: Watch, lease_writer: LeaseWriter, *, answers: bool) -> Verdict:
        assert answers is (not watched), "one that failed answers no more: the recorder replaces it"
        one.stations = {LEASE.name: LEASE, NOTHING.name: NOTHING}
        one.has_failed, one.heard_at = failed, one.heard_at - (silent_s if not watched else 0.0)
        watched.append(one)
        if len(watched) <= faults:
            raise MemoryError("none is left")
        return Verdict.DEAD

    action_log = ActionLog(folder)
    patch(monkeypatch, "guard._watch", watch)
    patch(monkeypatch, "guard._take_over", lambda *_: ("taken over", ()))
    writer = LeaseWriter(folder, action_log)
    return guard_run(Watch(time.monotonic()), recorder, writer, action_log), len(watched)


@pytest.mark.usefixtures("answers")
def test_one_whose_recorder_lives_watches_until_it_is_replaced(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, said: list[str]
) -> None:
    """A recorder that dies before it has replaced it has nobody else."""
    assert guarded(monkeypatch, tmp_path, Other(is_gone=False), 1) == (("taken over", ()), 2)
    assert said == ["the guard failed, MemoryError: none is left"]


@pytest.mark.usefixtures("answers")
def test_one_that_fails_every_time_leaves_it_to_the_next(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, said: list[str]
) -> None:
    with pytest.raises(GuardLost, match="failed 3 times"):
        guarded(monkeypatch, tmp_path, Other(is_gone=False), 99)
    assert said == ["the guard failed, MemoryError: none is left"] * GUARD_TRIES


@pytest.mark.parametrize(
    ("is_gone", "failed", "silent_s"),
    [(True, False, 0.0), (False, True, 0.0), (False, False, RECORDER_HUNG_S + 0.1)],
    ids=["gone", "failed", "hung"],
)
@pytest.mark.usefixtures("answers")
def test_one_that_nobody_follows_begins_again(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    said: list[str],
    is_gone: bool,
    failed: bool,
    silent_s: float,
) -> None:
    for faults in (1, 2):
        said.clear()
        result = guarded(
            monkeypatch, tmp_path, Other(is_gone), faults, failed=failed, silent_s=silent_s
        )
        assert result == (("taken over", ()), faults + 1)
        assert said == ["the guard failed, MemoryError: none is left"] * faults


@pytest.mark.usefixtures("answers")
def test_one_that_fails_every_time_hands_on_what_may_be_hot(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, said: list[str]
) -> None:
    (left, flooded), watched = guarded(monkeypatch, tmp_path, Other(is_gone=True), 99)  # type: ignore[misc]  # a pair
    assert (left, flooded, watched) == ([LEASE], (), GUARD_TRIES)


@pytest.mark.parametrize("does", [True, False])
def test_one_that_answers_no_more_still_hears(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, answers: int, does: bool
) -> None:
    read, write = os.pipe()
    os.write(write, f"{LEASE.to_json()}\n".encode())
    os.close(write)
    patch(monkeypatch, "guard.STDIN", read)
    os.set_blocking(answers, False)
    watch = Watch(0.0)
    assert (
        watch_recorder(watch, LeaseWriter(tmp_path, ActionLog(tmp_path)), answers=does)
        is Verdict.DEAD
    )
    os.close(read)
    assert watch.stations == {LEASE.name: LEASE}
    assert select.select([answers], [], [], 0)[0] == ([answers] if does else [])


@pytest.mark.parametrize("verdict", [Verdict.DONE, Verdict.DEAD])
def test_nothing_is_taken_over_where_all_is_done(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, answers: int, verdict: Verdict
) -> None:
    action_log = ActionLog(tmp_path)
    patch(monkeypatch, "guard._watch", lambda *_, answers: verdict)
    patch(monkeypatch, "guard._take_over", lambda *_: ("taken over", ()))
    expected = ((), ()) if verdict is Verdict.DONE else ("taken over", ())
    writer, recorder = LeaseWriter(tmp_path, action_log), Other(is_gone=False)
    assert guard_run(Watch(0.0), recorder, writer, action_log) == expected
    assert os.read(answers, 99) == GUARD_READY  # the recorder sees that it is there


# -- taking over -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("verdict", "ended", "why"),
    [
        (Verdict.DEAD, [(DYING_S, DEATH_S)], "the recorder died"),
        (
            Verdict.HUNG,
            [(0.0, DEATH_S)],
            "the recorder did not renew its lease for 2 s and was ended",
        ),
        # it has closed its ports, and has its record to finish
        (Verdict.FAILED, [], "the recorder failed"),
    ],
)
@pytest.mark.parametrize("left", [[], [LEASE]])
def test_the_recorder_is_ended_as_it_needs_and_the_diary_says_why(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    verdict: Verdict,
    ended: list[tuple[float, float]],
    why: str,
    left: list[StationLease],
) -> None:
    ends: list[tuple[float, float]] = []

    class Ends(Other):
        def end(self, grace_s: float, patience_s: float) -> bool:
            ends.append((grace_s, patience_s))
            return True

    class TakesOver:
        flooded = frozenset({"dde-1"})

        def __init__(
            self, stations: list[StationLease], action_log: ActionLog, *, continuity: Continuity
        ) -> None:
            assert ends == ended  # before anybody opens a port that it may hold
            assert stations == [LEASE]
            assert continuity is watch.continuity
            assert 0 <= elapsed() - continuity.died_at < 60

        def run(self) -> list[StationLease]:
            return left

    patch(monkeypatch, "guard.TakeOver", TakesOver)
    watch = Watch(0.0)
    watch.stations = {LEASE.name: LEASE}
    assert take_over_run(watch, verdict, Ends(is_gone=False), ActionLog(tmp_path)) == (
        left,
        {"dde-1"},
    )
    row = json.loads((tmp_path / ACTION_LOG_FILE).read_text())
    outcome, severity = (
        ("not every tool could be made safe", "critical")
        if left
        else ("every tool is in its safe state", "error")
    )
    assert row["text"] == f"The guard took over, because {why}: {outcome}."
    assert (row["kind"], row["severity"], row["station"]) == ("guard.took_over", severity, None)


@pytest.mark.parametrize("is_torn", [False, True])
@pytest.mark.parametrize("left", [[], [LEASE]])
def test_a_lease_is_closed_as_far_as_it_could_be_written_down_why(
    tmp_path: Path, left: list[StationLease], is_torn: bool
) -> None:
    write_leases(tmp_path, [LEASE, NOTHING])
    action_log = ActionLog(tmp_path)
    action_log.reserve(3)
    action_log.is_torn = is_torn
    close_lease(left, LeaseWriter(tmp_path, action_log), action_log)
    assert read_leases(tmp_path) == ([LEASE] if is_torn else left)
    # what has nothing in it is taken away when all is done
    assert (tmp_path / ACTION_LOG_FILE).exists() == bool(left)


def test_one_without_descriptors_ends_when_another_process_has_dealt_with_its_lease(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It can neither write the lease again nor take the lock; a removed lease is seen anyhow."""
    action_log = ActionLog(tmp_path)
    lease_writer = LeaseWriter(tmp_path, action_log)
    lease_writer.put([LEASE])
    lease_writer.settle(60.0)

    def refused(*_: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    patch(monkeypatch, "lease.write_leases", refused)
    patch(monkeypatch, "guard.guard_lock", refused)
    lease_writer.put([LEASE])
    lease_writer.settle(60.0)
    (tmp_path / LEASES_FILE).unlink()
    patch(monkeypatch, "guard.RETRY_EVERY_S", 0.01)
    patch(monkeypatch, "guard.RETRY_FOR_S", 60.0)
    began = time.monotonic()
    with Inquiries(tmp_path) as inquiries:
        retry_orders(tmp_path, [LEASE], (), Continuity(), inquiries, lease_writer, action_log)
    assert time.monotonic() - began < 30
