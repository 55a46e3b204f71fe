"""Parquet whose footer, page heads or values are not what a recorder writes: a sentence, and never
the end of the process.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbclog.core.files import NotReadable
from jbclog.core.foreign import parquet_pages, tables
from jbclog.core.foreign.parquet_footer import (
    BINARY,
    BYTE,
    I16,
    I32,
    I64,
    LIST,
    STRUCT,
    YES,
    ThriftReader,
    groups_in,
)
from jbclog.core.foreign.parquet_pages import IN_FULL, TAIL, pages_of
from jbclog.core.foreign.tables import (
    _texts_in,
    batches_in,
    bounds_of,
    open_table,
    read_small,
)

ROWS = pa.table(
    {
        "time": pa.array(
            [1_790_000_000_000_000, 1_790_000_001_000_000], pa.timestamp("us", tz="UTC")
        ),
        "name": pa.array(["dde-1", None]),
        "value": pa.array([350.0, None], pa.float64()),
    }
)


def written(path: Path, rows: pa.Table = ROWS) -> Path:
    pq.write_table(rows, path, write_page_checksum=True, compression="zstd", row_group_size=1)
    return path


def test_row_groups_without_end_are_refused(tmp_path: Path) -> None:
    """Each takes a millisecond, however few rows it has."""
    most, path = tables.FREE_GROUPS, tmp_path / "a.parquet"
    assert read_small(written(path, pa.concat_tables([ROWS] * (most // 2)))).num_rows == most
    with pytest.raises(NotReadable, match=rf"{most + 2} row groups for {most + 2} rows; at most"):
        read_small(written(path, pa.concat_tables([ROWS] * (most // 2 + 1))))


def footer_of(data: bytes) -> bytes:
    length = TAIL.unpack(data[-TAIL.size :])[0]
    return data[-TAIL.size - length : -TAIL.size]


def test_the_footer_says_what_the_library_says(tmp_path: Path) -> None:
    path = written(tmp_path / "a.parquet")
    groups, known = groups_in(footer_of(path.read_bytes())), pq.read_metadata(path)
    assert len(groups) == known.num_row_groups == 2
    for index, group in enumerate(groups):
        assert group.rows == known.row_group(index).num_rows
        for place, chunk in enumerate(group.chunks):
            column = known.row_group(index).column(place)
            same = (
                column.path_in_schema,
                column.num_values,
                column.total_uncompressed_size,
                column.total_compressed_size,
            )
            assert (chunk.name, chunk.values, chunk.unpacked, chunk.packed) == same
            assert (chunk.data_at, chunk.dictionary_at) == (
                column.data_page_offset,
                column.dictionary_page_offset,
            )
    micros = [
        (1_790_000_000_000_000 + second * 1_000_000).to_bytes(8, "little") for second in range(2)
    ]
    assert bounds_of(path, "time") == [(one, one) for one in micros]
    assert bounds_of(path, "value")[1] is None


@pytest.mark.parametrize("length", [10, 500, 3000])
def test_a_page_s_header_is_read_whatever_its_length(tmp_path: Path, length: int) -> None:
    """The library writes the least and the greatest text of a page into its header, too."""
    texts = [letter * length for letter in "ab"]
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"name": texts}), path, use_dictionary=False, write_page_checksum=True)
    (group,) = groups_in(footer_of(path.read_bytes()))
    ((_, size, _, encoding, _),) = pages_of(io.BytesIO(path.read_bytes()), group.chunks[0])
    assert encoding in IN_FULL
    assert size >= 2 * length
    assert size < 2 * length + 20
    assert read_small(path)["name"].to_pylist() == texts


def test_the_headers_of_a_long_record_are_parsed_once(tmp_path: Path) -> None:
    """A report reads a week's samples several times, some 5000 page headers each time."""
    # with other values in each column: else they would have the same pages
    rows = pa.table({f"{begin}": range(begin, begin + 60) for begin in range(0, 4500, 100)})
    path = written(tmp_path / "a.parquet", rows)

    def parsed() -> int:
        before = parquet_pages._usual_head.cache_info().misses
        with open_table(path) as table:
            assert sum(len(group) for group in table.groups()) == 60
        return parquet_pages._usual_head.cache_info().misses - before

    assert parsed() > 5000
    assert parsed() == 0


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("encoding", [None, "PLAIN", "DELTA_LENGTH_BYTE_ARRAY", "DELTA_BYTE_ARRAY"])
def test_what_pages_have_of_texts_is_known_from_their_heads(
    tmp_path: Path, encoding: str | None, version: str
) -> None:
    """Places in a dictionary are no texts: else a long row group in which stations take turns had
    to be decoded before it is read.
    """
    path, rows = tmp_path / "a.parquet", 20_000
    kinds = {} if encoding is None else {"use_dictionary": False, "column_encoding": encoding}
    pq.write_table(
        pa.table({"name": ["one", "another"] * rows}), path, data_page_version=version, **kinds
    )
    (group,) = groups_in(footer_of(path.read_bytes()))
    pages = [*pages_of(io.BytesIO(path.read_bytes()), group.chunks[0])]
    longest, written_once, is_known = _texts_in(pages)
    assert is_known is (encoding != "DELTA_BYTE_ARRAY")
    if encoding is None:
        assert (longest, written_once) == (len("one") + len("another") + 8, 0)
    elif encoding != "DELTA_BYTE_ARRAY":
        assert longest == 0
        assert rows * (len("one") + len("another")) <= written_once <= 2 * rows * 10
    else:
        assert longest >= len("another")


def child_that_ends(path: Path, all_of_them: Iterator[bytes]) -> int:
    """How a child ends that reads each of these in turn: the library's abort would end it."""
    child = os.fork()
    if not child:
        code = 1
        try:
            for data in all_of_them:
                path.write_bytes(data)
                try:
                    read_small(path)
                except (OSError, pa.ArrowException):
                    continue
            code = 0
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def test_no_byte_of_a_footer_ends_the_process(tmp_path: Path) -> None:
    """Two of them did, in a library that does not catch its own exception where a column's
    statistics contradict its kind.
    """
    path = written(tmp_path / "a.parquet", ROWS.select(["name"]).slice(0, 1))
    data = path.read_bytes()
    begin = len(data) - TAIL.size - len(footer_of(data))
    turned = (
        data[:at] + bytes([data[at] ^ (1 << at % 8)]) + data[at + 1 :]
        for at in range(begin, len(data))
    )
    assert child_that_ends(path, turned) == 0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("time", pa.array([9 * 10**18], pa.timestamp("us", tz="UTC"))),
        ("time", pa.array([-(10**15)], pa.timestamp("us", tz="UTC"))),
        ("value", pa.array([float("nan")])),
        ("value", pa.array([float("inf")])),
        ("value", pa.array([1e300])),
        ("number", pa.array([2**63 - 1])),
        ("number", pa.array([2**53 + 1])),
        ("number", pa.array([-(2**53) - 1])),
        ("text", pa.Array.from_buffers(pa.string(), 1, pa.array([b"\xff\xfe"]).buffers())),
    ],
)
def test_a_value_that_nobody_can_reckon_with_or_show(
    tmp_path: Path, name: str, value: pa.Array
) -> None:
    path = written(tmp_path / "a.parquet", pa.table({name: value}))
    with pytest.raises((NotReadable, pa.ArrowInvalid)):
        read_small(path)
    with open_table(path) as table, pytest.raises((NotReadable, pa.ArrowInvalid)):
        list(table.batches(10))


def test_a_whole_number_that_can_be_read_can_be_reckoned_with(tmp_path: Path) -> None:
    """Charts and an export to MDF take whole numbers as floats."""
    path = written(tmp_path / "a.parquet", pa.table({"number": [2**53, -(2**53)]}))
    assert read_small(path)["number"].cast(pa.float64()).to_pylist() == [2**53, -(2**53)]


def test_a_number_that_the_library_would_take_otherwise() -> None:
    """A field twice, a field's number and a value beyond their bits: the last one, or a part of it,
    would count there.
    """
    twice = bytes([0x15, 2, 0x05, 2, 4, 0])  # field 1 twice, the second time by its whole number
    beyond = bytes([0x05, 0x84, 0x80, 0x08, 2, 0])  # field 65538
    large = bytes([0x15, 0x82, 0x80, 0x80, 0x80, 0x20, 0])  # beyond 32 bits
    for data in (twice, beyond, large):
        reader = ThriftReader(data)
        with pytest.raises(ValueError, match=r"duplicate|bits"):
            [reader.integer(kind) for _, kind in reader.fields()]


@pytest.mark.parametrize(
    ("kind", "data"),
    [
        (I16, b"\x06"),
        (I32, b"\x85\x01"),
        (I64, b"\x06"),
        (BYTE, b"\x06"),
        (BINARY, b"\x03abc"),
        (LIST, bytes([0x20 | BINARY]) + b"\x01a\x02bc"),
        (LIST, bytes([0x30 | YES]) + b"\x01\x02\x01"),  # a flag in a list is a byte
        (STRUCT, b"\x11\x12\x25\x06\x00"),  # in a struct it is its kind
    ],
)
def test_what_is_skipped_is_skipped_whole(kind: int, data: bytes) -> None:
    reader = ThriftReader(data + b"\x7f")
    reader.skip(kind)
    assert reader.at == len(data)


def test_texts_that_repeat_the_beginning_of_the_one_before_are_bounded(tmp_path: Path) -> None:
    """400 texts of 500 kB in 0.5 kB, without a dictionary."""
    path = tmp_path / "a.parquet"
    pq.write_table(
        pa.table({"name": ["x" * 500_000] * 400}),
        path,
        use_dictionary=False,
        column_encoding={"name": "DELTA_BYTE_ARRAY"},
        compression="zstd",
    )
    assert path.stat().st_size < 100_000
    with pytest.raises(NotReadable, match="MiB of text"):
        read_small(path)


@pytest.mark.parametrize(
    "rows",
    [pa.table({"b": [1]}), pa.table({"a": [{"x": 1}]}), pa.table({"a": [["x"]]})],
    ids=["missing", "structure", "list"],
)
def test_a_column_to_be_coded_that_is_none_of_plain_values(tmp_path: Path, rows: pa.Table) -> None:
    path = written(tmp_path / "x.parquet", rows)
    with (
        pytest.raises(NotReadable, match="has no column a of plain values"),
        open_table(path, ["a"]),
    ):
        pass
    with pa.OSFile(os.fspath(path)) as data, pytest.raises(NotReadable, match="no column a"):
        [*batches_in(data, [0], ["a"], 10, ["a"])]


def test_a_file_that_is_replaced_by_a_pipe_once_it_is_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path / "x.parquet")
    footer = tables.footer_of

    def replaced(data: BinaryIO) -> bytes:
        path.unlink()
        os.mkfifo(path)
        return footer(data)

    monkeypatch.setattr(tables, "footer_of", replaced)
    with open_table(path) as table:
        assert pa.concat_tables(table.groups()) == ROWS
