"""Excel workbooks: a sheet `about` with facts and units, and a sheet for each table.

A table with more rows than a sheet holds continues on further sheets, `samples 2` and so on;
`about` lists the sheets of each table. A workbook has no formulas and no links.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import datetime
from itertools import repeat
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
from xlsxwriter import Workbook
from xlsxwriter.exceptions import FileCreateError
from xlsxwriter.worksheet import Worksheet

from jbclog.app.export.cells import cells
from jbclog.app.export.csv_files import DATATYPES
from jbclog.app.export.source import SCHEMA_OF, Source
from jbclog.core.text import csv_cell, shortened

# rows of a sheet, with its header (Microsoft: "Excel specifications and limits")
MOST_ROWS: Final = 1_048_576
# of a cell: Excel takes 32 767, and a note on what is left out follows
MOST_CHARACTERS: Final = 32_000
ABOUT: Final = "about"
WriteCell = Callable[[int, int, Any], object]
"""Writes a value into a row and a column."""


def write(source: Source, path: Path) -> dict[str, int]:
    """Write a workbook; return the number of rows of each table. Raises `OSError`,
    `RecordError`.
    """
    options = {
        "constant_memory": True,
        "strings_to_formulas": False,
        "strings_to_urls": False,
        "tmpdir": str(path.parent),
    }
    book = Workbook(str(path), options)
    book.use_zip64()
    book.set_properties({"title": source.title, "created": _created(source)})
    try:
        about = book.add_worksheet(ABOUT)  # shown first, filled last
        sheets = {table: _write_table(book, table, source.pieces(table)) for table in source.tables}
        _write_rows(about, _about(source, sheets))
    finally:
        _close(book)
    return {table: sum(rows.values()) for table, rows in sheets.items()}


def _close(book: Workbook) -> None:
    """Close a workbook. Raises `OSError`, which xlsxwriter wraps."""
    try:
        book.close()
    except FileCreateError as error:
        raise (
            error.args[0]
            if error.args and isinstance(error.args[0], OSError)
            else OSError(str(error))
        ) from error


def _created(source: Source) -> datetime:
    """Return the start of the run, so that the same run and version give the same bytes; without
    one, the first day of 1980.
    """
    started = source.run.manifest.start
    moment = datetime(1980, 1, 1) if started is None else datetime.fromisoformat(started)  # noqa: DTZ001  # Excel has no zones
    return moment.replace(tzinfo=None, microsecond=0)


def _write_table(book: Workbook, table: str, pieces: Iterable[pa.Table]) -> dict[str, int]:
    """Write a table on as many sheets as it needs; return the number of rows of each sheet."""
    names, filled = SCHEMA_OF[table].names, dict[str, int]()
    sheet = _next_sheet(book, table, names, filled)
    for piece in pieces:
        start = 0
        while start < piece.num_rows:
            if filled[sheet.name] == MOST_ROWS - 1:
                sheet = _next_sheet(book, table, names, filled)
            part = piece.slice(start, MOST_ROWS - 1 - filled[sheet.name])
            _write_columns(sheet, filled[sheet.name] + 1, cells(part))
            filled[sheet.name] += part.num_rows
            start += part.num_rows
    return filled


def _next_sheet(book: Workbook, table: str, names: list[str], filled: dict[str, int]) -> Worksheet:
    sheet = book.add_worksheet(table if not filled else f"{table} {len(filled) + 1}")
    sheet.freeze_panes(1, 0)
    _write_rows(sheet, [names])
    filled[sheet.name] = 0
    return sheet


def _write_columns(sheet: Worksheet, row: int, part: pa.Table) -> None:
    """Write the cells of some rows by their column's type; an unknown value is an empty cell."""
    writers = [_writer(sheet, field.type) for field in part.schema]
    columns = [column.to_pylist() for column in part.itercolumns()]
    for number, values in enumerate(zip(*columns, strict=True), row):
        for place, (write, value) in enumerate(zip(writers, values, strict=True)):
            if value is not None:
                write(number, place, value)


def _writer(sheet: Worksheet, kind: pa.DataType) -> WriteCell:
    if pa.types.is_string(kind):
        return lambda row, place, text: sheet.write_string(
            row, place, shortened(text, MOST_CHARACTERS)
        )
    writer: WriteCell = sheet.write_boolean if pa.types.is_boolean(kind) else sheet.write_number
    return writer


def _write_rows(sheet: Worksheet, rows: Iterable[Iterable[object]]) -> None:
    """Write rows of texts and numbers, from the first row on."""
    for number, values in enumerate(rows):
        for place, value in enumerate(values):
            if isinstance(value, int):
                sheet.write_number(number, place, value)
            else:
                sheet.write_string(number, place, shortened(str(csv_cell(value)), MOST_CHARACTERS))


def _about(source: Source, sheets: dict[str, dict[str, int]]) -> Iterator[Sequence[object]]:
    """Yield the rows of `about`: facts, each table's sheets, columns with units."""
    yield [source.title]
    yield from ([name, text] for name, text in source.facts.items())
    yield []
    yield ["table", "sheet", "rows"]
    for table, filled in sheets.items():
        yield from ([table, sheet, rows] for sheet, rows in filled.items())
        if len(filled) > 1:
            text = (
                f"{table} has more rows than a sheet holds ({MOST_ROWS - 1}); it continues on"
                f" {len(filled) - 1} further sheet(s)"
            )
            yield [table, text]
    yield []
    yield ["table", "column", "uom", "type", "meaning"]
    for table in sheets:
        yield from map(_described, repeat(table), SCHEMA_OF[table])


def _described(table: str, field: pa.Field) -> list[object]:
    found = {key.decode(): text.decode() for key, text in (field.metadata or {}).items()}
    return [
        table,
        field.name,
        found.get("uom", ""),
        DATATYPES[field.type],
        found.get("definition") or found.get("command", ""),
    ]
