"""`joints.parquet`: every joint of the run, as `Run.joints` finds them."""

from __future__ import annotations

from pathlib import Path

from jbclog.analysis import open_run
from jbclog.analysis.features import joints_table
from jbclog.analysis.joint_table import FILE as JOINTS
from jbclog.analysis.joint_table import as_bytes
from jbclog.record.manifest import manifest_sha256

__all__ = ["JOINTS", "joints_bytes"]


def joints_bytes(folder: Path) -> bytes:
    """What `joints.parquet` of this run holds; the same run gives the same bytes. Raises `RecordError`."""
    return as_bytes(joints_table(open_run(folder)), manifest_sha256(folder))
