"""Tables stored with a run: joints in `joints.parquet`, metrics in `report.json` and in a cache.

They save a pass over the samples, if they belong to this run: the joints name their source
manifest, and the report names manifest, jbclog and rules. An annotation must hold the hash of
`report.json`, which holds the hash of `joints.parquet`.

After a run its recorder leaves all metrics in `metrics.parquet`, a cache for trends that names
manifest, rules and methods. No hash outside of it shows a change, so only `trend` reads it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import file_digest, sha256
from pathlib import Path
from typing import Final

import msgspec
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from jbclog import __version__
from jbclog.analysis.metrics.definitions import DEFINITIONS, METHODS
from jbclog.analysis.verdict import RULES
from jbclog.core.durable_files import write_whole
from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, open_regular, read_regular
from jbclog.core.json_files import decoder
from jbclog.record.annotations import read as read_annotations
from jbclog.record.folder import METRICS_CACHE
from jbclog.record.part_file import read_parquet
from jbclog.record.schema import FLAG, FLOAT, INT, TEXT, TIME, Column, field_of

REPORT_FILE: Final = "report.json"
JOINTS_FILE: Final = "joints.parquet"
MADE_FROM: Final = b"jbclog.manifest_sha256"
METRICS: Final = {
    "station": "str",
    "port": "int64",
    "metric": "str",
    "value": "Float64",
    "unit": "str",
    "n": "int64",
    "coverage": "Float64",
    "resolution": "Float64",
    "why": "str",
}
"""Columns of the table of metrics, and their types."""


@dataclass(frozen=True, slots=True)
class MetricRow:
    """One metric of one port."""

    station: str
    port: int
    metric: str
    value: float | None
    unit: str
    n: int
    coverage: float | None
    resolution: float | None
    why: str | None


@dataclass(frozen=True, slots=True)
class _Written:
    """The part of `report.json` that has the hashes of its other files."""

    written: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class _Report:
    """The part of `report.json` that has the metrics and their source."""

    manifest_sha256: str
    jbclog: str
    rules: int
    metrics: list[MetricRow]


_read_written: Final = decoder(_Written)
_read_report: Final = decoder(_Report)

JOINTS: Final[Sequence[Column]] = (
    ("station!", TEXT, "", ""),
    ("port!", INT, "", ""),
    ("joint!", INT, "count", "number of the joint in this port, from 1"),
    ("start!", TIME, "UTC", "time of the row nearest to the joint's start"),
    ("end!", TIME, "UTC", "time of the row nearest to its end"),
    ("start_s!", FLOAT, "s", "the same on the run's monotonic grid, between rows"),
    ("end_s!", FLOAT, "s", "the same on the run's monotonic grid, between rows"),
    ("touches!", INT, "count", "contacts joined in it; 0: a feed without a draw of heat"),
    ("dwell_s", FLOAT, "s", "time in which heat flows into the work"),
    ("depth_c", FLOAT, "°C", "temperature at the start minus the lowest until the tip is back"),
    (
        "recovery_s",
        FLOAT,
        "s",
        "from the start until the tip is back near the level at which it rests",
    ),
    ("peak_permille", FLOAT, "‰", "highest flow of heat into the work"),
    ("heat_permille_s", FLOAT, "‰·s", "heat that went into the work"),
    (
        "energy_permille_s",
        FLOAT,
        "‰·s",
        "power above holding power from the start until the tip is back",
    ),
    ("energy_j", FLOAT, "J", "the same × full-scale power / 1000, where that is declared"),
    ("fed", FLAG, "", "solder wire was fed; null where that is not known"),
    (
        "confidence!",
        FLOAT,
        "",
        (
            "0 to 1, not a probability: peak above noise; half if feeds cut the joint, 0.3 for a"
            " feed alone"
        ),
    ),
    (
        "why",
        TEXT,
        "",
        "why recovery, depth or energy is null; or that only the feeder shows the joint",
    ),
    (
        "kind!",
        TEXT,
        "",
        (
            "joint, or not known: as short or small as a wipe or a touch without solder, without"
            " wire, or wire alone"
        ),
    ),
    ("heat_j", FLOAT, "J", "heat_permille_s × full-scale power / 1000, where that is declared"),
    ("setpoint_c", FLOAT, "°C", "setpoint at the start"),
    ("deficit_c", FLOAT, "°C", "setpoint minus temperature at the start"),
    (
        "resting_below_c",
        FLOAT,
        "°C",
        "level at which the tip rests at this setpoint minus temperature at the start",
    ),
    ("lowest_c", FLOAT, "°C", "lowest temperature from the start until the tip is back"),
    ("end_c", FLOAT, "°C", "temperature at the end"),
    (
        "recovered",
        FLAG,
        "",
        "the tip was back before the next draw of heat; null where it was cut off before",
    ),
    ("had_s", FLOAT, "s", "from the start until the next draw of heat, or until it was cut off"),
)


JOINTS_A_GROUP: Final = 131_072
"""Rows of a group: a day of 32 ports has half a million joints, and a group is encoded at once."""
JOINTS_SCHEMA: Final = pa.schema([field_of(column, "definition") for column in JOINTS])


def joints_parquet(joints: pa.Table, manifest_sha256: str) -> bytes:
    """Return the content of `joints.parquet`: deterministic for given joints and manifest."""
    sink = pa.BufferOutputStream()
    pq.write_table(
        joints.replace_schema_metadata({MADE_FROM: manifest_sha256.encode()}),
        sink,
        compression="zstd",
        row_group_size=JOINTS_A_GROUP,
    )
    return bytes(sink.getvalue().to_pybytes())


def stored_joints(folder: Path, manifest_sha256: str) -> pa.Table | None:
    """Return the joints in the run's folder; None if missing, damaged, or of another report or
    manifest.
    """
    try:
        with open_regular(folder / JOINTS_FILE, Kind.OF_REPORT) as file:
            written = _read_written(_report(folder, manifest_sha256)).written
            if written.get(JOINTS_FILE) != file_digest(file, "sha256").hexdigest():
                return None
        table = read_parquet(folder / JOINTS_FILE, Kind.OF_REPORT)
    except (RecordError, OSError, ValueError):
        return None
    made_from = (table.schema.metadata or {}).get(MADE_FROM)
    return (
        table
        if made_from == manifest_sha256.encode() and table.schema.equals(JOINTS_SCHEMA)
        else None
    )


def stored_metrics(folder: Path, manifest_sha256: str) -> list[MetricRow] | None:
    """Return all metrics of the run; None if missing, damaged, or of another manifest, jbclog or
    version of the rules.
    """
    try:
        report = _read_report(_report(folder, manifest_sha256))
    except (RecordError, OSError, ValueError):
        return None
    is_ours = (report.manifest_sha256, report.jbclog, report.rules) == (
        manifest_sha256,
        __version__,
        RULES,
    )
    return report.metrics if is_ours else None


METRICS_SCHEMA: Final = pa.schema(
    [
        *(
            pa.field(name, kind, nullable=False)
            for name, kind in (("station", TEXT), ("port", INT), ("metric", TEXT))
        ),
        *(
            pa.field("value", FLOAT),
            pa.field("unit", TEXT, nullable=False),
            pa.field("n", INT, nullable=False),
        ),
        *(pa.field("coverage", FLOAT), pa.field("resolution", FLOAT), pa.field("why", TEXT)),
    ]
)
"""Columns of `metrics.parquet`, in the order of `MetricRow`."""
BY: Final = b"jbclog.methods"
SUM: Final = b"jbclog.rows_sha256"
METRIC_NAMES: Final = tuple(one.name for one in DEFINITIONS)
METHODS_TEXT: Final = f"rules {RULES}, methods {METHODS}"
"""Versions that compute metrics now. A cache with another text is ignored."""


def cache_metrics(folder: Path, rows: Sequence[MetricRow], manifest_sha256: str) -> None:
    """Write the cache of all metrics of a sealed run into its folder. Raises `OSError`."""
    table = pa.Table.from_pylist([asdict(row) for row in rows], schema=METRICS_SCHEMA)
    sink = pa.BufferOutputStream()
    table = table.replace_schema_metadata(_made_from(manifest_sha256, _rows_of(table)))
    # faster to read
    pq.write_table(table, sink, compression="zstd", use_dictionary=False, write_statistics=False)
    write_whole(folder / METRICS_CACHE, bytes(sink.getvalue().to_pybytes()))


def _made_from(manifest_sha256: str, rows: Sequence[MetricRow]) -> dict[bytes, bytes]:
    """Return the metadata that a valid cache has; its checksum shows damage."""
    own = sha256(msgspec.json.encode(rows)).hexdigest()
    return {MADE_FROM: manifest_sha256.encode(), BY: METHODS_TEXT.encode(), SUM: own.encode()}


def _rows_of(table: pa.Table) -> list[MetricRow]:
    return [
        MetricRow(*row)
        for row in zip(*(column.to_pylist() for column in table.columns), strict=True)
    ]


def cached_metrics(folder: Path, manifest_sha256: str) -> list[MetricRow] | None:
    """Return all metrics of the run from its cache; None if missing, damaged, or of another
    manifest or other methods.
    """
    try:
        table = read_parquet(folder / METRICS_CACHE, Kind.CACHE)
    except RecordError:
        return None
    if not table.schema.equals(METRICS_SCHEMA) or not _is_complete(table):
        return None
    try:
        rows = _rows_of(table)
    except UnicodeDecodeError:
        return None
    made_from = _made_from(manifest_sha256, rows)
    return rows if made_from.items() <= (table.schema.metadata or {}).items() else None


def _is_complete(table: pa.Table) -> bool:
    """Whether each port has all metrics in order, each with a value or the reason why it has
    none.
    """
    has_neither = pc.and_(pc.is_null(table["value"]), pc.is_null(table["why"]))
    is_whole = len(table) > 0 and table["metric"].to_pylist() == [*METRIC_NAMES] * (
        len(table) // len(METRIC_NAMES)
    )
    return is_whole and not pc.any(has_neither).as_py()


def metric_table(rows: Sequence[MetricRow]) -> pd.DataFrame:
    """Return rows of metrics as a table."""
    return pd.DataFrame({name: [getattr(row, name) for row in rows] for name in METRICS}).astype(
        METRICS
    )


def _report(folder: Path, manifest_sha256: str) -> bytes:
    """Return the bytes of `report.json`.

    Raises `RecordError`, `OSError`, or `ValueError` if no annotation holds their hash.
    """
    data = read_regular(folder / REPORT_FILE, Kind.REPORT)
    if read_annotations(folder, manifest_sha256).report != sha256(data).hexdigest():
        raise ValueError("no annotation holds the hash of this report")
    return data
