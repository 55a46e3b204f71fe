"""Opens a run: four tables as DataFrames, the manifest, and what follows from them. Start with `Run`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from jbclog.analysis.notebook_html import run_html
from jbclog.analysis.run_tables import RunTables, frame
from jbclog.core.errors import RecordError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jbclog.analysis.run_alarms import Alarms


class Run(RunTables):
    """One run in `folder`. Tables are read anew at each call, so a run that is being recorded grows."""

    def _repr_html_(self) -> str:
        return run_html(self.name, self.manifest)

    def __repr__(self) -> str:
        return f"<Run {self.folder.name}: {self.manifest.state}, {self.manifest.verdict or 'no verdict yet'}>"

    def alarms(self) -> pd.DataFrame:
        """Alarm episodes: a row for each, as each detector (`detector`) saw it; rows of one `incident` belong together.

        Detectors: A the station's flags, B our samples with the alarm's delays and a dead band, C every sampled excursion.
        It began after `onset_earliest` and at `onset` at the latest, and ended between `end_earliest` and `end`; `raised` is
        when it was known. `state`: active, cleared, or uncertain (not read for too long). `seconds`: from `onset` to `end`.
        `confirmed`: a flag that a temperature bears out. `uncertain`: in between nothing was read for too long. `finding`: on
        what the detectors do not agree. `acknowledged_*`: by whom, when and why (`jbclog alarms ack`).
        """
        return self.alarm_findings().frame()

    def alarm_findings(self) -> Alarms:
        """The same as objects: incidents side by side, figures of floods and chatter, findings."""
        from jbclog.analysis.run_alarms import alarms_of

        return alarms_of(self)

    def joints(self, station: str | None = None) -> pd.DataFrame:
        """A row for each joint that was found: start, end, dwell, depth, recovery, heat, energy, confidence.

        From `joints.parquet` where `report` has written it for this manifest, else found anew; also of a run that is still
        open. What a joint is here stands in `jbclog.analysis.joints.joints`; nothing in it says that a joint is good.
        """
        from jbclog.analysis.run_metrics import joints_of

        return frame(joints_of(self, station)).astype({"fed": "boolean"})

    def metrics(self, station: str | None = None) -> pd.DataFrame:
        """A row for each metric of each port: `metric, value, unit, n, coverage, resolution, why`; no value, then a reason.

        From `report.json` where `report` of this version has written it for this manifest, else computed anew.
        `metric_definitions()` tells what each of them means.
        """
        from jbclog.analysis.run_metrics import metrics_of

        return metrics_of(self, station)

    @staticmethod
    def metric_definitions() -> pd.DataFrame:
        """What each metric means: `metric, unit, definition, applies_to`."""
        from jbclog.analysis.run_metrics import definitions

        return definitions()

    def plot(self, station: str | None = None, port: int | None = None) -> Figure:
        """Draw each port as in the report: temperature, power, status, missing data, alarms; days (UTC) on the x axis."""
        from jbclog.analysis.run_plot import plot

        return plot(self, station, port)


def open_run(path: str | os.PathLike[str]) -> Run:
    """The run in the folder `path`: sealed, still being recorded, or cut off by a crash. Raises `RecordError`."""
    folder = Path(path)
    run = Run(folder)
    if not folder.is_dir():
        raise RecordError(f"{folder} is not there, or is no folder")
    run.manifest  # noqa: B018  # a folder that is no run is said to be none here, not at the first table
    return run
