"""Recorded runs of every family, replayed: the tables must equal those stored with the runs."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from support.product import FAMILIES, is_capture_done, load_line, wire_paths
from support.readers.run_files import read_rows
from support.records.demonstration import RUNS, TABLES, profiles, tables_of
from support.virtual.captured_run import relived

ANEW = (
    "after a change to what sessions ask: python tests/support records.demonstration {name}, and"
    " read what git shows"
)
MOST_BYTES = 400_000
DEMONSTRATIONS = sorted(path.name for path in RUNS.iterdir())

each = pytest.mark.parametrize("name", DEMONSTRATIONS)
relived_once = cache(lambda name: relived(RUNS / name))  # for all that only look at it


@each
def test_the_decoded_tables_are_those_that_were_kept(name: str) -> None:
    memory, left = relived_once(name)
    assert left == {}, ANEW.format(name=name)
    found = tables_of(memory)
    for table in TABLES:
        assert found[table] == (RUNS / name / f"{table}.csv").read_text(), ANEW.format(name=name)


@each
def test_it_shows_the_station_with_its_trouble(name: str) -> None:
    memory, _ = relived_once(name)
    (facts,) = memory.stations.values()
    kinds = memory.kinds()
    assert facts.outcome == "completed", facts.reason
    assert "station.ready" in kinds
    assert ("link.lost" in kinds, "link.back" in kinds) == (True, True)
    assert (
        sum(row.what == "heard" for path in wire_paths(RUNS / name) for row in read_rows(path)) > 50
    )
    assert not memory.stations.keys() ^ {load_line(RUNS / name / "line.toml").stations[0].name}


def test_every_profile_and_every_family_has_one() -> None:
    missing = profiles().keys() - set(DEMONSTRATIONS)
    assert not missing, f"python tests/support records.demonstration {' '.join(missing)}"
    shown = {load_line(RUNS / name / "line.toml").stations[0].family for name in DEMONSTRATIONS}
    assert shown >= FAMILIES.keys()


def test_they_are_whole_and_small() -> None:
    files = [path for path in RUNS.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < MOST_BYTES
    for path in (path for name in DEMONSTRATIONS for path in wire_paths(RUNS / name)):
        assert is_capture_done(path)


def test_they_name_no_machine() -> None:
    """The test that searches for machine names cannot read packed texts."""
    for path in (path for name in DEMONSTRATIONS for path in wire_paths(RUNS / name)):
        texts = {row.text for row in read_rows(path) if row.what not in ("sent", "heard")}
        assert not any(Path(text).is_absolute() and not text.startswith("/dev/") for text in texts)
