"""What a guard did stands in the recovered record: as events behind the last one, in the facts, in
the files' list.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from jbclog.core.rows import EventRow, Severity
from jbclog.guard.action_log import NAME, ActionLog
from jbclog.record import conclude as concluding
from jbclog.record.check import check
from jbclog.record.guard_actions import ACTION_LOG as DIARY
from jbclog.record.manifest import ClockStep, Manifest, iso, read_manifest, write_manifest
from jbclog.record.parts import row_groups
from jbclog.record.recover import recover
from support.records import few_rows


@pytest.fixture
def guarded(tmp_path: Path) -> Path:
    """A run whose recorder died, and whose guard could save one of two tools."""
    folder = few_rows.abandoned(tmp_path)
    action_log = ActionLog(folder)
    action_log.write(
        "safety.safe_state",
        "info",
        "The guard put the tool in its safe state, as read back: stand.",
        "a",
        1,
    )
    action_log.write(
        "safety.not_safe", "critical", "The tool could not be made safe; it may be hot.", "a", 2
    )
    action_log.write(
        "guard.took_over", "critical", "The guard took over, because the recorder died."
    )
    return folder


def events(folder: Path) -> list[tuple[str, str | None, int | None]]:
    rows = [row for group in row_groups(folder, "events") for row in group.to_pylist()]
    return [(row["kind"], row["station"], row["port"]) for row in rows]


def test_guard_and_record_mean_the_same_file() -> None:
    assert NAME == DIARY


def test_its_diary_becomes_events_behind_the_recorders_and_facts(guarded: Path) -> None:
    recover(guarded)
    assert events(guarded)[-3:] == [
        ("safety.safe_state", "a", 1),
        ("safety.not_safe", "a", 2),
        ("guard.took_over", None, None),
    ]
    facts = read_manifest(guarded).stations[0]
    assert facts.safe_state == {1: "verified", 2: "failed"}
    assert facts.unsafe == ["a port 2: The tool could not be made safe; it may be hot."]
    assert DIARY in [file.path for file in read_manifest(guarded).files]
    assert check(guarded) == []


def test_a_recovery_that_is_cut_off_behind_the_events_and_done_again_has_them_once(
    guarded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def torn(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(concluding, "write_manifest", torn)
        with pytest.raises(KeyboardInterrupt):
            recover(guarded)
    recover(guarded)
    assert [kind for kind, _, _ in events(guarded)].count("guard.took_over") == 1
    assert check(guarded) == []


def test_a_torn_last_line_is_no_event(guarded: Path) -> None:
    with (guarded / DIARY).open("a", encoding="utf-8") as file:
        file.write(json.dumps({"time": 1, "kind": "guard.took_over"})[:-4])
    recover(guarded)
    assert events(guarded)[-1][0] == "guard.took_over"
    assert check(guarded) == []


@pytest.mark.parametrize("size", [-20.0, 3600.0, -86_400.0, 1_790_000_000.0])
def test_its_lines_get_the_runs_time_if_the_hosts_clock_was_stepped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: float
) -> None:
    store = few_rows.begun(tmp_path)
    write_manifest(store.folder, Manifest(store.folder.name, clock_steps=[]))
    few_rows.hand_over(store, range(50))
    stepped_us = few_rows.T0 + 5_000_000
    step = EventRow(stepped_us, "clock.step", Severity.WARNING, "Stepped.", value=size, raw="then")
    store.event(step)
    store.commit_now()
    few_rows.vanish(store)
    took_over_us = stepped_us + 2_000_000
    monkeypatch.setattr("time.time_ns", lambda: (took_over_us + round(size * 1e6)) * 1000)
    ActionLog(store.folder).write("guard.took_over", "critical", "The guard took over.")
    recover(store.folder)
    last = [row for group in row_groups(store.folder, "events") for row in group.to_pylist()][-1]
    assert last["kind"] == "guard.took_over"
    assert last["time"].timestamp() == pytest.approx(took_over_us / 1e6, abs=0.001)
    manifest = read_manifest(store.folder)
    assert manifest.clock_steps == [ClockStep(iso(stepped_us), size, size)]
    assert manifest.stop == iso(took_over_us)
    assert check(store.folder) == []
