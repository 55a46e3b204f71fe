"""`Run`: manifest and tables of a run (`RunTables`), and the alarms, joints, metrics and figures
computed from them.

Methods import what they need when they are called, so that opening a run loads neither matplotlib
nor the joint search.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from jbclog.analysis.notebook_html import run_html
from jbclog.analysis.run_tables import UNTIL, RunTables, frame
from jbclog.core.errors import RecordError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jbclog.analysis.port_data import PortData
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

    def units(self) -> pd.DataFrame:
        """Return a row for each stay of a unit on the bench: `run`, `unit` (serial), `start` and
        `stop` (UTC), `joints`, `energy_j` (J), `coverage` (%), `alarms`.

        - Units whose serials were read come first, then units that were only named on the command
          line or later. A single named unit, with no serial read, spans the whole run.
        - `joints`: joints that began meanwhile, of all ports; `alarms`: those that were active
          meanwhile, at least in part
        - `energy_j`: of all ports; missing if one of them has a gap of more than one reading
          meanwhile, or no declared full-scale power
        - `coverage`: readings of temperature and power obtained, of those due meanwhile

        What is not known is missing: all figures of a unit without `start` or `stop`, and `joints`
        where the metric `joints` of a port is not known for another reason than a gap elsewhere.
        Reads `derived/units.parquet` if it is of this record and these methods, else computes it.
        Raises `RecordError` for a record that cannot be read.
        """
        from jbclog.analysis.run_gaps import gap_rows
        from jbclog.analysis.run_metrics import joints_and_metrics, stored_table
        from jbclog.analysis.run_units import units_of

        table = stored_table(self, "units")
        if table is None:
            measures = joints_and_metrics(self)
            table = units_of(self, measures, self.alarm_findings(), gap_rows(self))
        return frame(table)

    def tips(self) -> pd.DataFrame:
        """Return a row for each port whose tip was named at the start of the run: `run`, `station`,
        `port`, `tip` (the cartridge's id).

        A tip that was named for a station, or for the run, is that of all its ports. Raises
        `RecordError`.
        """
        from jbclog.analysis.run_derived import tips_of

        manifest = replace(self.manifest, stations=self.stations)
        return frame(tips_of(manifest))

    def accounting(self, station: str | None = None, port: int | None = None) -> pd.DataFrame:
        """Return a row for each signal of each port: readings `due`, `obtained`, and a column with
        the number that is missing for each reason.

        `due` is `obtained` and all columns after it. `signal` is the name of a column of the
        samples, of a counter or of a setting; `port` is missing for signals of the whole station.
        Of a run that is not sealed it is counted from what is committed, until ``attrs["until"]``.
        Raises `UsageError` for an unknown station or port, `RecordError` for a record that cannot
        be read.
        """
        from jbclog.analysis.run_derived import accounting_of, manifest_now

        self.expect_place(station, port)
        until = self.committed_until()
        rows = frame(accounting_of(manifest_now(self)))
        return with_until(of_place(rows, station, port), until)

    def gaps(
        self, station: str | None = None, port: int | None = None, signal: str | None = None
    ) -> pd.DataFrame:
        """Return a row for each gap: the time from the last reading of a signal to its next one,
        where readings that were due between the two are missing.

        - `start`, `stop`: times of these two readings; `seconds`: between them
        - `missing`: readings that were due in it; `reasons`: why, each once, in order of
          appearance, with ``;`` between. ``no_rows``: ticks without a row
        - `at_least`: no reading is before it or none after it; it may have lasted longer

        Of a run that is not sealed these are the gaps in what is committed, until
        ``attrs["until"]``. Raises `UsageError` for an unknown station, port or signal,
        `RecordError` for a record that cannot be read.
        """
        from jbclog.analysis.run_gaps import gaps_of

        return gaps_of(self, station, port, signal)

    def alarms(
        self, station: str | None = None, port: int | None = None, *, witnesses: bool = False
    ) -> pd.DataFrame:
        """Return a row for each alarm: raised by the station's flags, or by our samples with delays
        and deadband.

        With ``witnesses=True`` a row for each episode of each detector. Rows with the same
        `incident` belong together. The one with `main` describes the alarm, and is the one that is
        given otherwise; incidents without it are excursions, no alarms.

        - `detector`: A the station's flags, B our samples with delays and deadband, C every
          excursion of our samples; `witnesses`: those of the incident, such as ``A, B ×2, C``
        - `start_earliest`, `start`: the episode began after the first and no later than the second
        - `stop_earliest`, `stop`: it ended after the first and no later than the second
        - `raised`: when it became known; `seconds`: from `start` to `stop`
        - `seconds_least`, `seconds_most`: without its unread time, and with that right before
          `start`; null where all of it was read
        - `state`: active, cleared, or uncertain (not read for too long)
        - `confirmed`: a temperature supports the flag
        - `uncertain`: not read for too long in between
        - `finding`: how the detectors disagree
        - `acknowledged_by`, `acknowledged_at`, `acknowledged_why`: from `jbclog alarms ack`

        Raises `UsageError` for an unknown station or port, `RecordError` for a record that cannot
        be read.
        """
        self.expect_place(station, port)
        rows = of_place(self.alarm_findings().frame(), station, port)
        return rows if witnesses else rows[rows["main"]].reset_index(drop=True)

    def alarm_findings(self) -> Alarms:
        """Return the alarms as objects: incidents with their episodes, flood and chatter figures,
        findings.
        """
        from jbclog.analysis.run_alarms import alarms_of

        return alarms_of(self)

    def port(self, station: str, port: int) -> PortData:
        """Return the rows of a port as arrays: what figures, metrics and verdict are made of.

        ``port("bench-1", 1).temperature`` is an array, ``.frame()`` a table. Raises `UsageError`
        for an unknown station or port, `RecordError` for a record that cannot be read.
        """
        from jbclog.analysis.run_ports import RunPorts, columns_of

        self.expect_place(station, port)
        facts = next((facts for facts in self.stations if facts.name == station), None)
        return RunPorts(self, [] if facts is None else columns_of(facts))[station, port]

    def joints(self, station: str | None = None, port: int | None = None) -> pd.DataFrame:
        """Return a row for each joint: start, stop, unit, tip, dwell, depth, recovery, heat,
        energy, confidence.

        docs/explanation/joints.md defines a joint; no column rates its quality. Reads
        `derived/joints.parquet` if it is of this record and these methods, else searches the
        samples. Raises `UsageError` for an unknown station or port, `RecordError` for a record that
        cannot be read.
        """
        from jbclog.analysis.run_metrics import joints_of

        self.expect_place(station, port)
        return of_place(frame(joints_of(self, station)), station, port)

    def each_joint(self, station: str | None = None, port: int | None = None) -> list[RunJoint]:
        """Return the joints as objects: the columns as fields, and `samples()`, its slice of the
        samples.

        Raises `UsageError` for an unknown station or port, `RecordError` for a record that cannot
        be read.
        """
        from jbclog.analysis.run_joints import each_joint

        self.expect_place(station, port)
        return each_joint(self, station, port)

    def metrics(self, station: str | None = None, port: int | None = None) -> pd.DataFrame:
        """Return a row for each metric of each port: `metric`, `value` between `low` and `high`
        (null where no range is known) in `uom`, `n`, `coverage`, `resolution`, `why`.

        Without a `value`, `why` has the reason; `metric_definitions` defines the metrics. Reads
        `derived/metrics.parquet` if it is of this record and these methods, else computes the
        metrics; those of a run that is not sealed from what is committed, until
        ``attrs["until"]``. Raises `UsageError` for an unknown station or port, `RecordError` for a
        record that cannot be read.
        """
        from jbclog.analysis.run_metrics import metrics_of

        self.expect_place(station, port)
        until = self.committed_until()
        return with_until(of_place(metrics_of(self, station), station, port), until)

    @staticmethod
    def metric_definitions() -> pd.DataFrame:
        """Return the definition of each metric: `metric`, `uom`, `definition`, `applies_to`."""
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


def of_place(rows: pd.DataFrame, station: str | None, port: int | None) -> pd.DataFrame:
    """Return the rows of a station, of a port, of both, or all."""
    if station is not None:
        rows = rows[rows["station"] == station]
    if port is not None:
        rows = rows[rows["port"] == port]
    return rows.reset_index(drop=True)


def with_until(rows: pd.DataFrame, until: pd.Timestamp | None) -> pd.DataFrame:
    """Return rows that say until when a run was read; None: it is sealed, and was read to its
    end.
    """
    if until is not None:
        rows.attrs[UNTIL] = until
    return rows


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
