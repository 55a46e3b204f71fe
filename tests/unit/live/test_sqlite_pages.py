"""Pages and rows of SQLite, read without a lock: always one committed state, the same as SQLite's
own.
"""

from __future__ import annotations

import os
import random
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path

import pytest

from jbclog.live import sqlite_pages
from jbclog.live.sqlite_pages import DatabasePages, Malformed
from jbclog.live.sqlite_rows import Value, roots, row, rows

Rows = list[tuple[int, list[Value]]]
WRITER = """
import os, random, sqlite3, sys
path, commits = sys.argv[1], int(sys.argv[2])
random.seed(5)
db = sqlite3.connect(path, isolation_level=None)
db.executescript("PRAGMA journal_mode = WAL; PRAGMA synchronous = OFF;"
                 "PRAGMA wal_autocheckpoint = 40;"
                 "CREATE TABLE t (number INTEGER PRIMARY KEY, commit_number INTEGER, data BLOB);")
print("ready", flush=True)
number = 0
for commit in range(1, commits + 1):
    db.execute("BEGIN IMMEDIATE")
    for _ in range(random.randrange(1, 5)):
        number += 1
        data = number.to_bytes(4, "big") * random.randrange(1, 6000)
        db.execute("INSERT INTO t VALUES (?, ?, ?)", (number, commit, data))
    db.execute("UPDATE t SET commit_number = ? WHERE number = 1", (commit,))
    if commit % 50 == 0:
        db.execute("DELETE FROM t WHERE number > 1 AND number < ?", (number - 60,))
    db.execute("COMMIT")
    if commit % 30 == 0:
        sys.stdin.readline()  # the reader has seen a state since
"""


def read_all(pages: DatabasePages) -> Rows:
    return [(one.number, one.values(pages)) for one in rows(pages, roots(pages)["t"])]


def read_once(path: Path) -> Rows:
    with closing(DatabasePages(path)) as pages:
        return pages.snapshot(read_all)


def made(path: Path, *values: object) -> sqlite3.Connection:
    db = sqlite3.connect(path, isolation_level=None)
    db.executescript(
        "PRAGMA journal_mode = WAL; PRAGMA synchronous = OFF; CREATE TABLE t (number INTEGER"
        " PRIMARY KEY, value)"
    )
    db.execute("BEGIN")
    db.executemany("INSERT INTO t (value) VALUES (?)", ((value,) for value in values))
    db.execute("COMMIT")
    return db


def as_sqlite_reads(path: Path) -> Rows:
    with closing(sqlite3.connect(path)) as db:
        return [
            (number, [None, value])
            for number, value in db.execute("SELECT number, value FROM t ORDER BY number")
        ]


VALUES = [
    *(
        None,
        0,
        1,
        -1,
        127,
        128,
        -32_768,
        1 << 20,
        -(1 << 31),
        1 << 40,
        (1 << 63) - 1,
        -(1 << 63),
        1.5,
        -2e300,
    ),
    *(
        "",
        "350 °C",
        "x" * 4_061,
        "x" * 4_062,
        b"",
        b"\x00\xff",
        bytes(100),
        *(bytes(4_000 + step) for step in range(0, 200, 7)),
    ),
    *(random.Random(1).randbytes(300_000), "ä" * 50_000),
]


@pytest.mark.parametrize("page_size", [512, 4096, 65_536])
def test_every_kind_of_value(tmp_path: Path, page_size: int) -> None:
    path = tmp_path / "t.sqlite"
    with closing(sqlite3.connect(path)) as db:
        db.execute(f"PRAGMA page_size = {page_size}")
        db.execute("VACUUM")
    with closing(made(path, *VALUES)):
        in_log = read_once(path)
    in_file = read_once(path)
    assert not path.with_name("t.sqlite-wal").exists()
    assert in_log == in_file == as_sqlite_reads(path)
    assert [value for _, (_, value) in in_file] == VALUES


def test_a_row_is_found_by_its_number_and_rows_after_one(tmp_path: Path) -> None:
    path = tmp_path / "t.sqlite"
    with closing(made(path, *range(3000))) as db:
        db.execute("DELETE FROM t WHERE number % 3 = 0")

        def read(pages: DatabasePages) -> tuple[list[int], list[bool]]:
            root = roots(pages)["t"]
            return [one.number for one in rows(pages, root, 2990)], [
                row(pages, root, n) is not None for n in (1, 2, 3, 3000, 3001)
            ]

        with closing(DatabasePages(path)) as pages:
            assert pages.snapshot(read) == (
                [2992, 2993, 2995, 2996, 2998, 2999],
                [True, True, False, False, False],
            )


def test_rolled_back_rows_are_not_seen(tmp_path: Path) -> None:
    path = tmp_path / "t.sqlite"
    with closing(made(path, "before")) as db, closing(DatabasePages(path)) as pages:
        db.execute("PRAGMA cache_size = 1")  # it writes frames before the commit
        db.execute("BEGIN")
        for _ in range(100):
            db.execute("INSERT INTO t (value) VALUES (?)", (bytes(5000),))
        assert len(pages.snapshot(read_all)) == 1
        db.execute("ROLLBACK")
        assert len(pages.snapshot(read_all)) == 1
        db.execute("INSERT INTO t (value) VALUES ('after')")
        assert [value for _, (_, value) in pages.snapshot(read_all)] == ["before", "after"]


def test_a_log_that_begins_anew_during_the_reading_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "t.sqlite"
    with closing(made(path, *["old"] * 500)) as db, closing(DatabasePages(path)) as pages:
        calls = 0

        def read(pages: DatabasePages) -> Rows:
            nonlocal calls
            calls += 1
            found = read_all(pages)
            if calls == 1:
                db.execute("PRAGMA wal_checkpoint")
                db.execute("UPDATE t SET value = 'new'")  # writes the log from its begin
            return found

        assert {value for _, (_, value) in pages.snapshot(read)} == {"new"}
        assert calls == 2


def test_a_page_that_a_checkpoint_changes_during_the_reading_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "t.sqlite"
    with closing(made(path, *["old"] * 2000)) as db, closing(DatabasePages(path)) as pages:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        db.execute("INSERT INTO t (value) VALUES ('last')")
        calls = 0

        def read(pages: DatabasePages) -> set[Value]:
            nonlocal calls
            calls += 1
            steps = rows(pages, roots(pages)["t"])
            found = {next(steps).values(pages)[1]}
            if calls == 1:
                db.execute("UPDATE t SET value = 'new'")
                db.execute("PRAGMA wal_checkpoint")
            return found | {one.values(pages)[1] for one in steps}

        assert pages.snapshot(read) == {"new"}


def test_a_commit_with_a_torn_frame_is_none(tmp_path: Path) -> None:
    """What SQLite itself takes for not written, after a crash."""
    path, copy = tmp_path / "t.sqlite", tmp_path / "copy.sqlite"
    with closing(made(path, "before")) as db:
        db.execute("INSERT INTO t (value) VALUES ('after')")
        log = bytearray(path.with_name("t.sqlite-wal").read_bytes())
        data = path.read_bytes()
    for at, expected in (
        (None, ["before", "after"]),
        (len(log) - 1, ["before"]),
        (len(log) - 4096, ["before"]),
    ):
        changed = bytearray(log)
        if at is not None:
            changed[at] ^= 1
        copy.write_bytes(data)
        copy.with_name("copy.sqlite-wal").write_bytes(changed)
        assert [value for _, (_, value) in read_once(copy)] == expected


def test_a_database_that_is_closed_and_opened_again(tmp_path: Path) -> None:
    path = tmp_path / "t.sqlite"
    made(path, 1).close()
    with closing(DatabasePages(path)) as pages:
        assert len(pages.snapshot(read_all)) == 1
        with closing(sqlite3.connect(path, isolation_level=None)) as db:
            db.execute("PRAGMA synchronous = OFF")
            for value in range(2, 50):
                db.execute("INSERT INTO t (value) VALUES (?)", (value,))
                assert len(pages.snapshot(read_all)) == value
        assert len(pages.snapshot(read_all)) == 49


def expect_one_commit(found: Rows) -> None:
    for number, (_, _, data) in found:
        assert isinstance(data, bytes)
        assert data == number.to_bytes(4, "big") * (len(data) // 4)
    if len(found) > 1:
        assert found[0][1][1] == found[-1][1][1]
        assert [number for number, _ in found[1:]] == list(range(found[1][0], found[-1][0] + 1))


@pytest.mark.parametrize(
    "commits", [300, pytest.param(20_000, marks=[pytest.mark.campaign, pytest.mark.timeout(900)])]
)
def test_each_state_is_one_that_was_committed(
    tmp_path: Path, commits: int, counted: Callable[..., None]
) -> None:
    """A writer without pause, whose log begins anew every few commits: row 1 names the commit of
    the newest row, none is torn.
    """
    path = tmp_path / "t.sqlite"
    command = [sys.executable, "-c", WRITER, str(path), str(commits)]
    states = set()
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
    ) as writer:
        assert writer.stdin is not None
        assert writer.stdout is not None
        writer.stdout.readline()
        with closing(DatabasePages(path)) as pages:
            is_running = True
            while is_running:
                is_running = writer.poll() is None
                found = pages.snapshot(read_all)
                expect_one_commit(found)
                if found and found[-1][0] not in states:
                    states.add(found[-1][0])
                    with suppress(BrokenPipeError):
                        writer.stdin.write(b"\n")
    assert found[-1][1][1] == commits
    assert len(states) >= commits // 30
    counted(states=len(states), torn=0)


@pytest.mark.parametrize("name", ["t.sqlite", "t.sqlite-wal"])
def test_changed_bytes_are_found_or_harmless(tmp_path: Path, name: str) -> None:
    """Whatever bytes the files hold, reading ends, and with `Malformed` or with rows."""
    path = tmp_path / "t.sqlite"
    with closing(made(path, *VALUES, *range(500))) as db:
        if name == "t.sqlite":
            db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        data = (tmp_path / name).read_bytes()
        whole = {file: (tmp_path / file).read_bytes() for file in ("t.sqlite", "t.sqlite-wal")}
    chance, ends = random.Random(3), {"rows": 0, "malformed": 0}
    for _ in range(150):
        changed = bytearray(data)
        for _ in range(chance.randrange(1, 6)):
            changed[chance.randrange(min(len(changed), 20_000))] = chance.randrange(256)
        for file, content in (whole | {name: bytes(changed)}).items():
            (tmp_path / file).write_bytes(content)
        pages = DatabasePages(path)
        try:
            pages.snapshot(read_all)
        except (Malformed, KeyError):  # KeyError: the table is not there any more
            ends["malformed"] += 1
        else:
            ends["rows"] += 1
        pages.close()
    assert ends["rows"] > 0 or name == "t.sqlite"
    assert ends["malformed"] > 0


@pytest.mark.parametrize("size", [0, 10, 99, 100, 4095, 4096, 5000])
def test_a_file_that_was_cut_off(tmp_path: Path, size: int) -> None:
    path = tmp_path / "t.sqlite"
    made(path, *range(5000)).close()
    os.truncate(path, size)
    with pytest.raises((Malformed, KeyError)):
        read_once(path)


@pytest.mark.parametrize("made_of", ["folder", "link", "pipe"])
def test_only_files_are_opened(tmp_path: Path, made_of: str) -> None:
    path, real = tmp_path / "t.sqlite", tmp_path / "real.sqlite"
    made(real, 1).close()
    {
        "folder": lambda: path.mkdir(),
        "link": lambda: path.symlink_to(real),
        "pipe": lambda: os.mkfifo(path),
    }[made_of]()
    with pytest.raises(OSError, match=made_of):
        DatabasePages(path)


# -- files that nobody's SQLite has written --------------------------------------------------------

PAGE = 512
TABLE = ("table", "t", "t", 3, "CREATE TABLE t (value)")


def varint(number: int) -> bytes:
    if number >= 1 << 56 or number < 0:
        number &= (1 << 64) - 1
        high = [(number >> shift & 0x7F) | 0x80 for shift in range(57, 7, -7)]
        return bytes([*high, number & 0xFF])
    digits = [number & 0x7F]
    while number := number >> 7:
        digits.append(number & 0x7F | 0x80)
    return bytes(reversed(digits))


def record(*columns: int | str) -> bytes:
    kinds = b"".join(varint(6 if isinstance(one, int) else 13 + 2 * len(one)) for one in columns)
    data = b"".join(
        one.to_bytes(8, "big") if isinstance(one, int) else one.encode() for one in columns
    )
    return varint(len(kinds) + 1) + kinds + data


def cell(number: int, payload: bytes) -> bytes:
    return varint(len(payload)) + varint(number) + payload


def endless(number: int, size: int, page: int) -> bytes:
    """A row of `size` bytes whose rest begins at `page`."""
    least = (PAGE - 12) * 32 // 255 - 23
    here = least + (size - least) % (PAGE - 4)
    here = here if here <= PAGE - 35 else least
    kinds = varint(13 + 2 * (size - 20))
    start = varint(len(kinds) + 1) + kinds + b"x" * here
    return varint(size) + varint(number) + start[:here] + page.to_bytes(4, "big")


def leaf(*cells: bytes, base: int = 0) -> bytes:
    data, end = bytearray(PAGE), PAGE
    data[base], data[base + 4] = 13, len(cells)
    for place, one in enumerate(cells):
        end -= len(one)
        data[end : end + len(one)] = one
        data[base + 8 + 2 * place : base + 10 + 2 * place] = end.to_bytes(2, "big")
    return bytes(data)


def branch(*below: tuple[int, int]) -> bytes:
    """A page with pages below it: their number, and the largest number of their rows."""
    data = bytearray(leaf(*(page.to_bytes(4, "big") + varint(key) for page, key in below[:-1])))
    places = data[8 : 8 + 2 * (len(below) - 1)]
    data[0], data[8:12], data[12 : 12 + len(places)] = 5, below[-1][0].to_bytes(4, "big"), places
    return bytes(data)


def first(*cells: bytes) -> bytes:
    data = bytearray(leaf(*cells, base=100))
    data[:20] = b"SQLite format 3\0" + PAGE.to_bytes(2, "big") + b"\2\2"
    return bytes(data)


def ring(page: int) -> bytes:
    """A page of a row's rest that leads to itself."""
    return page.to_bytes(4, "big") + b"y" * (PAGE - 4)


FORGED = {
    "the rest of a row leads to itself": [
        first(cell(1, record(*TABLE))),
        ring(2),
        leaf(endless(1, 80 << 20, 2)),
    ],
    "a list of tables of gigabytes": [
        first(endless(1, 80 << 20, 2), endless(2, 80 << 20, 2)),
        ring(2),
    ],
    "a row longer than any": [
        first(cell(1, record(*TABLE))),
        ring(2),
        leaf(endless(1, 200 << 20, 2)),
    ],
    "all rows of a page at one place": [
        first(cell(1, record(*TABLE))),
        ring(2),
        leaf(*[cell(1, record("x"))] * 2)[:10] + b"\x01\xfb" + leaf(cell(1, record("x")))[12:],
    ],
    "a row below the one before": [
        first(cell(1, record(*TABLE))),
        ring(2),
        leaf(cell(2, record("x")), cell(1, record("x"))),
    ],
    "a page below with rows of the page before it": [
        first(cell(1, record(*TABLE))),
        leaf(cell(1, record("x"))),
        branch((2, 5), (4, 6)),
        leaf(cell(1, record("x"))),
    ],
    "a row of more columns than any": [
        first(cell(1, record(*TABLE))),
        ring(2),
        leaf(cell(1, varint(41) + varint(0) * 40)),
    ],
    "a column of a kind below zero": [
        first(cell(1, record(*TABLE))),
        ring(2),
        leaf(cell(1, varint(11) + varint(-100) + b"zz")),
    ],
}


@pytest.mark.parametrize("forged", FORGED.values(), ids=FORGED)
def test_a_forged_file_is_malformed(tmp_path: Path, forged: list[bytes]) -> None:
    (tmp_path / "a.sqlite").write_bytes(b"".join(forged))
    with pytest.raises(Malformed):
        read_once(tmp_path / "a.sqlite")


def test_rows_are_no_more_than_a_reader_takes(tmp_path: Path) -> None:
    path = tmp_path / "t.sqlite"
    with closing(made(path, *range(20))), closing(DatabasePages(path)) as pages:
        pages.snapshot(lambda one: list(rows(one, roots(one)["t"], 10, most_rows=10)))
        with pytest.raises(Malformed, match="more than 9 rows"):
            pages.snapshot(lambda one: list(rows(one, roots(one)["t"], 10, most_rows=9)))


def test_frames_behind_the_last_commit_are_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A log whose last commit never ends costs its time once, not with each row that is read."""
    path, summed = tmp_path / "t.sqlite", []
    check_sums = sqlite_pages._check_sums

    def counted(order: str, data: bytes, sums: tuple[int, int]) -> tuple[int, int]:
        summed.append(len(data))
        return check_sums(order, data, sums)

    monkeypatch.setattr(sqlite_pages, "_check_sums", counted)
    with closing(made(path, "before")) as db, closing(DatabasePages(path)) as pages:
        db.execute("PRAGMA cache_size = 1")  # it writes frames before the commit
        db.execute("BEGIN")
        for _ in range(100):
            db.execute("INSERT INTO t (value) VALUES (?)", (bytes(5000),))
        assert len(pages.snapshot(read_all)) == 1
        assert len(summed) > 200
        summed.clear()
        assert len(pages.snapshot(read_all)) == 1
        assert not summed
        db.execute("COMMIT")
        assert len(pages.snapshot(read_all)) == 101


def test_a_list_of_tables_with_too_few_columns_names_none(tmp_path: Path) -> None:
    (tmp_path / "a.sqlite").write_bytes(first(cell(1, record("table"))))
    with closing(DatabasePages(tmp_path / "a.sqlite")) as pages:
        assert pages.snapshot(roots) == {}


def test_the_first_columns_of_an_empty_row_are_malformed(tmp_path: Path) -> None:
    forged = [first(cell(1, record(*TABLE))), ring(2), leaf(cell(1, varint(1)))]
    (tmp_path / "a.sqlite").write_bytes(b"".join(forged))
    with closing(DatabasePages(tmp_path / "a.sqlite")) as pages, pytest.raises(Malformed):
        pages.snapshot(lambda pages: [one.first_values(2) for one in rows(pages, 3)])


def test_rows_have_no_more_than_the_bytes_that_a_reader_takes(tmp_path: Path) -> None:
    with (
        closing(made(tmp_path / "a.sqlite", *["x" * 400_000] * 4)),
        closing(DatabasePages(tmp_path / "a.sqlite")) as pages,
    ):
        read = [
            pages.snapshot(
                lambda pages: [*rows(pages, roots(pages)["t"], most_bytes=most)]  # noqa: B023
            )
            for most in (None, 2_000_000)
        ]
        assert [len(found) for found in read] == [4, 4]
        with pytest.raises(Malformed, match="more than 1 MiB"):
            pages.snapshot(lambda pages: [*rows(pages, roots(pages)["t"], most_bytes=1 << 20)])
