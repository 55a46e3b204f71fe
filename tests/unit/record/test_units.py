"""Units from events: when each began and ended, in runs that were sealed and in those that a crash
cut off.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.analysis.run import open_run
from jbclog.core.errors import RecordError
from jbclog.core.files import LIMITS, Kind
from jbclog.record.annotations import append, late_serials
from jbclog.record.check import check
from jbclog.record.manifest import Metadata, Unit, iso, read_manifest, write_manifest
from jbclog.record.recover import recover
from jbclog.record.units import only_unit, units_of
from support.records import event_run
from support.records.event_run import Told
from support.records.few_rows import T0

CALM: list[Told] = [
    (1, "unit.begin", "SN-1"),
    (5, "unit.again", "SN-1"),
    (9, "unit.end", "SN-1"),
    (9, "unit.begin", "SN-2"),
]


def run_with(out: Path, told: list[Told], *, crashes: bool = False) -> Path:
    """A run with these events: second, kind, serial."""
    return event_run.run_with(out, told, Metadata(order="88123", units=["SN-0"]), crashes=crashes)


def at(second: int) -> str:
    return iso(T0 + second * 1_000_000)


def test_a_unit_lasts_until_the_next_one_begins(tmp_path: Path) -> None:
    folder = run_with(tmp_path, [*CALM, (20, "unit.end", "SN-2")])
    expected = [Unit("SN-1", at(1), at(9)), Unit("SN-2", at(9), at(20))]
    assert units_of(folder) == expected == read_manifest(folder).units
    assert check(folder) == []


def test_between_two_units_there_may_be_none(tmp_path: Path) -> None:
    folder = run_with(
        tmp_path,
        [
            (1, "unit.begin", "SN-1"),
            (4, "unit.refused", "X"),
            (4, "unit.end", "SN-1"),
            (8, "unit.begin", "SN-2"),
        ],
    )
    assert units_of(folder) == [Unit("SN-1", at(1), at(4)), Unit("SN-2", at(8))]


def test_a_run_without_serials_has_none(tmp_path: Path) -> None:
    assert read_manifest(run_with(tmp_path, [(1, "run.start", None)])).units == []


def test_after_a_crash_the_units_are_in_the_manifest_too_and_the_last_has_no_end(
    tmp_path: Path,
) -> None:
    folder = run_with(tmp_path, CALM, crashes=True)
    assert read_manifest(folder).units == []
    recover(folder)
    assert read_manifest(folder).units == [Unit("SN-1", at(1), at(9)), Unit("SN-2", at(9))]
    assert check(folder) == []


def test_a_manifest_that_names_other_units_than_the_events_is_found(tmp_path: Path) -> None:
    folder = run_with(tmp_path, CALM)
    manifest = read_manifest(folder)
    manifest.units[0] = Unit("SN-9", at(1), at(9))
    write_manifest(folder, manifest)
    assert [str(finding) for finding in check(folder)] == [
        "manifest.json: units: differ from those in the events"
    ]


@pytest.mark.parametrize(
    ("named", "late", "unit"),
    [
        (["1"], [], "1"),
        ([], ["1"], "1"),
        (["1"], ["1"], "1"),
        (["1"], ["2"], None),
        (["1", "2"], [], None),
        ([], [], None),
    ],
)
def test_joints_of_a_run_in_which_no_serial_was_read(
    named: list[str], late: list[str], unit: str | None
) -> None:
    assert only_unit(named, late) == unit


def test_a_serial_may_be_told_late(tmp_path: Path) -> None:
    folder = run_with(tmp_path, [])
    append(folder, who="A. Rossi", what="SN-7", why="the reader was off", kind="unit.late")
    append(folder, who="A. Rossi", what="SN-8 was scrapped", why="cracked joint")
    assert late_serials(folder) == ["SN-7"]


def test_units_beyond_what_a_manifest_can_hold_stay_in_the_events(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run that was recorded can be opened, however many serials somebody scanned."""
    whole = run_with(
        tmp_path / "whole", [(second, "unit.begin", f"SN-{second}") for second in range(1, 41)]
    )
    size = (whole / "manifest.json").stat().st_size
    monkeypatch.setattr("jbclog.record.manifest.LIMITS", {**LIMITS, Kind.MANIFEST: size - 500})
    folder = run_with(
        tmp_path / "short", [(second, "unit.begin", f"SN-{second}") for second in range(1, 41)]
    )
    assert size - 1000 < (folder / "manifest.json").stat().st_size <= size - 500
    kept = read_manifest(folder).units
    assert 30 < len(kept) < 40
    assert kept == units_of(folder)[: len(kept)]
    assert check(folder) == []
    write_manifest(folder, replace(read_manifest(folder), units=kept[:-1]))
    assert any("units: differ" in str(one) for one in check(folder))


def test_what_no_reader_would_take_is_not_sealed_and_stays_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("jbclog.record.manifest.LIMITS", {**LIMITS, Kind.MANIFEST: 700})
    with pytest.raises(
        RecordError, match=r"too much for one record: its manifest has \d+ bytes, at most 700"
    ):
        run_with(tmp_path, CALM)
    (folder,) = tmp_path.iterdir()
    assert read_manifest(folder).state == "open"
    assert open_run(folder).events()["kind"].tolist().count("unit.begin") == 2
