"""Opens a run: four tables as DataFrames, the manifest, a plot."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
import pyarrow as pa

from jbclog.analysis.selection import Asked, Moment, asked, frame
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.wire import Passed
from jbclog.record.capture import Hole, read_head, rows_and_holes, wire_path
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import Manifest, read_manifest
from jbclog.record.parts import Damage, groups_of, part_paths, parts_through
from jbclog.record.schema import SCHEMAS
from jbclog.record.sealed_files import expect_manifest_unchanged, expect_unchanged
from jbclog.record.store import segments
from jbclog.record.store_reader import StoreReader

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jbclog.analysis.run_alarms import Alarms
    from jbclog.analysis.units import Times


class Run:
    """One run in `folder`. Tables are read anew at each call, so a run that is being recorded grows."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._sealed: tuple[tuple[int, ...], Manifest] | None = None

    def _repr_html_(self) -> str:
        from jbclog.analysis.html import run_html

        return run_html(self)

    def __repr__(self) -> str:
        return f"<Run {self.folder.name}: {self.manifest.state}, {self.manifest.verdict or 'no verdict yet'}>"

    @property
    def name(self) -> str:
        """The name of its folder."""
        return self.folder.name

    @property
    def manifest(self) -> Manifest:
        """The manifest as it is now; for a run that was cut off before it had one, an empty one.

        One that is sealed is read again only when its file is another one: every table asks for it.
        """
        before = self._seen()
        if self._sealed is None or before is None or self._sealed[0] != before:
            manifest = self._read_manifest()
            if manifest.state != "sealed" or before is None:
                return manifest
            self._sealed = before, manifest
        return self._sealed[1]

    def _seen(self) -> tuple[int, ...] | None:
        """Which file the manifest is now; None where there is none."""
        try:
            there = (self.folder / MANIFEST).stat()
        except OSError:
            return None
        return there.st_ino, there.st_mtime_ns, there.st_ctime_ns, there.st_size

    def _read_manifest(self) -> Manifest:
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

        `start` is included, `stop` is not. A value that was not read is missing; `reasons` says why. Raises `UsageError` where
        the run has no such station, as the other tables do.
        """
        return self._frame(self._asked("samples", station, port, start, stop, columns))

    def stream(
        self,
        table: str = "samples",
        station: str | None = None,
        port: int | None = None,
        start: Moment | None = None,
        stop: Moment | None = None,
        columns: Sequence[str] | None = None,
    ) -> Iterator[pd.DataFrame]:
        """The rows of a table a piece at a time (a row group of some 33 000 rows at most), none of them kept; none that is empty.

        For what does not fit into memory: a month of 32 stations takes no more than an hour of them.
        """
        wanted = self._asked(table, station, port, start, stop, columns)
        return (frame(piece) for piece in self._lazily(wanted) if piece.num_rows)

    def events(self, station: str | None = None, start: Moment | None = None, stop: Moment | None = None) -> pd.DataFrame:
        """What happened, in order."""
        return self._frame(self._asked("events", station, start=start, stop=stop))

    def settings(self, station: str | None = None) -> pd.DataFrame:
        """The outcome of each setting, values as text in their unit."""
        return self._frame(self._asked("settings", station))

    def counters(self, station: str | None = None) -> pd.DataFrame:
        """Readings of the stations' counters; a failed one has no value, and the reason in `raw`."""
        return self._frame(self._asked("counters", station))

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
        from jbclog.analysis.run_alarms import alarms_of

        return alarms_of(self)

    def unit_at(self, times: Times) -> pd.Series:
        """The serial of the unit on the bench at each of these UTC moments, in their order; missing where none is known."""
        from jbclog.analysis.units import unit_at

        return unit_at(self, times)

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
        """Temperature against its setting, power below, what was not read hatched; a panel a port."""
        from jbclog.analysis.plot import plot

        return plot(self, station, port)

    def groups(self, table: str, columns: list[str]) -> Iterator[pa.Table]:
        """The rows of a table, a row group at a time, in order; what is still in the live store comes last."""
        return self._lazily(asked(table, columns))

    def pieces(self, table: str, columns: list[str]) -> list[pa.Table]:
        """The rows of a table piece by piece as Arrow tables, in order."""
        return self._pieces(asked(table, columns))

    def _frame(self, wanted: Asked) -> pd.DataFrame:
        pieces = self._pieces(wanted)
        return frame(pa.concat_tables(pieces) if pieces else SCHEMAS[wanted.table].empty_table().select(list(wanted.columns)))

    def _asked(
        self,
        table: str,
        station: str | None = None,
        port: int | None = None,
        start: Moment | None = None,
        stop: Moment | None = None,
        columns: Sequence[str] | None = None,
    ) -> Asked:
        """Raises `UsageError` where the run has no such station: no rows would read as if nothing had been recorded of it."""
        names = [facts.name for facts in self.manifest.stations] if station is not None else []
        if names and station not in names:
            raise UsageError(f"{self.name} has no station {station!r}; it has {', '.join(names)}")
        return asked(table, columns, station, port, start, stop)

    def _pieces(self, wanted: Asked) -> list[pa.Table]:
        """Sealed row groups, then what is still in the live store and in no part; each is cut before the next is read."""
        return list(self._lazily(wanted))

    def _lazily(self, wanted: Asked) -> Iterator[pa.Table]:
        """The same, one after the other: only what is in the live store is kept until it comes to that."""
        parts, live, damage = self._read(wanted)
        if damage:
            warnings.warn(f"{self.folder}: {'; '.join(map(str, damage))}", stacklevel=5)
        yield from map(wanted.cut, groups_of(parts, wanted.needed))
        yield from live

    def _read(self, wanted: Asked) -> tuple[list[Path], list[pa.Table], list[Damage]]:
        """The order matters: a snapshot of the store first, then manifest and parts, then what the parts do not have."""
        with StoreReader(self.folder) as stock:
            manifest = self.manifest
            parts = part_paths(self.folder, wanted.table)
            if manifest.state == "sealed":
                expect_unchanged(self.folder, manifest, wanted.table, parts)
            numbers = stock.numbers_of(wanted.table, parts_through(parts))
            live = [wanted.cut(piece.select(wanted.needed)) for piece in stock.tables(numbers)]
            return [part for part in parts if wanted.may_have(part)], live, stock.damage


def open_run(path: str | os.PathLike[str]) -> Run:
    """The run in the folder `path`: sealed, still being recorded, or cut off by a crash. Raises `RecordError`."""
    folder = Path(path)
    run = Run(folder)
    if not folder.is_dir():
        raise RecordError(f"{folder} is not there, or is no folder")
    run.manifest  # noqa: B018  # a folder that is no run is said to be none here, not at the first table
    return run
