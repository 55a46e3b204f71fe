"""Parquet parts whose page headers say what is not so: a sentence before the library reads them,
and few findings of the check of a run that has one.
"""

from __future__ import annotations

import io
import os
import resource
import time
from contextlib import suppress
from itertools import count
from pathlib import Path
from shutil import copytree

import pyarrow as pa
import pytest

from jbclog.core.files import NotReadable
from jbclog.core.foreign import parquet_pages
from jbclog.core.foreign.parquet_pages import BYTES_A_PAGE, FREE_PAGES
from jbclog.core.foreign.parquet_sizes import sizes_of
from jbclog.core.foreign.tables import GROUP_BYTES, open_table, read_small
from jbclog.record.check import check
from jbclog.record.schema import SCHEMAS
from support.faults.forged_parts import FORGED, forge, write
from support.records.small_run import make_run

REFUSED = {
    "a negative packed size": "page without a size",
    "a negative unpacked size": "page without a size",
    "a negative number of values": "page without a size",
    "a page beyond its column": "page beyond its end",
    "2 GB in a small page": "more than 128 MiB",
    "2**31 - 1 values in a small page": "pages of other than",
    "2**31 - 1 words in a small dictionary": "too many words",
    "a page without a type": "of another kind",
    "a page of another type": "of another kind",
    "a page of no type": "of another kind",
    "two dictionaries": "second dictionary",
    "a dictionary behind its data": "second dictionary",
    "no pages": "pages of other than",
    "a header of two kinds": "of another kind",
    "a long word that the footer does not count": "MiB of text",
    "a long word in a structure": "MiB of text",
}
"""What is said of some, whatever the library would say."""
OF_THE_FOOTER = (
    "columns by other names",
    "columns of another type",
    "two columns of one name",
    "columns that are not there",
)
SHARED = "empty pages that all row groups share"
"""Too many pages in a table of many columns."""
OF_A_STORE = {**REFUSED, SHARED: "too many pages"}
for one in (
    *("2 GB in a small page", "a long word that the footer does not count"),
    "a long word in a structure",
):
    del OF_A_STORE[one]  # the limits of the table are for these


def part(tmp_path: Path, table: str) -> Path:
    """Two row groups with all columns of a table."""
    path = tmp_path / table / "part-0000.parquet"
    path.parent.mkdir()
    write(path, 100, 50)
    return path


@pytest.mark.parametrize("table", SCHEMAS)
def test_what_is_taken_to_pieces_and_not_changed_is_the_same(tmp_path: Path, table: str) -> None:
    path = part(tmp_path, table)
    rows, size = read_small(path), path.stat().st_size
    forge(path)
    assert path.stat().st_size == size
    assert read_small(path).equals(rows)
    with open_table(path) as opened:
        assert opened.schema.equals(SCHEMAS[table])


@pytest.mark.parametrize("table", SCHEMAS)
@pytest.mark.parametrize("name", REFUSED)
def test_a_forged_page_is_refused_before_the_library_reads_it(
    tmp_path: Path, table: str, name: str
) -> None:
    path = part(tmp_path, table)
    FORGED[name](path)
    pool, began = pa.default_memory_pool(), time.process_time()
    before = pool.bytes_allocated()
    with open_table(path) as opened, pytest.raises(NotReadable, match=REFUSED[name]):  # noqa: PT012
        for _ in opened.groups():
            assert pool.bytes_allocated() - before < GROUP_BYTES
    assert time.process_time() - began < 5


@pytest.mark.parametrize("name", OF_A_STORE)
def test_a_store_s_file_is_refused_while_it_is_measured(tmp_path: Path, name: str) -> None:
    path = part(tmp_path, "samples")
    FORGED[name](path)
    with path.open("rb") as data, pytest.raises(NotReadable, match=OF_A_STORE[name]):
        sizes_of(data)


@pytest.mark.parametrize("name", OF_THE_FOOTER)
def test_columns_are_those_of_the_schema(tmp_path: Path, name: str) -> None:
    """The library goes by the schema: at a column with another name nobody had looked."""
    path = part(tmp_path, "samples")
    FORGED[name](path)
    with pytest.raises(NotReadable, match="unreadable footer"):
        read_small(path, ["station"])
    with path.open("rb") as data, pytest.raises(NotReadable, match="unreadable footer"):
        sizes_of(data)


def test_pages_are_limited_by_the_file_s_size_and_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sixty row groups with the same empty pages in each of their columns are seven million headers
    in 5 MB.
    """
    path, read = part(tmp_path, "samples"), count()
    FORGED[SHARED](path)
    head = parquet_pages._head
    monkeypatch.setattr(parquet_pages, "_head", lambda data: (next(read), head(data))[1])
    with open_table(path) as opened, pytest.raises(NotReadable, match="too many pages"):
        [*opened.groups()]
    assert FREE_PAGES < next(read) < 2 * FREE_PAGES + path.stat().st_size // BYTES_A_PAGE


@pytest.mark.parametrize("name", sorted({*FORGED} - {*REFUSED, SHARED, *OF_THE_FOOTER}))
def test_the_others_are_an_error_of_the_library_or_rows(tmp_path: Path, name: str) -> None:
    """In a child, which the library could end."""
    path = part(tmp_path, "samples")
    FORGED[name](path)
    child = os.fork()
    if not child:
        code = 1
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (5, 5))
            with suppress(OSError, pa.ArrowException):
                read_small(path)
            with suppress(NotReadable):
                sizes_of(io.BytesIO(path.read_bytes()))
            code = 0
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


# -- in a run --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("runs"), seconds=12.0)


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    return copytree(made, tmp_path / made.name)


def texts(folder: Path) -> list[str]:
    return [str(finding) for finding in check(folder)]


def test_rows_of_more_stations_than_a_run_can_have(run: Path) -> None:
    """Each of 200 000 rows had the table searched for its own station, and its accounting kept."""
    FORGED["a station of its own in each row"](run / "samples" / "part-0000.parquet")
    found = texts(run)
    assert "rows of more than 4096 stations and ports" in found[-1]


def test_texts_that_differ_in_each_row_are_findings_of_one_line_each(run: Path) -> None:
    FORGED["texts of their own in each row"](run / "samples" / "part-0000.parquet")
    found = texts(run)
    assert len(found) < 500
    assert max(map(len, found)) < 2200
