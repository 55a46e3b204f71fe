"""Runs of an earlier version, which lack the columns that came since, stay readable: these are
null, and a reader that asks for one by name is warned.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbclog.analysis.run import open_run
from jbclog.core.errors import RecordError
from jbclog.core.rows import SAMPLE_COLUMNS, SCHEMA_VERSION
from jbclog.record import batches, parts, schema
from jbclog.record.check import check
from jbclog.record.parts import row_groups
from jbclog.record.recover import Outcome, recover
from jbclog.record.seal import seal_rows
from support.records import few_rows

ROWS = 150  # of `few_rows.abandoned`
BOTH = ("preparing", "in_range")  # the last columns of `samples`


def run_without(
    later: Sequence[str], home: Path, monkeypatch: pytest.MonkeyPatch, *, is_sealed: bool
) -> Path:
    """A run as a recorder left it that did not know the last columns."""
    known = [one for one in schema.SCHEMAS["samples"] if one.name not in later]
    earlier = pa.schema(known, metadata=schema.SCHEMAS["samples"].metadata)
    bare = pa.schema([pa.field(one.name, one.type, one.nullable) for one in known])
    with monkeypatch.context() as before:
        before.setattr(few_rows, "SAMPLE_COLUMNS", SAMPLE_COLUMNS[: len(known)])
        before.setitem(batches.BARE, "samples", bare)
        before.setitem(batches._COLUMNS, "samples", batches._COLUMNS["samples"][: len(known)])
        for module in (batches, parts):
            before.setattr(module, "SCHEMAS", {**schema.SCHEMAS, "samples": earlier})
        folder = few_rows.abandoned(home)
        if is_sealed:
            seal_rows(folder, part=True)
            (part,) = parts.part_paths(folder, "samples")
            assert pq.read_metadata(part).num_columns == len(known)
    return folder


@pytest.mark.parametrize("is_sealed", [True, False])
@pytest.mark.parametrize("later", [BOTH, BOTH[1:]])
def test_what_an_earlier_version_did_not_record_is_null(
    later: Sequence[str], is_sealed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = run_without(later, tmp_path, monkeypatch, is_sealed=is_sealed)
    for version, name in enumerate(BOTH, 2):
        monkeypatch.setitem(schema.FIRST_IN, ("samples", name), version)
    run = open_run(folder)
    rows = run.samples()
    assert (tuple(rows), len(rows)) == (SAMPLE_COLUMNS, ROWS)
    assert rows["temperature_c"].notna().all()
    assert rows[[*later]].isna().all(axis=None)
    assert {str(rows[name].dtype) for name in later} == {"boolean"}
    with pytest.warns(UserWarning, match="samples: in_range not recorded by the version"):
        assert len(run.samples(columns=["in_range"])) == ROWS
    some = pa.concat_tables([*run.groups("samples", ["in_range", "station", "tick"], coded=True)])
    assert some.column_names == ["in_range", "station", "tick"]
    assert some["tick"].to_pylist() == [*range(ROWS)]
    assert recover(folder).outcome is Outcome.RECOVERED
    assert check(folder) == []
    assert sum(len(group) for group in row_groups(folder, "samples", ["in_range"])) == ROWS


def test_other_columns_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = run_without(BOTH, tmp_path, monkeypatch, is_sealed=True)
    with pytest.raises(RecordError, match="its columns are others"):
        open_run(folder).samples()
    monkeypatch.setitem(schema.FIRST_IN, ("samples", "in_range"), 2)
    with pytest.raises(RecordError, match="its columns are others"):
        open_run(folder).samples()


def test_the_version_is_that_of_the_latest_column() -> None:
    assert max(schema.FIRST_IN.values(), default=1) == SCHEMA_VERSION
    assert all(
        table != "events" and schema.SCHEMAS[table].field(name).nullable
        for table, name in schema.FIRST_IN
    )
