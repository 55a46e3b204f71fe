"""Reads a store: first its runs, then only the columns, partitions and files with the requested
rows.

A row counts if the newest row of its run in `runs` names its publication; other rows belong to an
older version, or to a publisher that was interrupted. `runs` is read first: the rows that it names
were committed before it. It has the number of a run's rows in each table, so that a missing part is
an error, never a shorter answer.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import unquote

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
import pyarrow.fs as pf

from jbclog.analysis.store.data_files import FILES, DataFiles
from jbclog.analysis.store.identity import Identity
from jbclog.analysis.store.place import Place, expect_library, explained, one_line
from jbclog.analysis.store.plain_files import is_name
from jbclog.analysis.store.rows import kept_files, rows_in_order, span_of
from jbclog.analysis.store.schema import (
    DATA,
    OWN,
    PARTITIONS,
    PROPERTY,
    RECORD,
    RUNS,
    SCHEMA,
    schema_of,
)
from jbclog.analysis.store.values import expect_values
from jbclog.core.clock import utc_text
from jbclog.core.errors import RecordError, StoreError
from jbclog.core.files import NotReadable
from jbclog.record.find_runs import ALL, SEALED, Filter, Found

if TYPE_CHECKING:
    from deltalake import DeltaTable

SHOWN: Final = (
    "operator",
    "order",
    "product",
    "verdict",
    "exit_status",
    "exit_code",
    "lost",
    "line",
    "manifest_sha256",
)


@dataclass(frozen=True, slots=True)
class Published:
    """A version of a run in a store: its summary for filters, its identity, and where its rows are.
    `record` and `findings` are publications; `rows` has the number of rows in each table.
    """

    found: Found
    identity: Identity
    version: int
    record: str
    findings: str
    line: str | None
    month: str | None
    rows: Mapping[str, int]

    def publication(self, table: str) -> str:
        """Return the publication of the run's rows in a table."""
        return self.record if table in RECORD else self.findings


class Store:
    """A store in the state in which its tables are first read; later commits do not change it."""

    def __init__(self, place: Place, runs: DeltaTable | None = None) -> None:
        expect_library()
        self.place = place
        self._tables: dict[str, DeltaTable] = {} if runs is None else {RUNS: runs}
        self._datasets: dict[str, ds.Dataset] = {}
        self._checks: dict[str, DataFiles] = {}

    def table(self, name: str) -> DeltaTable:
        """Return a table at the version that this object reads. Raises `StoreError`, also for a
        table of a newer jbclog.
        """
        if name not in self._tables:
            if name != RUNS:
                self.table(RUNS)  # first: the rows that it names were committed before it
            self._tables[name] = opened(self.place, name)
        return self._tables[name]

    def dataset(self, name: str) -> ds.Dataset:
        """Return a table as a dataset; filters on line, month, run or publication skip files.
        Raises `RecordError`.
        """
        if name not in self._datasets:
            with explained(self.place.url):
                files = (
                    None
                    if self.place.is_remote
                    else pf.SubTreeFileSystem(self.place.of(name), pf.LocalFileSystem())
                )
                found = self.table(name).to_pyarrow_dataset(filesystem=files)
            self.place.expect_below(name, found.files)
            self.place.expect_plain(name)
            self._datasets[name] = found
        return self._datasets[name]

    def bounded(self, name: str, fragments: Iterable[ds.Fragment]) -> list[ds.Fragment]:
        """Return these files of a table as a list. Raises `StoreError` if they exceed the limits in
        `data_files`.
        """
        found = list(fragments)
        self.data_files(name).expect_bounded(one.path for one in found)
        return found

    def data_files(self, name: str) -> DataFiles:
        """Return the object that checks the files of a table before they are read."""
        if name not in self._checks:
            files = actions_of(self.table(name)).select(["path", "num_records"]).to_pydict()
            declared = dict(zip(map(unquote, files["path"]), files["num_records"], strict=True))
            self._checks[name] = DataFiles(self.place, name, declared)
        return self._checks[name]

    def runs(self, wanted: Filter = ALL) -> list[Published]:
        """Return the newest version of each run that matches, ordered by name, which begins with
        the start.
        """
        newest: dict[str, Published] = {}
        for one in self._versions(wanted):
            if one.identity.run not in newest or one.version > newest[one.identity.run].version:
                newest[one.identity.run] = one
        return [newest[name] for name in sorted(newest) if wanted.fits(newest[name].found)]

    def every_version(self) -> list[Published]:
        """Return all versions of all runs."""
        return [*self._versions(ALL)]

    def _versions(self, wanted: Filter) -> Iterator[Published]:
        line = wanted.line if wanted.line and "*" not in wanted.line else None
        return map(
            self._published, self._rows(_in_partitions([line] if line else [], _months(wanted)))
        )

    def run(self, name: str) -> Published:
        """Return the newest version of a run. Raises `RecordError` if the store does not have the
        run.
        """
        found = self.newest(name)
        if found is None:
            raise RecordError(
                f"{self.place}: no run {name}; `jbclog runs {self.place}` lists all runs"
            )
        return found

    def newest(self, name: str) -> Published | None:
        """Return the newest version of a run; None if the store does not have the run."""
        rows = self._rows(pc.field("run") == name, self._with_run(name))
        return max(map(self._published, rows), key=lambda one: one.version, default=None)

    def _with_run(self, name: str) -> ds.Dataset:
        """Return the files of `runs` that, by their statistics, may have this run, as a dataset: a
        dataset of all files takes 1 ms for each.
        """
        table = self.table(RUNS)
        if table.protocol().reader_features:
            return self.dataset(RUNS)  # foreign: the library decides whether it can read it
        schema, form = pa.schema(table.schema().to_arrow()), ds.ParquetFileFormat()
        files = pf.SubTreeFileSystem(RUNS, self.place.files())
        chosen = [one for one in actions_of(table).to_pylist() if may_have(one, "run", name)]
        self.place.expect_files(RUNS, [unquote(one["path"]) for one in chosen])
        fragments = [
            form.make_fragment(
                unquote(one["path"]), files, partition_expression=_partition_values(one)
            )
            for one in chosen
        ]
        return ds.FileSystemDataset(fragments, schema, form, files)

    def _rows(
        self, condition: pc.Expression | None, runs: ds.Dataset | None = None
    ) -> list[dict[str, Any]]:
        with explained(self.place.url):
            runs = self.dataset(RUNS) if runs is None else runs
            self.bounded(RUNS, runs.get_fragments(filter=condition))
            columns = [name for name in runs.schema.names if name != FILES]
            rows = runs.to_table(columns=columns, filter=condition)
            expect_columns(rows)
            expect_values(rows, f"{RUNS}: ")
            return list(rows.to_pylist())

    def files_of(self, one: Published) -> list[tuple[str, bytes]]:
        """Return name and bytes of each small file of a run: manifest, annotations, line, recipes.
        Raises `RecordError`.
        """
        name, version = one.identity.run, one.version
        chosen = (pc.field("run") == name) & (pc.field("version") == version)
        with explained(self.place.url):
            files = self.bounded(RUNS, self.dataset(RUNS).get_fragments(filter=chosen))
            return [kept for file in files for kept in kept_files(file, name, version)]

    def pieces(
        self,
        table: str,
        one: Published,
        columns: Sequence[str],
        condition: pc.Expression | None = None,
    ) -> Iterator[pa.Table]:
        """Yield the rows of a run in a table, in order, at most 32 768 at a time. Raises
        `RecordError`, also if some are missing.
        """
        mine = pc.field("publication") == one.publication(table)
        chosen = mine if condition is None else mine & condition
        try:
            schema = self.dataset(table).schema
            files = self._fragments(table, one, mine)
            spans = [span_of(fragment, mine, schema) for fragment in files]
            expect_rows(self.place, one, table, sum(span.count for span in spans))
            last = max((span.last for span in spans), default=-1)
            if last >= one.rows[table]:
                raise RecordError(
                    f"{self.place}: {one.identity.run}: its {table} have a row numbered {last}, and"
                    f" only {one.rows[table]} rows: another program wrote them. Publish the run"
                    " into a new store"
                )
            for piece in rows_in_order(spans, columns, chosen, schema):
                yield as_own(piece, table)
        except (OSError, pa.ArrowException) as error:
            raise RecordError(
                missing(self.place, one.identity.run, table, one_line(error))
            ) from error

    def _fragments(self, table: str, one: Published, mine: pc.Expression) -> list[ds.Fragment]:
        """Return the files that may have rows of the run."""
        condition = _in_partitions([one.line], [one.month])
        return self.bounded(
            table,
            self.dataset(table).get_fragments(
                filter=mine if condition is None else mine & condition
            ),
        )

    def _published(self, row: Mapping[str, Any]) -> Published:
        if not is_name(row["run"]):  # `StoredRun` writes its files to a folder of that name
            raise StoreError(
                f"{self.place}: {RUNS} has a run {row['run']!r:.100}, which no run is named; no"
                " publisher writes such a row. Publish the runs into a new store"
            )
        facts: dict[str, Any] = {name: row[name] for name in SHOWN}
        facts |= {
            name: tuple(row[name] or ())
            for name in ("stations", "recipes", "units", "wire_lots", "flux_lots", "tips")
        }
        found = Found(
            folder=self.place.path / row["run"],
            run=row["run"],
            state=SEALED,
            started=_iso(row["started"]),
            ended=_iso(row["ended"]),
            changed=None,
            tags=dict(row["tags"] or ()),
            periods_s=dict(row["periods"] or ()),
            **facts,
        )
        identity = Identity(
            row["run"], row["manifest_sha256"], tuple(row["annotations"] or ()), row["rules"]
        )
        rows = {table: row[f"{table}_rows"] or 0 for table in DATA}
        return Published(
            found,
            identity,
            row["version"],
            row["record"],
            row["findings"],
            row["line"],
            row["month"],
            rows,
        )


def expect_columns(rows: pa.Table) -> None:
    """Raise `NotReadable` if rows of `runs` lack a column, or a value that must not be null."""
    for field in schema_of(RUNS):
        if field.name == FILES:
            continue
        if field.name not in rows.column_names:
            raise NotReadable(f"{RUNS} has no column {field.name}")
        if not field.nullable and rows[field.name].null_count:
            raise NotReadable(f"{RUNS} has rows without {field.name}")


def opened(place: Place, name: str) -> DeltaTable:
    """Open the newest version of a table. Raises `StoreError`, also for a table whose schema this
    jbclog does not know.
    """
    table = place.table(name)
    written = table.metadata().configuration.get(PROPERTY, "")
    if not written.isdecimal() or int(written) > SCHEMA:
        raise StoreError(
            f"{place}: {name} is written with schema {written or '(none)'}; this jbclog knows"
            f" {SCHEMA}. Upgrade jbclog"
        )
    return table


def actions_of(table: DeltaTable) -> pa.Table:
    """Return a row for each file of a table: path, size, number of rows, statistics."""
    return pa.table(table.get_add_actions(flatten=True))


def may_have(file: Mapping[str, Any], column: str, value: str) -> bool:
    """Return True if a file can have a row with this value; without statistics, it can."""
    least, most = file.get(f"min.{column}"), file.get(f"max.{column}")
    return least is None or most is None or least <= value <= most


def _partition_values(file: Mapping[str, Any]) -> pc.Expression:
    """Return the values of a file's partition columns as a condition, because only its path has
    them.
    """
    values = {name: file[f"partition.{name}"] for name in PARTITIONS}
    line, month = (
        pc.field(name).is_null() if value is None else pc.field(name) == value
        for name, value in values.items()
    )
    return line & month


def as_own(piece: pa.Table, table: str) -> pa.Table:
    """Return the rows with the types and metadata of a run's folder."""
    own = OWN[table]
    fields = [
        own.field(name) if name in own.names else piece.schema.field(name)
        for name in piece.column_names
    ]
    return piece.cast(pa.schema(fields, metadata=own.metadata))


def expect_rows(place: Place, one: Published, table: str, there: int) -> None:
    """Raise `RecordError` unless a run has as many rows in a table as its publisher counted."""
    if there != one.rows[table]:
        raise RecordError(
            missing(place, one.identity.run, table, f"{there} of {one.rows[table]} rows are there")
        )


def missing(place: Place, run: str, table: str, why: str) -> str:
    """Return the message for a table that lacks rows of a run."""
    return (
        f"{place}: {run}: its {table} are incomplete: {why}; `jbclog store check {place}` lists all"
        " damage"
    )


def _in_partitions(
    lines: Iterable[str | None], months: Iterable[str | None]
) -> pc.Expression | None:
    """Return the condition for rows of these lines and months; None without a condition. An unknown
    line or month (None) is no condition.
    """
    condition = None
    for name, values in (("line", set(lines)), ("month", set(months))):
        if values and None not in values:
            chosen = pc.field(name).isin(pa.array(sorted(values), pa.utf8()))  # type: ignore[type-var]  # without None
            condition = chosen if condition is None else condition & chosen
    return condition


def _months(wanted: Filter) -> list[str]:
    """Return the months from `since` to `until` of a filter; empty without both limits, or for more
    than ten years.
    """
    if wanted.since is None or wanted.until is None:
        return []
    first, last = (moment.year * 12 + moment.month - 1 for moment in (wanted.since, wanted.until))
    return (
        [f"{month // 12:04}-{month % 12 + 1:02}" for month in range(first, last + 1)]
        if 0 <= last - first < 120
        else []
    )


def _iso(moment: datetime | None) -> str | None:
    return None if moment is None else utc_text(moment)
