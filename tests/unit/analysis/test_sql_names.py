"""Every column of every table of a run, stored or derived, is selected, filtered and ordered by
without quotes, in DuckDB and in PostgreSQL, whose own grammar parses the questions here.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Final

import pyarrow as pa
import pytest

from support.lazy import duckdb, pglast
from support.product import DERIVED_SCHEMAS, STORED_SCHEMAS

EVERY_TABLE: Final[Mapping[str, pa.Schema]] = {**STORED_SCHEMAS, **DERIVED_SCHEMAS}
"""Name -> schema of every table that a run's folder can have."""
COLUMNS: Final = [(table, name) for table, schema in EVERY_TABLE.items() for name in schema.names]

every_column = pytest.mark.parametrize(("table", "column"), COLUMNS)


def question(table: str, column: str) -> str:
    return (
        f"SELECT {column}, count(*) FROM {table} WHERE {column} IS NOT NULL"
        f" GROUP BY {column} ORDER BY {column}"
    )


@every_column
def test_duckdb_takes_it(table: str, column: str) -> None:
    with duckdb.connect() as connection:
        connection.register(table, EVERY_TABLE[table].empty_table())
        assert connection.execute(question(table, column)).fetchall() == []


@every_column
def test_postgresql_takes_it_as_a_column(table: str, column: str) -> None:
    statement = json.loads(pglast.parser.parse_sql_json(question(table, column)))["stmts"][0]
    select = statement["stmt"]["SelectStmt"]
    as_column = [{"String": {"sval": column}}]
    assert select["targetList"][0]["ResTarget"]["val"]["ColumnRef"]["fields"] == as_column
    assert select["whereClause"]["NullTest"]["arg"]["ColumnRef"]["fields"] == as_column
    assert select["groupClause"][0]["ColumnRef"]["fields"] == as_column
    assert select["sortClause"][0]["SortBy"]["node"]["ColumnRef"]["fields"] == as_column


@pytest.mark.parametrize("column", ["limit", "end"])
def test_a_keyword_would_be_found(column: str) -> None:
    with pytest.raises(pglast.parser.ParseError):
        pglast.parser.parse_sql_json(question("events", column))
    with duckdb.connect() as connection, pytest.raises(duckdb.ParserException):
        connection.execute(question("events", column))
