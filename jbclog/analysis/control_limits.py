"""Fixed control limits from a phase I study, in a file that charts cite by its hash.

The JSON file has the charted metric; centre and limits of each port, with their distribution and
number of values; and the hashes of the source runs. The same runs give the same bytes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from jbclog.analysis import spc
from jbclog.analysis.charts import Fixed, Series, too_many_late
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.files import Kind, read_regular
from jbclog.core.json_files import builder

FORMAT: Final = "jbclog control limits 1"


@dataclass(frozen=True, slots=True)
class Source:
    """A source run of the limits: its name, and the SHA-256 of its manifest."""

    run: str
    manifest_sha256: str


@dataclass(frozen=True, slots=True)
class Limits:
    """Content of a file. `each`: kind of point, ``joint`` or ``run``."""

    format: str
    metric: str
    uom: str
    each: str
    limits: list[Fixed]
    sources: list[Source]

    def of(self, series: Series) -> Fixed | None:
        """Return the limits of a series, or None. Raises `UsageError` for another metric."""
        if (self.metric, self.each) != (series.metric, series.each):
            raise UsageError(
                f"the limits are of {self.metric} by {self.each}, the chart is of {series.metric}"
                f" by {series.each}; learn limits of that metric"
            )
        return next((one for one in self.limits if (one.station, one.port) == series.place), None)


_build_limits: Final = builder(Limits)


def learn(series: Series) -> Fixed | spc.Refused:
    """Return the limits of a series, or why it is not stable or no distribution fits."""
    chart = too_many_late(series.late, len(series.values)) or spc.phase_one(
        series.values, resolution=series.resolution
    )
    if isinstance(chart, spc.Refused):
        return chart
    edges = float(chart.lower[0]), float(chart.upper[0])
    return Fixed(
        series.station, series.port, chart.centre, *edges, chart.distribution, len(series.values)
    )


def as_bytes(limits: Limits) -> bytes:
    """Return the content of the file."""
    return (
        json.dumps(asdict(limits), indent=1, sort_keys=True, ensure_ascii=False) + "\n"
    ).encode()


def limits_of(
    metric: str, unit: str, each: str, found: Iterable[Fixed], sources: Iterable[Source]
) -> Limits:
    """Return limits in the current format."""
    return Limits(FORMAT, metric, unit, each, list(found), list(sources))


def read_limits(path: Path) -> tuple[Limits, str]:
    """Return the limits and the SHA-256 of their file.

    Raises `RecordError` if it cannot be read or has another format.
    """
    try:
        data = read_regular(path, Kind.SETTINGS)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}") from error
    try:
        limits = _build_limits(json.loads(data))
    except (ValueError, RecursionError) as error:
        raise RecordError(
            f"{path} is not a file of control limits; `jbclog limits learn` writes one"
        ) from error
    if limits.format != FORMAT or any(
        not one.lower < one.centre < one.upper for one in limits.limits
    ):
        raise RecordError(
            f"{path} is not a file of control limits of this version ({FORMAT}); learn them again"
        )
    return limits, hashlib.sha256(data).hexdigest()
