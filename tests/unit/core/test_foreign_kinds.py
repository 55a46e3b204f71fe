"""What is opened of somebody else's, and what is refused, by the kind of file."""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbclog.core.database import NotAStore, open_database
from jbclog.core.files import (
    LIMITS,
    LINES,
    Kind,
    NotReadable,
    open_regular,
    plain_files,
    read_regular,
)
from jbclog.core.foreign.tables import GROUP_BYTES, MIB, open_table, read_small
from jbclog.core.json_files import expect_moment, json_of
from jbclog.record.parts import ROWS_A_GROUP, write_part
from support.campaigns.each_row import each_row
from support.faults import bombs
from support.records import sealed_run

MADE: dict[str, Callable[[Path], object]] = {
    "a pipe": os.mkfifo,
    "a folder": Path.mkdir,
    "a link": lambda path: path.symlink_to(__file__),
    "a device": lambda path: os.mknod(path, 0o20666, os.makedev(1, 5)),
}


@pytest.mark.parametrize("what", MADE)
def test_what_is_no_file_is_named_and_not_opened(tmp_path: Path, what: str) -> None:
    path = tmp_path / "x"
    if what == "a device" and os.getuid():
        path.symlink_to("/dev/zero")
        what = "a link"
    else:
        MADE[what](path)
    with pytest.raises(NotReadable, match=f"^is {what}, not a file$"):
        read_regular(path, Kind.MANIFEST)


@pytest.mark.parametrize("what", ["a pipe", "a link"])
def test_a_folder_of_plain_files_has_nothing_else(tmp_path: Path, what: str) -> None:
    assert [*plain_files(tmp_path / "missing")] == []
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "b" / "file").write_bytes(b"x")
    assert [*plain_files(tmp_path / "a")] == [tmp_path / "a" / "b" / "file"]
    MADE[what](tmp_path / "a" / "b" / "other")
    with pytest.raises(NotReadable, match=f"other: is {what}, not a file"):
        [*plain_files(tmp_path / "a")]
    (tmp_path / "link").symlink_to(tmp_path / "a")
    with pytest.raises(NotReadable, match="link: is not a folder of its own"):
        [*plain_files(tmp_path / "link")]


def test_a_link_that_the_user_names_leads_to_a_file_and_to_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"x")
    (tmp_path / "link").symlink_to("file")
    (tmp_path / "zero").symlink_to("/dev/zero")
    assert read_regular(tmp_path / "link", Kind.SETTINGS, links=True) == b"x"
    with pytest.raises(NotReadable, match="is a device"):
        read_regular(tmp_path / "zero", Kind.SETTINGS, links=True)


@pytest.mark.parametrize("kind", Kind)
def test_each_kind_has_its_limit(tmp_path: Path, kind: Kind) -> None:
    path = tmp_path / "x"
    with path.open("wb") as file:
        file.truncate(LIMITS[kind])
    open_regular(path, kind).close()
    os.truncate(path, LIMITS[kind] + 1)
    with pytest.raises(NotReadable, match=str(LIMITS[kind])):
        open_regular(path, kind)


@pytest.mark.parametrize("kind", LINES)
def test_lines_have_a_limit_as_well(tmp_path: Path, kind: Kind) -> None:
    (tmp_path / "x").write_bytes(b"\n" * LINES[kind])
    read_regular(tmp_path / "x", kind)
    (tmp_path / "x").write_bytes(b"\n" * (LINES[kind] + 1))
    with pytest.raises(NotReadable, match="lines"):
        read_regular(tmp_path / "x", kind)


# -- numbers ---------------------------------------------------------------------------------------

NOT_TAKEN = [
    "NaN",
    "Infinity",
    "-Infinity",
    "1e308",
    "-1e99",
    "1e19",
    "1" + "0" * 30,
    "9" * 5000,
    "[" * 100_000,
    "1.5e+40",
]


@each_row(
    (f"{around} {text[:12]}", (text, around))
    for text in NOT_TAKEN
    for around in ("{}", '{{"a": {}}}', "[1,{}]", "[1, {}]")
)
def test_a_number_that_nobody_can_reckon_with_is_refused(text: str, around: str) -> None:
    with pytest.raises(ValueError, match=r"number|deeply|objects"):
        json_of(around.format(text))


@pytest.mark.parametrize(
    "value",
    [
        0,
        -1,
        2**62,
        1.5,
        1e17,
        1_790_000_000.123456,
        "1e308 9999999999999999999999",
        {"a": [None, True]},
    ],
)
def test_all_others_are_taken_as_they_are(value: object) -> None:
    assert json_of(json.dumps(value)) == value


@pytest.mark.parametrize("seconds", [-1.0, 1e10, 1e308, float("nan")])
def test_a_moment_lies_in_these_centuries(seconds: float) -> None:
    with pytest.raises(ValueError, match="no time"):
        expect_moment(seconds)


# -- tables ----------------------------------------------------------------------------------------


@pytest.fixture
def part(tmp_path: Path) -> Path:
    rows = sealed_run.table(sealed_run.samples(200))
    return write_part(tmp_path, "samples", lambda: [rows], 1)


@pytest.mark.parametrize("name", sorted({*bombs.PARTS} - {"many groups", "nested station"}))
def test_a_bomb_is_refused_before_it_is_unpacked(part: Path, name: str) -> None:
    bombs.PARTS[name](part)
    before = pa.total_allocated_bytes()
    pool = pa.default_memory_pool()
    with pytest.raises((OSError, pa.ArrowException)), open_table(part) as opened:  # noqa: PT012
        for _ in opened.groups():
            assert pool.bytes_allocated() - before < GROUP_BYTES
        pytest.fail("all of it was read")


def test_many_groups_are_read_one_after_the_other(part: Path) -> None:
    bombs.PARTS["many groups"](part)
    pool = pa.default_memory_pool()
    before = pool.bytes_allocated()
    with open_table(part) as opened:
        assert (
            sum(
                len(group)
                for group in opened.groups()
                if pool.bytes_allocated() - before < GROUP_BYTES
            )
            == opened.metadata.num_rows
        )


def test_what_pages_say_of_themselves_counts_and_not_what_the_footer_says(tmp_path: Path) -> None:
    """A page of 200 MiB whose column declares 128 MiB, as a library that unpacks it would find out
    too late.
    """
    path = tmp_path / "x.parquet"
    pq.write_table(
        pa.table({"a": [" " * (200 * MIB)]}),
        path,
        compression="zstd",
        use_dictionary=False,
        write_statistics=False,
    )
    with pytest.raises(NotReadable, match="MiB"), open_table(path) as opened:
        opened.group(0)
    honest, data = (
        pq.read_metadata(path).row_group(0).column(0).total_uncompressed_size,
        path.read_bytes(),
    )
    small = _varint(1 << 27)  # 128 MiB, with as many bytes as the honest number has
    assert len(small) == len(_varint(honest))
    # both stand in the footer; a page's head has the length of its contents
    path.write_bytes(data.replace(_varint(honest), small))
    assert pq.read_metadata(path).row_group(0).column(0).total_uncompressed_size == 1 << 27
    with pytest.raises(NotReadable, match="MiB"), open_table(path) as opened:
        opened.group(0)


def _varint(number: int) -> bytes:
    number, out = number << 1, b""
    while number > 0x7F:
        out, number = out + bytes([number & 0x7F | 0x80]), number >> 7
    return out + bytes([number])


def test_a_long_run_s_part_is_read(tmp_path: Path) -> None:
    """Hours in which nothing was read pack best of all that a recorder writes."""
    columns = sealed_run.samples(ROWS_A_GROUP)
    sealed_run.lose(columns, slice(0, None))
    rows = sealed_run.table(columns)
    path = write_part(tmp_path, "samples", lambda: [rows] * 40, 1)
    with open_table(path) as opened:
        assert sum(len(group) for group in opened.groups(["time", "tick"])) == 40 * ROWS_A_GROUP


def test_an_empty_part_and_a_small_table_are_read(tmp_path: Path) -> None:
    rows = sealed_run.table(sealed_run.samples(20))
    empty = write_part(tmp_path, "samples", lambda: (), 0)
    assert len(read_small(empty)) == 0
    none = write_part(tmp_path, "samples", lambda: [rows[:0]], 0)
    assert len(read_small(none)) == 0
    some = write_part(tmp_path, "samples", lambda: [rows], 0)
    assert read_small(some).equals(rows)
    assert read_small(some, ["tick"]).equals(rows.select(["tick"]))


# -- databases -------------------------------------------------------------------------------------

COLUMNS = {
    "batch": ("number", "name", "rows", "crc", "data"),
    "note": ("kind", "key", "text", "crc"),
}


@pytest.mark.parametrize(
    "name", ["endless views", "one endless view", "a trigger", "computed columns"]
)
def test_a_store_of_views_or_triggers_is_none(tmp_path: Path, name: str) -> None:
    path = tmp_path / "live.sqlite"
    bombs.STORES[name](path)
    opened = open_database(path, only_reads=True, busy_s=1.0)
    with pytest.raises(NotAStore):
        opened.expect_tables(COLUMNS)
    opened.close()


def test_a_statement_without_end_is_interrupted(tmp_path: Path) -> None:
    opened = open_database(tmp_path / "x", only_reads=False, busy_s=1.0)
    opened.within(0.1)
    with pytest.raises(sqlite3.OperationalError, match="interrupted"):
        opened.execute(
            "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT count(*) FROM n"
        ).fetchone()
    opened.close()


@pytest.mark.parametrize("ending", ["", "-wal", "-shm", "-journal"])
def test_a_pipe_beside_a_store_is_not_waited_for(tmp_path: Path, ending: str) -> None:
    path = tmp_path / "live.sqlite"
    bombs.STORES["large numbers"](path)
    (tmp_path / f"live.sqlite{ending}").unlink(missing_ok=True)
    os.mkfifo(tmp_path / f"live.sqlite{ending}")
    with pytest.raises(NotAStore, match="is a pipe"):
        open_database(path, only_reads=True, busy_s=1.0)
