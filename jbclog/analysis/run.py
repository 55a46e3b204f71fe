"""Opens a run: four tables as DataFrames, the manifest, a plot."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, cast

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.errors import RecordError, UsageError
from jbclog.record.damage import Damage
from jbclog.record.manifest import Manifest, read_manifest
from jbclog.record.parts import groups_of, part_paths, parts_through
from jbclog.record.schema import SCHEMAS
from jbclog.record.stock import Stock
from jbclog.record.store import segments
from jbclog.record.unchanged import expect_manifest_unchanged, expect_unchanged
from jbclog.record.wire import Hole, read_head, rows_and_holes, wire_path
from jbclog.tape import Passed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jbclog.analysis.alarms import Alarms
    from jbclog.analysis.units import Times

Moment = str | datetime | pd.Timestamp
"""A time: a string such as ``2026-11-21T01:30``, a datetime or a Timestamp; UTC where it names no zone."""

Cut = Callable[[pa.Table], pa.Table]
"""Takes out of some rows what was asked for."""


class Run:
    """One run in `folder`. Tables are read anew at each call, so a run that is being recorded grows."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __repr__(self) -> str:
        return f"<Run {self.folder.name}: {self.manifest.state}, {self.manifest.verdict or 'no verdict yet'}>"

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def manifest(self) -> Manifest:
        """The manifest as it is now; for a run that was cut off before it had one, an empty one."""
        try:
            manifest = read_manifest(self.folder)
            expect_manifest_unchanged(self.folder)
            return manifest
        except RecordError:
            if segments(self.folder):
                return Manifest(self.folder.name)
            raise

    def samples(
        self,
        station: str | None = None,
        port: int | None = None,
        start: Moment | None = None,
        stop: Moment | None = None,
        columns: Sequence[str] | None = None,
    ) -> pd.DataFrame:
        """A row per tick, station and port, in the order in which they were recorded.

        `start` is included, `stop` is not. A value that was not read is missing; `reasons` says why.
        """
        return self._frame("samples", station, port, start, stop, columns)

    def events(self, station: str | None = None, start: Moment | None = None, stop: Moment | None = None) -> pd.DataFrame:
        """What happened, in order."""
        return self._frame("events", station, None, start, stop, None)

    def settings(self, station: str | None = None) -> pd.DataFrame:
        """The outcome of each setting, values as text in their unit."""
        return self._frame("settings", station, None, None, None, None)

    def counters(self, station: str | None = None) -> pd.DataFrame:
        """Readings of the stations' counters; a failed one has no value, and the reason in `raw`."""
        return self._frame("counters", station, None, None, None, None)

    def wire(self, station: str) -> pd.DataFrame:
        """What passed over a station's wire, in order: `time`, `what`, `data` (bytes), `text`.

        Only of a run with ``--wire``; of others, and where the file is none, `RecordError`. What of it was damaged is left
        out, with a warning that says what.
        """
        path = wire_path(self.folder, station)
        if not path.is_file():
            raise RecordError(f"{self.folder}: what passed over the wire of {station} was not kept; it takes `run --wire`")
        head = read_head(path)
        rows = [*rows_and_holes(path)]
        passed = [row for row in rows if isinstance(row, Passed)]
        for hole in (row for row in rows if isinstance(row, Hole)):
            warnings.warn(f"{path}: {hole.told(head)}", stacklevel=2)
        table = pd.DataFrame(passed, columns=["time", "what", "data", "text"])
        micros = (table["time"] + (head.t0_utc - head.t0_mono)).mul(1e6).round()
        return table.assign(time=micros.astype("int64").astype("datetime64[us]").dt.tz_localize("UTC"))

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
        from jbclog.analysis.alarms import alarms_of

        return alarms_of(self)

    def unit_at(self, times: Times) -> pd.Series:
        """The serial of the unit on the bench at each of these UTC moments, in their order; missing where none is known."""
        from jbclog.analysis.units import unit_at

        return unit_at(self, times)

    def joints(self, station: str | None = None) -> pd.DataFrame:
        """A row for each joint that was found: start, end, dwell, depth, recovery, heat, energy, confidence.

        From `joints.parquet` where `report` has written it for this manifest, else found anew; also of a run that is still
        open. What a joint is here stands in `jbclog.features.joints`; nothing in it says that a joint is good.
        """
        from jbclog.analysis.features import joints_of

        return frame(joints_of(self, station)).astype({"fed": "boolean"})

    def metrics(self, station: str | None = None) -> pd.DataFrame:
        """A row for each metric of each port: `metric, value, unit, n, coverage, resolution, why`; no value, then a reason.

        `metric_definitions()` tells what each of them means.
        """
        from jbclog.analysis.features import metrics_of

        return metrics_of(self, station)

    @staticmethod
    def metric_definitions() -> pd.DataFrame:
        """What each metric means: `metric, unit, definition, applies_to`."""
        from jbclog.analysis.features import definitions

        return definitions()

    def plot(self, station: str | None = None, port: int | None = None) -> Figure:
        """Temperature against its setting, power below, what was not read hatched; a panel a port."""
        from jbclog.analysis.plot import plot

        return plot(self, station, port)

    def pieces(self, table: str, columns: list[str]) -> list[pa.Table]:
        """The rows of a table piece by piece as Arrow tables, in order."""
        return self._pieces(table, columns, lambda piece: piece.select(columns))

    def _frame(
        self,
        table: str,
        station: str | None,
        port: int | None,
        start: Moment | None,
        stop: Moment | None,
        columns: Sequence[str] | None,
    ) -> pd.DataFrame:
        schema = SCHEMAS[table]
        unknown = [name for name in columns or () if name not in schema.names]
        if unknown:
            raise UsageError(f"{table} has no column {', '.join(unknown)}; it has {', '.join(schema.names)}")
        wanted = list(columns) if columns is not None else schema.names
        bounds = _micros(start), _micros(stop)
        pieces = self._pieces(table, wanted, lambda piece: _cut(piece, station, port, *bounds).select(wanted))
        whole = pa.concat_tables(pieces) if pieces else schema.empty_table().select(wanted)
        return frame(whole)

    def _pieces(self, table: str, columns: list[str], cut: Cut) -> list[pa.Table]:
        """Sealed row groups, then what is still in the live store and in no part; each is cut before the next is read."""
        needed = [name for name in SCHEMAS[table].names if name in {*columns, "time", "station", "port"}]
        pieces, damage = self._read(table, needed, cut)
        if damage and not segments(self.folder):  # sealed in just this moment
            pieces, damage = self._read(table, needed, cut)
        if damage:
            warnings.warn(f"{self.folder}: {'; '.join(map(str, damage))}", stacklevel=4)
        return pieces

    def _read(self, table: str, columns: list[str], cut: Cut) -> tuple[list[pa.Table], list[Damage]]:
        """The order matters: a snapshot of the store first, then the parts, then what the parts do not have."""
        manifest = self.manifest
        with Stock(self.folder) as stock:
            parts = part_paths(self.folder, table)
            if manifest.state == "sealed":
                expect_unchanged(self.folder, manifest, table, parts)
            numbers = stock.numbers_of(table, parts_through(parts))
            live = [cut(piece.select(columns)) for piece in stock.tables(numbers)]
            return [*map(cut, groups_of(parts, columns)), *live], stock.damage


def open_run(path: str | os.PathLike[str]) -> Run:
    """The run in the folder `path`: sealed, still being recorded, or cut off by a crash. Raises `RecordError`."""
    folder = Path(path)
    run = Run(folder)
    if not folder.is_dir():
        raise RecordError(f"{folder} is not there, or is no folder")
    run.manifest  # noqa: B018  # a folder that is no run is said to be none here, not at the first table
    return run


def frame(table: pa.Table) -> pd.DataFrame:
    """An Arrow table as a DataFrame: Int64 and boolean where values can be missing, times in UTC."""
    return cast(pd.DataFrame, table.to_pandas())


def _micros(moment: Moment | None) -> pa.Scalar | None:
    if moment is None:
        return None
    stamp = pd.Timestamp(moment)
    stamp = stamp.tz_localize(UTC) if stamp.tzinfo is None else stamp.tz_convert(UTC)
    return pa.scalar(stamp.value // 1000, pa.int64()).cast(pa.timestamp("us", tz="UTC"))


def _cut(table: pa.Table, station: str | None, port: int | None, start: pa.Scalar | None, stop: pa.Scalar | None) -> pa.Table:
    if station is not None:
        table = table.filter(pc.equal(table["station"], station))
    if port is not None:
        table = table.filter(pc.equal(table["port"], port))
    if start is not None:
        table = table.filter(pc.greater_equal(table["time"], start))
    if stop is not None:
        table = table.filter(pc.less(table["time"], stop))
    return table
