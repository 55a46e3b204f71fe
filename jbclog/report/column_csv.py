"""Long tables as CSV, column by column in Arrow: a week of a port has a hundred thousand joints of
thirty cells each.

The bytes are those of `jbclog.core.text.csv_text`.
"""

from __future__ import annotations

import csv
import io
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.text import csv_cell
from jbclog.report.text import iso_times

LEAST, MOST = 1e-4, 1e9
"""Between these, Arrow writes a number as Python does, except the ``.0`` of an integer."""
LINE_END: Final = "\r\n"


def csv_lines(rows: pa.Table) -> bytes:
    """Return a line for each row, without a header; an unknown value is an empty cell."""
    if not rows.num_rows:
        return b""
    *cells, last = (_cells(column.combine_chunks()) for column in rows.columns)
    ended = pc.binary_join_element_wise(pc.fill_null(last, ""), LINE_END, "")
    lines = pc.binary_join_element_wise(
        *cells, ended, ",", null_handling="replace", null_replacement=""
    )
    _, offsets, contents = lines.buffers()
    ends = np.frombuffer(offsets, np.int32)[lines.offset : lines.offset + len(lines) + 1]
    return bytes(memoryview(contents)[ends[0] : ends[-1]])


def _cells(column: pa.Array) -> pa.StringArray:
    kind = column.type
    if pa.types.is_floating(kind):
        return _of_floats(column)
    if pa.types.is_boolean(kind):
        return pc.if_else(column, "True", "False")
    if pa.types.is_integer(kind):
        return column.cast(pa.string())
    if pa.types.is_timestamp(kind):
        return iso_times(column)
    texts = column.dictionary_encode()  # few are distinct
    cells = pa.array([_cell(text) for text in texts.dictionary.to_pylist()], pa.string())
    return cells.take(texts.indices)


def _of_floats(column: pa.Array) -> pa.StringArray:
    values = np.abs(column.to_numpy(zero_copy_only=False))
    if ((values >= MOST) | ((values < LEAST) & (values > 0))).any():
        texts = (None if value is None else repr(value) for value in column.to_pylist())
        return pa.array(texts, pa.string())
    texts = column.cast(pa.string())
    whole = pc.equal(column, pc.trunc(column))
    return pc.if_else(whole, pc.binary_join_element_wise(texts, ".0", ""), texts)


def _cell(text: str) -> str:
    """Return a text as a cell, quoted if needed."""
    out = io.StringIO()
    csv.writer(out, lineterminator="").writerow([csv_cell(text), ""])
    return out.getvalue().removesuffix(",")
