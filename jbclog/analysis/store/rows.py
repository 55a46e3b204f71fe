"""Matching rows of one or several files of a store's table, in batches and in order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds

from jbclog.analysis.store.data_files import FILES
from jbclog.analysis.store.tables import batches_in, written_out
from jbclog.analysis.store.values import expect_values
from jbclog.core.files import MIB, NotReadable

BATCH_ROWS: Final = 32_768  # as in the row groups of a run
NO_ROW: Final = 2**63 - 1  # behind the number of every row
UNPACKED_ROWS: Final = 65_536
"""A row group of more rows is read in batches, because the library unpacks a row group whole."""
FILES_ROWS: Final = 64  # rows of `runs` in a batch, with the small files of the runs
FILES_BYTES: Final = 128 * MIB  # small files of a run: manifest, annotations, line, recipes

# To remove some rows of a file, delta-rs rewrites the file and stores texts as Arrow string views,
# which Arrow cannot compare with strings. Such a file is read first and filtered afterwards.
COMPARED: Final = ("publication", "row", "metric", "station", "port", "time")


def has_views(fragment: ds.Fragment) -> bool:
    """Return True if a file stores texts as string views."""
    return any(pa.types.is_string_view(kind) for kind in fragment.physical_schema.types)


# A long run is committed in parts. Programs that join files (`jbclog store compact`, delta-rs,
# Spark) write these parts, and those of other runs, in any order.


@dataclass(frozen=True, slots=True)
class Span:
    """The rows of a run in one file: the number of the first and of the last, how many there are,
    and whether they are in order.
    """

    fragment: ds.Fragment
    first: int
    last: int
    count: int
    is_ordered: bool


def span_of(fragment: ds.Fragment, mine: pc.Expression, schema: pa.Schema) -> Span:
    """Return the span of the matching rows; without any, `first` is `NO_ROW`."""
    first, last, count, is_ordered, before = NO_ROW, -1, 0, True, -1
    for piece in chosen_rows(fragment, ["row"], mine, schema):
        numbers = piece["row"].to_numpy()
        is_ordered &= bool((np.diff(numbers, prepend=before) > 0).all())
        before, count = int(numbers[-1]), count + len(numbers)
        first, last = min(first, int(numbers.min())), max(last, int(numbers.max()))
    return Span(fragment, first, last, count, is_ordered)


def rows_in_order(
    spans: Iterable[Span], columns: Sequence[str], chosen: pc.Expression, schema: pa.Schema
) -> Iterator[pa.Table]:
    """Yield the matching rows in the order of their numbers, at most `BATCH_ROWS` at a time."""
    found = sorted((span for span in spans if span.count), key=lambda span: span.first)
    if all(span.is_ordered for span in found) and all(
        before.last < after.first for before, after in pairwise(found)
    ):
        for span in found:
            yield from chosen_rows(span.fragment, columns, chosen, schema)
    else:
        yield from _sorted_rows(found, columns, chosen, schema)


def _sorted_rows(
    spans: Sequence[Span], columns: Sequence[str], chosen: pc.Expression, schema: pa.Schema
) -> Iterator[pa.Table]:
    number, needed = pc.field("row"), [*dict.fromkeys([*columns, "row"])]
    first, most = 0, sum(span.count for span in spans)
    while first < most:
        behind = first + BATCH_ROWS
        within = chosen & (number >= first) & (number < behind)
        pieces = [
            piece
            for span in spans
            if span.first < behind and first <= span.last
            for piece in chosen_rows(span.fragment, needed, within, schema)
        ]
        if pieces:
            yield pa.concat_tables(pieces).sort_by("row").select(list(columns))
        first = behind


def chosen_rows(
    fragment: ds.Fragment,
    columns: Sequence[str],
    condition: pc.Expression | None,
    schema: pa.Schema,
    *,
    use_threads: bool = True,
) -> Iterator[pa.Table]:
    """Yield the matching rows of a file, at most `BATCH_ROWS` at a time; no piece is empty. A
    column that the file lacks is null. Raises `NotReadable` for values that no table may hold.
    """
    how = {"batch_size": BATCH_ROWS, "batch_readahead": 1, "use_threads": use_threads}
    needed = [
        *columns,
        *(name for name in COMPARED if name in schema.names and name not in columns),
    ]
    if any(group.num_rows > UNPACKED_ROWS for group in fragment.row_groups):
        pieces = _by_batches(fragment, needed, schema)
    elif has_views(fragment):
        viewed = pa.schema([_as_in_file(field, fragment.physical_schema) for field in schema])
        batches = fragment.to_batches(viewed, needed, **how)
        pieces = (as_texts(pa.Table.from_batches([batch])) for batch in batches)
    else:
        batches = fragment.to_batches(schema, list(columns), filter=condition, **how)
        pieces, condition = (pa.Table.from_batches([batch]) for batch in batches), None
    for piece in pieces:
        found = piece if condition is None else piece.filter(condition).select(list(columns))
        if found.num_rows:
            expect_values(found, "")
            yield found


def _by_batches(
    fragment: ds.Fragment, columns: Sequence[str], schema: pa.Schema
) -> Iterator[pa.Table]:
    groups = [group.id for group in fragment.row_groups]
    own = pa.schema([schema.field(name) for name in columns])
    with fragment.filesystem.open_input_file(fragment.path) as source:
        for batch in batches_in(source, groups, columns, BATCH_ROWS):
            piece = as_texts(pa.Table.from_batches([batch]))
            for field in own:
                if field.name not in piece.column_names:
                    piece = piece.append_column(field, pa.nulls(piece.num_rows, field.type))
            yield piece.select(list(columns)).cast(own)


def kept_files(fragment: ds.Fragment, run: str, version: int) -> Iterator[tuple[str, bytes]]:
    """Yield name and bytes of the small files of a run that a file of `runs` has. Limits their size
    before they are written out. Raises `NotReadable`.
    """
    names = (one.path for one in fragment.metadata.schema)
    coded = [name for name in names if name.startswith(f"{FILES}.") and name.endswith(".data")]
    groups = [group.id for group in fragment.row_groups]
    chosen, taken = (pc.field("run") == run) & (pc.field("version") == version), 0
    with fragment.filesystem.open_input_file(fragment.path) as source:
        columns = ["run", "version", FILES]
        for batch in batches_in(source, groups, columns, FILES_ROWS, coded):
            files = pc.list_flatten(pa.Table.from_batches([batch]).filter(chosen)[FILES])
            for piece in files.chunks:
                taken += written_out(piece.field("data"))
                if taken > FILES_BYTES:
                    most = FILES_BYTES // MIB
                    raise NotReadable(f"{run}: its files have more than {most} MiB")
                yield from (
                    (file["path"], file["data"])
                    for file in piece.to_pylist()
                    if file and None not in file.values()
                )


def _as_in_file(field: pa.Field, there: pa.Schema) -> pa.Field:
    """Return a field with its type in a file."""
    return field.with_type(there.field(field.name).type) if field.name in there.names else field


def as_texts(piece: pa.Table) -> pa.Table:
    """Return the rows with strings instead of string views."""
    fields = [
        field.with_type(pa.utf8()) if pa.types.is_string_view(field.type) else field
        for field in piece.schema
    ]
    return piece.cast(pa.schema(fields))
