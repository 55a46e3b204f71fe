"""Compare two records of the same session, except for the times of rows, which follow the drifting
wall clock.

A tick's lateness and its scan's duration are compared. The result states how much was compared:
records without common rows do not differ either.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Final

from jbclog.core.rows import TABLES
from jbclog.record.manifest import read_manifest
from jbclog.record.parts import row_groups
from jbclog.record.schema import SCHEMAS

LEFT_OUT: Final = frozenset({"time", "earliest", "seq", "prev_sha256"})
DERIVED: Final = "alarm.episode."
"""Events derived from samples, which are compared themselves."""
MOST_SHOWN: Final = 3  # in a table of a station: later differences mostly follow from the first

Value = object
Rows = list[tuple[Value, ...]]


@dataclass(frozen=True, slots=True)
class Compared:
    """One table of one station: the rows of both records, and differences in their common part."""

    table: str
    station: str
    first: int
    second: int
    differing: tuple[str, ...]

    @property
    def rows(self) -> int:
        """The number of compared rows."""
        return min(self.first, self.second)


@dataclass(frozen=True, slots=True)
class Comparison:
    """All tables of all stations, and differences of the manifests. `is_cut`: one lacks its end."""

    tables: Sequence[Compared]
    facts: Sequence[str]
    is_cut: bool

    @property
    def differences(self) -> list[str]:
        """Return the differences as sentences; if a record lacks its end, those of the common
        part.
        """
        found: list[str] = []
        for one in self.tables:
            if one.first != one.second and not self.is_cut:
                found.append(
                    f"{one.table}, {one.station}: {one.second} rows instead of {one.first}"
                )
            found += one.differing
        return [*found, *self.facts]

    @property
    def rows(self) -> int:
        """The number of compared rows of all tables."""
        return sum(one.rows for one in self.tables)

    def share(self, table: str) -> tuple[int, int]:
        """Return the compared and the recorded rows of a table in the first record."""
        ones = [one for one in self.tables if one.table == table]
        return sum(one.rows for one in ones), sum(one.first for one in ones)

    @property
    def lacking(self) -> list[str]:
        """Return the tables with fewer rows in the second record, as sentences."""
        short = (one for one in self.tables if one.second < one.first)
        return [
            f"{one.table}, {one.station}: only {one.second} of {one.first} rows could be compared"
            for one in short
        ]


def compare_records(first: Path, second: Path, *, is_cut: bool = False) -> Comparison:
    """Compare the sealed run in `second` with the one in `first`. Raises RecordError.

    `is_cut`: one of them may lack its end; then only the common part of the tables is compared, and
    not the manifests. Events of the run as a whole are ignored: they concern the recorder and its
    host.
    """
    tables = [one for table in TABLES for one in _compared(first, second, table)]
    return Comparison(tables, [] if is_cut else list(_differing_facts(first, second)), is_cut)


def _compared(first: Path, second: Path, table: str) -> Iterator[Compared]:
    ours, theirs = _by_station(first, table), _by_station(second, table)
    for station in sorted(ours.keys() | theirs.keys()):
        mine, others = ours.get(station, []), theirs.get(station, [])
        yield Compared(
            table, station, len(mine), len(others), tuple(_differing(table, station, mine, others))
        )


def _by_station(folder: Path, table: str) -> dict[str, Rows]:
    columns = [name for name in SCHEMAS[table].names if name not in LEFT_OUT]
    place, found = columns.index("station"), dict[str, Rows]()
    kind = columns.index("kind") if "kind" in columns else None
    for group in row_groups(folder, table, columns):
        for row in zip(*(group[name].to_pylist() for name in columns), strict=True):
            is_derived = kind is not None and str(row[kind]).startswith(DERIVED)
            if row[place] is not None and not is_derived:
                found.setdefault(row[place], []).append(row)
    return found


def _differing(table: str, station: str, ours: Rows, theirs: Rows) -> Iterator[str]:
    columns = [name for name in SCHEMAS[table].names if name not in LEFT_OUT]
    pairs = [
        (number, *pair)
        for number, pair in enumerate(zip(ours, theirs, strict=False))
        if pair[0] != pair[1]
    ]
    for number, mine, other in pairs[:MOST_SHOWN]:
        named = (
            f"{name} {b!r} instead of {a!r}"
            for name, a, b in zip(columns, mine, other, strict=True)
            if a != b
        )
        yield f"{table}, {station}, row {number}: {', '.join(named)}"
    if len(pairs) > MOST_SHOWN:
        yield f"{table}, {station}: {len(pairs) - MOST_SHOWN} more rows differ"


def _differing_facts(first: Path, second: Path) -> Iterator[str]:
    ours, theirs = read_manifest(first).stations, read_manifest(second).stations
    for mine, other in zip_longest(ours, theirs):
        if mine is None or other is None:
            yield f"manifest: {len(theirs)} stations instead of {len(ours)}"
            return
        before = asdict(mine)
        for name, value in asdict(other).items():
            if value != before[name]:
                yield f"manifest, {mine.name}: {name} {value!r} instead of {before[name]!r}"
