"""The tables of a run as DataFrames, its manifest, and the serials of its units."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, cast

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.capture_rows import LinkRow
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.foreign.tables import bounds_of
from jbclog.core.rows import StationFacts
from jbclog.record.annotations import BEGIN, END, late_serials, only_unit
from jbclog.record.capture import Hole, read_head, rows_and_holes, wire_path
from jbclog.record.conclude import known_stations
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import Manifest, read_manifest
from jbclog.record.parts import Damage, groups_of, part_paths, parts_through
from jbclog.record.schema import SCHEMAS
from jbclog.record.sealed_files import expect_manifest_unchanged, expect_unchanged
from jbclog.record.store import segments
from jbclog.record.store_reader import StoreReader

Moment = str | datetime | pd.Timestamp
"""A time: a string such as ``2026-11-21T01:30``, a datetime or a Timestamp; UTC where it names no zone."""

MICROSECONDS: Final = struct.Struct("<q")  # a time as Parquet writes one plainly


@dataclass(frozen=True, slots=True)
class Selection:
    """`start` is included, `stop` is not, both UTC; None asks for all."""

    table: str
    columns: Sequence[str]
    station: str | None = None
    port: int | None = None
    start: pd.Timestamp | None = None
    stop: pd.Timestamp | None = None

    @property
    def needed(self) -> list[str]:
        """The columns that have to be read for it, in their order."""
        beside = {"station": self.station, "port": self.port, "time": self.start if self.start is not None else self.stop}
        also = {name for name, value in beside.items() if value is not None}
        return [name for name in SCHEMAS[self.table].names if name in {*self.columns, *also}]

    def cut(self, rows: pa.Table) -> pa.Table:
        """Those of `rows` that are asked for, in the columns' order."""
        if self.station is not None:
            rows = rows.filter(pc.equal(rows["station"], self.station))
        if self.port is not None:
            rows = rows.filter(pc.equal(rows["port"], self.port))
        if self.start is not None:
            rows = rows.filter(pc.greater_equal(rows["time"], _scalar(self.start)))
        if self.stop is not None:
            rows = rows.filter(pc.less(rows["time"], _scalar(self.stop)))
        return rows.select(list(self.columns))

    def may_have(self, part: Path) -> bool:
        """Whether a part can have rows of the time asked for, by its footer. Raises `RecordError` where it has none."""
        if self.start is None and self.stop is None:
            return True
        try:
            first, last = _span(part)
        except (pa.ArrowException, OSError) as error:
            raise RecordError(f"{part} is no readable part: {error}") from error
        if first is None or last is None:
            return True
        return (self.start is None or last >= self.start) and (self.stop is None or first < self.stop)


def select(
    table: str,
    columns: Sequence[str] | None = None,
    station: str | None = None,
    port: int | None = None,
    start: Moment | None = None,
    stop: Moment | None = None,
) -> Selection:
    """What somebody asks for. Raises `UsageError` for a column that there is not."""
    names = SCHEMAS[table].names
    unknown = [name for name in columns or () if name not in names]
    if unknown:
        raise UsageError(f"{table} has no column {', '.join(unknown)}; it has {', '.join(names)}")
    return Selection(table, list(columns) if columns is not None else names, station, port, utc(start), utc(stop))


def utc(moment: Moment | None) -> pd.Timestamp | None:
    """A time in UTC, which it is taken to be where it names no zone."""
    if moment is None:
        return None
    stamp = pd.Timestamp(moment)
    return stamp.tz_localize(UTC) if stamp.tzinfo is None else stamp.tz_convert(UTC)


def frame(table: pa.Table) -> pd.DataFrame:
    """An Arrow table as a DataFrame: Int64 and boolean where values can be missing, times in UTC."""
    return cast(pd.DataFrame, table.to_pandas())


def _scalar(stamp: pd.Timestamp) -> pa.Scalar:
    return pa.scalar(stamp.as_unit("ns").value // 1000, pa.int64()).cast(pa.timestamp("us", tz="UTC"))


def _span(part: Path) -> tuple[pd.Timestamp | None, pd.Timestamp | None]:
    """The first and the last time in a part; None where its footer does not say. Raises OSError or pa.ArrowException."""
    seen = bounds_of(part, "time")
    if not seen or any(one is None or {*map(len, one)} != {MICROSECONDS.size} for one in seen):
        return None, None
    try:
        times = [pd.Timestamp(MICROSECONDS.unpack(plain)[0], unit="us", tz=UTC) for one in seen if one is not None for plain in one]
    except (ValueError, OverflowError):  # a time that no clock shows
        return None, None
    return min(times), max(times)


class RunTables:
    """Manifest and tables of the run in `folder`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._sealed: tuple[tuple[int, ...], Manifest] | None = None

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
        return self._frame(self._select("samples", station, port, start, stop, columns))

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
        wanted = self._select(table, station, port, start, stop, columns)
        return (frame(piece) for piece in self._lazily(wanted) if piece.num_rows)

    def events(self, station: str | None = None, start: Moment | None = None, stop: Moment | None = None) -> pd.DataFrame:
        """What happened, in order."""
        return self._frame(self._select("events", station, start=start, stop=stop))

    def settings(self, station: str | None = None) -> pd.DataFrame:
        """The outcome of each setting, values as text in their unit."""
        return self._frame(self._select("settings", station))

    def counters(self, station: str | None = None) -> pd.DataFrame:
        """Readings of the stations' counters; a failed one has no value, and the reason in `raw`."""
        return self._frame(self._select("counters", station))

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
        passed = [row for row in rows if isinstance(row, LinkRow)]
        for hole in (row for row in rows if isinstance(row, Hole)):
            warnings.warn(f"{path}: {hole.told(head)}", stacklevel=2)
        table = pd.DataFrame(passed, columns=["time", "what", "data", "text"])
        micros = (table["time"] + (head.t0_utc - head.t0_mono)).mul(1e6).round()
        return table.assign(time=micros.astype("int64").astype("datetime64[us]").dt.tz_localize("UTC"))

    def unit_at(self, times: Times) -> pd.Series:
        """The serial of the unit on the bench at each of these UTC moments, in their order; missing where none is known."""
        return unit_at(self, times)

    def groups(self, table: str, columns: list[str]) -> Iterator[pa.Table]:
        """The rows of a table, a row group at a time, in order; what is still in the live store comes last."""
        return self._lazily(select(table, columns))

    def pieces(self, table: str, columns: list[str]) -> list[pa.Table]:
        """The rows of a table piece by piece as Arrow tables, in order."""
        return self._pieces(select(table, columns))

    def _frame(self, wanted: Selection) -> pd.DataFrame:
        pieces = self._pieces(wanted)
        return frame(pa.concat_tables(pieces) if pieces else SCHEMAS[wanted.table].empty_table().select(list(wanted.columns)))

    def _select(
        self,
        table: str,
        station: str | None = None,
        port: int | None = None,
        start: Moment | None = None,
        stop: Moment | None = None,
        columns: Sequence[str] | None = None,
    ) -> Selection:
        """Raises `UsageError` where the run has no such station: no rows would read as if nothing had been recorded of it."""
        names = [facts.name for facts in self.manifest.stations] if station is not None else []
        if names and station not in names:
            raise UsageError(f"{self.name} has no station {station!r}; it has {', '.join(names)}")
        return select(table, columns, station, port, start, stop)

    def _pieces(self, wanted: Selection) -> list[pa.Table]:
        """Sealed row groups, then what is still in the live store and in no part; each is cut before the next is read."""
        return list(self._lazily(wanted))

    def _lazily(self, wanted: Selection) -> Iterator[pa.Table]:
        """The same, one after the other: only what is in the live store is kept until it comes to that."""
        parts, live, damage = self._read(wanted)
        if damage:
            warnings.warn(f"{self.folder}: {'; '.join(map(str, damage))}", stacklevel=5)
        yield from map(wanted.cut, groups_of(parts, wanted.needed))
        yield from live

    def _read(self, wanted: Selection) -> tuple[list[Path], list[pa.Table], list[Damage]]:
        """The order matters: a snapshot of the store first, then manifest and parts, then what the parts do not have."""
        with StoreReader(self.folder) as stock:
            manifest = self.manifest
            parts = part_paths(self.folder, wanted.table)
            if manifest.state == "sealed":
                expect_unchanged(self.folder, manifest, wanted.table, parts)
            numbers = stock.numbers_of(wanted.table, parts_through(parts))
            live = [wanted.cut(piece.select(wanted.needed)) for piece in stock.tables(numbers)]
            return [part for part in parts if wanted.may_have(part)], live, stock.damage


def stations_of(run: RunTables) -> list[StationFacts]:
    """What is known of the stations; of a run that is not sealed, what its live store has."""
    manifest = run.manifest
    if manifest.state == "sealed":
        return manifest.stations
    with StoreReader(run.folder) as stock:
        manifest = run.manifest  # after the store: a run that is sealed meanwhile has them there
        return manifest.stations if manifest.state == "sealed" else known_stations(stock, manifest.stations)


Times = Sequence[object] | pd.Series | pd.DatetimeIndex
"""UTC moments: Timestamps, datetimes, or strings with a zone."""


def unit_at(run: RunTables, times: Times) -> pd.Series:
    """The serial of the unit at each of `times`, in their order; missing where none is known. An index of `times` is kept."""
    index = times.index if isinstance(times, pd.Series) else None
    micros = _micros(pd.Series(times, index=index))
    manifest, events = run.manifest, run.events()
    told = events[events["kind"].isin([BEGIN, END])]
    if not (told["kind"] == BEGIN).any():
        late = late_serials(run.folder) if manifest.state == "sealed" else []
        return pd.Series(only_unit(manifest.metadata.units, late), index=micros.index, dtype="string")
    units = np.array([None, *told["raw"].where(told["kind"] == BEGIN, None)], dtype=object)  # the first: before any of them
    places = np.searchsorted(_micros(told["time"]).to_numpy(), micros.to_numpy(), side="right")
    return pd.Series(units[places], index=micros.index, dtype="string")


def _micros(times: pd.Series) -> pd.Series:
    return pd.to_datetime(times, utc=True).dt.as_unit("us").astype("int64")
