"""Runs that lack columns of this version open as far as their columns go: what they lack is null,
and a reader is told.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbclog.analysis import run_tables
from jbclog.analysis.run import open_run
from jbclog.core.errors import RecordError
from jbclog.core.rows import SAMPLE_COLUMNS
from jbclog.record import part_writer, parts, row_batches, schema
from jbclog.record.check import check
from jbclog.record.parts import row_groups
from jbclog.record.recover import Outcome, recover
from support.product import seal_part
from support.records import few_rows

ROWS = 150  # of `few_rows.abandoned`
BOTH = ("preparing", "in_range")  # the last columns of `samples`


def run_without(
    later: Sequence[str], home: Path, monkeypatch: pytest.MonkeyPatch, *, is_sealed: bool
) -> Path:
    """A run as a recorder left it that did not know the last columns."""
    known = [one for one in schema.SCHEMAS["samples"] if one.name not in later]
    earlier = pa.schema(known, metadata=schema.SCHEMAS["samples"].metadata)
    made = len(SAMPLE_COLUMNS) - len(later)
    of_now = row_batches.BARE["samples"]
    bare = pa.schema([*of_now][:made], metadata=of_now.metadata)
    with monkeypatch.context() as before:
        before.setattr(few_rows, "SAMPLE_COLUMNS", SAMPLE_COLUMNS[:made])
        before.setitem(row_batches.BARE, "samples", bare)
        before.setitem(row_batches._COLUMNS, "samples", row_batches._COLUMNS["samples"][:made])
        for module in (row_batches, parts, part_writer):
            before.setattr(module, "SCHEMAS", {**schema.SCHEMAS, "samples": earlier})
        for module in (row_batches, parts):
            before.setattr(module, "lacking_in", lambda *_: [])
        folder = few_rows.abandoned(home)
        if is_sealed:
            seal_part(folder)
            (part,) = parts.part_paths(folder, "samples")
            assert pq.read_metadata(part).num_columns == len(known)
    return folder


@pytest.mark.parametrize("is_sealed", [True, False])
@pytest.mark.parametrize("later", [BOTH, BOTH[1:]])
def test_what_an_earlier_version_did_not_record_is_null(
    later: Sequence[str], is_sealed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = run_without(later, tmp_path, monkeypatch, is_sealed=is_sealed)
    monkeypatch.setattr(run_tables, "SCHEMA_VERSION", 3)
    run = open_run(folder)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        rows = run.samples()
    told = f"samples: {', '.join(later)} not recorded by the version that made the run"
    assert any(told in str(one.message) for one in said) is is_sealed
    assert (tuple(rows), len(rows)) == (("run", "seq", *SAMPLE_COLUMNS), ROWS)
    assert rows["temperature_c"].notna().all()
    assert rows[[*later]].isna().all(axis=None)
    assert {str(rows[name].dtype) for name in later} == {"boolean"}
    assert len(run.samples(columns=["in_range"])) == ROWS
    some = pa.concat_tables([*run.groups("samples", ["in_range", "station", "tick"])])
    assert some.column_names == ["in_range", "station", "tick"]
    assert some["tick"].to_pylist() == [*range(ROWS)]
    assert recover(folder).outcome is Outcome.RECOVERED
    assert check(folder) == []
    assert sum(len(group) for group in row_groups(folder, "samples", ["in_range"])) == ROWS


@pytest.mark.parametrize(
    ("table", "names"),
    [
        ("samples", [name for name in SAMPLE_COLUMNS if name != "tick"]),  # never null
        ("samples", [*SAMPLE_COLUMNS, "another"]),
        ("samples", [*SAMPLE_COLUMNS[::-1]]),
        ("events", [name for name in schema.SCHEMAS["events"].names if name != "raw"]),
    ],
)
def test_rows_with_other_columns_are_refused(table: str, names: list[str]) -> None:
    assert schema.lacking_in(table, names) == []


def test_a_part_without_a_text_that_is_read_as_a_dictionary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = few_rows.abandoned(tmp_path)
    seal_part(folder)
    (part,) = parts.part_paths(folder, "samples")
    pq.write_table(pq.read_table(part, partitioning=None).drop_columns(["reasons"]), part)
    rows = pa.concat_tables([*row_groups(folder, "samples", ["status", "reasons"])])
    assert rows["reasons"].null_count == len(rows) == ROWS
    pq.write_table(pq.read_table(part, partitioning=None).drop_columns(["station"]), part)
    with pytest.raises(RecordError, match="its columns are others"):
        [*row_groups(folder, "samples")]
