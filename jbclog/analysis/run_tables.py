"""Manifest and tables of a run; rows and columns of a table as DataFrame or Arrow table, whole or
in pieces.

Also reads a run that is being recorded or was cut off by a crash: Parquet parts first, then the
rows that only the live store has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, cast

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.capture_rows import LinkRow
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.rows import SCHEMA_VERSION, StationFacts
from jbclog.core.text import shortened, warn
from jbclog.record.annotations import late_serials
from jbclog.record.capture import Hole, read_head, rows_and_holes, wire_path
from jbclog.record.conclude import known_stations
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import Manifest, SealedFile, read_manifest
from jbclog.record.part_file import open_part
from jbclog.record.parts import (
    NO_SEALS,
    Seals,
    Wanted,
    groups_of,
    part_paths,
    parts_through,
    summary_of,
)
from jbclog.record.schema import SCHEMAS, lacking_in
from jbclog.record.sealed_files import expect_manifest_unchanged, seals_of
from jbclog.record.store import segments
from jbclog.record.store_reader import StoreReader
from jbclog.record.units import BEGIN, COLUMNS, END, only_unit, units_in

Moment = str | datetime | pd.Timestamp
"""A time: a string such as ``2026-11-21T01:30``, a datetime or a Timestamp; UTC if without a
zone.
"""

Times = Sequence[object] | pd.Series | pd.DatetimeIndex
"""UTC moments: Timestamps, datetimes, or strings with a zone."""

HELD_ROWS: Final = 500_000  # rows of a live store in memory at once
# bytes of events, settings or counters: half a million events, more than a million counters
MOST_WHOLE: Final = {"events": 128 << 20, "settings": 32 << 20, "counters": 128 << 20}
MOST_SAID: Final = 2000  # characters of a warning
LEFT_OUT: Final = (
    "These rows are left out; `jbclog recover` finishes the run and keeps its live store in"
    " damaged/."
)


@dataclass(frozen=True, slots=True)
class Selection:
    """Rows and columns of a table: from `start`, before `stop`, both UTC; None: no condition."""

    table: str
    columns: Sequence[str]
    station: str | None = None
    port: int | None = None
    start: pd.Timestamp | None = None
    stop: pd.Timestamp | None = None
    coded: bool = False  # texts may be returned as dictionaries
    wanted: Wanted | None = None  # sealed row groups to read; None: all
    # gets a sentence for each damaged row group, which is left out; None: damage is an error
    on_damage: Callable[[str], None] | None = None

    @property
    def needed(self) -> list[str]:
        """Columns to read, in the table's order: the selected ones and those that conditions
        need.
        """
        conditions = {
            "station": self.station,
            "port": self.port,
            "time": self.start if self.start is not None else self.stop,
        }
        compared = {name for name, value in conditions.items() if value is not None}
        return [name for name in SCHEMAS[self.table].names if name in {*self.columns, *compared}]

    def cut(self, rows: pa.Table) -> pa.Table:
        """Return the selected part of `rows`."""
        if self.station is not None:
            rows = rows.filter(pc.equal(rows["station"], self.station))
        if self.port is not None:
            rows = rows.filter(pc.equal(rows["port"], self.port))
        if self.start is not None:
            rows = rows.filter(pc.greater_equal(rows["time"], arrow_time(self.start)))
        if self.stop is not None:
            rows = rows.filter(pc.less(rows["time"], arrow_time(self.stop)))
        return rows.select(list(self.columns))

    def may_have(self, part: Path, seal: SealedFile | None = None) -> bool:
        """Whether a part can hold rows between `start` and `stop`, by its footer.

        Raises `RecordError` for an unreadable part.
        """
        if self.start is None and self.stop is None:
            return True
        first, last = _time_bounds(part, seal)
        if first is None or last is None:
            return True
        return (self.start is None or last >= self.start) and (
            self.stop is None or first < self.stop
        )


def select(
    table: str,
    columns: Sequence[str] | None = None,
    station: str | None = None,
    port: int | None = None,
    start: Moment | None = None,
    stop: Moment | None = None,
) -> Selection:
    """Return a selection with its times in UTC. Raises `UsageError` for an unknown column."""
    names = SCHEMAS[table].names
    unknown = [name for name in columns or () if name not in names]
    if unknown:
        raise UsageError(f"{table} has no column {', '.join(unknown)}; it has {', '.join(names)}")
    return Selection(
        table, list(columns) if columns is not None else names, station, port, utc(start), utc(stop)
    )


def utc(moment: Moment | None) -> pd.Timestamp | None:
    """Return a time in UTC; a time without a zone is UTC."""
    if moment is None:
        return None
    stamp = pd.Timestamp(moment)
    return stamp.tz_localize(UTC) if stamp.tzinfo is None else stamp.tz_convert(UTC)


def frame(table: pa.Table) -> pd.DataFrame:
    """Return an Arrow table as a DataFrame: Int64 and boolean columns where values can be missing,
    times in UTC.
    """
    return cast(pd.DataFrame, table.to_pandas())


def arrow_time(stamp: pd.Timestamp) -> pa.Scalar:
    """Return a time as an Arrow scalar of the type of the tables' times."""
    return pa.scalar(stamp.as_unit("ns").value // 1000, pa.int64()).cast(
        pa.timestamp("us", tz="UTC")
    )


def _time_bounds(
    part: Path, seal: SealedFile | None
) -> tuple[pd.Timestamp | None, pd.Timestamp | None]:
    """Return the first and last time in a part: of a sealed one from its footer, of another from
    the column. None if it has none. Raises `RecordError`.
    """
    with open_part(part, seal) as opened:
        if seal is None:
            bounds = [_bounds_in(rows["time"]) for rows in opened.groups(["time"])]
        else:
            bounds = opened.bounds("time")
    known = [bound for bound in bounds if bound is not None]
    if not known or len(known) < len(bounds):
        return None, None
    try:
        first = pd.Timestamp(min(least for least, _ in known), unit="us", tz=UTC)
        last = pd.Timestamp(max(most for _, most in known), unit="us", tz=UTC)
    except (ValueError, OverflowError):  # beyond the range of a Timestamp
        return None, None
    return first, last


def _bounds_in(times: pa.ChunkedArray) -> tuple[int, int] | None:
    bounds = pc.min_max(times.cast(pa.int64())).as_py()
    return None if bounds["min"] is None else (bounds["min"], bounds["max"])


class RunTables:
    """Manifest and tables of the run in `folder`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._sealed: tuple[tuple[int, ...], Manifest] | None = None
        self._said: set[str] = set()

    @property
    def name(self) -> str:
        """Name of the run's folder."""
        return self.folder.name

    @property
    def place(self) -> str:
        """Where the run is, as messages show it."""
        return str(self.folder)

    @property
    def manifest(self) -> Manifest:
        """The current manifest; empty if the recorder crashed before it wrote one.

        A sealed manifest is cached until its file changes, because every table needs it. Raises
        `RecordError`.
        """
        identity = self._manifest_identity()
        if self._sealed is None or identity is None or self._sealed[0] != identity:
            manifest = self._read_manifest()
            if not manifest.is_sealed or identity is None:
                return manifest
            self._sealed = identity, manifest
        return self._sealed[1]

    @property
    def verdict(self) -> str | None:
        """The verdict as text; None if there is none yet."""
        return self.manifest.verdict

    @property
    def stations(self) -> list[StationFacts]:
        """Facts of each station, in the order of the line file. Raises `RecordError`."""
        manifest = self.manifest
        if manifest.is_sealed:
            return manifest.stations
        with StoreReader(self.folder) as store:
            # after the store: a run sealed in between has them in its manifest
            manifest = self.manifest
            known = manifest.stations
            return known if manifest.is_sealed else known_stations(store, known)

    @property
    def duration(self) -> pd.Timedelta | None:
        """Time from start to end by the host's clock; None without an end. Raises `RecordError`."""
        manifest = self.manifest
        if manifest.started is None or manifest.ended is None:
            return None
        return pd.Timestamp(manifest.ended) - pd.Timestamp(manifest.started)

    def expect_place(self, station: str | None, port: int | None = None) -> None:
        """Raise `UsageError` if the run does not have this station or port.

        An empty table would read as if nothing was recorded.
        """
        if station is None and port is None:
            return
        stations = self.stations
        names = [facts.name for facts in stations]
        if station is not None and names and station not in names:
            raise UsageError(f"{self.name} has no station {station!r}; it has {', '.join(names)}")
        ports = sorted(
            {one for facts in stations if station in (None, facts.name) for one in facts.ports}
        )
        if port is not None and ports and port not in ports:
            raise UsageError(
                f"{station or self.name} has no port {port}; it has {', '.join(map(str, ports))}"
            )

    def _manifest_identity(self) -> tuple[int, ...] | None:
        """Return a value that changes when the manifest's file changes; None if it is missing."""
        try:
            file = (self.folder / MANIFEST).stat()
        except OSError:
            return None
        return file.st_ino, file.st_mtime_ns, file.st_ctime_ns, file.st_size

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
        """Return a row for each tick, station and port, in recording order.

        `start` is included, `stop` is not. A value that was not read is missing, and `reasons` has
        the cause. Raises `UsageError` for an unknown station, port or column, `RecordError` for a
        record that cannot be read.
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
        """Yield the rows of a table in pieces of at most one row group (some 33 000 rows), none
        empty.

        Keeps no piece, so a month of 32 stations takes no more memory than an hour. Raises as
        `samples`.
        """
        selection = self._select(table, station, port, start, stop, columns)
        return (frame(piece) for piece in self._groups(selection) if piece.num_rows)

    def events(
        self, station: str | None = None, start: Moment | None = None, stop: Moment | None = None
    ) -> pd.DataFrame:
        """Return the event log, oldest first. Raises as `samples`."""
        return self._frame(self._select("events", station, start=start, stop=stop))

    def settings(self, station: str | None = None) -> pd.DataFrame:
        """Return the result of each setting, as text in its unit. Raises as `samples`."""
        return self._frame(self._select("settings", station))

    def counters(self, station: str | None = None) -> pd.DataFrame:
        """Return the readings of the stations' counters. Raises as `samples`.

        A failed reading has no value, and the cause in `raw`.
        """
        return self._frame(self._select("counters", station))

    def wire(self, station: str) -> pd.DataFrame:
        """Return the serial capture of a station, oldest first: `time`, `what`, `data` (bytes),
        `text`.

        Skips damaged stretches with a warning for each. Raises `UsageError` for an unknown station,
        `RecordError` for a run recorded without `--capture`.
        """
        path = wire_path(self.folder, station)
        if not path.is_file():
            self.expect_place(station)
            raise RecordError(
                f"{self.folder}: no serial capture of {station}; `jbclog run --capture` records one"
            )
        head = read_head(path)
        rows = [*rows_and_holes(path)]
        passed = [row for row in rows if isinstance(row, LinkRow)]
        for hole in (row for row in rows if isinstance(row, Hole)):
            warn(f"{path}: {hole.describe(head)}")
        table = pd.DataFrame(passed, columns=["time", "what", "data", "text"])
        micros = (table["time"] + (head.t0_utc - head.t0_mono)).mul(1e6).round()
        return table.assign(
            time=micros.astype("int64").astype("datetime64[us]").dt.tz_localize("UTC")
        )

    def unit_at(self, times: Times) -> pd.Series:
        """Return the serial of the unit on the bench at each of `times`; missing if not known.

        The result has the index of `times`.
        """
        index = times.index if isinstance(times, pd.Series) else None
        micros = _micros(pd.Series(times, index=index))
        manifest, events = self.manifest, self.events()
        changes = events[events["kind"].isin([BEGIN, END])]
        if not (changes["kind"] == BEGIN).any():
            unit = only_unit(manifest.metadata.units, self._late_serials(manifest))
            return pd.Series(unit, index=micros.index, dtype="string")
        # first row: before any unit
        serials = np.array(
            [None, *changes["raw"].where(changes["kind"] == BEGIN, None)], dtype=object
        )
        places = np.searchsorted(
            _micros(changes["time"]).to_numpy(), micros.to_numpy(), side="right"
        )
        return pd.Series(serials[places], index=micros.index, dtype="string")

    def units(self) -> pd.DataFrame:
        """Return a row for each unit: `unit` (serial), `begin` and `end` in UTC, missing if not
        known.

        Units whose serials were read come first, a row for each stay on the bench, then units that
        were only named on the command line or later. A single named unit, with no serial read,
        spans the whole run. Raises `RecordError`.
        """
        manifest, read = self.manifest, units_in(self.groups("events", COLUMNS))
        late = self._late_serials(manifest)
        named = [
            one
            for one in dict.fromkeys([*manifest.metadata.units, *late])
            if one not in {unit.serial for unit in read}
        ]
        if not read and only_unit(named, []) is not None:
            rows = [(named[0], manifest.started, manifest.ended)]
        else:
            rows = [(one.serial, one.begin, one.end) for one in read] + [
                (one, None, None) for one in named
            ]
        table = pd.DataFrame(rows, columns=["unit", "begin", "end"]).astype({"unit": "string"})
        times = {
            name: pd.to_datetime(table[name], utc=True, format="ISO8601").dt.as_unit("us")
            for name in ("begin", "end")
        }
        return table.assign(**times)

    def _late_serials(self, manifest: Manifest) -> list[str]:
        return late_serials(self.folder) if manifest.is_sealed else []

    def groups(
        self,
        table: str,
        columns: list[str],
        *,
        coded: bool = False,
        wanted: Wanted | None = None,
        on_damage: Callable[[str], None] | None = None,
    ) -> Iterator[pa.Table]:
        """Yield the rows of a table in order, one row group at a time, those of the live store
        last.

        `coded`: texts of sealed rows come as dictionaries, in half the time. `wanted`: row groups
        of a sealed run that must be included; others may be left out. `on_damage` gets a sentence
        for each damaged row group, which is left out; without it, damage raises `RecordError`.
        """
        selection = select(table, columns)
        return self._groups(replace(selection, coded=coded, wanted=wanted, on_damage=on_damage))

    def pieces(self, table: str, columns: list[str]) -> list[pa.Table]:
        """Return the row groups of `groups` as a list."""
        return list(self.groups(table, columns))

    def _frame(self, selection: Selection) -> pd.DataFrame:
        pieces, size = list[pa.Table](), 0
        for piece in self._groups(selection):
            pieces.append(piece)
            size += piece.nbytes
            most = MOST_WHOLE.get(selection.table)
            if most is not None and size > most:
                why = (
                    f"{self.folder}: its {selection.table} take more than {most >> 20} MiB"
                    " and are not read as a whole"
                )
                raise RecordError(f"{why}; `stream` reads them in pieces")
        return frame(
            pa.concat_tables(pieces)
            if pieces
            else SCHEMAS[selection.table].empty_table().select(list(selection.columns))
        )

    def _select(
        self,
        table: str,
        station: str | None = None,
        port: int | None = None,
        start: Moment | None = None,
        stop: Moment | None = None,
        columns: Sequence[str] | None = None,
    ) -> Selection:
        """Return a selection. Raises `UsageError` for an unknown station, port or column."""
        self.expect_place(station, port)
        return select(table, columns, station, port, start, stop)

    def _groups(self, selection: Selection) -> Iterator[pa.Table]:
        """Yield row groups of the parts, then those of the live store; each is cut before the next
        is read.

        The order matters: first a snapshot of the store, then manifest and parts, so that no row
        moves from store to parts unseen. A small store is read at once, because a snapshot held for
        long makes the recorder's log grow.
        """
        with ExitStack() as opened:
            store = opened.enter_context(StoreReader(self.folder))
            manifest = self.manifest
            parts = part_paths(self.folder, selection.table)
            seals: Seals = NO_SEALS
            if manifest.is_sealed:
                seals = seals_of(self.folder, manifest, selection.table, parts)
            numbers = store.numbers_of(selection.table, parts_through(parts, seals))
            live: Iterator[pa.Table] = (
                selection.cut(piece.select(selection.needed)) for piece in store.tables(numbers)
            )
            if store.rows <= HELD_ROWS:
                live = iter([*live])
                opened.close()
            elif numbers:
                self._say_once(
                    f"{store.rows} rows in its live store are read now; this takes longer than from"
                    " a sealed run"
                )
            sealed = [part for part in parts if selection.may_have(part, seals.get(part))]
            if manifest.schema < SCHEMA_VERSION:
                self._say_lacking(selection, sealed, seals)
            groups = groups_of(
                sealed,
                selection.needed,
                coded=selection.coded,
                wanted=selection.wanted,
                seals=seals,
                on_damage=selection.on_damage,
            )
            yield from map(selection.cut, groups)
            yield from live
        if store.damage:
            self._say_once(
                f"{shortened('; '.join(summary_of(store.damage)), MOST_SAID)}. {LEFT_OUT}"
            )

    def _say_lacking(self, selection: Selection, sealed: Sequence[Path], seals: Seals) -> None:
        """Say which columns the version that made the run did not record, if any is selected."""
        for part in sealed[:1]:
            with open_part(part, seals.get(part)) as file:
                lacking = lacking_in(selection.table, file.schema.names)
            if any(name in selection.needed for name in lacking):
                names = ", ".join(lacking)
                self._say_once(
                    f"{selection.table}: {names} not recorded by the version that made the run"
                )

    def _say_once(self, text: str) -> None:
        if text not in self._said:
            self._said.add(text)
            warn(f"{self.folder}: {text}")


def _micros(times: pd.Series) -> pd.Series:
    return pd.to_datetime(times, utc=True).dt.as_unit("us").astype("int64")
