"""The metrics as `report` left them in `report.json`: so that many runs are looked at without going through their samples again.

They are taken where that file was made from this very manifest, by this very version, in which the definitions are the same; else
they are computed anew. What somebody changed in that file since is found by `report --verify`, and not here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pandas as pd

from jbclog import __version__
from jbclog.foreign.files import Kind
from jbclog.foreign.numbers import read_json

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


def left_metrics(folder: Path, manifest_sha256: str) -> pd.DataFrame | None:
    """The table of all metrics of the run; None where the report does not have it, or is not this run's or this version's."""
    try:
        document = read_json(folder / FILE, Kind.REPORT)
        if (document["manifest_sha256"], document["jbclog"]) != (manifest_sha256, __version__):
            return None
        rows = document["metrics"]
        return metric_table(rows) if isinstance(rows, list) else None
    except (OSError, ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return None


def metric_table(rows: list[dict[str, object]]) -> pd.DataFrame:
    """Rows of metrics as a table. Raises ValueError, TypeError or KeyError where they are none."""
    return pd.DataFrame(rows, columns=list(METRICS)).astype(METRICS)
