"""The files of `derived/`: tables that save a pass over the samples, if they belong to this run.

Each names the manifest, the last annotation and the versions of rules and methods that it was made
from, and has a checksum of its rows. Nothing outside of it shows who made it: readers take what
fits, and whatever judges a run computes from the record.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from jbclog.analysis.derived_schemas import DERIVED_SCHEMAS, METRICS_SCHEMA
from jbclog.analysis.metrics.metric import METHODS
from jbclog.analysis.verdict import RULES
from jbclog.core.durable_files import write_whole
from jbclog.core.errors import RecordError
from jbclog.core.files import Kind
from jbclog.record.annotations import read as read_annotations
from jbclog.record.folder import DERIVED, derived_file
from jbclog.record.manifest import manifest_sha256
from jbclog.record.part_file import read_parquet

MADE_FROM: Final = b"jbclog.manifest_sha256"
BY: Final = b"jbclog.methods"
SUM: Final = b"jbclog.rows_sha256"
ANNOTATED: Final = b"jbclog.annotations_head"
WITH_ANNOTATIONS: Final = ("joints", "alarms", "units")
"""Tables with late serials or acknowledgements, which are annotations."""

METHODS_TEXT: Final = f"rules {RULES}, methods {METHODS}"
"""Versions that derive tables now. A file with another text is ignored."""
ROWS_A_GROUP: Final = 131_072
"""A day of 32 ports has half a million joints, and a group is encoded at once."""

TEXTS_AT_ONCE: Final = 16_384


@dataclass(frozen=True, slots=True)
class MetricRow:
    """One metric of one port."""

    station: str
    port: int
    metric: str
    value: float | None
    low: float | None
    high: float | None
    uom: str
    n: int
    coverage: float | None
    resolution: float | None
    why: str | None


@dataclass(frozen=True, slots=True)
class Origin:
    """What derived tables are made from: the hash of the manifest, and the last annotation's."""

    manifest_sha256: str
    annotations_head: str

    @classmethod
    def of(cls, folder: Path) -> Origin:
        """Return the origin of tables made now. Raises `RecordError`."""
        made_from = manifest_sha256(folder)
        return cls(made_from, read_annotations(folder, made_from).head)


def derived_files(tables: Mapping[str, pa.Table], origin: Origin) -> dict[str, bytes]:
    """Return name -> content of the files of these tables, the same for the same rows and
    origin.
    """
    return {derived_file(name): _parquet(table, origin) for name, table in tables.items()}


def write_derived(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the files into the folder of a sealed run, each whole or not at all. Raises
    `OSError`.
    """
    (folder / DERIVED).mkdir(exist_ok=True)
    for name, content in files.items():
        write_whole(folder / name, content)


def _parquet(table: pa.Table, origin: Origin) -> bytes:
    own = {
        b"pandas": (table.schema.metadata or {})[b"pandas"],
        MADE_FROM: origin.manifest_sha256.encode(),
        ANNOTATED: origin.annotations_head.encode(),
        BY: METHODS_TEXT.encode(),
        SUM: _rows_sha256(table).encode(),
    }
    sink = pa.BufferOutputStream()
    with pq.ParquetWriter(
        sink,
        table.schema,
        compression="zstd",
        use_dictionary=[field.name for field in table.schema if pa.types.is_string(field.type)],
        write_statistics=False,  # of one small row group they would be a third of the file
        store_schema=False,  # Parquet's own types say the same
    ) as writer:
        writer.write_table(table, ROWS_A_GROUP)
        writer.add_key_value_metadata(own)  # without a stored schema, its metadata are not written
    return bytes(sink.getvalue().to_pybytes())


def derived_table(folder: Path, name: str, made_from: str) -> pa.Table | None:
    """Return a derived table of a sealed run; None if it is missing, damaged, of another manifest
    (hash `made_from`), other annotations or other methods.
    """
    try:
        table = read_parquet(folder / derived_file(name), Kind.DERIVED)
        expected = {MADE_FROM: made_from.encode(), BY: METHODS_TEXT.encode()}
        if name in WITH_ANNOTATIONS:
            expected[ANNOTATED] = read_annotations(folder, made_from).head.encode()
        schema = DERIVED_SCHEMAS[name]
        metadata = table.schema.metadata or {}
        if not expected.items() <= metadata.items() or not table.schema.equals(schema):
            return None
        table = table.cast(schema)  # adds units and meanings
        is_whole = metadata.get(SUM) == _rows_sha256(table).encode()
    except (RecordError, OSError, ValueError, pa.ArrowException):
        return None
    return table if is_whole else None


def _rows_sha256(table: pa.Table) -> str:
    """Return a hash of all cells. However they are cut into chunks, it is the same."""
    digest = sha256()
    for column in table.columns:
        for part in _cells(column):
            digest.update(part)
    return digest.hexdigest()


def _cells(column: pa.ChunkedArray) -> Iterator[bytes]:
    for chunk in column.chunks:
        yield pc.is_valid(chunk).cast(pa.uint8()).to_numpy().tobytes()
    for chunk in column.chunks:
        if pa.types.is_string(chunk.type):
            for first in range(0, len(chunk), TEXTS_AT_ONCE):
                texts = chunk.slice(first, TEXTS_AT_ONCE).to_pylist()
                yield "".join(f"{text or ''}\0" for text in texts).encode()
        elif pa.types.is_boolean(chunk.type):
            yield pc.fill_null(chunk.cast(pa.uint8()), 0).to_numpy().tobytes()
        elif pa.types.is_timestamp(chunk.type):
            yield pc.fill_null(chunk.cast(pa.int64()), 0).to_numpy().tobytes()
        else:
            yield pc.fill_null(chunk, 0).to_numpy().tobytes()


def metrics_table(rows: Sequence[MetricRow], run: str) -> pa.Table:
    """Return rows of metrics of a run as a table."""
    return pa.Table.from_pylist([{"run": run, **asdict(row)} for row in rows], METRICS_SCHEMA)


def metric_rows_in(table: pa.Table) -> list[MetricRow]:
    """Return the rows of the table of metrics as objects."""
    columns = [column.to_pylist() for column in table.columns[1:]]
    return [MetricRow(*row) for row in zip(*columns, strict=True)]
