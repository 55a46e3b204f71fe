"""Writes `joints.parquet` beside the report: every joint of the run, as `Run.joints` finds them."""

from __future__ import annotations

from pathlib import Path

from jbclog.analysis import open_run
from jbclog.analysis.features import joints_table
from jbclog.analysis.joint_table import FILE, as_bytes
from jbclog.errors import RecordError
from jbclog.record.durable import write_whole
from jbclog.record.manifest import manifest_sha256


def joints_bytes(folder: Path) -> bytes:
    """What `joints.parquet` of this run holds; the same run gives the same bytes. Raises `RecordError`."""
    return as_bytes(joints_table(open_run(folder)), manifest_sha256(folder))


def write_joints(folder: Path | str) -> Path:
    """Write `joints.parquet` into the folder of a sealed run; give its path. Raises `RecordError`."""
    path = Path(folder) / FILE
    try:
        write_whole(path, joints_bytes(Path(folder)))
    except OSError as error:
        raise RecordError(f"{path} cannot be written: {error.strerror}") from error
    return path
