"""A manifest of schema 1 is read with the names of today, by whoever reads it."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path

import pytest

from jbclog.record.find_runs import Filter, Found, Unreadable, summary_of
from jbclog.record.manifest import NAME, Unit, read_manifest

FROM, AFTER, TO = (f"2026-09-21T14:13:{second}.000000Z" for second in (18, 19, 22))
OLD = {
    "run": "20260921T141318Z-bench-6vq7",
    "schema": 1,
    "state": "sealed",
    "started": FROM,
    "ended": TO,
    "stations": [{"name": "dde-1", "url": "", "family": "dde", "tools": {"1": "T245"}}],
    "verdict_rules": [{"name": "coverage", "limit": 99.5, "unit": "%"}],
    "units": [{"serial": "SN-1", "begin": AFTER, "end": None}],
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "20260921T141318Z-bench-6vq7"
    folder.mkdir()
    (folder / NAME).write_text(json.dumps(OLD, indent=1), "utf-8")
    return folder


def test_its_manifest_has_the_names_of_today(folder: Path) -> None:
    manifest = read_manifest(folder)
    assert (manifest.start, manifest.stop) == (FROM, TO)
    assert manifest.units == [Unit("SN-1", start=AFTER, stop=None)]
    assert manifest.stations[0].tool_names == {1: "T245"}
    assert manifest.verdict_rules == [{"name": "coverage", "limit_value": 99.5, "uom": "%"}]


def test_its_summary_has_them(folder: Path) -> None:
    found = summary_of(folder)
    assert isinstance(found, Found)
    assert (found.start, found.stop, found.units) == (FROM, TO, ("SN-1",))


@pytest.mark.parametrize(
    ("since", "is_found"), [("2026-09-21T14:13:20Z", True), ("2026-09-21T14:13:23Z", False)]
)
def test_its_end_keeps_it_from_being_read(folder: Path, since: str, is_found: bool) -> None:
    found = summary_of(folder, Filter(ended_since=datetime.fromisoformat(since)))
    assert (found is not None) is is_found


@pytest.mark.parametrize(
    "other", [{"units": None}, {"units": 3}, {"units": ["SN-1"]}, {"started": 3}]
)
def test_what_is_none_is_refused_as_one(folder: Path, other: dict[str, object]) -> None:
    (folder / NAME).write_text(json.dumps({**OLD, **other}, indent=1), "utf-8")
    assert isinstance(summary_of(folder), Unreadable)
