"""`Run`: manifest and tables of a run (`RunTables`), and the alarms, joints, metrics and figures
computed from them.

Methods import what they need when they are called, so that opening a run loads neither matplotlib
nor the joint search.
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
    """A run in a folder: sealed, still being recorded, or cut off by a crash.

    Nothing but the manifest is cached: each call reads the tables again.
    """

    def _repr_html_(self) -> str:
        return run_html(self.name, self.manifest)

    def __repr__(self) -> str:
        return (
            f"<Run {self.name}: {self.manifest.state}, {self.manifest.verdict or 'no verdict yet'}>"
        )

    def alarms(self) -> pd.DataFrame:
        """Return a row for each alarm episode; rows with the same `incident` belong together.

        - `detector`: A the station's flags, B our samples with delays and deadband, C every
          excursion of our samples
        - `onset_earliest`, `onset`: the episode began after the first and no later than the second
        - `end_earliest`, `end`: it ended after the first and no later than the second
        - `raised`: when it became known; `seconds`: from `onset` to `end`
        - `seconds_least`, `seconds_most`: without its unread time, and with that right before
          `onset`; null where all of it was read
        - `state`: active, cleared, or uncertain (not read for too long)
        - `confirmed`: a temperature supports the flag
        - `uncertain`: not read for too long in between
        - `finding`: how the detectors disagree
        - `acknowledged_by`, `acknowledged_at`, `acknowledged_why`: from `jbclog alarms ack`

        Raises `RecordError` for a record that cannot be read.
        """
        return self.alarm_findings().frame()

    def alarm_findings(self) -> Alarms:
        """Return the alarms as objects: incidents with their episodes, flood and chatter figures,
        findings.
        """
        from jbclog.analysis.run_alarms import alarms_of

        return alarms_of(self)

    def joints(self, station: str | None = None) -> pd.DataFrame:
        """Return a row for each joint: start, end, dwell, depth, recovery, heat, energy,
        confidence.

        docs/explanation/joints.md defines a joint; no column rates its quality. Reads
        `joints.parquet` if `jbclog report` wrote it for this manifest, else searches the samples.
        Raises `UsageError` for an unknown station, `RecordError` for a record that cannot be read.
        """
        from jbclog.analysis.run_metrics import joints_frame, joints_of

        self.expect_place(station)
        return joints_frame(joints_of(self, station))

    def each_joint(self, station: str | None = None, port: int | None = None) -> list[RunJoint]:
        """Return the joints as objects: the columns as fields, the unit, and `samples()`, its slice
        of the samples.

        Raises `UsageError` for an unknown station or port, `RecordError` for a record that cannot
        be read.
        """
        from jbclog.analysis.run_joints import each_joint

        self.expect_place(station, port)
        return each_joint(self, station, port)

    def metrics(self, station: str | None = None) -> pd.DataFrame:
        """Return a row for each metric of each port: `metric`, `value`, `unit`, `n`, `coverage`,
        `resolution`, `why`.

        Without a `value`, `why` has the reason; `metric_definitions` defines the metrics. Reads
        `report.json` if this version of jbclog wrote it for this manifest, else computes the
        metrics. Raises `UsageError` for an unknown station, `RecordError` for a record that cannot
        be read.
        """
        from jbclog.analysis.run_metrics import metrics_of

        self.expect_place(station)
        return metrics_of(self, station)

    @staticmethod
    def metric_definitions() -> pd.DataFrame:
        """Return the definition of each metric: `metric`, `unit`, `definition`, `applies_to`."""
        from jbclog.analysis.run_metrics import definitions

        return definitions()

    def plot(self, station: str | None = None, port: int | None = None) -> Figure:
        """Draw each port as in the report: temperature with setpoint and alarm limits, power,
        status, joints, missing data, alarms.

        Each panel has one linear scale over its whole range; the x axis is in days (UTC). Raises
        `UsageError` for an unknown station or port, or without samples.
        """
        from jbclog.analysis.run_plot import plot

        self.expect_place(station, port)
        return plot(self, station, port)


def open_run(path: str | os.PathLike[str]) -> Run:
    """Open the run in a folder: sealed, still being recorded, or cut off by a crash.

    Raises `RecordError` if it cannot be read.
    """
    folder = Path(path)
    run = Run(folder)
    if not folder.is_dir():
        raise RecordError(f"{folder} is missing, or not a folder")
    run.manifest  # noqa: B018  # raises here, not at the first table, if the folder holds no run
    return run
