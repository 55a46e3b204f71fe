"""A live store with altered bytes, anywhere: never a crash, never a wrong row, never a loss without
a message.

docs/reference/faults.md, F-29: torn tail, bit rot in the middle, a block of zeros.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from jbclog.core.errors import RecordError
from jbclog.record.check import check
from jbclog.record.manifest import read_manifest
from jbclog.record.recover import recover
from support.faults.altered_files import cut, zeros
from support.records import few_rows

ROWS = 30
Alteration = Callable[[bytearray, int], None]


def flip(data: bytearray, place: int) -> None:
    data[place] ^= 0x20


ALTERATIONS: list[Alteration] = [flip, zeros, cut]


@pytest.fixture(scope="module")
def in_the_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose rows are all still in the write-ahead log."""
    return few_rows.abandoned(tmp_path_factory.mktemp("runs"), commits=3, rows=ROWS // 3)


@pytest.fixture(scope="module")
def in_the_pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose rows are all in the pages of the database, which have no checksums."""
    return few_rows.abandoned(
        tmp_path_factory.mktemp("runs"), commits=3, rows=ROWS // 3, in_pages=True
    )


def altered(folder: Path, home: Path, name: str, alteration: Alteration, place: int) -> Path:
    trial = home / f"{name}-{alteration.__name__}-{place}" / folder.name
    shutil.copytree(folder, trial)
    data = bytearray((trial / name).read_bytes())
    alteration(data, place)
    (trial / name).write_bytes(data)
    return trial


def assert_nothing_is_wrong_silently(folder: Path) -> None:
    try:
        recover(folder)
    except RecordError as error:
        pytest.fail(f"not recovered: {error}")
    numbers = few_rows.sealed_numbers(folder)  # each row is as written
    lost = read_manifest(folder).lost
    assert sorted(set(numbers)) == numbers
    assert lost is not None
    missing = ROWS - len(numbers)
    if missing:
        assert lost.seconds_at_most is None or lost.seconds_at_most >= missing / (ROWS // 3), lost
    findings = [str(finding) for finding in check(folder)]
    # a lost batch of events breaks the chain
    assert all(text.startswith("events/: event") for text in findings), findings
    shutil.rmtree(folder.parent)


def walk(folder: Path, home: Path, name: str, first: int, stride: int) -> int:
    size = (folder / name).stat().st_size
    places = range(first, size, stride)
    for place in places:
        for alteration in ALTERATIONS:
            assert_nothing_is_wrong_silently(altered(folder, home, name, alteration, place))
    return len(places)


def test_the_log_altered_at_some_places(in_the_log: Path, tmp_path: Path) -> None:
    assert walk(in_the_log, tmp_path, "live.sqlite-wal", 11, 13_007) > 5


def test_the_pages_altered_at_some_places(in_the_pages: Path, tmp_path: Path) -> None:
    assert walk(in_the_pages, tmp_path, "live.sqlite", 13, 4909) > 5


def test_the_first_bytes_of_the_pages(in_the_pages: Path, tmp_path: Path) -> None:
    for place in range(0, 110, 15):
        assert_nothing_is_wrong_silently(
            altered(in_the_pages, tmp_path, "live.sqlite", flip, place)
        )


def test_a_complaint_that_quotes_what_is_no_text(in_the_pages: Path, tmp_path: Path) -> None:
    """SQLite quotes damaged words of the schema; if they are not UTF-8, Python raises a different
    error.
    """

    def quoted(data: bytearray, _: int) -> None:
        place = data.index(b"notenote")
        data[place : place + 8] = b"n\xa2te\xa2ote"

    assert_nothing_is_wrong_silently(altered(in_the_pages, tmp_path, "live.sqlite", quoted, 0))


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("remainder", range(4))
def test_the_log_altered_everywhere(
    in_the_log: Path, tmp_path: Path, remainder: int, counted: Callable[..., None]
) -> None:
    places = walk(in_the_log, tmp_path, "live.sqlite-wal", remainder, 44)
    counted(alterations=places * len(ALTERATIONS), wrong_rows=0)


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("remainder", range(4))
def test_the_pages_altered_everywhere(
    in_the_pages: Path, tmp_path: Path, remainder: int, counted: Callable[..., None]
) -> None:
    places = walk(in_the_pages, tmp_path, "live.sqlite", remainder, 16)
    counted(alterations=places * len(ALTERATIONS), wrong_rows=0)
