"""Many runs at once: found by their manifests, read one after another.

::

    runs = jbclog.open_runs("runs", line="bench-3", order="88123")
    runs.manifests()  # a row for each run
    runs.joints("dde-1")  # the rows of `Run.joints` of all runs, each with its `run`
    for piece in runs.stream(columns=["time", "station", "port", "temperature_c"]):
        ...  # DataFrames of some 30 000 rows, each with its `run`
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from functools import cached_property, partial, wraps
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING, Concatenate, Final, NoReturn, ParamSpec, TypeVar, cast, overload

import pandas as pd
import pyarrow as pa

from jbclog.analysis.derived_files import (
    MetricRow,
)
from jbclog.analysis.notebook_html import runs_html
from jbclog.analysis.opening import open_run
from jbclog.analysis.run import Run
from jbclog.analysis.run_tables import UNTIL, Moment, NoPlace, Selection, utc
from jbclog.analysis.workers import HERE, OfRun, Workers, why_unreadable
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.rows import StationFacts
from jbclog.core.text import count_text, shortened
from jbclog.record.find_runs import ALL, SEALED, STATES, Copy, Filter, Found, Unreadable, once
from jbclog.record.manifest import Manifest
from jbclog.record.published import Tree, find_in, is_table

if TYPE_CHECKING:
    from jbclog.analysis.charts import Charted

T = TypeVar("T")
P = ParamSpec("P")

MOST_SAID: Final = 500  # characters of the reason why a run cannot be read
TEXTS: Final = (
    "run",
    "state",
    "verdict",
    "line",
    "operator",
    "order",
    "product",
    "exit_status",
    "lost",
    "changed",
)
TIMES: Final = ("start", "stop")
LISTS: Final = ("stations", "recipes", "units", "wire_lots", "flux_lots", "tips")
COLUMNS: Final = ("run", *TIMES, *TEXTS[1:], "exit_code", *LISTS, "tags", "folder")
WHAT_A_RATE_CHANGES: Final = (
    "results (joints, recovery, dips, alarm episodes, energy) depend on the sampling rate"
)


@dataclass(frozen=True, slots=True)
class Records:
    """Runs in their own folders. `stored`: use their derived tables; else compute everything."""

    stored: bool = True

    def find(self, folder: Path, wanted: Filter = ALL) -> Iterator[Found | Unreadable]:
        return find_in(folder, wanted)

    def metrics(self, run: Run, station: str | None = None) -> list[MetricRow]:
        """Return the metrics of a run. Raises `RecordError`."""
        from jbclog.analysis.run_metrics import computed_metrics, metric_rows_of

        if self.stored:
            return metric_rows_of(run, station)
        return computed_metrics(run, station)


RECORDS: Final = Records()


class NoRun(Run):
    """A run without a row: its tables have the columns and types of every run's."""

    def __init__(self) -> None:
        super().__init__(Path())

    @property
    def manifest(self) -> Manifest:
        return Manifest("")

    @property
    def stations(self) -> list[StationFacts]:
        return []

    def _groups(self, selection: Selection) -> Iterator[pa.Table]:
        return iter(())


@dataclass(frozen=True, slots=True)
class Select:
    """The arguments of `Run.stream`."""

    table: str
    station: str | None
    port: int | None
    start: Moment | None
    stop: Moment | None
    columns: Sequence[str] | None


@dataclass(frozen=True, slots=True)
class OfEach:
    """Calls a method of `Run` that returns a DataFrame, also in another process."""

    name: str
    arguments: Mapping[str, object]

    @property
    def station(self) -> str | None:
        return cast("str | None", self.arguments.get("station"))

    @property
    def port(self) -> int | None:
        return cast("int | None", self.arguments.get("port"))

    def __call__(self, run: Run) -> pd.DataFrame | None:
        """Return the rows of a run with `run` as the first column; None without this place."""
        if not has_place(run, self.station, self.port):
            return None
        return with_run(self._rows(run), run)

    def without_rows(self) -> pd.DataFrame:
        """Return the table of no run."""
        no_run = NoRun()
        return with_run(self._rows(no_run), no_run)

    def _rows(self, run: Run) -> pd.DataFrame:
        rows = getattr(run, self.name)(**self.arguments)
        return cast(pd.DataFrame, rows)


def has_place(run: Run, station: str | None, port: int | None) -> bool:
    """Whether a run has a station and port, as far as that is known. Raises `UsageError` for a port
    that is no number.
    """
    try:
        run.expect_place(station, port)
    except NoPlace:
        return False
    return True


def with_run(rows: pd.DataFrame, run: Run) -> pd.DataFrame:
    """Return the rows with the run's name as the first column."""
    names = pd.Series(run.name, index=rows.index, dtype="str")
    rows = rows.drop(columns="run", errors="ignore")
    rows.insert(0, "run", names)
    return rows


def of_each(
    method: Callable[Concatenate[Run, P], pd.DataFrame],
) -> Callable[Concatenate[Runs, P], pd.DataFrame]:
    """Return the method of `Runs` for a method of `Run`: the rows of all runs, one after the
    other.
    """
    signature = inspect.signature(method)

    @wraps(method)
    def of_all(runs: Runs, /, *args: P.args, **kwargs: P.kwargs) -> pd.DataFrame:
        bound = signature.bind(None, *args, **kwargs)
        _, *arguments = bound.arguments.items()
        return runs._joined(OfEach(method.__name__, dict(arguments)))

    of_all.__doc__ = f"""Return the rows of `Run.{method.__name__}` of all runs, with `run` as the
    first column.

    Leaves out runs without the station or port. Raises `UsageError` if no run has it, and as
    `Run.{method.__name__}`; `RecordError` for a run that cannot be read."""
    return of_all


class Runs(Sequence[Run]):
    """The runs that match a filter, each once, ordered by start. A slice, such as `runs[-2:]`, has
    the same calls.

    Reads manifests at first use, and tables at each call; `refreshed()` searches again. `copies`
    has the folders with a run that another folder has; `unreadable` has those whose manifest cannot
    be read, so that it is not known whether they match, and those that `each` could not read.
    """

    def __init__(
        self, folder: Path, wanted: Filter, source: Records = RECORDS, workers: Workers = HERE
    ) -> None:
        self.folder = folder
        self.wanted = wanted
        self.source = source
        self.workers = workers

    @cached_property
    def _search(self) -> tuple[list[Found], list[Unreadable]]:
        found: list[Found] = []
        unreadable: list[Unreadable] = []
        for one in self.source.find(self.folder, self.wanted):
            (found if isinstance(one, Found) else unreadable).append(one)  # type: ignore[arg-type]  # the list of its type
        return found, unreadable

    @cached_property
    def _once(self) -> tuple[list[Found], list[Copy]]:
        return once(self._search[0])

    @property
    def found(self) -> list[Found]:
        """Summary of each run's manifest."""
        return self._once[0]

    @property
    def copies(self) -> list[Copy]:
        """Folders with a run that another folder has, by the name in their manifests; not counted.

        The folder of that name counts, else the first by name.
        """
        return self._once[1]

    @property
    def unreadable(self) -> list[Unreadable]:
        """Folders whose manifest, or a requested table, cannot be read, and why."""
        return self._search[1]

    def refreshed(self) -> Runs:
        """Search again and return the runs that match now, also those outside a slice."""
        return self.through(self.source)

    def through(self, source: Records) -> Runs:
        """Search again with another source of runs and metrics."""
        return Runs(self.folder, self.wanted, source, self.workers)

    def __len__(self) -> int:
        return len(self.found)

    @overload
    def __getitem__(self, place: int) -> Run: ...
    @overload
    def __getitem__(self, place: slice) -> Runs: ...
    def __getitem__(self, place: int | slice) -> Run | Runs:
        if not isinstance(place, slice):
            return self.open(self.found[place])
        part = self.refreshed()
        part._search = self.found[place], []
        part._once = self.found[place], []
        return part

    def __iter__(self) -> Iterator[Run]:
        return map(self.open, self.found)

    def open(self, one: Found) -> Run:
        """Open a run of `found`. Raises `RecordError`."""
        return open_run(one.folder)

    def __repr__(self) -> str:
        more = f", {len(self.unreadable)} unreadable" if self.unreadable else ""
        more += f", {len(self.copies)} copied" if self.copies else ""
        return f"<Runs {self.folder}: {count_text(len(self), 'run')}{more}>"

    def _repr_html_(self) -> str:
        return runs_html(self.folder, self.found, self.copies, self.unreadable)

    def manifests(self) -> pd.DataFrame:
        """Return a row for each run: start and end, result, metadata, stations, folder.

        Times are UTC; `stations`, `recipes`, `units`, `wire_lots`, `flux_lots` and `tips` hold
        tuples.
        """
        rows = [
            {**{name: getattr(one, name, None) for name in COLUMNS}, "run": one.folder.name}
            for one in self.found
        ]
        frame = pd.DataFrame(rows, columns=list(COLUMNS))
        for name in TIMES:
            frame[name] = pd.to_datetime(frame[name], utc=True, format="ISO8601").astype(
                "datetime64[us, UTC]"
            )
        frame["folder"] = frame["folder"].map(str)
        return frame.astype(dict.fromkeys((*TEXTS, "folder"), "str") | {"exit_code": "Int64"})

    samples = of_each(Run.samples)
    events = of_each(Run.events)
    settings = of_each(Run.settings)
    counters = of_each(Run.counters)
    joints = of_each(Run.joints)
    metrics = of_each(Run.metrics)
    alarms = of_each(Run.alarms)
    units = of_each(Run.units)
    gaps = of_each(Run.gaps)
    tips = of_each(Run.tips)
    accounting = of_each(Run.accounting)

    def stream(
        self,
        table: str = "samples",
        station: str | None = None,
        port: int | None = None,
        start: Moment | None = None,
        stop: Moment | None = None,
        columns: Sequence[str] | None = None,
    ) -> Iterator[pd.DataFrame]:
        """Yield the rows of a table of all runs in pieces, as `Run.stream`, with `run` as the first
        column.

        Keeps no piece, so a month of 32 stations takes no more memory than an hour. Leaves out runs
        without the station or port. Raises `UsageError` if no run has it, `RecordError` for a run
        that cannot be read.
        """
        with_station = self._with(station)
        return self._pieces(with_station, Select(table, station, port, start, stop, columns))

    def _pieces(self, found: Sequence[Found], wanted: Select) -> Iterator[pd.DataFrame]:
        is_anywhere = not found
        for run in map(self.open, found):
            if not has_place(run, wanted.station, wanted.port):
                continue
            is_anywhere = True
            for piece in run.stream(*astuple(wanted)):
                yield with_run(piece, run)
        if not is_anywhere:
            self._refuse(wanted.station, wanted.port)

    def _joined(self, method: OfEach) -> pd.DataFrame:
        """Return the rows of all runs, read here or by the workers."""
        found = self._with(method.station)
        paths = [str(run.folder.absolute()) for run in found]
        frames: list[pd.DataFrame] = []
        until: dict[str, pd.Timestamp] = {}
        for run, (rows, why) in zip(found, self.workers.map(OfRun(method), paths), strict=True):
            if why is not None:
                raise RecordError(why)
            if rows is not None:
                until |= {run.folder.name: rows.attrs[UNTIL]} if UNTIL in rows.attrs else {}
                frames.append(rows)
        if found and not frames:
            self._refuse(method.station, method.port)
        joined = pd.concat(frames, ignore_index=True) if frames else method.without_rows()
        joined.attrs = {UNTIL: until} if until else {}
        return joined

    def chart(self, metric: str, station: str, port: int) -> Charted:
        """Return the control chart (individuals and moving ranges) of a metric of one port, a point
        a run, as `jbclog chart` and `jbclog trend` do.

        `plot()` of the result draws it as a matplotlib Figure; if control limits would mislead, the
        reason stands in the axes. `charts` has the two charts, or the refusal; `series` the values,
        their `names` (runs), `uom` and `resolution`. Raises `UsageError` for a metric, station or
        port that no run has.
        """
        from jbclog.analysis.charts import chart_of_runs

        for name, value in (("station", station), ("port", port)):
            if value is None:
                raise UsageError(f"a chart is of one port of one station; {name} is None")
        return chart_of_runs(self, metric, station, port)

    def expect_place(self, station: str | None, port: int | None = None) -> None:
        """Raise `UsageError` if no run has this station or port."""
        if self.found and not any(has_place(run, station, port) for run in self):
            self._refuse(station, port)

    def _refuse(self, station: str | None, port: int | None) -> NoReturn:
        """Raise `UsageError` for a station or port that no run has."""
        places = {
            (facts.name, number) for run in self for facts in run.stations for number in facts.ports
        }
        names = sorted({name for name, _ in places})
        if station is not None and station not in names:
            raise UsageError(f"no run has a station {station!r}; there are {', '.join(names)}")
        ports = sorted({number for name, number in places if station in (None, name)})
        of = "" if station is None else f" of {station!r}"
        raise UsageError(f"no run has a port {port}{of}; there are {', '.join(map(str, ports))}")

    def metric_rows(self, station: str | None = None) -> Iterator[tuple[Found, list[MetricRow]]]:
        """Yield each readable run with its rows of `metrics`."""
        metrics = partial(self.source.metrics, station=station)
        if self.workers != HERE:
            return self._mapped(metrics, Exception)
        return self.each(lambda found: metrics(self.open(found)))

    def each(self, read: Callable[[Found], T]) -> Iterator[tuple[Found, T]]:
        """Yield each run with the result of `read`; a run that cannot be read is added to
        `unreadable`.
        """
        for one in self.found:
            try:
                read_here = read(one)
            except UsageError:
                raise
            except Exception as error:
                self._add_unreadable(one.folder, why_unreadable(error))
            else:
                yield one, read_here

    def _with(self, station: str | None) -> list[Found]:
        """Return the runs that may have a station. Raises `UsageError` if none has: an empty table
        would hide the mistake.
        """
        # the manifest of a run in progress does not list its stations
        those = [
            run
            for run in self.found
            if station is None or station in run.stations or run.state != SEALED
        ]
        if not those and self.found:
            self._refuse(station, None)
        return those

    def map(self, function: Callable[[Run], T]) -> Iterator[tuple[Found, T]]:
        """Yield each run, in order, with the result of `function`; a run that cannot be read is
        added to `unreadable`.

        The function is called here, in processes, or on a scheduler: see `open_runs`. A
        script that starts processes does so below ``if __name__ == "__main__":``. Its other
        exceptions propagate. Raises `RecordError` if the scheduler is lost.
        """
        return self._mapped(function, RecordError)

    def _mapped(
        self, function: Callable[[Run], T], caught: type[Exception]
    ) -> Iterator[tuple[Found, T]]:
        found = self.found
        paths = [str(one.folder.absolute()) for one in found]
        results = self.workers.map(OfRun(function, caught), paths)
        for one, (result, why) in zip(found, results, strict=True):
            if why is None:
                yield one, cast(T, result)
            else:
                self._add_unreadable(one.folder, why)

    def _add_unreadable(self, folder: Path, why: str) -> None:
        one = Unreadable(folder, shortened(why.removeprefix(f"{folder}: "), MOST_SAID))
        if one not in self.unreadable:
            self.unreadable.append(one)


def open_runs(
    folder: str | os.PathLike[str] = "runs",
    *,
    since: Moment | None = None,
    until: Moment | None = None,
    tags: Mapping[str, str] | None = None,
    processes: int = 1,
    scheduler: str | None = None,
    **texts: str | None,
) -> Runs:
    """Find the runs below `folder`, or published runs (also ``s3://BUCKET/PATH``), that match all
    conditions.

    - `since`, `until`: start of the run, UTC if without a zone; `since` is included, `until` is not
    - `tags`: names and values that the run must have
    - `texts`: `operator`, `order`, `product`, `unit`, `wire_lot`, `flux_lot`, `tip`, `line`,
      `station`, `recipe` (``NAME`` or ``NAME@REVISION``), `verdict`, `state`; the whole text must
      match, ``*`` stands for any characters
    - `processes`, `scheduler`: where `Runs.map` calls its function: in so many processes of this
      computer, or by the workers of a Dask scheduler at ``tcp://HOST:PORT`` or ``tls://HOST:PORT``

    Raises `UsageError` for an unknown condition or state, or an address that none is;
    `RecordError` if `folder` does not exist.
    """
    workers = Workers(processes, scheduler)
    wanted = filter_of(since, until, tags, texts)
    if is_table(folder):
        return Runs(Tree.at(folder).path, wanted, RECORDS, workers)
    path = Path(folder)
    if not path.is_dir():
        raise RecordError(f"{path} is missing, or not a folder")
    return Runs(path, wanted, RECORDS, workers)


def filter_of(
    since: Moment | None,
    until: Moment | None,
    tags: Mapping[str, str] | None,
    texts: Mapping[str, str | None],
) -> Filter:
    """Return the conditions of `open_runs` as a filter. Raises `UsageError` for an unknown one, and
    for a state that no run has.
    """
    known = {one.name for one in fields(Filter)} - {"since", "until", "ended_since", "tags"}
    unknown = sorted(texts.keys() - known)
    if unknown:
        raise UsageError(
            f"runs cannot be filtered by {', '.join(unknown)}; by {', '.join(sorted(known))},"
            " since, until and tags"
        )
    state = texts.get("state")
    if state is not None and "*" not in state and state not in STATES:
        raise UsageError(f"state={state!r}: must be one of {', '.join(STATES)}")
    return Filter(since=utc(since), until=utc(until), ended_since=None, tags=tags or {}, **texts)


def rate_text(period_s: float | None) -> str:
    """Return a sampling rate as text: ``5 Hz``; ``max`` if read without pause (None)."""
    return "max" if period_s is None else f"{1 / period_s:.3g} Hz"


def is_same_rate(one_s: float | None, two_s: float | None) -> bool:
    """Whether two sampling periods, in s, are equal; None: read without pause."""
    return one_s == two_s if one_s is None or two_s is None else isclose(one_s, two_s)
