"""The log's tail: what SQLite believes is believed, what it leaves out is counted."""

from __future__ import annotations

import random
import shutil
import sqlite3
from pathlib import Path

import few_rows
import pytest

from jbclog.record.torn import torn_commits


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return few_rows.abandoned(tmp_path_factory.mktemp("runs"), commits=6, rows=3)


def log_of(folder: Path) -> Path:
    return folder / "live.sqlite-wal"


def believed_by_sqlite(folder: Path) -> int:
    """How many commits of the six SQLite finds; each brought one batch of samples."""
    connection = sqlite3.connect(folder / "live.sqlite")
    try:
        (count,) = connection.execute("SELECT count(*) FROM batch WHERE name = 'samples'").fetchone()
        return int(count)
    except sqlite3.DatabaseError:
        return 0
    finally:
        connection.close()


def test_a_log_after_a_kill_is_whole(folder: Path) -> None:
    assert torn_commits(log_of(folder)) == 0


def test_no_log_and_an_empty_one(tmp_path: Path) -> None:
    assert torn_commits(tmp_path / "none") == 0
    (tmp_path / "empty").write_bytes(b"")
    assert torn_commits(tmp_path / "empty") == 0


def test_a_tail_cut_off_in_a_frame_is_no_commit(folder: Path, tmp_path: Path) -> None:
    """What a power cut leaves of a transaction that was never acknowledged."""
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    data = log_of(copy).read_bytes()
    log_of(copy).write_bytes(data[:-100])
    assert torn_commits(log_of(copy)) == 0


@pytest.mark.parametrize("seed", range(40))
def test_damage_anywhere_loses_no_commit_uncounted(folder: Path, tmp_path: Path, seed: int) -> None:
    """Found by SQLite plus counted as torn is never less than what was acknowledged."""
    rng = random.Random(seed)
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    data = bytearray(log_of(copy).read_bytes())
    place = rng.randrange(len(data))
    data[place] ^= 1 << rng.randrange(8)
    log_of(copy).write_bytes(data)
    torn = torn_commits(log_of(copy))
    assert believed_by_sqlite(copy) + torn >= 6


def test_a_page_of_zeros_in_the_middle(folder: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    data = bytearray(log_of(copy).read_bytes())
    middle = len(data) // 2
    data[middle : middle + 4096] = bytes(4096)
    log_of(copy).write_bytes(data)
    torn = torn_commits(log_of(copy))
    assert torn >= 1
    assert believed_by_sqlite(copy) + torn >= 6
