"""Small data files of a plant's store that take much, or hold what no publisher writes: each is put
in the place of one, and the table's log says what it would say of it.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Final
from urllib.parse import unquote

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from support.faults.bombs import lying_footer, other_bytes

Bomb = Callable[[Path], int | None]
"""Put in the place of a data file; the number of its rows, which its log then has."""

WORD: Final = " " * 900_000


def _filled(schema: pa.Schema, rows: int, **columns: pa.Array) -> pa.Table:
    """Rows of a table that are all alike, with these columns in place of theirs."""
    found = {field.name: columns.get(field.name, _alike(field.type, rows)) for field in schema}
    return pa.table(found, pa.schema([pa.field(name, one.type) for name, one in found.items()]))


def _alike(kind: pa.DataType, rows: int) -> pa.Array:
    if pa.types.is_string(kind):
        return pa.repeat("", rows)
    if pa.types.is_nested(kind):
        return pa.nulls(rows, kind)
    return pa.array(np.zeros(rows, np.int64)).cast(kind)


def _rows(rows: int, columns: int | None = None) -> Bomb:
    """So many rows, in the first columns or in all."""

    def made(path: Path) -> int:
        schema = pa.schema([*pq.read_schema(path)][:columns])
        pq.write_table(_filled(schema, rows), path, compression="zstd", row_group_size=rows)
        return rows

    return made


def _column(name: str, values: Callable[[], pa.Array], **how: object) -> Bomb:
    def made(path: Path) -> int:
        column = values()
        table = _filled(pq.read_schema(path), len(column), **{name: column})
        pq.write_table(table, path, compression="zstd", store_schema=False, **how)
        return len(column)

    return made


def _long_list() -> pa.Array:
    return pa.ListArray.from_arrays(
        pa.array([0, 20_000_000], pa.int32()), pa.repeat("", 20_000_000)
    )


def _one_word() -> pa.Array:
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(900, np.int32)), pa.array([WORD]))


def _kept_files(path: Path) -> int:
    """The run as it is, with 180 MB of files."""
    table = pq.ParquetFile(path).read()
    place = table.schema.get_field_index("files")
    files = pa.array(
        [[{"path": "line.toml", "data": WORD.encode()}] * 200], table.schema.field(place).type
    )
    pq.write_table(table.set_column(place, "files", files), path, compression="zstd")
    return 1


def _deep_schema(path: Path) -> None:
    """A footer whose schema is 200 000 groups, each in the one before."""
    group = b"\x48\x01a\x15\x02\x00"  # name, number of children
    count = 200_000
    size = bytes([count & 0x7F | 0x80, count >> 7 & 0x7F | 0x80, count >> 14])
    footer = b"\x15\x04\x19\xfc" + size + group * count + b"\x16\x00\x19\x0c\x00"
    path.write_bytes(b"PAR1" + footer + len(footer).to_bytes(4, "little") + b"PAR1")


OF_RUNS: Final[dict[str, Bomb]] = {
    "many rows": _rows(2_000_000),
    "a long list": _column("units", _long_list),
    "a long word": _column("operator", _one_word),
    "long texts": _column("operator", lambda: pa.array([WORD] * 300), use_dictionary=False),
    "texts that begin alike": _column(
        "operator",
        lambda: pa.array([WORD] * 300),
        use_dictionary=False,
        column_encoding={"operator": "DELTA_BYTE_ARRAY"},
    ),
    "long kept files": _kept_files,
    "a deep schema": lambda path: _deep_schema(path) and None,
    "lying footer": lambda path: lying_footer(path) and None,
    "noise": lambda path: other_bytes(path) and None,
}
OF_DATA: Final[dict[str, Bomb]] = {
    "many rows": _rows(3_000_000, 3),
    "a long word": _column("station", lambda: pa.concat_arrays([_one_word()] * 30)),
    "noise": lambda path: other_bytes(path) and None,
    "a deep schema": lambda path: _deep_schema(path) and None,
}
BOMBS: Final = {("runs", name): bomb for name, bomb in OF_RUNS.items()} | {
    (table, name): bomb for table in ("samples", "metrics") for name, bomb in OF_DATA.items()
}
"""Table and name of each."""


def data_file(store: Path, table: str) -> Path:
    """The one data file of a table of a store with one run."""
    (found,) = (store / table).rglob("part-*.parquet")
    return found


def put(store: Path, table: str, bomb: Bomb) -> Path:
    """Put a bomb in the place of a table's data file."""
    path = data_file(store, table)
    rows = bomb(path)
    told(store, table, **({} if rows is None else {"numRecords": rows}))
    return path


def told(store: Path, table: str, **stats: object) -> None:
    """Change what the log of a table says of its data file."""
    path = data_file(store, table)
    for log in (store / table / "_delta_log").glob("*.json"):
        lines = [json.loads(line) for line in log.read_text().splitlines()]
        for line in lines:
            if unquote(line.get("add", {}).get("path", "")).endswith(path.name):
                known = json.loads(line["add"]["stats"]) | stats
                line["add"] |= {"size": path.stat().st_size, "stats": json.dumps(known)}
        log.write_text("".join(json.dumps(line) + "\n" for line in lines))
