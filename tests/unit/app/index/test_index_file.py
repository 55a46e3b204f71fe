"""The index's file: what is damaged, foreign or locked has no entries, and is no error; where it
may lie.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from jbclog.app.index import index_file
from jbclog.app.index.index_file import CREATE, NAME, IndexFile, cache_folder

KEY = (b"p" * 16, "run", b"one")
STAMP = b"s" * 16


def written(path: Path, *data: bytes) -> None:
    file = IndexFile(path)
    for number, one in enumerate(data or (b"data",)):
        file.put(*KEY[:2], KEY[2] if number == 0 else b"%d" % number, STAMP, one)
    file.close()


def read(path: Path, key: tuple[bytes, str, bytes] = KEY, stamp: bytes = STAMP) -> bytes | None:
    file = IndexFile(path)
    found = file.data_of(*key, stamp)
    file.close()
    return found


def test_an_entry_is_that_of_its_key_and_stamp(tmp_path: Path) -> None:
    path = tmp_path / NAME
    written(path)
    assert read(path) == b"data"
    assert read(path, stamp=b"t" * 16) is None
    for key in (
        (b"q" * 16, "run", b"one"),
        (KEY[0], "idle_error_c", b"one"),
        (KEY[0], "run", b"two"),
    ):
        assert read(path, key) is None


def test_an_entry_of_another_version_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path / NAME)
    monkeypatch.setattr(index_file, "BY", b"jbclog 99")
    assert read(tmp_path / NAME) is None


@pytest.mark.parametrize("column", ["place", "kind", "run", "stamp", "data", "sum"])
def test_a_changed_cell_is_no_entry(tmp_path: Path, column: str) -> None:
    path = tmp_path / NAME
    written(path)
    new = {"kind": "'idle_error_c'", "run": "x'74776f'"}.get(column, f"x'{'70' * 15}71'")
    with sqlite3.connect(path) as database:
        database.execute(f"UPDATE entries SET {column} = {new}")
        (now,) = database.execute("SELECT place, kind, run, stamp FROM entries").fetchall()
    assert read(path, now[:3], now[3]) is None


@pytest.mark.parametrize("cell", ["NULL", "'text'", "7", "1.5"])
def test_a_cell_of_another_type_is_no_entry(tmp_path: Path, cell: str) -> None:
    path = tmp_path / NAME
    written(path)
    for column in ("stamp", "data", "sum"):
        with sqlite3.connect(path) as database:
            database.execute(f"UPDATE entries SET {column} = {cell}")
        assert read(path) is None


def bytes_of(data: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(data)


def schema(*statements: str) -> Callable[[Path], object]:
    def make(path: Path) -> None:
        path.unlink(missing_ok=True)
        with sqlite3.connect(path) as database:
            for statement in statements:
                database.execute(statement)

    return make


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:6000])


FOREIGN: dict[str, Callable[[Path], object]] = {
    "empty": bytes_of(b""),
    "text": bytes_of(b"hello" * 1000),
    "half": cut,
    "a head alone": bytes_of(b"SQLite format 3\0" + bytes(84)),
    "another table": schema("CREATE TABLE other (x)"),
    "newer": schema(CREATE.replace("sum,", "sum, more,")),
    "a view": schema(
        "CREATE TABLE t (place, kind, run, stamp, data, sum)",
        "CREATE VIEW entries AS SELECT * FROM t",
    ),
    "a trigger": schema(
        CREATE, "CREATE TRIGGER t AFTER INSERT ON entries BEGIN DELETE FROM entries; END"
    ),
    "a link": lambda path: (path.unlink(), path.symlink_to("/dev/zero")),
    "a pipe": lambda path: (path.unlink(), os.mkfifo(path)),
}


@pytest.mark.parametrize("foreign", FOREIGN.values(), ids=FOREIGN)
def test_what_is_not_ours_is_built_anew(tmp_path: Path, foreign: Callable[[Path], object]) -> None:
    path = tmp_path / NAME
    written(path)
    foreign(path)
    assert read(path) is None
    written(path)
    assert read(path) == b"data"


def test_a_file_beyond_the_limit_is_built_anew(tmp_path: Path) -> None:
    path = tmp_path / NAME
    written(path)
    os.truncate(path, 3 << 30)  # sparse
    assert read(path) is None
    written(path)
    assert path.stat().st_size < 1 << 20
    assert read(path) == b"data"


def test_each_damaged_byte_costs_at_most_the_entry(tmp_path: Path) -> None:
    path = tmp_path / NAME
    written(path, *(b"%d" % number * 300 for number in range(20)))
    whole = path.read_bytes()
    for at in range(0, len(whole), 61):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x5A]) + whole[at + 1 :])
        assert read(path) in (None, b"0" * 300)


def test_a_folder_in_its_place_is_no_index(tmp_path: Path) -> None:
    (tmp_path / NAME / "full").mkdir(parents=True)
    written(tmp_path / NAME)
    assert read(tmp_path / NAME) is None


def test_what_cannot_be_written_is_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / NAME
    written(path)
    monkeypatch.setattr(index_file, "SPARE_PAGES", (2 << 30) // 4096 - 3)  # three pages for all
    written(path, b"0" * 100_000)
    assert read(path) is None  # a full one is removed, and begun anew
    written(path)
    assert read(path) == b"data"


def test_the_folder_is_the_users_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = cache_folder()
    assert folder == tmp_path / "jbclog"
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o770)
    assert cache_folder() is None
    folder.rmdir()
    (tmp_path / "elsewhere").mkdir()
    folder.symlink_to(tmp_path / "elsewhere")
    assert cache_folder() is None


def test_a_relative_path_in_the_environment_does_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "jbclog"


@pytest.mark.parametrize("home", ["/proc/self/nothing", "/dev/null"])
def test_where_nothing_can_be_created_there_is_none(
    home: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", home)
    assert cache_folder() is None


def test_nothing_is_created_below_the_home_of_another_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / ".cache"))
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    assert cache_folder() is None
    assert not (tmp_path / ".cache").exists()
