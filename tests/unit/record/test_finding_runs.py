"""Runs are found by anything said of them, whatever else is in the folder, and quickly."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from jbclog.core.locks import FolderLock
from jbclog.core.rows import StationFacts
from jbclog.record.annotations import append
from jbclog.record.find_runs import Filter, Found, Unreadable, find, summary_of
from jbclog.record.manifest import (
    NAME,
    LineFile,
    Manifest,
    Metadata,
    RecipeFile,
    Unit,
    manifest_text,
    write_manifest,
)

SAID = Metadata(
    "A. Rossi",
    "88123",
    'board "7"',
    ["SN-0"],
    {"shift": "früh"},
    ["W-7"],
    ["F-1"],
    ["T1", "ale-1:1=T2"],
)
FULL = Manifest(
    "20261121T013000Z-bench-3-k7qd",
    state="sealed",
    exit_status="success",
    exit_code=0,
    verdict="ACCEPT",
    start="2026-11-21T01:30:00.500000Z",
    stop="2026-11-21T01:59:59.000000Z",
    line=LineFile("bench-3", "line.toml", "ab"),
    recipes=[RecipeFile("recipes/a.toml", "cd", "sn100c-tht", 7)],
    metadata=SAID,
    units=[Unit("SN-1", "2026-11-21T01:31:00.000000Z")],
    stations=[StationFacts("ale-1", "url", "ale")],
)
OTHER = Manifest(
    "20261122T013000Z-bench-4-k7qd",
    state="sealed",
    exit_status="failed",
    verdict="REJECT",
    start="2026-11-22T01:30:00.000000Z",
    line=LineFile("bench-4", "line.toml", "ab"),
    recipes=[RecipeFile("recipes/a.toml", "cd", "other", "b")],
    stations=[StationFacts("dde-1", "url", "dde")],
)


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    for manifest in (OTHER, FULL):
        (tmp_path / manifest.run).mkdir()
        write_manifest(tmp_path / manifest.run, manifest)
    return tmp_path


def names(found: Iterator[Found | Unreadable]) -> list[str]:
    return [one.folder.name for one in found]


def utc(text: str) -> datetime:
    return datetime.fromisoformat(text).replace(tzinfo=UTC)


FITTING = [
    Filter(operator="A. Rossi"),
    Filter(operator="* Rossi"),
    Filter(order="88123"),
    Filter(order="881*"),
    Filter(product='board "7"'),
    Filter(unit="SN-0"),
    Filter(unit="SN-1"),
    Filter(unit="*1"),
    Filter(wire_lot="W-7"),
    Filter(flux_lot="F-1"),
    Filter(tip="T1"),
    Filter(tip="T2"),
    Filter(tip="ale-1:1=T2"),
    Filter(tags={"shift": "früh"}),
    Filter(tags={"shift": "*"}),
    Filter(recipe="sn100c-tht"),
    Filter(recipe="sn100c-tht@7"),
    Filter(line="bench-3"),
    Filter(station="ale-1"),
    Filter(verdict="accept"),
    Filter(state="ended"),
    Filter(until=utc("2026-11-21T01:30:01")),
    Filter(order="88123", ended_since=utc("2026-11-21T01:59:59")),
    Filter(operator="A. Rossi", order="88123", since=utc("2026-11-21T01:30:00.5")),
]


@pytest.mark.parametrize("wanted", FITTING, ids=repr)
def test_a_run_is_found_by_anything_that_was_said_of_it(runs: Path, wanted: Filter) -> None:
    assert names(find(runs, wanted)) == [FULL.run]


NOT_FITTING = [
    Filter(order="88123", ended_since=utc("2026-11-21T02:00:00")),
    Filter(operator="Rossi"),
    Filter(order="881"),
    Filter(unit="SN"),
    Filter(unit="SN-1", order="1"),
    Filter(tags={"shift": "spät"}),
    Filter(tags={"früh": "shift"}),
    Filter(recipe="sn100c-tht@8"),
    Filter(recipe="sn100c"),
    Filter(verdict="INCONCLUSIVE"),
    Filter(until=utc("2026-11-21T01:30:00.5")),
    Filter(since=utc("2026-11-23")),
]


@pytest.mark.parametrize("wanted", NOT_FITTING, ids=repr)
def test_what_does_not_fit_whole_is_not_found(runs: Path, wanted: Filter) -> None:
    assert names(find(runs, wanted)) == []


NO_TIMES = ["x\ny", "0001-01-01T00:00:00Z", "2026-11-21T01:59:59", "9999-99-99T99:99:99Z"]


@pytest.mark.parametrize("time", NO_TIMES)
@pytest.mark.parametrize("key", ["start", "stop"])
def test_a_time_that_is_none_is_a_finding_of_its_folder_alone(
    runs: Path, key: str, time: str
) -> None:
    write_manifest(runs / FULL.run, replace(FULL, **{key: time}))
    for wanted in (Filter(), Filter(ended_since=utc("2026-01-01"), since=utc("2026-01-01"))):
        found = [*find(runs, wanted)]
        assert [type(one) for one in found] == [Unreadable, Found]
        assert names(iter(found)) == [FULL.run, OTHER.run]


def test_without_a_filter_all_are_told_in_the_order_of_time(runs: Path) -> None:
    assert names(find(runs)) == [FULL.run, OTHER.run]


def test_one_run_may_be_asked_for_itself(runs: Path) -> None:
    assert names(find(runs / FULL.run)) == [FULL.run]


def test_a_run_under_another_name_is_found_by_its_time(runs: Path) -> None:
    (runs / FULL.run).rename(runs / "kept for the audit")
    assert names(find(runs, Filter(since=utc("2026-11-21"), until=utc("2026-11-22")))) == [
        "kept for the audit"
    ]


def test_a_serial_that_was_told_late_finds_the_run(runs: Path) -> None:
    append(
        runs / OTHER.run, who="A. Rossi", what="SN-7", why="the reader was off", kind="unit.late"
    )
    assert names(find(runs, Filter(unit="SN-7"))) == [OTHER.run]


def test_what_else_lies_there_is_no_run(runs: Path) -> None:
    (runs / "notes").mkdir()
    (runs / "notes.txt").write_text("x")
    assert len(list(find(runs))) == 2


def test_a_folder_that_may_not_be_entered_hides_no_run(
    runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk has one, `lost+found`."""
    (runs / "lost+found").mkdir()
    exists = Path.exists

    def refused(path: Path) -> bool:
        if path.parent.name == "lost+found":
            raise PermissionError(errno.EACCES, "Permission denied")
        return exists(path)

    monkeypatch.setattr(Path, "exists", refused)
    assert len(list(find(runs))) == 2


# -- not sealed ------------------------------------------------------------------------------------


def test_a_run_that_goes_on_and_one_that_crashed(runs: Path) -> None:
    folder = runs / FULL.run
    write_manifest(folder, replace(FULL, state="open", exit_status=None, verdict=None))
    lock = FolderLock.take(folder)
    assert [one.state for one in find(folder) if isinstance(one, Found)] == ["running"]
    lock.release()
    assert [one.state for one in find(runs, Filter(state="crashed")) if isinstance(one, Found)] == [
        "crashed"
    ]


# -- damaged ---------------------------------------------------------------------------------------

TEXT = manifest_text(FULL)
DAMAGED = {
    "empty": "",
    "cut": TEXT[: len(TEXT) // 2],
    "no object": "[]",
    "another state": TEXT.replace('"sealed"', '"closed"'),
    "newer": TEXT.replace('"schema": 2', '"schema": 999'),
    "wrong kind": TEXT.replace('"88123"', "88123"),
    "wrong time": TEXT.replace("2026-11-21T01:30:00", "2026-99-21T01:30:00"),
    "deep": "[" * 100_000,
}


@pytest.mark.parametrize("text", DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_manifest_is_told_and_the_others_are_found(runs: Path, text: str) -> None:
    (runs / FULL.run / NAME).write_text(text)
    damaged, other = find(runs)
    assert isinstance(damaged, Unreadable)
    assert other.folder.name == OTHER.run


@pytest.mark.parametrize(
    "wanted", [Filter(order="1"), Filter(unit="x"), Filter(until=utc("2026-11-22"))], ids=repr
)
def test_of_a_damaged_one_nobody_can_say_whether_it_fits(runs: Path, wanted: Filter) -> None:
    (runs / FULL.run / NAME).write_text(DAMAGED["cut"])
    (one,) = find(runs, wanted)
    assert isinstance(one, Unreadable)


def test_a_folder_that_was_cut_off_at_its_very_start(runs: Path) -> None:
    (runs / FULL.run / NAME).unlink()
    one = summary_of(runs / FULL.run)
    assert isinstance(one, Unreadable)
    assert "no manifest" in one.why


def test_a_changed_manifest_is_found_by_what_it_says_now_and_that_is_told(runs: Path) -> None:
    (runs / OTHER.run / NAME).write_text(manifest_text(OTHER).replace("REJECT", "ACCEPT"))
    found = [one for one in find(runs, Filter(verdict="ACCEPT")) if isinstance(one, Found)]
    assert [(one.folder.name, bool(one.changed)) for one in found] == [
        (FULL.run, False),
        (OTHER.run, True),
    ]
