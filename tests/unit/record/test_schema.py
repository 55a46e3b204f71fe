"""The schema agrees with the rows that the session makes, with the commands, and with what pandas
makes of it.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbclog.core.rows import (
    SAMPLE_COLUMNS,
    SIGNAL_COLUMNS,
    SIGNAL_OF_COLUMN,
    TABLES,
    CounterRow,
    EventRow,
    SettingRow,
)
from jbclog.protocol.commands.family import FAMILIES
from jbclog.record.schema import FLAG, INT, SCHEMAS, TEXT, TIME

CONTRACT = (
    "run, seq, time, earliest, station, port, kind, severity, code, text, value, limit_value, raw,"
    " prev_sha256"
)
CONTRACT_EVENTS = CONTRACT.split(", ")
FLAG_COLUMNS = [
    "cooling",
    "desoldering",
    "alarm_high",
    "alarm_low",
    "feeding",
    "solder_shortage",
    "clogged",
    "preparing",
    "in_range",
]
TEXT_COLUMNS = ["run", "station", "quality", "reasons", "status", "motor"]


def test_columns_are_those_of_the_rows() -> None:
    for table, made in (
        ("samples", SAMPLE_COLUMNS),
        ("settings", SettingRow._fields),
        ("counters", CounterRow._fields),
    ):
        assert SCHEMAS[table].names == ["run", "seq", *made]
    assert SCHEMAS["events"].names == CONTRACT_EVENTS
    assert set(EventRow._fields) == set(CONTRACT_EVENTS) - {"run", "seq", "prev_sha256"}


def test_types_are_those_that_the_rows_promise() -> None:
    for field in SCHEMAS["samples"]:
        expected = (
            FLAG if field.name in FLAG_COLUMNS else TEXT if field.name in TEXT_COLUMNS else INT
        )
        assert field.type == (TIME if field.name == "time" else expected), field.name


def test_every_signal_is_named_by_its_first_column() -> None:
    for family in FAMILIES.values():
        for signal in family.signals:
            assert {SIGNAL_OF_COLUMN[column] for column in signal.columns} == {signal.name}
    assert tuple(SIGNAL_OF_COLUMN) == SIGNAL_COLUMNS


def test_units_and_commands_stand_in_the_fields() -> None:
    """The unit of a column is the unit of the command that fills it."""
    schema = SCHEMAS["samples"]
    for family in FAMILIES.values():
        for signal in family.signals:
            command, metadata = (
                family.commands[signal.command],
                schema.field(signal.columns[0]).metadata,
            )
            assert command.letters in metadata[b"command"].decode().replace("R-", "")
            if command.unit:  # a share of what the station says is its most is told in per mille
                assert metadata[b"uom"].decode() == ("‰" if command.share_of else command.unit)
    assert schema.field("late_us").metadata[b"uom"].decode() == "µs"


@pytest.mark.parametrize("table", TABLES)
def test_pandas_makes_types_that_know_missing_values(tmp_path: Path, table: str) -> None:
    schema = SCHEMAS[table]
    values = {TIME: 0, INT: 2**53 + 1, FLAG: True, TEXT: "x", pa.float64(): 0.5}
    columns = [
        [values[field.type], None if field.nullable else values[field.type]] for field in schema
    ]
    rows = pa.table(columns, schema=schema)
    pq.write_table(rows, tmp_path / "part-0000.parquet")
    pq.write_table(schema.empty_table(), tmp_path / "part-0001.parquet")
    frame = pd.read_parquet(tmp_path)
    for field in schema:
        whole = "Int64" if field.nullable else "int64"
        expected = {
            TIME: "datetime64[us, UTC]",
            INT: whole,
            FLAG: "boolean",
            TEXT: "str",
            pa.float64(): "float64",
        }
        assert str(frame.dtypes[field.name]) == expected[field.type], field.name
        if field.type == INT:
            assert frame[field.name][0] == 2**53 + 1  # not through a float
