"""Compares what two versions of jbclog made of the same histories, and says of each history where
they differ first: table, station, row, column.

    python -m support.histories.compare ORACLE CHECKOUT NUMBER ...

`differences.toml` lists what is meant to differ since the oracle; with all histories an entry that
nothing needs any more is an error. Ends with 1 at any difference.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import Any

from support.histories.drawn import COUNT, history

MEANT = Path(__file__).with_name("differences.toml")
EVERY = "*"
ABSENT = "absent"
Row = dict[str, Any]
Table = tuple[str, str]
"""Table and station."""


@dataclass
class Entry:
    """A difference that is meant: `rows` are those whose columns have these values."""

    table: str
    reason: str
    history: int | str = EVERY
    column: str = EVERY
    rows: Row = field(default_factory=dict)
    is_needed: bool = False

    def covers(self, number: int, table: str, column: str, *rows: Row | None) -> bool:
        """Whether this difference is meant by it."""
        return (
            self.history in (EVERY, number)
            and self.table == table
            and self.column in (EVERY, column)
            and any(self.has(row) for row in rows if row is not None)
        )

    def has(self, row: Row) -> bool:
        return all(row.get(column) == value for column, value in self.rows.items())


@dataclass
class Side:
    """One file: columns by table, and rows by table and station."""

    columns: dict[str, list[str]] = field(default_factory=dict)
    rows: dict[Table, list[Row]] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> Side:
        side = cls()
        with path.open(encoding="utf-8") as file:
            for line in map(json.loads, file):
                if "is" in line:
                    side.rows.setdefault((line["table"], line["station"]), []).append(line["is"])
                else:
                    side.columns[line["table"]] = line.get("columns", [line.get("raised")])
        return side


def differences(number: int, oracle: Side, checkout: Side, meant: list[Entry]) -> Iterator[str]:
    """Yield the first difference of each table."""
    for table in sorted({*oracle.columns, *checkout.columns}):
        sides = [set(side.columns.get(table, [])) for side in (oracle, checkout)]
        for column in sorted(sides[0] ^ sides[1]):
            if not _is_meant(meant, number, table, column, {}):
                which = "oracle" if column in sides[0] else "checkout"
                yield f"{table}: column {column} only in the {which}"
    for table, station in sorted({*oracle.rows, *checkout.rows}):
        here = [entry for entry in meant if entry.table == table]
        pairs = _paired(
            number,
            oracle.rows.get((table, station), []),
            checkout.rows.get((table, station), []),
            here,
        )
        for row, (old, new) in enumerate(pairs):
            text = _first(number, table, old, new, here)
            if text:
                yield f"{table} of {station or 'the run'}, row {row}: {text}"
                break


def _paired(
    number: int, oracle: list[Row], checkout: list[Row], meant: list[Entry]
) -> Iterator[tuple[Row | None, Row | None]]:
    """Pair the rows; leave out those that only one version has and may have."""
    whole = [
        entry
        for entry in meant
        if entry.column == EVERY and entry.rows and entry.history in (EVERY, number)
    ]

    def rest(rows: list[Row]) -> list[Row]:
        kept = []
        for row in rows:
            covering = [entry for entry in whole if entry.has(row)]
            if not covering:
                kept.append(row)
        return kept

    if rest(oracle) != oracle or rest(checkout) != checkout:
        for entry in whole:
            mine = [[row for row in rows if entry.has(row)] for rows in (oracle, checkout)]
            entry.is_needed = entry.is_needed or mine[0] != mine[1]
    return zip_longest(rest(oracle), rest(checkout))


def _first(number: int, table: str, old: Row | None, new: Row | None, meant: list[Entry]) -> str:
    """Say in which column two rows differ first; nothing if they do not."""
    if old is None or new is None:
        if _is_meant(meant, number, table, EVERY, old, new):
            return ""
        which, row = ("checkout", new) if old is None else ("oracle", old)
        return f"only in the {which}: {json.dumps(row, ensure_ascii=False)}"
    for column in dict.fromkeys([*old, *new]):
        values = [side.get(column, ABSENT) for side in (old, new)]
        if values[0] != values[1] and not _is_meant(meant, number, table, column, old, new):
            row = json.dumps(old, ensure_ascii=False)
            return f"{column} was {values[0]!r}, is {values[1]!r}\n      in {row}"
    return ""


def _is_meant(meant: list[Entry], number: int, table: str, column: str, *rows: Row | None) -> bool:
    for entry in meant:
        if entry.covers(number, table, column, *rows):
            entry.is_needed = True
            return True
    return False


def differing(oracle: Path, checkout: Path, numbers: Sequence[int]) -> dict[int, str]:
    """Say by history where two folders of files differ first; an empty text where they do not."""
    listed = tomllib.loads(MEANT.read_text(encoding="utf-8")).get("difference", [])
    meant = [Entry(**entry) for entry in listed]
    texts = {}
    for number in numbers:
        paths = [folder / f"{number:03d}.jsonl" for folder in (oracle, checkout)]
        first: list[str] = []
        if paths[0].read_bytes() != paths[1].read_bytes():
            first = [*differences(number, *map(Side.read, paths), meant)]
        head = f"history {history(number).name}"
        texts[number] = "\n   ".join([head, *first]) if first else ""
    unneeded = [entry for entry in meant if not entry.is_needed]
    if unneeded and len(numbers) == COUNT:
        names = "\n   ".join(f"{entry.table}: {entry.reason}" for entry in unneeded)
        texts[COUNT] = f"{MEANT.name}: nothing differs any more by:\n   {names}"
    return texts


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("oracle", type=Path)
    words.add_argument("checkout", type=Path)
    words.add_argument("numbers", type=int, nargs="+")
    given = words.parse_args()
    texts = differing(given.oracle, given.checkout, given.numbers)
    differ = [text for text in texts.values() if text]
    print(*differ, sep="\n")
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
