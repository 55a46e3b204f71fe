"""The table of joints, `joints.parquet`: its columns, their units, and how it is read and made into bytes.

The file names the manifest that it was made from (its schema's `jbclog.manifest_sha256`); the same run gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from jbclog.core.foreign.tables import read_small
from jbclog.record.schema import FLAG, FLOAT, INT, TEXT, TIME

FILE: Final = "joints.parquet"
MADE_FROM: Final = b"jbclog.manifest_sha256"

Column = tuple[str, pa.DataType, str, str]
JOINTS: Final[Sequence[Column]] = (
    ("station!", TEXT, "", ""),
    ("port!", INT, "", ""),
    ("joint!", INT, "count", "number of the joint in this port, from 1"),
    ("start!", TIME, "UTC", "time of the row nearest to the joint's start"),
    ("end!", TIME, "UTC", "time of the row nearest to its end"),
    ("start_s!", FLOAT, "s", "the same on the run's monotonic grid, between rows"),
    ("end_s!", FLOAT, "s", "the same on the run's monotonic grid, between rows"),
    ("touches!", INT, "count", "contacts put together in it; 0: a feed without a draw of heat"),
    ("dwell_s", FLOAT, "s", "time in which heat flows into the work"),
    ("depth_c", FLOAT, "°C", "temperature at the start minus the lowest until the tip is back"),
    ("recovery_s", FLOAT, "s", "from the start until the tip is back near the level at which it rests"),
    ("peak_permille", FLOAT, "‰", "highest flow of heat into the work"),
    ("heat_permille_s", FLOAT, "‰·s", "heat that went into the work"),
    ("energy_permille_s", FLOAT, "‰·s", "power above holding power from the start until the tip is back"),
    ("energy_j", FLOAT, "J", "the same × full-scale power / 1000, where that is declared"),
    ("fed", FLAG, "", "wire was pushed in it; null where that is not known"),
    (
        "confidence!",
        FLOAT,
        "",
        "0 to 1, no probability: how far its peak is beyond noise; half where feeds cut it, 0.3 of a feed",
    ),
    ("why", TEXT, "", "why recovery, depth or energy is null; that only the feeder tells of it"),
    ("kind!", TEXT, "", "joint, or not known: as short or small as a wipe or a touch without solder, without wire, or wire alone"),
    ("heat_j", FLOAT, "J", "heat_permille_s × full-scale power / 1000, where that is declared"),
    ("setpoint_c", FLOAT, "°C", "setpoint at the start"),
    ("deficit_c", FLOAT, "°C", "setpoint minus temperature at the start"),
    ("resting_below_c", FLOAT, "°C", "level at which the tip rests at this setpoint minus temperature at the start"),
    ("lowest_c", FLOAT, "°C", "lowest temperature from the start until the tip is back"),
    ("end_c", FLOAT, "°C", "temperature at the end"),
    ("recovered", FLAG, "", "the tip was back before the next draw of heat; null where it was cut off before"),
    ("had_s", FLOAT, "s", "from the start until the next draw of heat, or until it was cut off"),
)


def _field(column: Column) -> pa.Field:
    name, kind, unit, text = column
    metadata = {key: told for key, told in (("unit", unit), ("definition", text)) if told}
    return pa.field(name.removesuffix("!"), kind, nullable=not name.endswith("!"), metadata=metadata or None)


JOINTS_SCHEMA: Final = pa.schema([_field(column) for column in JOINTS])


def as_bytes(joints: pa.Table, manifest_sha256: str) -> bytes:
    """The file's bytes."""
    sink = pa.BufferOutputStream()
    pq.write_table(joints.replace_schema_metadata({MADE_FROM: manifest_sha256.encode()}), sink, compression="zstd")
    return bytes(sink.getvalue().to_pybytes())


def read_joints(folder: Path, manifest_sha256: str) -> pa.Table | None:
    """The joints as the file in the run's folder has them; None where it is not there, not one, or of another manifest."""
    try:
        table = read_small(folder / FILE)
    except (OSError, pa.ArrowException):
        return None
    made_from = (table.schema.metadata or {}).get(MADE_FROM)
    same = made_from == manifest_sha256.encode() and table.schema.equals(JOINTS_SCHEMA)
    return table if same else None
