"""Manifest and tables of a run; rows and columns of a table as DataFrame or Arrow table, whole or
in pieces.

Also reads a run that is being recorded or was cut off by a crash: Parquet parts first, then the
rows that only the journal has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from numbers import Real
from pathlib import Path
from typing import Final, NamedTuple, cast

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.event_kinds import of_kind
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.locks import is_held
from jbclog.core.rows import SCHEMA_VERSION, TABLES, StationFacts
from jbclog.core.text import shortened, warn
from jbclog.record.annotations import late_serials
from jbclog.record.clock_steps import COLUMNS as STEP_COLUMNS
from jbclog.record.clock_steps import HostClock, steps_in
from jbclog.record.conclude import known_stations
from jbclog.record.damage import summary_of
from jbclog.record.journal_reader import Journal, refuse_old_store
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import Manifest, SealedFile, read_manifest
from jbclog.record.part_file import open_part
from jbclog.record.parts import (
    Seals,
    groups_of,
    part_paths,
)
from jbclog.record.samples_by_port import KEY, SamplesByPort, samples_by_port
from jbclog.record.schema import CAPTURE, RUN, SCHEMAS, SEQ, lacking_in
from jbclog.record.sealed_files import expect_manifest_unchanged, seals_of
from jbclog.record.segments import segments
from jbclog.record.units import BEGIN, COLUMNS, END, only_unit, units_in
from jbclog.record.wire_recorder import RUN as HEAD

Moment = str | date | np.datetime64
"""A time: a string such as ``2026-11-21T01:30`` or ``2026-11-21`` (0:00), a date, datetime or
Timestamp; UTC if without a zone. A time without a date is refused.
"""

Times = Sequence[object] | pd.Series | pd.DatetimeIndex
"""UTC moments: Timestamps, datetimes, or strings with a zone."""

# bytes of events, settings or counters: half a million events, more than a million counters
MOST_WHOLE: Final = {"events": 128 << 20, "settings": 32 << 20, "counters": 128 << 20}
MOST_SAID: Final = 2000  # characters of a warning
CLOCKS: Final = ("run", "wall")
UNTIL: Final = "until"
"""Key of a DataFrame's `attrs`: until when a run that is not sealed was read."""
AS_READ, IN_FORCE = "as read", "in force"
SETPOINTS: Final = (AS_READ, IN_FORCE)
LEFT_OUT: Final = (
    "These rows are left out; `jbclog recover` finishes the run and keeps the damaged segment in"
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
    """Return a selection with its times in UTC. Raises `UsageError` for an unknown table or
    column.
    """
    if table not in SCHEMAS:
        raise UsageError(f"there is no table {table!r}; there are {', '.join(TABLES)}")
    names = SCHEMAS[table].names
    unknown = [name for name in columns or () if name not in names]
    if unknown:
        raise UsageError(f"{table} has no column {', '.join(unknown)}; it has {', '.join(names)}")
    return Selection(
        table, list(columns) if columns is not None else names, station, port, utc(start), utc(stop)
    )


def utc(moment: Moment | None) -> pd.Timestamp | None:
    """Return a time in UTC; a time without a zone is UTC. Raises `UsageError` for what is no time
    with a date.
    """
    if moment is None:
        return None
    try:
        stamp = pd.Timestamp(datetime.fromisoformat(moment) if isinstance(moment, str) else moment)
        stamp = stamp.tz_localize(UTC) if stamp.tzinfo is None else stamp.tz_convert(UTC)
        stamp = stamp.floor("us").as_unit("us")
        is_time = isinstance(moment, str | date | np.datetime64) and not pd.isna(stamp)
    except (ValueError, TypeError, OverflowError):
        is_time = False
    if not is_time:
        raise UsageError(
            f"{str(moment)[:64]!r} is no time with a date; write 2026-11-21, 2026-11-21T20:22 (UTC)"
            " or 2026-11-21T20:22+01:00"
        )
    return stamp


def _micros_of(moment: Moment) -> int:
    stamp = utc(moment)
    assert stamp is not None
    return _number(stamp)


def frame(table: pa.Table) -> pd.DataFrame:
    """Return an Arrow table as a DataFrame: Int64 and boolean columns where values can be missing,
    times in UTC.
    """
    return cast(pd.DataFrame, table.to_pandas())


def arrow_time(stamp: pd.Timestamp) -> pa.Scalar:
    """Return a time as an Arrow scalar of the type of the tables' times."""
    return pa.scalar(_number(stamp), pa.int64()).cast(pa.timestamp("us", tz="UTC"))


def _number(stamp: pd.Timestamp) -> int:
    """Return UTC microseconds since 1970; `Timestamp.value` is in ns, until the year 2262."""
    return int(stamp.asm8.astype("datetime64[us]").astype(np.int64))


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


class _Snapshot(NamedTuple):
    """The parts of a table, with their entries in the manifest of a sealed run, and the rows that
    are in none of them.
    """

    parts: list[Path]
    seals: Seals
    newest: Iterator[pa.Table]


class NoPlace(UsageError):
    """A station or port that a run does not have."""


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
        with Journal(self.folder) as journal:
            # after the journal: a run sealed in between has them in its manifest
            manifest = self.manifest
            known = manifest.stations
            return known if manifest.is_sealed else known_stations(journal, known)

    @property
    def duration(self) -> pd.Timedelta | None:
        """Time from start to end; None without an end. Raises `RecordError`."""
        manifest = self.manifest
        if manifest.start is None or manifest.stop is None:
            return None
        return pd.Timestamp(manifest.stop) - pd.Timestamp(manifest.start)

    def expect_place(self, station: str | None, port: int | None = None) -> None:
        """Raise `UsageError` if the run does not have this station or port, or `port` is no number.

        An empty table would read as if nothing was recorded.
        """
        if port is not None and not isinstance(port, Real):
            raise UsageError(f"port must be a number, such as 1 (got {port!r})")
        if station is None and port is None:
            return
        stations = self.stations
        names = [facts.name for facts in stations]
        if station is not None and names and station not in names:
            raise NoPlace(f"{self.name} has no station {station!r}; it has {', '.join(names)}")
        ports = sorted(
            {one for facts in stations if station in (None, facts.name) for one in facts.ports}
        )
        if port is not None and ports and port not in ports:
            raise NoPlace(
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
        *,
        clock: str = "run",
        setpoint: str = AS_READ,
    ) -> pd.DataFrame:
        """Return a row for each tick, station and port.

        - The rows of a port come in order. Those of several ports come as they are stored: part by
          part, in each port by port; then the newest of a run in progress, as recorded. `seq` has
          the order in which they were recorded.
        - `start` is included, `stop` is not. A date is its 0:00; a time without a zone is UTC, one
          without a date is refused.
        - A value that was not read is missing, and `reasons` has the cause.
        - Times are by the run's clock, which never jumps; with ``clock="wall"``, `start` and `stop`
          too are by the host's, with its steps (docs/reference/tables.md).
        - `setpoint_c` is read every 5 s and missing between. With ``setpoint="in force"`` it is the
          one last read from this port, for at most 15 s, as in verdict, joints and metrics.

        Raises `UsageError` for an unknown station, port, column, clock, setpoint or time,
        `RecordError` for a record that cannot be read.
        """
        _expect_word("clock", clock, CLOCKS)
        _expect_word("setpoint", setpoint, SETPOINTS)
        selection = self._select("samples", station, port, start, stop, columns)
        read = self._frame if setpoint == AS_READ else self._in_force
        return read(selection) if clock == "run" else self._by_host(selection, read)

    def host_time(self, moment: Moment) -> pd.Timestamp:
        """Return the host's time at a moment of the run. Raises `RecordError`."""
        micros = self._host_clock().corrected(_micros_of(moment))
        return pd.Timestamp(micros, unit="us", tz=UTC)

    def run_time(self, moment: Moment) -> pd.Timestamp:
        """Return the run's time at a moment of its host's clock. Raises `RecordError`."""
        micros = self._host_clock().run_time(_micros_of(moment))
        return pd.Timestamp(micros, unit="us", tz=UTC)

    def _host_clock(self) -> HostClock:
        return HostClock(steps_in(self.groups("events", STEP_COLUMNS)), self.manifest.start)

    def _in_force(self, wanted: Selection) -> pd.DataFrame:
        """Return the selected samples with the setpoint in force; also from rows before them."""
        from jbclog.analysis.clock_steps import steps_in as followed_steps
        from jbclog.analysis.setpoints import BEFORE, NEEDED, with_setpoint_in_force

        columns = list(dict.fromkeys([*wanted.columns, *NEEDED]))
        start = wanted.start
        before = None if start is None else start - BEFORE
        rows = self._frame(replace(wanted, columns=columns, start=before))
        periods = {facts.name: facts.period_s for facts in self.stations}
        events = self.groups("events", STEP_COLUMNS)
        followed = followed_steps(events)
        rows = with_setpoint_in_force(rows, periods, followed, self.manifest.t0_utc_us)
        if start is not None:
            rows = rows[rows["time"] >= start].reset_index(drop=True)
        return rows[list(wanted.columns)]

    def _by_host(
        self, wanted: Selection, read: Callable[[Selection], pd.DataFrame]
    ) -> pd.DataFrame:
        host = self._host_clock()
        most = pd.Timedelta(max(host.offsets_us), "us")
        least = pd.Timedelta(min(host.offsets_us), "us")
        start, stop = wanted.start, wanted.stop
        around = replace(
            wanted,
            columns=list(dict.fromkeys([*wanted.columns, "time"])),
            start=None if start is None else start - most,
            stop=None if stop is None else stop - least,
        )
        rows = read(around)
        segments = np.searchsorted(host.from_us, rows["time"].astype("int64"), side="right")
        offsets = pd.to_timedelta(np.array(host.offsets_us)[segments], "us").as_unit("us")
        rows["time"] = rows["time"] + offsets
        if start is not None:
            rows = rows[rows["time"] >= start]
        if stop is not None:
            rows = rows[rows["time"] < stop]
        return rows.reset_index(drop=True)[list(wanted.columns)]

    def stream(
        self,
        table: str = "samples",
        station: str | None = None,
        port: int | None = None,
        start: Moment | None = None,
        stop: Moment | None = None,
        columns: Sequence[str] | None = None,
    ) -> Iterator[pd.DataFrame]:
        """Yield the rows of a table in pieces of at most one row group (some 33 000 rows, those of
        a port in an hour at 10 Hz), none empty.

        The order is that of `samples`. Keeps no piece, so a month of 32
        stations takes no more memory than an hour. Raises as `samples`.
        """
        selection = self._select(table, station, port, start, stop, columns)
        return (frame(piece) for piece in self._groups(selection) if piece.num_rows)

    def events(
        self,
        station: str | None = None,
        port: int | None = None,
        start: Moment | None = None,
        stop: Moment | None = None,
        *,
        kind: str | None = None,
    ) -> pd.DataFrame:
        """Return the event log, oldest first.

        `kind`: a kind of docs/reference/events.md, such as ``link.lost``; ``*`` stands for any
        characters (``alarm.*``). With a `port` events of the whole station are left out. Raises as
        `samples`, and `UsageError` for a kind that no event has.
        """
        events = self._frame(self._select("events", station, port, start, stop))
        return events if kind is None else of_kind(events, kind)

    def settings(self, station: str | None = None, port: int | None = None) -> pd.DataFrame:
        """Return the result of each setting, as text in its unit. Raises as `samples`.

        With a `port` settings of the whole station are left out.
        """
        return self._frame(self._select("settings", station, port))

    def counters(self, station: str | None = None, port: int | None = None) -> pd.DataFrame:
        """Return the readings of the stations' counters. Raises as `samples`.

        A failed reading has no value, and the cause in `raw`. With a `port` counters of the whole
        station are left out.
        """
        return self._frame(self._select("counters", station, port))

    def wire(self, station: str) -> pd.DataFrame:
        """Return the serial capture of a station, oldest first: `time`, `what`, `data` (bytes),
        `text`.

        Of a run that is recorded, it has the rows that are sealed. Raises `UsageError` for an
        unknown station, `RecordError` for a run recorded without `--capture`.
        """
        self.expect_place(station)
        columns = ["time", "what", "data", "text", "request"]
        pieces = [*self._groups(select(CAPTURE, columns, station))]
        if not any(piece.num_rows for piece in pieces):
            raise RecordError(
                f"{self.folder}: no serial capture of {station}; `jbclog run --capture` records one"
            )
        rows = pa.concat_tables(pieces)
        is_of_link = pc.and_(pc.is_null(rows["request"]), pc.not_equal(rows["what"], HEAD))
        rows = rows.filter(is_of_link).drop_columns("request")
        table = frame(rows)
        data = [value or b"" for value in rows["data"].to_pylist()]
        return table.assign(data=data, text=table["text"].fillna(""))

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

    def unit_times(self) -> pd.DataFrame:
        """Return a row for each unit: `unit` (serial), `start` and `stop` in UTC, missing if not
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
            if one not in {unit.unit for unit in read}
        ]
        if not read and only_unit(named, []) is not None:
            rows = [(named[0], manifest.start, manifest.stop)]
        else:
            rows = [(one.unit, one.start, one.stop) for one in read] + [
                (one, None, None) for one in named
            ]
        table = pd.DataFrame(rows, columns=["unit", "start", "stop"]).astype({"unit": "string"})
        times = {
            name: pd.to_datetime(table[name], utc=True, format="ISO8601").dt.as_unit("us")
            for name in ("start", "stop")
        }
        return table.assign(**times)

    def _late_serials(self, manifest: Manifest) -> list[str]:
        return late_serials(self.folder) if manifest.is_sealed else []

    def groups(
        self,
        table: str,
        columns: list[str],
        *,
        on_damage: Callable[[str], None] | None = None,
    ) -> Iterator[pa.Table]:
        """Yield the rows of a table as they are stored, one row group at a time, those of the live
        store last. Samples of a part are sorted by station, port and tick.

        `on_damage` gets a sentence for each damaged row group, which is left out; without it,
        damage raises `RecordError`.
        """
        selection = select(table, columns)
        return self._groups(replace(selection, on_damage=on_damage))

    def samples_by_port(self, columns: Sequence[str]) -> SamplesByPort:
        """Return these columns of the samples port by port, in the order of the line file; of a run
        that is not sealed those of the rows that are committed now. Raises `RecordError`.
        """
        selection = select("samples", list(dict.fromkeys([*KEY, *columns])))
        with self._snapshot(selection) as snapshot:
            newest = [*snapshot.newest]
        order = [(facts.name, port) for facts in self.stations for port in facts.ports]
        return samples_by_port(
            self.folder,
            selection.columns,
            newest,
            order,
            parts=snapshot.parts,
            seals=snapshot.seals,
        )

    def committed_until(self) -> pd.Timestamp | None:
        """Return the time of the latest committed row of the samples of a run that is not sealed;
        None without one. Raises `RecordError`.
        """
        if self.manifest.is_sealed:
            return None
        latest: list[int] = []
        for rows in self.groups("samples", ["time"]):
            bounds = _bounds_in(rows["time"])
            if bounds is not None:
                latest.append(bounds[1])
        return pd.Timestamp(max(latest), unit="us", tz=UTC) if latest else None

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
        """Yield row groups of the parts, then the rows of the journal; each is cut before the next
        is read.
        """
        with self._snapshot(selection) as snapshot:
            seals = snapshot.seals
            sealed = [part for part in snapshot.parts if selection.may_have(part, seals.get(part))]
            groups = groups_of(
                sealed,
                selection.needed,
                station=selection.station,
                port=selection.port,
                seals=seals,
                on_damage=selection.on_damage,
            )
            yield from map(selection.cut, groups)
            yield from snapshot.newest

    @contextmanager
    def _snapshot(self, selection: Selection) -> Iterator[_Snapshot]:
        """Yield the parts of a table, and the selected rows of the journal.

        The order matters: the journal is opened first, then the manifest is read, so that no row
        moves to parts unseen.
        """
        with Journal(self.folder, only_marked=self._is_recorded()) as journal:
            manifest = self.manifest
            seals: Seals
            if manifest.is_sealed:
                parts = part_paths(self.folder, selection.table)
                seals = seals_of(self.folder, manifest, selection.table, parts)
            else:
                refuse_old_store(self.folder)
                listed = journal.chain.of(selection.table)
                seals = {self.folder / part.file.path: part.file for part in listed}
                parts = list(seals)
            if manifest.schema < SCHEMA_VERSION:
                self._say_lacking(selection, parts, seals)
            newest: Iterator[pa.Table] = iter(())
            if not manifest.is_sealed:
                pieces = journal.rows(selection.table)
                newest = (selection.cut(piece.select(selection.needed)) for piece in pieces)
            yield _Snapshot(parts, seals, newest)
            damage = [] if manifest.is_sealed else journal.damage()
        if damage:
            self._say_once(f"{shortened('; '.join(summary_of(damage)), MOST_SAID)}. {LEFT_OUT}")

    def _is_recorded(self) -> bool:
        try:
            return is_held(self.folder)
        except OSError as error:
            raise RecordError(f"{self.folder} cannot be read: {error}") from error

    def _say_lacking(self, selection: Selection, sealed: Sequence[Path], seals: Seals) -> None:
        """Say which columns the version that made the run did not record, if any is selected."""
        for part in sealed[:1]:
            with open_part(part, seals.get(part)) as file:
                lacking = lacking_in(selection.table, file.schema.names)
            lacking = [name for name in lacking if name not in (RUN, SEQ)]
            if any(name in selection.needed for name in lacking):
                names = ", ".join(lacking)
                self._say_once(
                    f"{selection.table}: {names} not recorded by the version that made the run"
                )

    def _say_once(self, text: str) -> None:
        if text not in self._said:
            self._said.add(text)
            warn(f"{self.folder}: {text}")


def _expect_word(what: str, word: str, words: Sequence[str]) -> None:
    if word not in words:
        raise UsageError(f"{what} {word!r}: must be {' or '.join(map(repr, words))}")


def _micros(times: pd.Series) -> pd.Series:
    if not pd.api.types.is_datetime64_any_dtype(times.dtype):
        times = times.map(utc)
    return pd.to_datetime(times, utc=True).dt.as_unit("us").astype("int64")
