"""CSV: a file per table (RFC 4180, UTF-8 with a byte order mark), and `csv-metadata.json` with
units and facts.

The metadata follow "Metadata Vocabulary for Tabular Data" (W3C Recommendation, 17 December 2015,
sections 5.3 to 5.6).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, Final

import pyarrow as pa
from pyarrow.csv import WriteOptions, write_csv

from jbclog.app.export.cells import cells
from jbclog.app.export.source import SCHEMA_OF, Source
from jbclog.core.text import BOM

# the name required by "Model for Tabular Data and Metadata on the Web", section 5
ROWS_AT_ONCE: Final = 32_768
METADATA: Final = "csv-metadata.json"
NAMESPACE: Final = "http://www.w3.org/ns/csvw"
DATATYPES: Final[Mapping[pa.DataType, str]] = {
    pa.timestamp("us", tz="UTC"): "dateTimeStamp",
    pa.int64(): "integer",
    pa.float64(): "double",
    pa.bool_(): "boolean",
    pa.utf8(): "string",
}


def write(source: Source, folder: Path) -> dict[str, int]:
    """Write the tables and their metadata into a new folder; return the number of rows of each
    table.

    Raises `OSError`, `RecordError`.
    """
    folder.mkdir()
    rows = {table: _write_table(source, table, folder / f"{table}.csv") for table in source.tables}
    (folder / METADATA).write_text(
        json.dumps(_metadata(source, rows), indent=1, ensure_ascii=False) + "\n", "utf-8"
    )
    return rows


def _write_table(source: Source, table: str, path: Path) -> int:
    rows = 0
    with path.open("xb") as file:
        file.write(BOM.encode())
        _write(SCHEMA_OF[table].empty_table(), file, header=True)
        for piece in source.pieces(table):
            for start in range(0, piece.num_rows, ROWS_AT_ONCE):
                _write(piece.slice(start, ROWS_AT_ONCE), file, header=False)
            rows += piece.num_rows
    return rows


def _write(piece: pa.Table, file: BinaryIO, *, header: bool) -> None:
    """Write rows with the line ends of RFC 4180; no cell contains one."""
    sink = pa.BufferOutputStream()
    write_csv(cells(piece), sink, WriteOptions(include_header=header, quoting_style="needed"))
    file.write(sink.getvalue().to_pybytes().replace(b"\n", b"\r\n"))


def _metadata(source: Source, rows: Mapping[str, int]) -> dict[str, object]:
    tables = [_table(table, rows[table]) for table in source.tables]
    facts = [{"schema:name": name, "schema:value": text} for name, text in source.facts.items()]
    return {
        "@context": NAMESPACE,
        "dc:title": source.title,
        "schema:additionalProperty": facts,
        "tables": tables,
    }


def _table(table: str, rows: int) -> dict[str, object]:
    columns = [_column(field) for field in SCHEMA_OF[table]]
    return {
        "url": f"{table}.csv",
        "schema:numberOfItems": rows,
        "tableSchema": {"columns": columns},
    }


def _column(field: pa.Field) -> dict[str, object]:
    found = {key.decode(): text.decode() for key, text in (field.metadata or {}).items()}
    more = {
        "schema:unitText": found.get("uom"),
        "dc:description": found.get("definition"),
        "dc:source": found.get("command"),
    }
    plain = {
        "name": field.name,
        "titles": field.name,
        "datatype": DATATYPES[field.type],
        "required": not field.nullable,
    }
    return plain | {key: text for key, text in more.items() if text}
