"""Parts of a store's table that are read independently, also on other computers: some files, or
some row groups of a large one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import unquote

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
import pyarrow.fs as pf

from jbclog.analysis.store.place import Place, explained
from jbclog.analysis.store.reader import Published, Store, actions_of, expect_rows
from jbclog.analysis.store.rows import chosen_rows
from jbclog.analysis.store.schema import schema_of

PART_ROWS: Final = 2_000_000
"""Rows of a part. A larger file is divided, and smaller ones are joined: a task costs scheduler,
worker and client 6 ms in all, and these rows take 0.3 s.
"""
MOST_FILES: Final = 32
"""Files of a part. A file with few rows takes a few ms to read, about 10 ms from S3."""


@dataclass(frozen=True, slots=True)
class FilePart:
    """One share of a table's file (`share` of `shares`, from 0), and the publications whose rows
    count.
    """

    place: Place
    table: str
    path: str
    share: int
    shares: int
    publications: frozenset[str]

    @property
    def wanted(self) -> pc.Expression:
        """Condition for the rows that count."""
        return pc.field("publication").isin(pa.array(sorted(self.publications), pa.utf8()))

    def pieces(
        self, columns: Sequence[str], condition: pc.Expression | None = None
    ) -> Iterator[pa.Table]:
        """Yield the matching rows that count, at most 32 768 at a time, in one thread. Raises
        `RecordError`.
        """
        chosen = self.wanted if condition is None else self.wanted & condition
        with explained(self.place.url):
            for fragment in self._fragments():
                yield from chosen_rows(
                    fragment, columns, chosen, schema_of(self.table), use_threads=False
                )

    def _fragments(self) -> Iterator[ds.Fragment]:
        fragment = ds.ParquetFileFormat().make_fragment(
            self.path, filesystem=table_files(self.place, self.table)
        )
        if self.shares == 1:
            yield fragment
            return
        groups = [one.id for one in fragment.row_groups]
        mine = groups[
            self.share * len(groups) // self.shares : (self.share + 1) * len(groups) // self.shares
        ]
        if mine:
            yield fragment.subset(row_group_ids=mine)


@dataclass(frozen=True, slots=True)
class Files:
    """The files, and shares of files, that one task reads."""

    files: tuple[FilePart, ...]

    @property
    def publications(self) -> frozenset[str]:
        """Publications whose rows count."""
        return frozenset().union(*(one.publications for one in self.files))

    def pieces(
        self, columns: Sequence[str], condition: pc.Expression | None = None
    ) -> Iterator[pa.Table]:
        """Yield the matching rows that count, file by file. Raises `RecordError`."""
        for one in self.files:
            yield from one.pieces(columns, condition)


def together(files: Iterable[tuple[FilePart, int]]) -> Iterator[Files]:
    """Group files into parts of at most `PART_ROWS` rows, in order; `files` has each file's number
    of rows.
    """
    mine: list[FilePart] = []
    rows = 0
    for one, count in files:
        if mine and (rows + count > PART_ROWS or len(mine) == MOST_FILES):
            yield Files(tuple(mine))
            mine, rows = [], 0
        mine.append(one)
        rows += count
    if mine:
        yield Files(tuple(mine))


def table_files(place: Place, table: str) -> pf.FileSystem:
    """Return the files of a table as a file system; names are relative to the table."""
    return Place(place.of(table)).files()


def parts_of(store: Store, table: str, runs: Iterable[Published]) -> list[Files]:
    """Return the parts that may have rows of these runs, by line, month and the statistics of the
    files. Raises `RecordError`.
    """
    return [*together(_files(store, table, runs))]


def _files(store: Store, table: str, runs: Iterable[Published]) -> Iterator[tuple[FilePart, int]]:
    wanted: dict[tuple[str | None, str | None], list[str]] = {}
    for one in runs:
        wanted.setdefault((one.line, one.month), []).append(one.publication(table))
    with explained(store.place.url):
        paths = {
            unquote(fragment.path): fragment.path
            for fragment in store.dataset(table).get_fragments()
        }
        files = actions_of(store.table(table)).to_pylist()
    chosen = [(file, mine) for file in files if (mine := _publications(file, wanted))]
    with explained(store.place.url):  # afterwards the log's numbers of rows are known to be true
        store.data_files(table).expect_bounded(paths[unquote(one["path"])] for one, _ in chosen)
    for file, mine in sorted(chosen, key=lambda one: str(one[0]["path"])):
        rows = file["num_records"] or 1
        shares = -(-rows // PART_ROWS)
        path = paths[unquote(file["path"])]
        for share in range(shares):
            yield FilePart(store.place, table, path, share, shares, mine), -(-rows // shares)


def _publications(
    file: Mapping[str, Any], wanted: Mapping[tuple[str | None, str | None], Collection[str]]
) -> frozenset[str]:
    """Return the publications of which a file may have rows, by its partition and statistics."""
    first, last = file.get("min.publication") or "", file.get("max.publication")
    of_partition = wanted.get((file.get("partition.line"), file.get("partition.month")), ())
    return frozenset(
        name for name in of_partition if first <= name and (last is None or name <= last)
    )


@dataclass(frozen=True, slots=True)
class MetricRows:
    """Reads the metrics of one part: those of one station or of all, those of `names` or all."""

    station: str | None
    names: Collection[str] | None

    def __call__(self, part: Files) -> tuple[Counter[str], pa.Table]:
        """Return the number of all rows of each publication, and the matching rows. Raises
        `RecordError`.
        """
        counts = Counter(
            name
            for piece in part.pieces(["publication"])
            for name in piece["publication"].to_pylist()
        )
        schema = schema_of("metrics")
        columns = [name for name in schema.names if name not in ("run", "row", "line", "month")]
        empty = pa.schema([schema.field(name) for name in columns]).empty_table()
        pieces = [piece.cast(empty.schema) for piece in part.pieces(columns, self._condition())]
        return counts, pa.concat_tables([empty, *pieces])

    def _condition(self) -> pc.Expression | None:
        own = None if self.station is None else pc.field("station") == self.station
        if self.names is None:
            return own
        named = pc.field("metric").isin(pa.array(sorted(self.names), pa.utf8()))
        return named if own is None else own & named


def expect_all(place: Place, table: str, runs: Iterable[Published], counts: Counter[str]) -> None:
    """Raise `RecordError` unless each run has as many rows as its publisher counted."""
    for one in runs:
        expect_rows(place, one, table, counts[one.publication(table)])
