"""Small files that take much: each is put in the place of one that a run has."""

from __future__ import annotations

import gzip
import json
import sqlite3
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from jbclog.record.manifest import DIGEST, END, NAME
from jbclog.record.schema import SCHEMAS
from support.faults import large_stores, wire_bombs

Bomb = Callable[[Path], None]
"""Made in the place of the file at a path, which is there."""

MANY: Final = 40_000_000


def _columns(table: str, rows: int, first: int | None = None) -> dict[str, pa.Array]:
    """The first columns of a table, or all."""
    zeros = np.zeros(rows, dtype=np.int64)
    made = {}
    for field in list(SCHEMAS[table])[:first]:
        text = pa.types.is_string(field.type)
        made[field.name] = (
            pa.array([""]).take(pa.array(zeros)) if text else pa.array(zeros).cast(field.type)
        )
    return made


def many_rows(path: Path) -> None:
    """Rows that take next to nothing in the file and gigabytes in memory, in one group."""
    table = path.parent.name
    pq.write_table(
        pa.table(_columns(table, MANY // 10, 3)), path, row_group_size=MANY, compression="zstd"
    )


def many_groups(path: Path) -> None:
    """The same with all columns, in groups of a plausible size."""
    table = path.parent.name
    rows = 200_000
    one = pa.table(_columns(table, rows), schema=SCHEMAS[table])
    with pq.ParquetWriter(path, SCHEMAS[table], compression="zstd") as writer:
        for _ in range(12):
            writer.write_table(one, row_group_size=rows)
        writer.add_key_value_metadata({"jbclog.through": "1"})


def long_pages(path: Path) -> None:
    """Few rows whose texts are long and pack well: 300 MB of blanks."""
    schema = SCHEMAS[path.parent.name]
    columns = _columns(path.parent.name, 3)
    for field in schema:
        if pa.types.is_string(field.type):
            columns[field.name] = pa.repeat("x", 3)
    columns["station"] = pa.repeat(" " * 100_000_000, 3)
    pq.write_table(
        pa.table(columns, schema),
        path,
        compression="zstd",
        use_dictionary=False,
        # of the long texts the file would have none, and to find that out takes seconds
        write_statistics=[name for name in schema.names if name != "station"],
    )


def long_words(path: Path) -> None:
    """A dictionary with one long word that stands in every row: 200 kB in the file, 20 GB written
    out.
    """
    table = path.parent.name
    rows = 200_000
    columns = _columns(table, rows)
    word = pa.array([" " * 900_000])
    columns["station"] = pa.DictionaryArray.from_arrays(
        pa.array(np.zeros(rows, dtype=np.int32)), word
    )
    schema = pa.schema([pa.field(field.name, columns[field.name].type) for field in SCHEMAS[table]])
    pq.write_table(
        pa.table(columns, schema=schema),
        path,
        compression="zstd",
        row_group_size=rows,
        store_schema=False,
    )


def long_beginnings(path: Path) -> None:
    """Texts of which each is said to begin as the one before it: no dictionary, 100 kB in the file,
    400 MB written out.
    """
    table, rows = path.parent.name, 4_000
    columns = _columns(table, 2)
    columns["station"] = pa.array([" " * 100_000] * 2)
    encodings = dict.fromkeys(columns, "PLAIN") | {"station": "DELTA_BYTE_ARRAY"}
    few = pa.table(columns, schema=SCHEMAS[table])
    with pq.ParquetWriter(
        path, SCHEMAS[table], compression="zstd", use_dictionary=False, column_encoding=encodings
    ) as writer:
        writer.write_table(pa.concat_tables([few] * (rows // 2)), row_group_size=rows)


def lying_footer(path: Path) -> None:
    """A footer that is said to have two gigabytes."""
    path.write_bytes(path.read_bytes()[:-8] + (2**31 - 1).to_bytes(4, "little") + b"PAR1")


def other_bytes(path: Path) -> None:
    """The beginning and the end of a Parquet file, and noise between."""
    path.write_bytes(
        b"PAR1" + np.random.default_rng(1).bytes(100_000) + (90_000).to_bytes(4, "little") + b"PAR1"
    )


def nested_station(path: Path) -> None:
    """A structure in the place of the stations' names."""
    with pq.ParquetFile(path) as file:
        rows, more = file.read(), dict(file.metadata.metadata or {})
    if "station" not in rows.schema.names:
        return
    at = rows.schema.names.index("station")
    station = pa.array([{"a": 1}] * rows.num_rows)
    rows = rows.set_column(at, pa.field("station", station.type, nullable=False), station)
    with pq.ParquetWriter(path, rows.schema) as writer:
        writer.write_table(rows)
        more.pop(b"ARROW:schema", None)
        writer.add_key_value_metadata(more)


PARTS: Final[dict[str, Bomb]] = {
    "nested station": nested_station,
    "many rows": many_rows,
    "many groups": many_groups,
    "long pages": long_pages,
    "long words": long_words,
    "long beginnings": long_beginnings,
    "lying footer": lying_footer,
    "noise": other_bytes,
}


def _told(**changes: object) -> Bomb:
    """A manifest with these values, of which one can be what makes it, and the digest that belongs
    to it.
    """

    def made(path: Path) -> None:
        data = json.loads(path.read_bytes())
        data.pop("digest", None)
        for place, given in changes.items():
            value = given() if callable(given) else given
            *above, last = place.split("__")
            table = data
            for key in above:
                table = table[int(key) if key.isdigit() else key]
            table[last] = value
        plain = json.dumps(data, indent=1) + "\n"
        path.write_text(
            plain.removesuffix(END.decode()) + DIGEST % sha256(plain.encode()).hexdigest()
        )

    return made


def _text(text: str, piece: str = "", times: int = 0, end: str = "") -> Bomb:
    """A text with a piece many times in it, which is made when it is written."""
    return lambda path: path.write_text(text + piece * times + end) and None


NUMBERS: Final[dict[str, object]] = {
    "1e308": 1e308,
    "-1e308": -1e308,
    "infinite": float("inf"),
    "NaN": float("nan"),
    "2**62": 2**62,
    "2**64": 2**64,
    "10**300": 10**300,
    "-1": -1,
    "0": 0,
}
PLACES: Final = (
    *(
        "t0_utc",
        "t0_mono",
        "rate",
        "rules",
        "exit_code",
        "stations__0__period_s",
        "stations__0__last_tick",
        "stations__0__first_tick",
    ),
    *(
        "stations__0__rate_hz",
        "stations__0__baudrate",
        "stations__0__skipped",
        "stations__0__rated_power_w",
        "files__0__rows",
    ),
    *("files__0__bytes", "stations__0__ports", "stations__0__worst_slow_periods"),
)
MANIFESTS: Final[dict[str, Bomb]] = {
    **{
        f"{place} = {name}": _told(**{place: [value] if place.endswith("ports") else value})
        for place in PLACES
        for name, value in NUMBERS.items()
    },
    **{
        f"{place} in {year}": _told(**{place: f"{year}-01-01T00:00:00Z"})
        for place in ("started", "ended")
        for year in ("0001", "9999", "2262")
    },
    "ended = no time": _told(ended="x"),
    "started without a zone": _told(started="2026-11-21T01:30:00"),
    "a station of a million letters": _told(stations__0__name="x" * 1_000_000),
    "a verdict of a million letters": _told(verdict="x" * 1_000_000),
    "an operator of a million letters": _told(metadata__operator="x" * 1_000_000),
    "1000 tags of 1000 letters": _told(
        metadata__tags={f"t{at}": "word " * 200 for at in range(1000)}
    ),
    "900 000 keys": _told(more=lambda: {f"k{at}": 1 for at in range(900_000)}),
    "15 MB of numbers": _text('{"run": "x", "more": [', "1.5,", 3_900_000, "1]}"),
    "15 MB of lists": _text('{"run": "x", "stations": [', "[],", 5_000_000, "[]]}"),
    "15 MB of texts": _text('{"run": "x", "units": [', '"a",', 3_700_000, '"a"]}'),
    "nested": _text("", "[", 2_000_000),
    "20 MB": _text('{"run": "', "x", 20_000_000, '"}'),
    "a list": _text("[]"),
    "a number": _text("1e999"),
    "noise": lambda path: path.write_bytes(np.random.default_rng(1).bytes(100_000)) and None,
}

LINES: Final[dict[str, Bomb]] = {
    "64 MB": lambda path: path.write_bytes(b"x" * (64 << 20)) and None,
    "15 MB of line ends": lambda path: path.write_bytes(b"\n" * (15 << 20)) and None,
    "15 MB of braces": lambda path: path.write_bytes((b"{" * 150 + b"\n") * 90_000) and None,
    "nested": lambda path: path.write_bytes(b'{"a":' * 500_000) and None,
    "odd numbers": (
        lambda path: (
            path.write_text('{"seq": 1e308, "time": NaN, "port": 1' + "0" * 5000 + "}\n") and None
        )
    ),
    "NULs": lambda path: path.write_bytes(b"\0" * 1_000_000) and None,
}


def _database(script: str) -> Bomb:
    def made(path: Path) -> None:
        path.unlink(missing_ok=True)
        for ending in ("-wal", "-shm"):
            path.with_name(path.name + ending).unlink(missing_ok=True)
        with sqlite3.connect(path) as made:
            made.executescript(script)
        made.close()

    return made


_ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
_NOTE = (
    "CREATE TABLE note (kind TEXT NOT NULL, key TEXT NOT NULL, text TEXT NOT NULL, crc INTEGER NOT"
    " NULL, PRIMARY KEY (kind, key));"
)
_BATCH = (
    "CREATE TABLE batch (number INTEGER PRIMARY KEY, name TEXT NOT NULL, rows INTEGER NOT NULL, crc"
    " INTEGER NOT NULL, data BLOB NOT NULL);"
)
STORES: Final[dict[str, Bomb]] = {
    "endless views": _database(
        f"CREATE VIEW batch AS {_ENDLESS} SELECT i AS number, 'samples' AS name, 1 AS rows, 1 AS"
        f" crc, x'00' AS data FROM n;CREATE VIEW note AS {_ENDLESS} SELECT 'meta' AS kind, i AS"
        " key, 'x' AS text, 1 AS crc FROM n;"
    ),
    "one endless view": _database(
        _BATCH
        + f"CREATE VIEW note AS {_ENDLESS} SELECT 'meta' AS kind, i AS key, 'x' AS text, 1 AS crc"
        " FROM n;"
    ),
    "a trigger": _database(
        _BATCH + _NOTE + "CREATE TRIGGER t AFTER DELETE ON batch"
        f" BEGIN INSERT INTO note {_ENDLESS} SELECT 'a', i, 'x', 1 FROM n; END;"
    ),
    "computed columns": _database(
        _NOTE
        + "CREATE TABLE batch (number INTEGER PRIMARY KEY, name TEXT, rows INTEGER, crc INTEGER,"
        " data BLOB AS (zeroblob(900000000)));"
        "INSERT INTO batch (number, name, rows, crc) VALUES (1, 'samples', 1, 1);"
    ),
    "a large blob": _database(
        _BATCH + _NOTE + "INSERT INTO batch VALUES (1, 'samples', 1, 1, zeroblob(300000000));"
    ),
    "large numbers": _database(
        _BATCH
        + _NOTE
        + "INSERT INTO batch VALUES (9223372036854775807, 'samples', 9223372036854775807, 1,"
        " x'00');"
        "INSERT INTO note VALUES ('meta', 'last', '9223372036854775807', 1);"
    ),
    "valid batches of 797 325 rows": lambda path: large_stores.write_store(
        path, large_stores.large_batches(7, 797_325), {}
    ),
    "a gap after each of 1000 batches": lambda path: large_stores.write_store(
        path, large_stores.small_batches(range(1, 2000, 2)), {}
    ),
    "300 MB of notes": lambda path: large_stores.write_store(
        path, (), {("facts", str(number)): " " * 1_000_000 for number in range(300)}
    ),
    "noise": (
        lambda path: (
            path.write_bytes(b"SQLite format 3\0" + np.random.default_rng(1).bytes(500_000))
            and None
        )
    ),
}


def _packed(byte: bytes, times: int) -> Bomb:
    return lambda path: path.write_bytes(gzip.compress(byte * times)) and None


WIRES: Final[dict[str, Bomb]] = {
    "300 MB of blanks, packed": _packed(b" ", 300_000_000),
    "a table of 36 MB of junk, packed": lambda path: large_stores.junk_lines(path, 1_000_000),
    "300 MB of lines, packed": _packed(b"\n", 300_000_000),
    "heads in one another": wire_bombs.heads_in_one_another,
    "beginnings of heads": wire_bombs.beginnings,
    "noise": lambda path: path.write_bytes(np.random.default_rng(1).bytes(100_000)) and None,
}

RECIPES: Final[dict[str, Bomb]] = {
    **LINES,
    "nested lists": _text("joints = ", "[", 30_000, "]" * 30_000),
    "nested tables": _text("joints = ", "{a=", 15_000, "1" + "}" * 15_000),
    "dotted key": _text("a", ".a", 31_999, " = 1"),  # 6 s and gigabytes in `tomllib`
    "huge numbers": _text("[joints]\nmin_depth_c = 1e400\nsettle_s = ", "9", 60_000),
}

BOMBS: Final[dict[str, dict[str, Bomb]]] = {
    NAME: MANIFESTS,
    "annotations.jsonl": LINES,
    "lease.json": LINES,
    "guard.jsonl": LINES,
    "damage.jsonl": LINES,
    "../verifications.jsonl": LINES,
    "report.json": {
        **LINES,
        "a list": _text("[]"),
        "31 MB of numbers": _text('{"more": [', "1.5,", 7_500_000, "1]}"),
        "written": _text('{"manifest_sha256": 1, "written": [1]}'),
    },
    "samples/part-0000.parquet": PARTS,
    "events/part-0000.parquet": PARTS,
    "settings/part-0000.parquet": PARTS,
    "joints.parquet": {
        name: bomb for name, bomb in PARTS.items() if name in ("lying footer", "noise")
    },
    "live.sqlite": STORES,
    "live.lock": LINES,
    "wire/a.tsv.gz": WIRES,
    "recipes/tht.toml": RECIPES,
}
"""File of a run -> what is put in its place, by name."""

_LINE = "CREATE TABLE journal (number INTEGER PRIMARY KEY, line BLOB NOT NULL);"
_REST = (
    "CREATE TABLE attempt (name TEXT PRIMARY KEY, spec BLOB, run TEXT, progress TEXT, result TEXT,"
    " ended REAL);CREATE TABLE event (number INTEGER PRIMARY KEY, attempt TEXT NOT NULL, line TEXT"
    " NOT NULL);"
)


def _journal(lines: str) -> Bomb:
    return _database(f"{_LINE}{_REST}{lines}")


BATCHES: Final[dict[str, Bomb]] = {
    "endless views": _database(
        f"CREATE VIEW journal AS {_ENDLESS} SELECT i AS number, x'7b7d' AS line FROM n;{_REST}"
    ),
    "a trigger": _journal(
        "CREATE TRIGGER t AFTER INSERT ON journal"
        f" BEGIN INSERT INTO event {_ENDLESS} SELECT i, 'a', 'x' FROM n; END;"
    ),
    "computed columns": _database(
        "CREATE TABLE journal (number INTEGER PRIMARY KEY, line BLOB AS (zeroblob(900000000)));"
        f"{_REST}INSERT INTO journal (number) VALUES (1);"
    ),
    "a number for a line": _journal("INSERT INTO journal VALUES (1, 4000000000);"),
    "a large number for a line": _journal("INSERT INTO journal VALUES (1, 9223372036854775807);"),
    "texts, nulls and infinite numbers": _journal(
        "INSERT INTO journal VALUES (1, 'x');INSERT INTO journal VALUES (2, 1e999);"
        "INSERT INTO attempt VALUES (x'00', 1e999, 1, 1e999, 1e999, 'x');"
        "INSERT INTO event VALUES (-9223372036854775808, 'a', 1e999);"
    ),
    "deep JSON": _journal(
        "INSERT INTO journal VALUES (1, CAST(replace(hex(zeroblob(500000)), '0', '[') AS BLOB));"
        "INSERT INTO attempt VALUES ('a-1', NULL, NULL, replace(hex(zeroblob(500000)), '0', '['),"
        " NULL, NULL);"
    ),
    "60 MB of blanks": _journal("INSERT INTO journal VALUES (1, zeroblob(60000000));"),
    "1 000 000 lines": _journal(
        f"INSERT INTO journal {_ENDLESS} SELECT i, x'7b7d' FROM n LIMIT 1000000;"
    ),
    "1 000 000 attempts": _journal(
        f"INSERT INTO attempt (name) {_ENDLESS} SELECT i FROM n LIMIT 1000000;"
    ),
    "numbers of JSON": _journal(
        'INSERT INTO journal VALUES (1, CAST(\'{"seq": 1e308, "time": NaN, "job": \''
        " || '1' || '}' AS BLOB));"
    ),
    "noise": STORES["noise"],
}
"""What is put in the place of a batch's store."""

_ENTRIES = (
    "CREATE TABLE entries (place, kind, run, stamp, data, sum, PRIMARY KEY (place, kind, run))"
    " WITHOUT ROWID;"
)


def _index(script: str) -> Callable[[Path, bytes], None]:
    """An index with this in it; `place` stands for the folder of runs."""
    return lambda path, place: _database(script.replace("place!", f"x'{place.hex()}'"))(path)


INDEXES: Final[dict[str, Callable[[Path, bytes], None]]] = {
    "endless view": _index(
        f"CREATE VIEW entries AS {_ENDLESS} SELECT place! AS place, 'run' AS kind, i AS run, x'00'"
        " AS stamp, x'00' AS data, x'00' AS sum FROM n;"
    ),
    "a trigger": _index(
        f"{_ENTRIES}CREATE TRIGGER t AFTER INSERT ON entries"
        f" BEGIN DELETE FROM entries WHERE run IN ({_ENDLESS} SELECT i FROM n); END;"
    ),
    "a cell of 97 MiB": _index(
        f"{_ENTRIES}INSERT INTO entries VALUES (place!, 'run', x'00', x'00',"
        " zeroblob(97 << 20), x'00');"
    ),
    "4 cells of 80 MB": _index(
        f"{_ENTRIES}INSERT INTO entries {_ENDLESS} SELECT place!, 'run', CAST(i AS BLOB), x'00',"
        " zeroblob(80000000), x'00' FROM n LIMIT 4;"
    ),
    "1 200 000 rows": _index(
        f"{_ENTRIES}INSERT INTO entries {_ENDLESS} SELECT place!, 'run', CAST(i AS BLOB), x'00',"
        " x'00', x'00' FROM n LIMIT 1200000;"
    ),
    "wrong types": _index(
        f"{_ENTRIES}INSERT INTO entries VALUES (place!, 'run', 1e999, NULL, 'x', 1);"
        "INSERT INTO entries VALUES (1e999, 1, 1, 1, 1, 1);"
        "INSERT INTO entries VALUES (place!, x'00', x'00', x'00', x'00', x'00');"
    ),
    "noise": lambda path, _: STORES["noise"](path),
}
"""What is put in the place of the index of runs."""
