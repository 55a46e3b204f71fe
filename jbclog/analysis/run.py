"""Opens a run. `Run` has its manifest and tables (`RunTables`), and what is computed from them:
alarms, joints, metrics, figures.

Methods import what they compute with when they are called, so that opening a run loads neither
matplotlib nor the joint search.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from jbclog.analysis.notebook_html import run_html
from jbclog.analysis.run_tables import RunTables
from jbclog.core.errors import RecordError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jbclog.analysis.run_alarms import Alarms
    from jbclog.analysis.run_joints import RunJoint


class Run(RunTables):
    """The run in `folder`: sealed, still being recorded, or cut off by a crash. Each call reads the
    tables anew.
    """

    def _repr_html_(self) -> str:
        return run_html(self.name, self.manifest)

    def __repr__(self) -> str:
        return (
            f"<Run {self.name}: {self.manifest.state}, {self.manifest.verdict or 'no verdict yet'}>"
        )

    def alarms(self) -> pd.DataFrame:
        """Return a row for each alarm episode that a detector found; rows with the same `incident`
        belong together.

        `detector`: A the station's flags, B our samples with delays and deadband, C every excursion
        of our samples. The episode began after `onset_earliest` and no later than `onset`; it ended
        after `end_earliest` and no later than `end`. `raised`: when it became known. `state`:
        active, cleared, or uncertain (not read for too long). `seconds`: from `onset` to `end`.
        `confirmed`: a temperature supports the flag. `uncertain`: not read for too long in between.
        `finding`: how the detectors disagree. `acknowledged_by`, `_at`, `_why`: from
        `jbclog alarms ack`. Raises `RecordError`.
        """
        return self.alarm_findings().frame()

    def alarm_findings(self) -> Alarms:
        """Return the same as objects: incidents with their episodes, figures of floods and chatter,
        findings.
        """
        from jbclog.analysis.run_alarms import alarms_of

        return alarms_of(self)

    def joints(self, station: str | None = None) -> pd.DataFrame:
        """Return a row for each joint: start, end, dwell, depth, recovery, heat, energy,
        confidence.

        Reads `joints.parquet` if `jbclog report` wrote it for this manifest, and searches the
        samples otherwise. The definition of a joint is in `jbclog/analysis/joints/joints.py`; no
        column says that a joint is good. Raises `UsageError` for an unknown station, `RecordError`.
        """
        from jbclog.analysis.run_metrics import joints_frame, joints_of

        self.expect_place(station)
        return joints_frame(joints_of(self, station))

    def each_joint(self, station: str | None = None, port: int | None = None) -> list[RunJoint]:
        """Return the same joints as objects: the columns as fields, the unit, and the slice of the
        samples by `samples()`.

        Raises `UsageError` for an unknown station or port, `RecordError`.
        """
        from jbclog.analysis.run_joints import each_joint

        self.expect_place(station, port)
        return each_joint(self, station, port)

    def metrics(self, station: str | None = None) -> pd.DataFrame:
        """Return a row for each metric of each port:
        `metric, value, unit, n, coverage, resolution, why`.

        A metric without a value has the reason in `why`; `metric_definitions` has the meanings.
        Reads `report.json` if this version of jbclog wrote it for this manifest, and computes the
        metrics otherwise. Raises `UsageError` for an unknown station, `RecordError`.
        """
        from jbclog.analysis.run_metrics import metrics_of

        self.expect_place(station)
        return metrics_of(self, station)

    @staticmethod
    def metric_definitions() -> pd.DataFrame:
        """Return the definition of each metric: `metric, unit, definition, applies_to`."""
        from jbclog.analysis.run_metrics import definitions

        return definitions()

    def plot(self, station: str | None = None, port: int | None = None) -> Figure:
        """Draw each port as in the report: temperature with setpoint and alarm limits, power,
        status, joints, missing data, alarms.

        Each panel has one linear scale over its whole range; the x axis has days (UTC). Raises
        `UsageError` for an unknown station or port, and if there are no samples to show.
        """
        from jbclog.analysis.run_plot import plot

        self.expect_place(station, port)
        return plot(self, station, port)


def open_run(path: str | os.PathLike[str]) -> Run:
    """Return the run in the folder `path`: sealed, still being recorded, or cut off by a crash.
    Raises `RecordError`.
    """
    folder = Path(path)
    run = Run(folder)
    if not folder.is_dir():
        raise RecordError(f"{folder} is missing, or not a folder")
    run.manifest  # noqa: B018  # raises here, not at the first table, if the folder holds no run
    return run
