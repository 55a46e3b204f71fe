"""The metrics as `report` left them in `report.json`: so that many runs are looked at without going through their samples again.

They are taken where that file was made from this very manifest, by this very version and its rules, in which the definitions are
the same, and where a line of the annotations vouches for its bytes; else they are computed anew.
"""

from __future__ import annotations

from hashlib import file_digest, sha256
from pathlib import Path
from typing import Final

import pandas as pd

from jbclog import __version__
from jbclog.analysis.verdict import RULES
from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind, open_foreign, read_foreign
from jbclog.core.foreign.json_reader import json_of
from jbclog.record.annotations import read

FILE: Final = "report.json"
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
"""The columns of a table of metrics and their kinds."""


def is_as_written(folder: Path, name: str) -> bool:
    """Whether a file of the report has the bytes that `report.json` says, and a line of the annotations vouches for that one's."""
    try:
        data = read_foreign(folder / FILE, Kind.REPORT)
        if read(folder).report != sha256(data).hexdigest():
            return False
        with open_foreign(folder / name, Kind.OF_REPORT) as file:
            return bool(json_of(data)["written"][name] == file_digest(file, "sha256").hexdigest())
    except (RecordError, OSError, ValueError, TypeError, KeyError, RecursionError):
        return False


def left_metrics(folder: Path, manifest_sha256: str) -> pd.DataFrame | None:
    """The table of all metrics of the run; None where the report does not have it, or is not this run's or this version's."""
    try:
        data = read_foreign(folder / FILE, Kind.REPORT)
        document = json_of(data)
        made_by = document["manifest_sha256"], document["jbclog"], document["rules"]
        if made_by != (manifest_sha256, __version__, RULES) or read(folder).report != sha256(data).hexdigest():
            return None
        rows = document["metrics"]
        return metric_table(rows) if isinstance(rows, list) else None
    except (RecordError, OSError, ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return None


def metric_table(rows: list[dict[str, object]]) -> pd.DataFrame:
    """Rows of metrics as a table. Raises ValueError, TypeError or KeyError where they are none."""
    return pd.DataFrame(rows, columns=list(METRICS)).astype(METRICS)
