"""Rows for spreadsheets and CSV readers: times as text in UTC, and no text that is evaluated as a
formula.
"""

from __future__ import annotations

from typing import Final

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.text import csv_cell

# for times in microseconds: Arrow prints seconds with six decimals
ISO: Final = "%Y-%m-%dT%H:%M:%SZ"


def cells(piece: pa.Table) -> pa.Table:
    """Return the rows with times in ISO 8601 and each text neutralised
    (`jbclog.core.text.csv_cell`); numbers and flags are unchanged.
    """
    columns = [_escaped(_timed(column)) for column in piece.itercolumns()]
    return pa.table(columns, names=piece.column_names)


def _timed(column: pa.ChunkedArray) -> pa.ChunkedArray:
    return pc.strftime(column, format=ISO) if pa.types.is_timestamp(column.type) else column


def _escaped(column: pa.ChunkedArray) -> pa.ChunkedArray:
    if not pa.types.is_string(column.type):
        return column
    coded = column.combine_chunks().dictionary_encode()
    texts = pa.array([csv_cell(text) for text in coded.dictionary.to_pylist()], pa.string())
    return texts.take(coded.indices)
