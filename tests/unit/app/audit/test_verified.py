"""A tip that was verified counts as done, from the file beside the runs; what never was is told so,
and is no alarm at first.
"""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

from jbclog.app.audit.records import verified, with_never
from jbclog.config.tasks_file import load_tasks
from jbclog.maintenance.counter_totals.observed import Count, Identity, Observation
from jbclog.maintenance.due import State, TaskState
from jbclog.maintenance.fleet import exit_code
from jbclog.maintenance.fleet_of_ledger import fleet_of
from jbclog.maintenance.ledger import Book
from jbclog.maintenance.verification import Given, keep, own_of, verify

NOW = datetime(2026, 11, 21, 6, 0, tzinfo=UTC)
PLACE = ("hall", "dde-1")
TASKS = [one for one in load_tasks(Path("profiles/tasks/bench.toml")) if one.name == "verification"]


def at(days: float) -> str:
    return (NOW + timedelta(days=days)).isoformat(timespec="milliseconds")


def keep_one(
    runs: Path, days: float, reading: float = 351.0, port: int = 1, due: date = date(2027, 3, 1)
) -> None:
    given = Given("dde-1", port, reading, "TC-7", due, "T-17", "A. Rossi")
    keep(
        runs,
        verify(given, own_of([350.0] * 12, 350.0, 0.0, "T245", "DDE"), NOW + timedelta(days=days)),
    )


def task(runs: Path, days: float = 0.0) -> tuple[TaskState, int]:
    """How it stands, and the audit's exit code, so many days after a first audit."""
    counts = tuple(Count(port, "work_h", "h", 5.0) for port in (1, 2))
    first = Observation(
        at(0),
        at(0),
        *PLACE,
        "/dev/dde-1",
        True,
        identity=Identity("dde", "DDE", "1"),
        counts=counts,
    )
    now = replace(first, time=at(days), audit=at(days))
    facts, wrong = verified(runs, [PLACE])
    assert wrong == []
    looks = [first, now] if days else [first]
    audit = fleet_of(
        Book(Path("counters.jsonl"), [*looks]), [now], at(days), with_never(TASKS, runs), {}, facts
    )
    (found,) = audit.stations[0].tasks
    return found, exit_code(audit)


def test_never_verified_is_told_and_is_due_when_its_days_went_by_since_the_first_audit(
    tmp_path: Path,
) -> None:
    found, code = task(tmp_path)
    assert (found.state, code, found.percent) == (State.UNKNOWN, 0, None)
    assert found.why == f"no verification in {tmp_path / 'verifications.jsonl'} or the ledger"
    assert [(state.state, code) for state, code in (task(tmp_path, 80), task(tmp_path, 91))] == [
        (State.SOON, 0),
        (State.DUE, 1),
    ]


def test_the_last_valid_verification_is_when_it_was_done(tmp_path: Path) -> None:
    keep_one(tmp_path, -60)
    keep_one(tmp_path, -50, reading=400.0)
    keep_one(tmp_path, -1, due=date(2020, 1, 1))  # its instrument proves nothing
    found, code = task(tmp_path)
    assert (found.state, code, found.since, found.part) == (State.FINE, 0, at(-50), "T-17")
    assert (
        found.told_by
        == f"port 1 verified by A. Rossi, FAIL: line 2 of {tmp_path / 'verifications.jsonl'}"
    )
    keep_one(tmp_path, -80, port=2)
    assert task(tmp_path)[0].since == at(-80)  # the port that waits longest
    keep_one(tmp_path, 0, port=2)
    assert task(tmp_path)[0].since == at(-50)


def test_a_file_that_was_changed_is_told_and_its_sound_lines_count(tmp_path: Path) -> None:
    keep_one(tmp_path, -60)
    keep_one(tmp_path, -1)
    file = tmp_path / "verifications.jsonl"
    file.write_bytes(file.read_bytes().replace(b"A. Rossi", b"B. Rossi", 1))
    facts, wrong = verified(tmp_path, [PLACE])
    assert [fact.time for fact in facts] == [at(-1)]
    assert f"{file}: line 1 " in wrong[0]
    file.unlink()
    file.mkdir()
    assert "cannot be read" in verified(tmp_path, [PLACE])[1][0]
