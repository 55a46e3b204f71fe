"""Live stores of valid batches that are larger than a recorder's, and serial captures that unpack
to much.
"""

from __future__ import annotations

import gzip
import json
import sqlite3
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from jbclog.record.batches import BARE, Batch
from jbclog.record.folder import create_run
from jbclog.record.manifest import Manifest, iso, write_manifest
from jbclog.record.store import FACTS, META
from support.records import few_rows

T0: Final = 1_790_000_000
TABLES: Final = """
CREATE TABLE batch (
  number INTEGER PRIMARY KEY, name TEXT NOT NULL, rows INTEGER NOT NULL, crc INTEGER NOT NULL,
  data BLOB NOT NULL
);
CREATE TABLE note (
  kind TEXT NOT NULL, key TEXT NOT NULL, text TEXT NOT NULL, crc INTEGER NOT NULL,
  PRIMARY KEY (kind, key)
);
"""


def samples(rows: int, first: int = 0) -> pa.RecordBatch:
    """Rows of samples as a recorder makes them, from tick `first` on."""
    ticks = np.arange(first, first + rows, dtype=np.int64)
    celsius = 350 + ticks // 7 % 3
    known = {
        "time": pa.array(T0 * 1_000_000 + ticks * 100_000).cast(pa.timestamp("us", tz="UTC")),
        "tick": pa.array(ticks),
        "station": pa.array(["a"]).take(pa.array(np.zeros(rows, dtype=np.int64))),
        "port": pa.array(np.ones(rows, dtype=np.int64)),
        "quality": pa.array(["ok"]).take(pa.array(np.zeros(rows, dtype=np.int64))),
        "temperature_c": pa.array(celsius.astype(np.int64)),
        "power_permille": pa.array((celsius * 7 % 1000).astype(np.int64)),
        "status": pa.array(["working"]).take(pa.array(np.zeros(rows, dtype=np.int64))),
    }
    schema = BARE["samples"]
    return pa.RecordBatch.from_arrays(
        [known.get(f.name, pa.nulls(rows, f.type)) for f in schema], schema=schema
    )


def packed(number: int, table: str, rows: pa.RecordBatch) -> Batch:
    """A batch of these rows, with the right check sum, whatever its size."""
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, rows.schema) as writer:
        writer.write_batch(rows)
    stream = sink.getvalue()
    data = struct.pack("<I", stream.size) + bytes(
        pa.Codec("zstd", compression_level=1).compress(stream, asbytes=True)
    )
    return Batch(number, table, rows.num_rows, data)


def write_store(path: Path, batches: Iterable[Batch], notes: dict[tuple[str, str], str]) -> None:
    """Write a live store with these batches and notes, all with the right check sums."""
    for ending in ("", "-wal", "-shm"):
        path.with_name(path.name + ending).unlink(missing_ok=True)
    with sqlite3.connect(path) as made:
        made.executescript(TABLES)
        made.executemany(
            "INSERT INTO batch VALUES (?, ?, ?, ?, ?)",
            ((one.number, one.table, one.rows, one.crc, one.data) for one in batches),
        )
        made.executemany(
            "INSERT INTO note VALUES (?, ?, ?, ?)",
            (
                (kind, key, text, zlib.crc32(f"{kind} {key} {text}".encode()))
                for (kind, key), text in notes.items()
            ),
        )
    made.close()


def crashed_run(
    out: Path, batches: Iterable[Batch], notes: dict[tuple[str, str], str] | None = None
) -> Path:
    """The folder of a run that crashed, with these batches in its live store."""
    folder = create_run(out, "bench", float(T0))
    facts = replace(
        few_rows.facts(),
        period_s=0.1,
        signals=["temperature_c", "power_permille", "status"],
        first_tick=0,
    )
    write_manifest(
        folder,
        Manifest(
            folder.name,
            started=iso(T0 * 1_000_000),
            t0_utc=float(T0),
            t0_mono=0.0,
            stations=[facts],
        ),
    )
    said = {
        (META, "schema"): "1",
        (META, "run"): folder.name,
        (FACTS, "a"): json.dumps(asdict(facts)),
    }
    write_store(folder / "live.sqlite", batches, said | (notes or {}))
    return folder


def large_batches(count: int, rows: int) -> Iterator[Batch]:
    """So many batches of so many samples each."""
    return (
        packed(number, "samples", samples(rows, (number - 1) * rows))
        for number in range(1, count + 1)
    )


def small_batches(numbers: Iterable[int]) -> Iterator[Batch]:
    """A batch of one sample for each of these numbers."""
    return (packed(number, "samples", samples(1, number)) for number in numbers)


def junk_lines(path: Path, lines: int) -> None:
    """A gzip file of so many lines that are none of a serial capture."""
    path.parent.mkdir(exist_ok=True)
    with gzip.open(path, "wb", 6) as file:
        for _ in range(lines // 1_000_000):
            file.write(b"junk of a bomb; no row of a capture\n" * 1_000_000)
