"""Rows of the tables in pages of SQLite ("Database File Format", sections 1.5, 1.6 and 2)."""

from __future__ import annotations

import struct
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from jbclog.live.sqlite_pages import DatabasePages, Malformed

INTERIOR, LEAF = 5, 13  # page types of a table
FILE_HEADER: Final = 100  # bytes before the content of page 1
DEEPEST: Final = 20
LONGEST: Final = 96 << 20  # bytes of a row, as in `core/database.py`
MOST_TABLES: Final = 1 << 20  # bytes of the list of tables
MOST_COLUMNS: Final = 32
FIRST, LAST = -(1 << 63), (1 << 63) - 1  # row numbers
WIDTHS: Final = (0, 1, 2, 3, 4, 6, 8)  # bytes of an integer by its serial type

Value = None | int | float | str | bytes


@dataclass(frozen=True, slots=True)
class Row:
    """A row in its page: its number, its length, the first bytes, and the first overflow page (0:
    none).
    """

    number: int
    size: int
    start: bytes
    rest: int

    def values(self, pages: DatabasePages) -> list[Value]:
        """Return all columns. Raises `Malformed`."""
        return _values(self._whole(pages))

    def first_values(self, count: int) -> list[Value]:
        """Return the first columns, which must be within the first page. Raises `Malformed`."""
        found = _values(self.start, count)
        if len(found) < count:
            raise Malformed(f"row {self.number} has {len(found)} columns")
        return found

    def _whole(self, pages: DatabasePages) -> bytes:
        pieces, page, missing = [self.start], self.rest, self.size - len(self.start)
        seen: set[int] = set()
        while missing > 0:
            if page in seen:
                raise Malformed(f"row {self.number} has page {page} twice")
            seen.add(page)
            data = pages.page(page)
            piece = data[4 : min(pages.usable, 4 + missing)]
            pieces.append(piece)
            page, missing = int.from_bytes(data[:4], "big"), missing - len(piece)
        return b"".join(pieces)


def roots(pages: DatabasePages) -> dict[str, int]:
    """Return table name -> first page. Raises `Malformed`."""
    found: dict[str, int] = {}
    for row in rows(pages, 1, most_bytes=MOST_TABLES, most_rows=MOST_TABLES >> 10):
        match row.values(pages):
            case ["table", str(name), _, int(root), *_]:
                found[name] = root
    return found


def rows(
    pages: DatabasePages,
    root: int,
    after: int = 0,
    *,
    most_bytes: int | None = None,
    most_rows: int | None = None,
) -> Iterator[Row]:
    """Yield the rows of the table at `root` with a number above `after`, ascending.

    Raises `Malformed`, also above `most_bytes` (a file of 2 kB can declare gigabytes) or
    `most_rows` (a row may have one byte).
    """
    total = 0
    for count, found in enumerate(_Walk(pages, after).below(root, FIRST, LAST), 1):
        total += found.size
        if most_bytes is not None and total > most_bytes:
            raise Malformed(f"its table at page {root} has more than {most_bytes >> 20} MiB")
        if most_rows is not None and count > most_rows:
            raise Malformed(f"its table at page {root} has more than {most_rows} rows")
        yield found


def row(pages: DatabasePages, root: int, number: int) -> Row | None:
    """Return a row, or None if it does not exist. Raises `Malformed`."""
    page = root
    for _ in range(DEEPEST):
        one = _table_page(pages, page)
        place = bisect_left(one.places, number, key=one.key)
        if one.is_leaf:
            found = (
                None
                if place == len(one.places)
                else _row(one.data, one.places[place], pages.usable)
            )
            return found if found is not None and found.number == number else None
        page = one.child(place)
    raise Malformed(f"page {page} is in its table twice")


@dataclass(frozen=True, slots=True)
class _TablePage:
    """A page of a table: one with rows, or one with the pages below it."""

    data: bytes
    base: int
    is_leaf: bool
    places: tuple[int, ...]

    def key(self, at: int) -> int:
        """Return the number of the row at `at`, or the largest number below the page there."""
        if self.is_leaf:
            _, at = _varint(self.data, at)
            return _varint(self.data, at)[0]
        return _varint(self.data, at + 4)[0]

    def child(self, place: int) -> int:
        """Return a page below this one; behind all places the last one."""
        at = self.places[place] if place < len(self.places) else self.base + 8
        return int.from_bytes(self.data[at : at + 4], "big")


def _table_page(pages: DatabasePages, number: int) -> _TablePage:
    data = pages.page(number)
    base = FILE_HEADER if number == 1 else 0
    kind, cells = data[base], int.from_bytes(data[base + 3 : base + 5], "big")
    if kind not in (INTERIOR, LEAF):
        raise Malformed(f"page {number} is no page of a table")
    places = _places(data, base + (12 if kind == INTERIOR else 8), cells)
    return _TablePage(data, base, kind == LEAF, places)


@dataclass(frozen=True, slots=True)
class _Walk:
    """Yields the rows of a table with a number above `after`: each number above the one before.

    Without this order, a page whose rows are all at one place has thousands of rows, and a search
    for each row reads the whole table.
    """

    pages: DatabasePages
    after: int
    seen: set[int] = field(default_factory=set)

    def below(self, number: int, first: int, last: int, depth: int = 0) -> Iterator[Row]:
        """Yield the rows of a page and of those below it, which must be from `first` to `last`."""
        if number in self.seen or depth > DEEPEST:
            raise Malformed(f"page {number} is in its table twice")
        self.seen.add(number)
        page = _table_page(self.pages, number)
        if page.is_leaf:
            for at in page.places:
                found = _row(page.data, at, self.pages.usable)
                first = _next(number, first, found.number, last)
                if found.number > self.after:
                    yield found
            return
        for place, at in enumerate(page.places):
            key = page.key(at)
            next_first = _next(number, first, key, last)
            if key > self.after:
                yield from self.below(page.child(place), first, key, depth + 1)
            first = next_first
        yield from self.below(page.child(len(page.places)), first, last, depth + 1)


def _next(page: int, first: int, number: int, last: int) -> int:
    """Return the first number that may follow `number`. Raises `Malformed`."""
    if not first <= number <= last:
        raise Malformed(f"page {page} has row {number} out of order")
    return number + 1


def _places(data: bytes, at: int, cells: int) -> tuple[int, ...]:
    if at + 2 * cells > len(data):
        raise Malformed("a page has more rows than fit")
    return struct.unpack_from(f">{cells}H", data, at)


def _row(data: bytes, at: int, usable: int) -> Row:
    size, at = _varint(data, at)
    number, at = _varint(data, at)
    if not 0 <= size <= LONGEST:
        raise Malformed(f"row {number} has {size} bytes")
    here = _bytes_here(size, usable)
    start = data[at : at + here]
    rest = int.from_bytes(data[at + here : at + here + 4], "big") if here < size else 0
    if len(start) < here or (here < size and rest < 2):
        raise Malformed(f"row {number} reaches beyond its page")
    return Row(number, size, start, rest)


def _bytes_here(size: int, usable: int) -> int:
    """Return how many bytes of a row are in the table's own page (section 1.6)."""
    if size <= usable - 35:
        return size
    least = (usable - 12) * 32 // 255 - 23
    here = least + (size - least) % (usable - 4)
    return here if here <= usable - 35 else least


def _values(data: bytes, count: int | None = None) -> list[Value]:
    """Decode a row. `count`: only the first columns (section 2.1)."""
    end, at = _varint(data, 0)
    kinds: list[int] = []
    while at < end and (count is None or len(kinds) < count):
        if len(kinds) == MOST_COLUMNS:
            raise Malformed(f"a row has more than {MOST_COLUMNS} columns")
        kind, at = _varint(data, at)
        if kind < 0:
            raise Malformed(f"a column of kind {kind}")
        kinds.append(kind)
    found, at = list[Value](), end
    for kind in kinds:
        width = (
            WIDTHS[kind]
            if kind < len(WIDTHS)
            else 8
            if kind == 7
            else (kind - 12) // 2
            if kind >= 12
            else 0
        )
        if at + width > len(data):
            raise Malformed("a row is shorter than its header says")
        found.append(_value(kind, data[at : at + width]))
        at += width
    return found


def _value(kind: int, data: bytes) -> Value:
    if kind == 0:
        return None
    if kind < len(WIDTHS):
        return int.from_bytes(data, "big", signed=True)
    if kind == 7:
        return float(struct.unpack(">d", data)[0])
    if kind < 12:
        return kind - 8
    try:
        return data.decode() if kind % 2 else data
    except UnicodeDecodeError as error:
        raise Malformed("a text is not UTF-8") from error


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """Return a varint and the position after it (section 1.6)."""
    number = 0
    for place in range(at, min(at + 8, len(data))):
        number = number << 7 | data[place] & 0x7F
        if data[place] < 0x80:
            return number, place + 1
    if at + 8 >= len(data):
        raise Malformed("a number reaches beyond its page")
    number = number << 8 | data[at + 8]
    return number - (1 << 64 if number >> 63 else 0), at + 9
