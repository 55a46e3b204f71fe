"""Finds runs, and their metrics, through an index in the user's cache folder.

    with run_index() as index:
        for one in index.find(Path("runs"), Filter(order="88123")):
            ...  # as `find_runs.find` yields them

An entry is valid for files of certain sizes, inodes and times, which are read each time; any write
changes the ctime, which users cannot set. Metrics left by a recorder or a report depend on
manifest, annotations and those files; others on all files of the record. Files written just now are
not indexed, because a second write could leave the same time. A run that continues or was cut off,
and one that cannot be read, is read each time.

The index is only a cache: `check` and `report` do not use it, `where-used` hashes again the runs it
names, and ``--no-cache`` disables it.
"""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from hashlib import blake2b
from operator import attrgetter, methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, TypeVar, get_type_hints

import msgspec

from jbclog.app.index.index_file import DIGEST, NAME, IndexFile, cache_folder
from jbclog.core.foreign.files import why_link_hangs
from jbclog.core.rows import TABLES
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import REPORT
from jbclog.record.find_runs import (
    ALL,
    SEALED,
    Filter,
    Found,
    Unreadable,
    find,
    runs_in,
    summary_of,
)
from jbclog.record.folder import FOLDER as RECIPES
from jbclog.record.folder import METRICS_CACHE
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.published import TreePath, find_in, is_table

if TYPE_CHECKING:
    from jbclog.analysis.runs import Records
    from jbclog.analysis.stored_tables import MetricRow

# files that `Records.known` reads
LEFT: Final = (MANIFEST, ANNOTATIONS, REPORT, METRICS_CACHE)
FOUND: Final = "run"  # kind of the entries of runs
SETTLED_NS: Final = 2_000_000_000  # the coarsest clock of a file system
_TYPES: Final = {name: kind for name, kind in get_type_hints(Found).items() if name != "folder"}
_values_of: Final = attrgetter(*_TYPES)
_read_values: Final = msgspec.msgpack.Decoder(tuple.__class_getitem__(tuple(_TYPES.values())))
# figures of a `MetricRow`
_figures_of: Final = attrgetter(
    "station", "port", "value", "unit", "n", "coverage", "resolution", "why"
)
_read_figures: Final = msgspec.msgpack.Decoder(
    list[tuple[str, int, float | None, str, int, float | None, float | None, str | None]]
)
T = TypeVar("T")


class Look(NamedTuple):
    """Stamp of some files, and the times of their changes and of this look in ns since 1970."""

    stamp: bytes
    times: list[int]
    now: int

    @property
    def is_settled(self) -> bool:
        """Whether any later write would change the stamp."""
        return all(abs(self.now - time) > SETTLED_NS for time in self.times)


class RunIndex:
    """A `Source` of `Runs`: runs and their metrics as `Records` reads them, through an index."""

    def __init__(self, file: IndexFile) -> None:
        self._file = file
        self._places: dict[Path, bytes] = {}

    def find(self, folder: Path, wanted: Filter = ALL) -> Iterator[Found | Unreadable]:
        """Yield the matching runs as `find_runs.find` does. Raises `RecordError`."""
        if is_table(folder):
            yield from find_in(folder, wanted)
            return
        paths = runs_in(folder)
        if paths == [folder] or wanted.ended_since is not None:
            yield from find(folder, wanted)
            return
        place, is_any = self._place(folder), wanted == ALL
        for path in paths:
            if is_any or wanted.may_have(path):
                run = self._summary(place, path, wanted)
                if run is not None and (is_any or isinstance(run, Unreadable) or wanted.fits(run)):
                    yield run
        self._file.keep_only(place, FOUND, {os.fsencode(path.name) for path in paths})

    def metrics(
        self, run: Found, names: Collection[str], station: str | None = None
    ) -> list[MetricRow]:
        """Return at least the metrics `names` of a run, as `Records` does. Raises `RecordError`."""
        if run.state == SEALED and not isinstance(run.folder, TreePath):
            rows = self._of_sealed(run, names)
        else:
            rows = self.records.metrics(run, names)
        return [row for row in rows if station in (None, row.station)]

    @property
    def records(self) -> Records:
        """How runs are read that the index does not have."""
        from jbclog.analysis.runs import Records

        return Records(cache=True)

    def _of_sealed(self, run: Found, names: Collection[str]) -> list[MetricRow]:
        from jbclog.analysis.stored_tables import METRIC_NAMES

        place, name = self._place(run.folder.parent), os.fsencode(run.folder.name)
        left = _look_at_left(run.folder)
        known = self._metrics(place, name, left.stamp, names)
        if known is not None:
            return known
        whole = _look_at_record(run.folder)
        known = None if whole is None else self._metrics(place, name, whole.stamp, names)
        if known is not None:
            return known
        records = self.records
        rows = records.known(run)
        seen = whole if rows is None else left
        if rows is None:
            rows = records.metrics(run, METRIC_NAMES)
        if seen is not None and seen.is_settled:
            self._put_metrics(place, name, seen.stamp, rows)
        return rows

    def _put_metrics(
        self, place: bytes, run: bytes, stamp: bytes, rows: Iterable[MetricRow]
    ) -> None:
        from jbclog.analysis.stored_tables import METRIC_NAMES

        figures: dict[str, list[object]] = {metric: [] for metric in METRIC_NAMES}
        for row in rows:
            figures.get(row.metric, []).append(_figures_of(row))
        for metric, those in figures.items():
            # `item` turns numpy scalars into Python numbers
            self._file.put(
                place,
                metric,
                run,
                stamp,
                msgspec.msgpack.encode(those, enc_hook=methodcaller("item")),
            )

    def _place(self, folder: Path) -> bytes:
        """Return the key of a folder of runs, however its path is written."""
        if folder not in self._places:
            self._places[folder] = blake2b(
                os.fsencode(os.path.realpath(folder)), digest_size=DIGEST
            ).digest()
        return self._places[folder]

    def _summary(self, place: bytes, path: Path, wanted: Filter) -> Found | Unreadable | None:
        if why_link_hangs(path) is not None:
            return summary_of(path, wanted)
        seen, name = (
            _look([f"{path}/{MANIFEST}", f"{path}/{ANNOTATIONS}"], len(str(path))),
            os.fsencode(path.name),
        )
        data = self._file.data_of(place, FOUND, name, seen.stamp)
        values = None if data is None else _decoded(_read_values, data)
        if values is not None:
            return Found(path, *values)
        run = summary_of(path)
        if isinstance(run, Unreadable):
            return summary_of(path, wanted)  # which returns it only if it may match
        if run is not None and run.state == SEALED and seen.is_settled:
            self._file.put(place, FOUND, name, seen.stamp, msgspec.msgpack.encode(_values_of(run)))
        return run

    def _metrics(
        self, place: bytes, run: bytes, stamp: bytes, names: Collection[str]
    ) -> list[MetricRow] | None:
        """Return the rows of these metrics; None unless the index has all of them."""
        from jbclog.analysis.stored_tables import MetricRow

        rows: list[MetricRow] = []
        for name in names:
            data = self._file.data_of(place, name, run, stamp)
            known = None if data is None else _decoded(_read_figures, data)
            if known is None:
                return None
            rows += [MetricRow(one[0], one[1], name, *one[2:]) for one in known]
        return rows


@contextmanager
def run_index() -> Iterator[RunIndex]:
    """Open the user's index; without a folder for it, an empty one that stores nothing."""
    folder = cache_folder()
    file = IndexFile(None if folder is None else folder / NAME)
    try:
        yield RunIndex(file)
    finally:
        file.close()


def _look_at_left(run: Path) -> Look:
    """Stamp the files of metrics that a recorder or a report left."""
    from jbclog.analysis.stored_tables import METHODS_TEXT

    return _look([f"{run}/{name}" for name in LEFT], len(str(run)), METHODS_TEXT)


def _look_at_record(run: Path) -> Look | None:
    """Stamp all files on which a run's metrics can depend; None if that is not possible."""
    from jbclog.analysis.stored_tables import METHODS_TEXT

    there = [f"{run}/{name}" for name in LEFT]
    try:
        for name in (*TABLES, RECIPES):
            with suppress(FileNotFoundError):
                there += [f"{run}/{name}/{part}" for part in sorted(os.listdir(f"{run}/{name}"))]  # noqa: PTH208  # as below
    except OSError:
        return None
    return _look(there, len(str(run)), f"all of the record, {METHODS_TEXT}")


def _look(paths: Iterable[str], run: int, by: str = "") -> Look:
    """Stamp a run's files; `run` is the length of the run's own path. `by`: who reads them."""
    now, times, facts = time.time_ns(), list[int](), list[object]([by])
    for path in paths:
        try:
            found = os.lstat(path)  # creating a `Path` takes as long as all the rest
        except OSError as error:
            facts.append(error.errno)
            times += [] if error.errno == errno.ENOENT else [now]
        else:
            facts.append(
                (
                    path[run:],
                    found.st_mode,
                    found.st_size,
                    found.st_mtime_ns,
                    found.st_ctime_ns,
                    found.st_ino,
                )
            )
            times += [found.st_mtime_ns, found.st_ctime_ns]
    return Look(
        blake2b(repr(facts).encode(errors="surrogateescape"), digest_size=DIGEST).digest(),
        times,
        now,
    )


def _decoded(decoder: msgspec.msgpack.Decoder[T], data: bytes) -> T | None:
    try:
        return decoder.decode(data)
    except ValueError:  # with a checksum that fits: forged
        return None
