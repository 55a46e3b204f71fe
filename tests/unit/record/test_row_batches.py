"""Rows as frames: what is encoded comes back, also what an older recorder wrote."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import pyarrow as pa
import pytest

from jbclog.core.rows import COLUMN
from jbclog.record.frames import Frame, FrameKind
from jbclog.record.row_batches import (
    BARE,
    Damaged,
    NotRows,
    decode,
    encode,
    schema_frame,
    schema_of,
    table_of,
)
from jbclog.record.schema import SCHEMAS
from support.records import few_rows

RUN = "20260921T141320Z-bench-k7qd"


def values(count: int) -> list[object]:
    return [value for number in range(count) for value in few_rows.sample(number)]


def test_what_is_encoded_comes_back() -> None:
    frame = encode("samples", values(300), 7000, 2)
    schema = schema_of(schema_frame("samples", 2))
    table = decode(frame, schema, RUN)
    assert (frame.kind, frame.table, frame.first, frame.rows) == (FrameKind.ROWS, 2, 7000, 300)
    assert table_of(schema) == "samples"
    assert table.schema.equals(SCHEMAS["samples"], check_metadata=True)
    assert table["run"].to_pylist() == [RUN] * 300
    assert table["seq"].to_pylist() == [*range(7000, 7300)]
    plain = table.set_column(2, "time", table["time"].cast(pa.int64())).drop_columns(["run", "seq"])
    assert [value for row in plain.to_pylist() for value in row.values()] == values(300)


def test_columns_that_an_older_recorder_did_not_have_are_null() -> None:
    names = [name for name in BARE["samples"].names if name not in ("late_us", "in_range")]
    older = pa.schema(
        [BARE["samples"].field(name) for name in names], metadata={"table": "samples"}
    )
    batch = pa.ipc.read_record_batch(
        pa.py_buffer(encode("samples", values(3), 0).payload()), BARE["samples"]
    )
    payload = batch.select(names).serialize().to_pybytes()
    table = decode(Frame.of(FrameKind.ROWS, payload, 0, 5, 3), older, RUN)
    assert table.schema.equals(SCHEMAS["samples"], check_metadata=True)
    assert table["seq"].to_pylist() == [5, 6, 7]
    assert table["late_us"].null_count == 3
    assert table["temperature_c"].null_count == 0


def test_a_column_that_this_jbclog_does_not_know_is_refused() -> None:
    newer = BARE["samples"].append(pa.field("humidity", pa.int64()))
    batch = pa.record_batch([pa.array([], field.type) for field in newer], schema=newer)
    frame = Frame.of(FrameKind.ROWS, batch.serialize().to_pybytes())
    with pytest.raises(Damaged):
        decode(frame, newer, RUN)


def test_a_frame_that_says_another_number_of_rows_is_refused() -> None:
    frame = encode("samples", values(3), 0)
    with pytest.raises(Damaged, match="3 rows, not 2"):
        decode(replace(frame, rows=2), BARE["samples"], RUN)


def test_large_frames_let_other_threads_run() -> None:
    breaths: list[None] = []
    encode("samples", values(600), 0, breath=lambda: breaths.append(None))
    assert len(breaths) >= 2
    breaths.clear()
    encode("samples", values(60), 0, breath=lambda: breaths.append(None))
    assert not breaths


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("temperature_c", "350"),
        ("temperature_c", 350.5),
        ("tool", True),
        ("alarm_high", 1),
        ("status", 1),
        ("quality", None),
    ],
)
def test_what_does_not_fit_a_column_is_refused_by_name(column: str, value: object) -> None:
    row = few_rows.sample(0)
    row[COLUMN[column]] = value
    with pytest.raises(NotRows, match=column):
        encode("samples", row, 0)


def test_the_recorder_does_without_pandas_and_pandas_still_works_later() -> None:
    program = """
import sys
import pyarrow as pa
from jbclog.record.row_batches import BARE, decode, encode, prepare_arrow
prepare_arrow()
frame = encode("counters", [0, "a", None, "work_h", 1.0, "h", "00001"], 0)
assert "pyarrow.compute" not in sys.modules, "a recorder stores rows"
table = decode(frame, BARE["counters"], "bench")
assert "pandas" not in sys.modules, "pandas came in"
assert pa.default_memory_pool().backend_name == "system"
frame = table.to_pandas()
assert str(frame.dtypes["port"]) == "Int64"
"""
    subprocess.run([sys.executable, "-W", "error", "-c", program], check=True)
