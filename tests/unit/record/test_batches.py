"""Batches: what is stored comes back, and what was altered is known to be."""

from __future__ import annotations

import struct
import subprocess
import sys
from dataclasses import replace

import pyarrow as pa
import pytest

from jbclog.core.rows import COLUMN
from jbclog.record.batches import MOST_BYTES, MOST_ROWS, Batch, Damaged, NotRows, decode, encode
from jbclog.record.schema import SCHEMAS
from support.records import few_rows


def values(count: int) -> list[object]:
    return [value for number in range(count) for value in few_rows.sample(number)]


def test_what_is_stored_comes_back() -> None:
    batch = encode(5, "samples", values(300))
    table = decode(batch, batch.crc)
    assert (batch.number, batch.table, batch.rows) == (5, "samples", 300)
    assert table.schema.equals(SCHEMAS["samples"], check_metadata=True)
    plain = table.set_column(0, "time", table["time"].cast(pa.int64()))
    assert [value for row in plain.to_pylist() for value in row.values()] == values(300)


def test_a_batch_without_rows() -> None:
    batch = encode(1, "events", [])
    assert decode(batch, batch.crc).num_rows == 0


def test_large_batches_let_other_threads_run() -> None:
    breaths: list[None] = []
    encode(1, "samples", values(600), breath=lambda: breaths.append(None))
    assert len(breaths) >= 2
    breaths.clear()
    encode(1, "samples", values(60), breath=lambda: breaths.append(None))
    assert not breaths


def test_the_check_sum_covers_number_table_and_rows() -> None:
    batch = encode(5, "samples", values(3))
    for other in (replace(batch, number=6), replace(batch, table="events"), replace(batch, rows=4)):
        with pytest.raises(Damaged):
            decode(other, batch.crc)


def test_every_single_altered_byte_is_noticed() -> None:
    batch = encode(1, "counters", few_rows.counter(7))
    for place in range(len(batch.data)):
        altered = bytearray(batch.data)
        altered[place] ^= 0x10
        with pytest.raises(Damaged):
            decode(replace(batch, data=bytes(altered)), batch.crc)


def test_nonsense_with_a_right_check_sum_is_damage_too() -> None:
    for data in (b"", b"\xff" * 40, b"\x10\0\0\0" + b"\0" * 30):
        nonsense = Batch(1, "samples", 3, data)
        with pytest.raises(Damaged):
            decode(nonsense, nonsense.crc)


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
        encode(1, "samples", row)


def test_the_recorder_does_without_pandas_and_pandas_still_works_later() -> None:
    program = """
import sys
import pyarrow as pa
from jbclog.record.batches import decode, encode, prepare_arrow
prepare_arrow()
batch = encode(1, "counters", [0, "a", None, "work_h", 1.0, "h", "00001"])
assert "pyarrow.compute" not in sys.modules, "a recorder stores rows"
table = decode(batch, batch.crc)
assert "pandas" not in sys.modules, "pandas came in"
assert pa.default_memory_pool().backend_name == "system"
frame = table.to_pandas()
assert str(frame.dtypes["port"]) == "Int64"
"""
    subprocess.run([sys.executable, "-W", "error", "-c", program], check=True)


def stored(data: bytes, rows: int = 1) -> Batch:
    return Batch(1, "samples", rows, data)


def packed(stream: bytes, size: int | None = None) -> bytes:
    """A stream of Arrow as it stands in a live store."""
    return struct.pack("<I", len(stream) if size is None else size) + bytes(
        pa.Codec("zstd").compress(stream, asbytes=True)
    )


def stream_of(rows: pa.RecordBatch, compression: str | None = None) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(
        sink, rows.schema, options=pa.ipc.IpcWriteOptions(compression=compression)
    ) as writer:
        writer.write_batch(rows)
    return bytes(sink.getvalue().to_pybytes())


ONE_ROW = pa.record_batch({"x": pa.array([1])})


@pytest.mark.parametrize(
    ("batch", "why"),
    [
        (stored(packed(bytes(1), MOST_BYTES + 1)), "bytes, unpacked"),
        (
            stored(packed(stream_of(ONE_ROW), 10), MOST_ROWS + 1),
            "rows; a recorder's batches have at most",
        ),
        (stored(packed(stream_of(ONE_ROW)), 2), "1 rows, not 2"),
        (
            stored(
                packed(stream_of(pa.record_batch({"x": pa.array([0] * 99_999)}), "zstd")), 99_999
            ),
            "packed twice",
        ),
        (
            stored(packed(stream_of(pa.record_batch({"x": pa.array(["a"]).dictionary_encode()})))),
            "what no recorder writes",
        ),
    ],
)
def test_a_batch_that_unpacks_to_more_than_a_recorder_s(batch: Batch, why: str) -> None:
    with pytest.raises(Damaged, match=why):
        decode(batch, batch.crc)
