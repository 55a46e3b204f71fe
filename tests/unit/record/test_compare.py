"""Two records of the same happenings are held against each other row by row, but for the moments of
writing.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from shutil import copytree

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from jbclog.record.compare import MOST_SHOWN, compare_records
from jbclog.record.manifest import read_manifest, write_manifest
from jbclog.record.parts import part_paths
from support.records.few_rows import with_cell
from support.records.small_run import make_run

Change = Callable[[pa.Table], pa.Table]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return [make_run(tmp_path_factory.mktemp(name), seconds=6.0) for name in ("first", "second")]


@pytest.fixture
def pair(made: list[Path], tmp_path: Path) -> tuple[Path, Path]:
    first, second = (
        copytree(run, tmp_path / name / run.name)
        for name, run in zip(("first", "second"), made, strict=True)
    )
    return first, second


def rewrite(folder: Path, table: str, change: Change) -> None:
    (path,) = part_paths(folder, table)
    with pq.ParquetFile(path) as file:
        changed = change(file.read())
    pq.write_table(changed, path)


def test_the_same_run_twice(pair: tuple[Path, Path]) -> None:
    assert compare_records(*pair).differences == []


def test_moments_of_writing_and_events_of_the_run_as_a_whole_are_left_out(
    pair: tuple[Path, Path],
) -> None:
    def later(table: pa.Table) -> pa.Table:
        moved = pc.add(table["time"].cast(pa.int64()), 5000).cast(table.schema.field("time").type)
        return table.set_column(
            table.schema.get_field_index("time"), table.schema.field("time"), moved
        )

    for table in ("samples", "events", "settings", "counters"):
        rewrite(pair[1], table, later)
    rewrite(pair[1], "events", lambda events: events.filter(pc.is_valid(events["station"])))
    assert compare_records(*pair).differences == []


@pytest.mark.parametrize(
    ("table", "column", "value"),
    [
        ("samples", "temperature_c", 999),
        ("samples", "late_us", 7),
        ("samples", "reasons", "x=y"),
        ("settings", "readback", "999"),
    ],
)
def test_one_value_is_found_and_named(
    pair: tuple[Path, Path], table: str, column: str, value: object
) -> None:
    rewrite(pair[1], table, lambda rows: with_cell(rows, 4, column, value))
    (found,) = compare_records(*pair).differences
    assert found.startswith(f"{table}, ")
    assert f"{column} {value!r} instead of" in found


def test_rows_that_are_missing(pair: tuple[Path, Path]) -> None:
    rewrite(pair[1], "samples", lambda rows: rows.slice(0, len(rows) - 4))
    found = compare_records(*pair).differences
    assert any("rows instead of" in text for text in found)
    assert compare_records(*pair, is_cut=True).differences == []


def test_a_table_that_differs_everywhere_is_said_briefly(pair: tuple[Path, Path]) -> None:
    rewrite(
        pair[1],
        "samples",
        lambda rows: rows.set_column(
            rows.schema.get_field_index("late_us"), "late_us", [[1] * len(rows)]
        ),
    )
    found = [text for text in compare_records(*pair).differences if "dde-1" in text]
    assert len(found) == MOST_SHOWN + 1
    assert "more rows differ" in found[-1]


def test_what_is_known_of_the_stations(pair: tuple[Path, Path]) -> None:
    manifest = read_manifest(pair[1])
    manifest.stations[0].outages += 1
    write_manifest(pair[1], manifest)
    (found,) = compare_records(*pair).differences
    assert "outages 2 instead of 1" in found
    assert compare_records(*pair, is_cut=True).differences == []
    manifest.stations.pop()
    write_manifest(pair[1], manifest)
    assert any("stations instead of" in text for text in compare_records(*pair).differences)


def test_how_much_was_compared(pair: tuple[Path, Path]) -> None:
    whole = compare_records(*pair)
    recorded = whole.share("samples")[1]
    assert whole.share("samples") == (recorded, recorded)
    assert whole.lacking == []
    assert whole.rows == sum(
        whole.share(table)[1] for table in ("samples", "events", "settings", "counters")
    )
    rewrite(pair[1], "samples", lambda rows: rows.slice(0, 4))
    short = compare_records(*pair, is_cut=True)
    assert short.share("samples") == (4, recorded)
    assert any(
        re.fullmatch(r"samples, dde-\d: only \d+ of \d+ rows could be compared", text)
        for text in short.lacking
    )


def test_two_that_share_nothing_do_not_differ_and_it_is_seen(pair: tuple[Path, Path]) -> None:
    for table in ("samples", "events", "settings", "counters"):
        rewrite(pair[1], table, lambda rows: rows.slice(0, 0))
    nothing = compare_records(*pair, is_cut=True)
    assert (nothing.differences, nothing.rows) == ([], 0)
