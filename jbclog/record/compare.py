"""Two records of the same happenings held against each other: everything but the moments at which rows were written.

Times of rows follow the wall clock, which drifts; how late a tick was and how long its scan took do not, and are compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from itertools import zip_longest
from pathlib import Path
from typing import Final

from jbclog.record.manifest import read_manifest
from jbclog.record.parts import row_groups
from jbclog.record.schema import SCHEMAS, TABLES

LEFT_OUT: Final = frozenset({"time", "earliest", "seq", "prev_sha256"})
MOST_TOLD: Final = 3  # for one table of one station: what follows the first differences mostly follows from them

Value = object
Rows = list[tuple[Value, ...]]


def differences(first: Path, second: Path, *, prefix: bool = False) -> list[str]:
    """What the sealed run in `second` has other than the one in `first`, as sentences; none where they say the same.

    With `prefix` one of them may have been cut off: tables are compared as far as both go. Events of the run as a whole
    are left out: they belong to the recorder and its host. Raises `RecordError`.
    """
    found: list[str] = []
    for table in TABLES:
        ours, theirs = _by_station(first, table), _by_station(second, table)
        for station in sorted(ours.keys() | theirs.keys()):
            found += _differing(table, station, ours.get(station, []), theirs.get(station, []), prefix)
    return found if prefix else [*found, *_differing_facts(first, second)]


def _by_station(folder: Path, table: str) -> dict[str, Rows]:
    """The rows of each station in their order."""
    columns = [name for name in SCHEMAS[table].names if name not in LEFT_OUT]
    place, found = columns.index("station"), dict[str, Rows]()
    for group in row_groups(folder, table, columns):
        for row in zip(*(group[name].to_pylist() for name in columns), strict=True):
            if row[place] is not None:
                found.setdefault(row[place], []).append(row)
    return found


def _differing(table: str, station: str, ours: Rows, theirs: Rows, prefix: bool) -> Iterator[str]:
    columns = [name for name in SCHEMAS[table].names if name not in LEFT_OUT]
    if len(ours) != len(theirs) and not prefix:
        yield f"{table}, {station}: {len(theirs)} rows instead of {len(ours)}"
    pairs = [(number, *pair) for number, pair in enumerate(zip(ours, theirs, strict=False)) if pair[0] != pair[1]]
    for number, mine, other in pairs[:MOST_TOLD]:
        named = (f"{name} {b!r} instead of {a!r}" for name, a, b in zip(columns, mine, other, strict=True) if a != b)
        yield f"{table}, {station}, row {number}: {', '.join(named)}"
    if len(pairs) > MOST_TOLD:
        yield f"{table}, {station}: {len(pairs) - MOST_TOLD} more rows differ"


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
