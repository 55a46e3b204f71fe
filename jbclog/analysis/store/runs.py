"""The runs of a store as `Run` and `Runs`: everything that reads a run's folder reads them, too.

A run's small files (manifest, annotations, line, recipes) are written to a temporary folder, which is removed with the object; rows
come from the store, only those columns that are asked for.
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Collection, Iterator
from functools import cached_property
from hashlib import sha256
from pathlib import Path, PurePosixPath

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.run import Run
from jbclog.analysis.run_metrics import metric_rows_of
from jbclog.analysis.run_tables import Selection, arrow_time
from jbclog.analysis.runs import Runs, Source
from jbclog.analysis.store.place import Place
from jbclog.analysis.store.reader import Published, Store, metric_rows
from jbclog.analysis.store.schema import OWN
from jbclog.analysis.stored_tables import MetricRow
from jbclog.analysis.verdict import RULES
from jbclog.core.errors import RecordError
from jbclog.record.find_runs import Filter, Found, Unreadable
from jbclog.record.manifest import NAME as MANIFEST


class StoredRun(Run):
    """A run of a store, at the newest version when it was opened."""

    def __init__(self, store: Store, entry: Published) -> None:
        self.store, self.entry = store, entry
        home = Path(tempfile.mkdtemp(prefix="jbclog-"))
        weakref.finalize(self, shutil.rmtree, home, ignore_errors=True)
        super().__init__(home / entry.identity.run)
        self._write_files()

    @property
    def place(self) -> str:
        """Where the run is, as messages and tables show it."""
        return str(self.entry.found.folder)

    def published(self, table: str) -> pa.Table | None:
        """Return its joints or metrics as they were published; None if another version of the rules computed them."""
        if self.entry.identity.rules != RULES:
            return None
        return pa.concat_tables([OWN[table].empty_table(), *self.store.pieces(table, self.entry, OWN[table].names)])

    def _groups(self, selection: Selection) -> Iterator[pa.Table]:
        pieces = self.store.pieces(selection.table, self.entry, selection.needed, _condition(selection))
        return map(selection.cut, pieces)

    def _write_files(self) -> None:
        for name, data in self.store.files_of(self.entry):
            if name == MANIFEST and sha256(data).hexdigest() != self.entry.identity.manifest_sha256:
                raise RecordError(f"{self.place}: its manifest was changed: its SHA-256 is not the one in `runs`")
            if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
                raise RecordError(f"{self.place}: has a file {name!r}, which lies outside of the run's folder")
            path = self.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)


def _condition(selection: Selection) -> pc.Expression | None:
    """Return what a file's statistics can exclude; `Selection.cut` selects exactly."""
    found = [pc.field(name) == value for name in ("station", "port") if (value := getattr(selection, name)) is not None]
    if selection.start is not None:
        found.append(pc.field("time") >= arrow_time(selection.start))
    if selection.stop is not None:
        found.append(pc.field("time") < arrow_time(selection.stop))
    if not found:
        return None
    both = found[0]
    for one in found[1:]:
        both = both & one
    return both


class StoredRuns(Runs):
    """The runs of a store that match a filter, all as they were when the first was read."""

    def __init__(self, place: Place, wanted: Filter) -> None:
        super().__init__(place.path, wanted)
        self._place = place
        self._store = Store(place)

    @cached_property
    def _published(self) -> dict[str, Published]:
        return {one.identity.run: one for one in self._store.runs(self.wanted)}

    @cached_property
    def _search(self) -> tuple[list[Found], list[Unreadable]]:
        return [one.found for one in self._published.values()], []

    def refreshed(self) -> StoredRuns:
        """Return the runs that match now."""
        return StoredRuns(self._place, self.wanted)

    def open(self, one: Found) -> Run:
        """Return the run that was found."""
        return StoredRun(self._store, self._published[one.folder.name])

    def through(self, source: Source) -> StoredRuns:
        """Return the same: a store is its own source."""
        return self

    def metric_rows(
        self, station: str | None = None, names: Collection[str] | None = None
    ) -> Iterator[tuple[Found, list[MetricRow]]]:
        """Yield each run with its rows of `metrics`, from one pass over the table."""
        current = [one for one in self._published.values() if one.identity.rules == RULES]
        table = metric_rows(self._store, current, station, names)
        rows: dict[str, list[MetricRow]] = {one.findings: [] for one in current}
        for row in table.to_pylist():
            rows[row.pop("publication")].append(MetricRow(**row))
        yield from ((one.found, rows[one.findings]) for one in current)
        others = [one.found for one in self._published.values() if one.identity.rules != RULES]
        yield from self._each(lambda one: metric_rows_of(self.open(one), station), others)

    def _metric_rows(self, found: Found, station: str | None) -> list[MetricRow]:
        return metric_rows_of(self.open(found), station)


class StoredFolders:
    """The runs of a store for what reads their manifests from folders: finds them, and returns a folder for each."""

    def __init__(self, place: Place) -> None:
        self._store = Store(place)
        self._kept: dict[str, StoredRun] = {}  # with their folders

    def find(self, _: Path) -> Iterator[Found]:
        """Yield all runs of the store."""
        return (one.found for one in self._store.runs())

    def folder_of(self, run: Found) -> Path:
        """Return a folder with the run's small files; its manifest has been hashed again. Raises `RecordError`."""
        name = run.folder.name
        if name not in self._kept:
            self._kept[name] = StoredRun(self._store, self._store.run(name))
        return self._kept[name].folder
