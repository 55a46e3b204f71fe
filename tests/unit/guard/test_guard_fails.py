"""A guard that breaks: it begins again where nobody else comes, and leaves it to the next one where the recorder lives."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from jbclog.guard import __main__ as guard_itself
from jbclog.guard.diary import Diary
from jbclog.guard.lease import StationLease
from jbclog.guard.recorder import Recorder
from jbclog.guard.shelf import Shelf
from jbclog.guard.watch import HUNG_S, Verdict, Watch

LEASE = StationLease("dde-1", "/dev/no1", 19200, "8N1", 1, "dde", "DDE", "1.0", "stand", (1, 2), False)
NOTHING = StationLease("dde-2", "/dev/no2", 19200, "8N1", 1, "dde", "DDE", "1.0", "stand", (), False)


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
    monkeypatch.setattr(guard_itself, "say", told.append)
    return told


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Where the recorder reads."""
    read, write = os.pipe()
    monkeypatch.setattr(guard_itself, "STDOUT", write)
    yield read
    for descriptor in (read, write):
        with suppress(OSError):
            os.close(descriptor)


def guarded(
    monkeypatch: pytest.MonkeyPatch, folder: Path, recorder: Recorder, faults: int, *, failed: bool = False, silent_s: float = 0.0
) -> tuple[object, int]:
    """What `_guard` gives, and how often it watched, where its first `faults` watches break."""
    watched: list[Watch] = []

    def watch(one: Watch, shelf: Shelf) -> Verdict:
        one.stations = {LEASE.name: LEASE, NOTHING.name: NOTHING}
        one.has_failed, one.heard_at = failed, one.heard_at - (silent_s if not watched else 0.0)
        watched.append(one)
        if len(watched) <= faults:
            raise MemoryError("none is left")
        return Verdict.DEAD

    diary = Diary(folder)
    monkeypatch.setattr(guard_itself, "_watch", watch)
    monkeypatch.setattr(guard_itself, "_take_over", lambda *_: ("taken over", ()))
    return guard_itself._guard(recorder, Shelf(folder, diary), diary), len(watched)


@pytest.mark.usefixtures("answers")
def test_one_whose_recorder_lives_leaves_it_to_the_next(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, said: list[str]) -> None:
    with pytest.raises(MemoryError):
        guarded(monkeypatch, tmp_path, Other(is_gone=False), 1)
    assert said == []  # `main` says it, once


@pytest.mark.parametrize(
    ("is_gone", "failed", "silent_s"),
    [(True, False, 0.0), (False, True, 0.0), (False, False, HUNG_S + 0.1)],
    ids=["gone", "failed", "hung"],
)
@pytest.mark.usefixtures("answers")
def test_one_that_nobody_follows_begins_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, said: list[str], is_gone: bool, failed: bool, silent_s: float
) -> None:
    for faults in (1, 2):
        said.clear()
        result = guarded(monkeypatch, tmp_path, Other(is_gone), faults, failed=failed, silent_s=silent_s)
        assert result == (("taken over", ()), faults + 1)
        assert said == ["the guard failed, MemoryError: none is left"] * faults


@pytest.mark.usefixtures("answers")
def test_one_that_fails_every_time_hands_on_what_may_be_hot(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, said: list[str]
) -> None:
    (left, flooded), watched = guarded(monkeypatch, tmp_path, Other(is_gone=True), 99)  # type: ignore[misc]  # a pair
    assert (left, flooded, watched) == ([LEASE], (), guard_itself.TRIES)


@pytest.mark.parametrize("verdict", [Verdict.DONE, Verdict.DEAD])
def test_nothing_is_taken_over_where_all_is_done(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, answers: int, verdict: Verdict
) -> None:
    diary = Diary(tmp_path)
    monkeypatch.setattr(guard_itself, "_watch", lambda *_: verdict)
    monkeypatch.setattr(guard_itself, "_take_over", lambda *_: ("taken over", ()))
    expected = ((), ()) if verdict is Verdict.DONE else ("taken over", ())
    assert guard_itself._guard(Other(is_gone=False), Shelf(tmp_path, diary), diary) == expected
    assert os.read(answers, 99) == guard_itself.READY  # the recorder sees that it is there
