"""ASAM MDF 4.10: a channel group for each port with its samples, one with its joints, and one for
each other table.

The master of a group is its time in seconds since the start of the file, which has a time in UTC.
An unknown value has its invalidation bit set (MDF 4.1, "Invalidation bits"); a reader that ignores
these bits finds NaN or `-`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import escape, quoteattr

import numpy as np
import pyarrow as pa
from asammdf import MDF, Signal
from numpy.typing import NDArray

from jbclog.analysis.clock_steps import steps_in
from jbclog.analysis.joints.port_rows import Clock
from jbclog.app.export.source import SCHEMA_OF, Source
from jbclog.core.errors import RecordError
from jbclog.core.rows import SIGNAL_OF_COLUMN, PortKey, StationFacts
from jbclog.core.text import clean
from jbclog.record.clock_steps import COLUMNS as STEP_COLUMNS
from jbclog.record.samples_by_port import split_by_port

VERSION: Final = "4.10"
HELD_ROWS: Final = 300_000  # rows of samples in memory, until each port's are written in one block
TRANSPOSED_AND_DEFLATED: Final = 2
MICROS: Final = "µs since 1970-01-01 UTC"
NO_TEXT: Final = "-"  # stands for null; readers take an empty text for none, and show a number
UTC_NAMES: Final = {"time": "time_utc"}  # `time` is the master
MASTER: Final = {"alarms": "start"}
"""Column with the time of a row; `time` in other tables."""

MOST_CHOICES: Final = 16_384  # a conversion of MDF has at most 65 535

Values = NDArray[Any]
Bits = NDArray[np.bool_]


class Choices:
    """Recurring texts, as their numbers from 1 and a table of the texts; 0: null."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._numbers: dict[str | None, int] = {None: 0}

    def values(self, column: pa.ChunkedArray) -> Values:
        coded = column.combine_chunks().dictionary_encode()
        self._expect_few(len(coded.dictionary))
        numbers = [
            self._numbers.setdefault(text and clean(text), len(self._numbers))
            for text in coded.dictionary.to_pylist()
        ]
        self._expect_few(len(self._numbers))
        places = coded.indices.cast(pa.int64()).fill_null(len(numbers)).to_numpy()
        found: Values = np.array([*numbers, 0], dtype=np.uint32)[places]
        return found

    def _expect_few(self, texts: int) -> None:
        if texts > MOST_CHOICES:
            raise RecordError(
                f"{self._name} has more than {MOST_CHOICES} different texts; MDF has no space for"
                " them, `--to csv` has"
            )

    def conversion(self) -> Mapping[str, object]:
        texts = [(text or NO_TEXT).encode() for text in self._numbers]
        texts += [NO_TEXT.encode()] * (2 - len(texts))  # mdfreader cannot read a table of one
        return {
            "default": NO_TEXT.encode(),
            **{f"val_{n}": n for n in range(len(texts))},
            **{f"text_{n}": text for n, text in enumerate(texts)},
        }


def _numbers(field: pa.Field, column: pa.ChunkedArray) -> Values:
    """Return numbers, flags as 0 and 1, times as microseconds. A null is NaN, for readers that
    ignore invalidation bits.
    """
    is_float = pa.types.is_floating(field.type)
    plain = column if is_float else column.cast(pa.int64())
    numbers = plain.cast(pa.float64() if is_float or field.nullable else pa.int64())
    filled: Values = (numbers.fill_null(np.nan) if numbers.null_count else numbers).to_numpy()
    return np.ascontiguousarray(filled)


def _texts(column: pa.ChunkedArray) -> Values:
    """Return texts in UTF-8."""
    texts = [clean(text or "").encode() for text in column.to_pylist()]
    return np.array(texts or [b""], dtype=bytes)[: len(column)]


class Group:
    """A channel group being written. `recur`: its texts recur, else each is different."""

    def __init__(self, name: str, comment: str, fields: Sequence[pa.Field], *, recur: bool) -> None:
        self._name = clean(name)
        self._comment = clean(comment)
        self._fields = fields
        self._choices = {
            field.name: Choices(field.name)
            for field in fields
            if recur and pa.types.is_string(field.type)
        }
        self._number: int | None = None  # once it has rows

    def add(self, file: MDF, seconds: Values, rows: pa.Table) -> None:
        """Append rows."""
        pairs = [(self._values(rows, field), _bits(rows, field)) for field in self._fields]
        if self._number is not None:
            file.extend(self._number, [(seconds, None), *pairs])
            return
        signals = [
            _signal(field, seconds, *pair) for field, pair in zip(self._fields, pairs, strict=True)
        ]
        self._number = file.append(
            signals, acq_name=self._name, comment=self._comment, common_timebase=True
        )

    def _values(self, rows: pa.Table, field: pa.Field) -> Values:
        column = rows[field.name]
        if field.name in self._choices:
            return self._choices[field.name].values(column)
        return _texts(column) if pa.types.is_string(field.type) else _numbers(field, column)

    def finish(self, file: MDF) -> None:
        """Add the table of all texts to the channels of recurring texts."""
        if self._number is None:
            return
        for place, field in enumerate(self._fields, 1):  # 0 is the master
            if field.name in self._choices:
                table = dict(self._choices[field.name].conversion())
                signal = Signal(np.zeros(1), np.zeros(1), name="x", conversion=table)
                file.groups[self._number].channels[place].conversion = signal.conversion


def write(source: Source, path: Path) -> dict[str, int]:
    """Write an MDF file; return the number of rows of each table. Raises `OSError`,
    `RecordError`.
    """
    file = MDF(version=VERSION, temporary_folder=str(path.parent))
    try:
        t0_us = source.run.manifest.t0_utc_us
        file.header.start_time = datetime.fromtimestamp(t0_us / 1e6, UTC)
        file.header.comment = _comment(source)
        rows = {table: _write_table(file, source, table, t0_us) for table in source.tables}
        saved = file.save(path, overwrite=True, compression=TRANSPOSED_AND_DEFLATED)
    finally:
        file.close()
    saved.replace(path)  # asammdf sets its own suffix
    return rows


def _write_table(file: MDF, source: Source, table: str, t0_us: int) -> int:
    if table == "samples":
        return _write_samples(file, source, t0_us)
    if table == "joints":
        return _write_joints(file, source)
    group = Group(table, f"{table} of {source.run.name}", SCHEMA_OF[table], recur=False)
    rows, master = 0, MASTER.get(table, "time")
    for piece in source.pieces(table):
        ordered = piece.sort_by(master)
        micros = ordered[master].cast(pa.int64()).to_numpy()
        group.add(file, (micros - t0_us) / 1e6, ordered)
        rows += piece.num_rows
    return rows


def _write_joints(file: MDF, source: Source) -> int:
    """Write a group for each port; the joints of a port have one time axis."""
    for (station, port), rows in split_by_port(source.joints).items():
        name = f"{station} port {port} joints"
        group = Group(name, "joints", SCHEMA_OF["joints"], recur=False)
        group.add(file, rows["start_s"].to_numpy(), rows)
    return int(source.joints.num_rows)


def _write_samples(file: MDF, source: Source, t0_us: int) -> int:
    """Write a group for each port, many rows at a time."""
    stations = {facts.name: facts for facts in source.run.stations}
    needs_steps = any(not facts.period_s for facts in stations.values())
    steps = steps_in(source.run.groups("events", STEP_COLUMNS)) if needs_steps else []
    groups: dict[PortKey, tuple[Group, Clock]] = {}
    held: dict[PortKey, list[pa.Table]] = {}

    def write_held() -> None:
        for key, pieces in held.items():
            if key not in groups:
                facts = stations.get(key[0])
                clock = Clock(None if facts is None else facts.period_s, steps, t0_us)
                groups[key] = _group_of(key, facts), clock
            group, clock = groups[key]
            rows = pa.concat_tables(pieces)
            ticks = rows["tick"].to_numpy().astype(np.float64)
            micros = rows["time"].cast(pa.int64()).to_numpy()
            group.add(file, clock.seconds(ticks, micros), rows)
        held.clear()

    count = unwritten = 0
    for piece in source.pieces("samples"):
        for key, rows in split_by_port(piece).items():
            held.setdefault(key, []).append(rows)
        count += piece.num_rows
        unwritten += piece.num_rows
        if unwritten >= HELD_ROWS:
            write_held()
            unwritten = 0
    write_held()
    for group, _ in groups.values():
        group.finish(file)
    return count


def _group_of(key: PortKey, facts: StationFacts | None) -> Group:
    station, port = key
    about = ""
    if facts is not None:
        about = f"{facts.model or facts.family}, tool {facts.tool_names.get(port, 'not known')}"
    return Group(f"{station} port {port}", about, _fields_of(facts), recur=True)


def _fields_of(facts: StationFacts | None) -> list[pa.Field]:
    """Return the columns that a station's family can fill, or all if the family is not known. The
    name of the group has station and port.
    """
    fields = [field for field in SCHEMA_OF["samples"] if field.name not in ("station", "port")]
    if facts is None or not facts.signals:
        return fields
    return [
        one for one in fields if SIGNAL_OF_COLUMN.get(one.name, facts.signals[0]) in facts.signals
    ]


def _bits(rows: pa.Table, field: pa.Field) -> Bits | None:
    """Return the invalidation bits of a column that can have nulls: set where it is null."""
    return rows[field.name].is_null().to_numpy() if field.nullable else None


def _signal(field: pa.Field, seconds: Values, values: Values, bits: Bits | None) -> Signal:
    found = {key.decode(): text.decode() for key, text in (field.metadata or {}).items()}
    unit = MICROS if pa.types.is_timestamp(field.type) else found.get("uom", "")
    comment = found.get("definition") or found.get("command", "")
    encoding = "utf-8" if values.dtype.kind == "S" else None
    name = UTC_NAMES.get(field.name, field.name)
    return Signal(
        values, seconds, unit, name, comment=comment, encoding=encoding, invalidation_bits=bits
    )


def _comment(source: Source) -> str:
    """Return the header's comment in XML, a property for each fact (MDF 4.1, "HDcomment")."""
    facts = "".join(
        f"<e name={quoteattr(name)}>{escape(text)}</e>" for name, text in source.facts.items()
    )
    title = f"<TX>{escape(source.title)}</TX>"
    return f"<HDcomment>{title}<common_properties>{facts}</common_properties></HDcomment>"
