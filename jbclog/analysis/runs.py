"""Many runs at once: found by their manifests, read one after another.

::

    runs = jbclog.open_runs("runs", line="bench-3", order="88123")
    runs.manifests()  # a row for each run
    for piece in runs.samples(columns=["time", "station", "port", "temperature_c"]):
        ...  # DataFrames of some 30 000 rows, each with its `run`
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, partial
from math import isclose
from pathlib import Path
from typing import Final, TypeVar, cast, overload

import pandas as pd
import pyarrow as pa

from jbclog.analysis.notebook_html import runs_html
from jbclog.analysis.opening import open_run
from jbclog.analysis.run import Run
from jbclog.analysis.run_tables import Moment, utc
from jbclog.analysis.stored_tables import (
    JOINTS_SCHEMA,
    METRIC_NAMES,
    MetricRow,
    cached_metrics,
    metric_table,
    stored_metrics,
)
from jbclog.analysis.workers import HERE, OfRun, Workers, why_unreadable
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.text import count_text, shortened
from jbclog.record.find_runs import ALL, SEALED, Copy, Filter, Found, Unreadable, once
from jbclog.record.manifest import manifest_sha256
from jbclog.record.published import Tree, TreePath, find_in, is_table

T = TypeVar("T")

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
TIMES: Final = ("started", "ended")
LISTS: Final = ("stations", "recipes", "units", "wire_lots", "flux_lots", "tips")
COLUMNS: Final = ("run", *TIMES, *TEXTS[1:], "exit_code", *LISTS, "tags", "folder")
WHAT_A_RATE_CHANGES: Final = (
    "results (joints, recovery, dips, alarm episodes, energy) depend on the sampling rate"
)


@dataclass(frozen=True, slots=True)
class Records:
    """Runs in their own folders. `stored`: use the metrics of reports; `cache`: use those that the
    recorder left.
    """

    stored: bool = True
    cache: bool = False

    def find(self, folder: Path, wanted: Filter = ALL) -> Iterator[Found | Unreadable]:
        return find_in(folder, wanted)

    def metrics(
        self, run: Found, names: Collection[str], station: str | None = None
    ) -> list[MetricRow]:
        known = None if isinstance(run.folder, TreePath) else self.known(run)
        if known is not None:
            return [row for row in known if row.metric in names and station in (None, row.station)]
        return self.of(open_run(run.folder), station)

    def of(self, run: Run, station: str | None = None) -> list[MetricRow]:
        """Return the metrics of an opened run. Raises `RecordError`."""
        if run.manifest.is_sealed:
            known = self._left(run.folder, manifest_sha256(run.folder))
            if known is not None:
                return [row for row in known if station in (None, row.station)]
        from jbclog.analysis.run_metrics import computed_metrics

        return computed_metrics(run, station)

    def known(self, run: Found) -> list[MetricRow] | None:
        """Return the metrics that a report or the recorder left; None if missing or of another run.

        The manifest is not parsed again if it has not changed since it was found.
        """
        if run.state != SEALED or run.changed is not None or not (self.stored or self.cache):
            return None
        if manifest_sha256(run.folder) != run.manifest_sha256:
            return None
        return self._left(run.folder, run.manifest_sha256)

    def _left(self, folder: Path, sha256: str) -> list[MetricRow] | None:
        """Return the metrics in a sealed run's folder."""
        known = stored_metrics(folder, sha256) if self.stored else None
        if known is None and self.cache:
            return cached_metrics(folder, sha256)
        return known


RECORDS: Final = Records()


class Runs(Sequence[Run]):
    """The runs that match a filter, each once, ordered by start.

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
        """Search again and return the runs that match now."""
        return self.through(self.source)

    def through(self, source: Records) -> Runs:
        """Search again with another source of runs and metrics."""
        return Runs(self.folder, self.wanted, source, self.workers)

    def __len__(self) -> int:
        return len(self.found)

    @overload
    def __getitem__(self, place: int) -> Run: ...
    @overload
    def __getitem__(self, place: slice) -> list[Run]: ...
    def __getitem__(self, place: int | slice) -> Run | list[Run]:
        if isinstance(place, slice):
            return [self.open(one) for one in self.found[place]]
        return self.open(self.found[place])

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

    def samples(
        self,
        station: str | None = None,
        port: int | None = None,
        start: Moment | None = None,
        stop: Moment | None = None,
        columns: Sequence[str] | None = None,
    ) -> Iterator[pd.DataFrame]:
        """Yield the samples of all runs in pieces of at most one row group (some 33 000 rows), with
        `run` as the first column.

        Keeps no piece, so a month of 32 stations takes no more memory than an hour; `pd.concat` of
        the pieces is the whole table. Skips runs without the station. Raises `UsageError` if no run
        has it, `RecordError` for a run that cannot be read.
        """
        for run in map(self.open, self._with(station)):
            for piece in run.stream("samples", station, port, start, stop, columns):
                piece.insert(0, "run", run.name)
                yield piece

    def metrics(self, station: str | None = None) -> pd.DataFrame:
        """Return the metrics of all runs (`Run.metrics`), with `run` and `started` as first
        columns.

        Raises `UsageError` if no run has the station, `RecordError` for a run that cannot be read.
        """
        found = [(one, self._metric_rows(one, station)) for one in self._with(station)]
        table = metric_table([row for _, rows in found for row in rows])
        return _with_runs(table, [(one, len(rows)) for one, rows in found])

    def metric_rows(
        self, station: str | None = None, names: Collection[str] | None = None
    ) -> Iterator[tuple[Found, list[MetricRow]]]:
        """Yield each readable run with its rows of `metrics`, at least those of `names`."""
        if self.workers != HERE:
            return self._mapped(partial(self.source.of, station=station), Exception)
        return self.each(
            lambda one: self.source.metrics(one, METRIC_NAMES if names is None else names, station)
        )

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
        """Return the runs that have a station. Raises `UsageError` if none has: an empty table
        would hide the mistake.
        """
        those = [one for one in self.found if station is None or station in one.stations]
        if not those and self.found:
            names = sorted({name for one in self.found for name in one.stations})
            raise UsageError(f"no run has a station {station!r}; there are {', '.join(names)}")
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

    def _metric_rows(self, found: Found, station: str | None) -> list[MetricRow]:
        return self.source.metrics(found, METRIC_NAMES, station)

    def _add_unreadable(self, folder: Path, why: str) -> None:
        one = Unreadable(folder, shortened(why.removeprefix(f"{folder}: "), MOST_SAID))
        if one not in self.unreadable:
            self.unreadable.append(one)

    def joints(self, station: str | None = None) -> pd.DataFrame:
        """Return the joints of all runs (`Run.joints`), with `run` and `started` as first columns.

        Raises `UsageError` if no run has the station, `RecordError` for a run that cannot be read.
        """
        from jbclog.analysis.run_metrics import joints_frame, joints_of

        found = [(one, joints_of(self.open(one), station)) for one in self._with(station)]
        table = joints_frame(
            pa.concat_tables([JOINTS_SCHEMA.empty_table(), *(joints for _, joints in found)])
        )
        return _with_runs(table, [(one, joints.num_rows) for one, joints in found])


def _with_runs(table: pd.DataFrame, counts: Sequence[tuple[Found, int]]) -> pd.DataFrame:
    """Add `run` and `started` as first columns; `counts` has each run's number of rows, in
    order.
    """
    rows = [count for _, count in counts]
    started = (
        pd.Series([one.started for one, _ in counts], dtype="str")
        .repeat(rows)
        .reset_index(drop=True)
    )
    names = (
        pd.Series([one.folder.name for one, _ in counts], dtype="str")
        .repeat(rows)
        .reset_index(drop=True)
    )
    table.insert(
        0,
        "started",
        pd.to_datetime(started, utc=True, format="ISO8601").astype("datetime64[us, UTC]"),
    )
    table.insert(0, "run", names)
    return table


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

    Raises `UsageError` for an unknown condition, or an address that none is; `RecordError` if
    `folder` does not exist.
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
    """Return the conditions of `open_runs` as a filter. Raises `UsageError` for an unknown one."""
    known = {one.name for one in fields(Filter)} - {"since", "until", "ended_since", "tags"}
    unknown = sorted(texts.keys() - known)
    if unknown:
        raise UsageError(
            f"runs cannot be filtered by {', '.join(unknown)}; by {', '.join(sorted(known))},"
            " since, until and tags"
        )
    return Filter(since=utc(since), until=utc(until), ended_since=None, tags=tags or {}, **texts)


def rate_text(period_s: float | None) -> str:
    """Return a sampling rate as text: ``5 Hz``; ``max`` if read without pause (None)."""
    return "max" if period_s is None else f"{1 / period_s:.3g} Hz"


def is_same_rate(one_s: float | None, two_s: float | None) -> bool:
    """Whether two sampling periods, in s, are equal; None: read without pause."""
    return one_s == two_s if one_s is None or two_s is None else isclose(one_s, two_s)
