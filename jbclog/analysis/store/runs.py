"""The runs of a store as `Runs`, with metrics and statistics from one pass over all of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import pandas as pd

from jbclog.analysis.fleet.engine import MUCH_ROWS, engine_of
from jbclog.analysis.run import Run
from jbclog.analysis.run_metrics import metric_rows_of
from jbclog.analysis.runs import Runs, Source, Together
from jbclog.analysis.store.parts import MetricRows, expect_all, parts_of
from jbclog.analysis.store.place import Place
from jbclog.analysis.store.reader import Published, Store
from jbclog.analysis.store.run import StoredRun
from jbclog.analysis.store.statistics import statistics
from jbclog.analysis.stored_tables import MetricRow
from jbclog.analysis.verdict import RULES
from jbclog.record.find_runs import Filter, Found, Unreadable


@dataclass(frozen=True, slots=True)
class StoredTogether:
    """A group of runs in a store, sent to the process that opens them."""

    place: Place
    entries: tuple[Published, ...]

    def openers(self) -> Iterator[Callable[[], Run]]:
        """Yield a function for each run that opens it."""
        store = Store(self.place)
        return (partial(StoredRun, store, one) for one in self.entries)


class StoredRuns(Runs):
    """The runs of a store that match a filter, in the store's state at the first read."""

    def __init__(self, place: Place, wanted: Filter, scheduler: str | None = None) -> None:
        super().__init__(place.path, wanted)
        self._place = place
        self._store = Store(place)
        self._scheduler = scheduler

    @cached_property
    def _published(self) -> dict[str, Published]:
        return {one.identity.run: one for one in self._store.runs(self.wanted)}

    @cached_property
    def _search(self) -> tuple[list[Found], list[Unreadable]]:
        return [one.found for one in self._published.values()], []

    def refreshed(self) -> StoredRuns:
        """Search again and return the runs that match now."""
        return StoredRuns(self._place, self.wanted, self._scheduler)

    def open(self, one: Found) -> Run:
        """Open a run of `found`. Raises `RecordError`."""
        return StoredRun(self._store, self._published[one.folder.name])

    def through(self, source: Source) -> StoredRuns:
        """Return these runs: a store is its own source."""
        return self

    def on(self, scheduler: str | None) -> StoredRuns:
        """Search again, and let the workers of a Dask scheduler read metrics and compute
        statistics.
        """
        return StoredRuns(self._place, self.wanted, scheduler)

    def metric_rows(
        self, station: str | None = None, names: Collection[str] | None = None
    ) -> Iterator[tuple[Found, list[MetricRow]]]:
        """Yield each run with its rows of `metrics`, from one pass over the table; runs published
        with other rules come last, computed again.
        """
        current = [one for one in self._published.values() if one.identity.rules == RULES]
        others = [one.found for one in self._published.values() if one.identity.rules != RULES]
        rows: dict[str, list[MetricRow]] = {one.findings: [] for one in current}
        counts: Counter[str] = Counter()
        engine = engine_of(
            self._scheduler, is_much=sum(one.rows["metrics"] for one in current) >= MUCH_ROWS
        )
        for counted, table in engine.run(
            MetricRows(station, names), parts_of(self._store, "metrics", current)
        ):
            counts.update(counted)
            for row in table.to_pylist():
                rows[row.pop("publication")].append(MetricRow(**row))
        expect_all(self._place, "metrics", current, counts)
        yield from ((one.found, rows[one.findings]) for one in current)
        yield from self._mapped(
            partial(metric_rows_of, station=station), others, self._scheduler, Exception
        )

    def statistics(
        self,
        table: str = "samples",
        column: str = "temperature_c",
        by: Sequence[str] = ("station", "port"),
    ) -> pd.DataFrame:
        """Return statistics of a column of `samples` or `joints`, a row for each group: count,
        mean, standard deviation, minimum, maximum, and the 5th, 50th and 95th percentile.

        `by` lists one or more of `run`, `line`, `station`, `port` and `tip` (as the user named it).
        Statistics have the unit of the column; `unknown` counts null and non-finite values. All are
        exact but the percentiles, which differ by at most 0.05 % from the value of their rank
        (`.attrs["quantile_error"]`). Reads 32 768 rows at a time. Raises `RecordError`,
        `UsageError` for an unknown table, column or group.
        """
        return statistics(
            self._store, [*self._published.values()], table, column, by, self._scheduler
        )

    def _together(self, those: Sequence[Found]) -> Together:
        return StoredTogether(self._place, tuple(self._published[one.folder.name] for one in those))

    def _metric_rows(self, found: Found, station: str | None) -> list[MetricRow]:
        return metric_rows_of(self.open(found), station)


class StoredFolders:
    """The runs of a store for code that reads manifests from folders: finds runs, and returns a
    folder for each.
    """

    def __init__(self, place: Place) -> None:
        self._store = Store(place)
        self._opened: dict[str, StoredRun] = {}  # keep their temporary folders

    def find(self, _: Path) -> Iterator[Found]:
        """Yield all runs of the store."""
        return (one.found for one in self._store.runs())

    def folder_of(self, run: Found) -> Path:
        """Return a folder with the run's small files, after comparing the manifest's SHA-256.
        Raises `RecordError`.
        """
        name = run.folder.name
        if name not in self._opened:
            self._opened[name] = StoredRun(self._store, self._store.run(name))
        return self._opened[name].folder
