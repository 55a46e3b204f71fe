"""Large tables are never held whole."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

import jbclog
from jbclog.app.export import csv_files, workbook
from jbclog.app.export.source import Source
from support.lazy import mdf

PIECES = 12


@pytest.mark.parametrize(
    ("format_", "most"), [(csv_files, 2), (workbook, 2), (mdf, 5)], ids=["csv", "xlsx", "mf4"]
)
def test_few_pieces_of_a_table_are_in_memory_at_once(
    run: jbclog.Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    format_: Any,
    most: int,
) -> None:
    rows = next(run.groups("samples", list(run.samples().columns))).combine_chunks()
    made, peak = list[weakref.ref[pa.Table]](), 0

    def pieces(table: str) -> Iterator[pa.Table]:
        nonlocal peak
        for _ in range(PIECES):
            copy = pa.ipc.open_stream(serialized(rows)).read_all()
            made.append(weakref.ref(copy))
            peak = max(peak, sum(one() is not None for one in made))
            yield copy
            del copy

    monkeypatch.setattr("jbclog.app.export.mdf.HELD_ROWS", 4 * rows.num_rows)
    source = Source(run, ["samples"], is_checked=True)
    monkeypatch.setattr(source, "pieces", pieces)
    format_.write(source, tmp_path / "out")
    assert peak <= most


def serialized(rows: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, rows.schema) as stream:
        stream.write_table(rows)
    return bytes(sink.getvalue())
