"""Parquet parts that are forged in their page headers or their footer: a genuine part is taken to
pieces, changed and put together again, so that all else in it is right (offsets, lengths, check
sums, keys, and what its run's manifest says of the file).
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from jbclog.analysis.store.parquet_footer import (
    BINARY,
    BYTE,
    DOUBLE,
    I16,
    I32,
    I64,
    LIST,
    NO,
    SET,
    STRUCT,
    YES,
)
from jbclog.record.manifest import DIGEST, END, NAME
from jbclog.record.parts import THROUGH
from jbclog.record.schema import SCHEMAS

# -- Thrift's compact protocol ---------------------------------------------------------------------

Fields = list[tuple[int, int, Any]]
"""The fields of a struct in their order: number, type, value (bytes; a whole number; a list's type
and items; fields).
"""


def decoded(data: bytes, at: int = 0) -> tuple[Fields, int]:
    """A struct, and where it ends."""
    fields: Fields = []
    number = 0
    while head := data[at]:
        at += 1
        if head >> 4:
            number += head >> 4
        else:
            number, at = _signed(data, at)
        value, at = _value(data, at, head & 15)
        fields.append((number, head & 15, value))
    return fields, at + 1


def _value(data: bytes, at: int, kind: int) -> tuple[Any, int]:
    if kind in (YES, NO):
        return None, at
    if kind in (I16, I32, I64):
        return _signed(data, at)
    if kind == BINARY:
        length, at = _unsigned(data, at)
        return data[at : at + length], at + length
    if kind in (BYTE, DOUBLE):
        end = at + (1 if kind == BYTE else 8)
        return data[at:end], end
    if kind in (LIST, SET):
        return _items(data, at)
    assert kind == STRUCT
    return decoded(data, at)


def _items(data: bytes, at: int) -> tuple[tuple[int, list[Any]], int]:
    kind, count = data[at] & 15, data[at] >> 4
    at += 1
    if count == 15:
        count, at = _unsigned(data, at)
    found = []
    for _ in range(count):
        one, at = _value(data, at, BYTE if kind in (YES, NO) else kind)
        found.append(one)
    return (kind, found), at


def _unsigned(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        value |= (data[at] & 0x7F) << shift
        shift, at = shift + 7, at + 1
        if not data[at - 1] & 0x80:
            return value, at


def _signed(data: bytes, at: int) -> tuple[int, int]:
    value, at = _unsigned(data, at)
    return (value >> 1) ^ -(value & 1), at


def encoded(fields: Fields) -> bytes:
    out, before = b"", 0
    for number, kind, value in fields:
        step = number - before
        out += bytes([step << 4 | kind]) if 0 < step < 16 else bytes([kind]) + _written(number)
        out += _encoded(kind, value)
        before = number
    return out + b"\0"


def _encoded(kind: int, value: Any) -> bytes:
    if kind in (YES, NO):
        return b""
    if kind in (I16, I32, I64):
        return _written(value)
    if kind == BINARY:
        return _varint(len(value)) + bytes(value)
    if kind in (LIST, SET):
        inner, items = value
        count = len(items)
        head = bytes([count << 4 | inner]) if count < 15 else bytes([0xF0 | inner]) + _varint(count)
        inner = BYTE if inner in (YES, NO) else inner
        return head + b"".join(_encoded(inner, one) for one in items)
    return encoded(value) if kind == STRUCT else bytes(value)


def _varint(value: int) -> bytes:
    out = b""
    while value > 0x7F:
        out, value = out + bytes([value & 0x7F | 0x80]), value >> 7
    return out + bytes([value])


def _written(value: int) -> bytes:
    return _varint(2 * value if value >= 0 else -2 * value - 1)


def of(fields: Fields, number: int) -> Any:
    """The value of a field, None without it."""
    return next((value for found, _, value in fields if found == number), None)


def put(fields: Fields, number: int, value: Any, kind: int = I32) -> None:
    """Set a field in its place, or as the last one. None removes it."""
    for place, (found, known, _) in enumerate(fields):
        if found == number:
            fields[place : place + 1] = [] if value is None else [(number, known, value)]
            return
    if value is not None:
        fields.append((number, kind, value))


# -- a part and its pages --------------------------------------------------------------------------

# fields of FileMetaData, RowGroup, ColumnChunk, ColumnMetaData and PageHeader
SCHEMA, ALL_ROWS, GROUPS = 2, 3, 4
CHUNKS, ROWS = 1, 3
ABOUT, INDEXES = 3, (4, 5, 6, 7)
CHUNK_KIND, PATH, VALUES, PACKED, DATA_AT, DICTIONARY_AT = 1, 3, 5, 7, 9, 11
OF_NUMBERS, OF_TEXTS = 2, 6  # physical types: INT64 and BYTE_ARRAY
TYPE, PAGE_UNPACKED, PAGE_PACKED, CRC, OF_DATA, OF_DICTIONARY, OF_DATA_2 = 1, 2, 3, 4, 5, 7, 8
DICTIONARY: Final = 2  # a type of pages
PAGE_VALUES, PAGE_ENCODING, PAGE_STATISTICS = 1, 2, 5
PLAIN: Final = 0
REPEATED: Final = 2
ELEMENT_REPEATS, ELEMENT_NAME, ELEMENT_CHILDREN = 3, 4, 5
MOST: Final = 2**31 - 1


@dataclass
class Page:
    """A page: its header's fields, and its bytes as they are stored."""

    head: Fields
    body: bytes

    @property
    def is_dictionary(self) -> bool:
        return bool(of(self.head, TYPE) == DICTIONARY)

    @property
    def about(self) -> Fields:
        """The fields of the header for its type."""
        found = of(self.head, OF_DICTIONARY if self.is_dictionary else OF_DATA)
        assert isinstance(found, list)
        return found

    def copy(self, body: bytes | None = None) -> Page:
        """A copy of its own, with another body."""
        page = Page(decoded(encoded(self.head))[0], self.body if body is None else body)
        put(page.head, PAGE_PACKED, len(page.body))
        crc = zlib.crc32(page.body)
        put(page.head, CRC, crc - 2**32 if crc >> 31 else crc)
        return page


Pages = Callable[[str, list[Page]], list[Page]]
"""The pages of the column of that name, changed."""


def same(_: str, pages: list[Page]) -> list[Page]:
    return pages


def forge(
    path: Path, pages: Pages = same, footer: Callable[[Fields], None] = lambda _: None
) -> None:
    """Change the pages of each column, then the footer; the run's manifest says what stands there
    now.
    """
    data = path.read_bytes()
    length = int.from_bytes(data[-8:-4], "little")
    told, _ = decoded(data[-8 - length : -8])
    out = bytearray(b"PAR1")
    for group in of(told, GROUPS)[1]:
        for chunk in of(group, CHUNKS)[1]:
            _put_chunk(out, data, chunk, pages)
    footer(told)
    foot = encoded(told)
    path.write_bytes(out + foot + len(foot).to_bytes(4, "little") + b"PAR1")
    relist(path, of(told, ALL_ROWS))


def _put_chunk(out: bytearray, data: bytes, chunk: Fields, change: Pages) -> None:
    about = of(chunk, ABOUT)
    begin = min(at for at in (of(about, DATA_AT), of(about, DICTIONARY_AT)) if at)
    name = b".".join(of(about, PATH)[1]).decode()
    at, data_at, dictionary_at = len(out), None, None
    written: dict[int, bytes] = {}  # a page can be there a thousand times
    for page in change(name, [*_pages(data, begin, begin + of(about, PACKED))]):
        if page.is_dictionary:
            dictionary_at = len(out) if dictionary_at is None else dictionary_at
        else:
            data_at = len(out) if data_at is None else data_at
        if id(page) not in written:
            written[id(page)] = encoded(page.head) + page.body
        out += written[id(page)]
    put(about, DATA_AT, at if data_at is None else data_at)
    put(about, DICTIONARY_AT, dictionary_at, I64)
    put(about, PACKED, len(out) - at)
    about.sort(key=lambda field: field[0])
    for number in INDEXES:
        put(chunk, number, None)


def _pages(data: bytes, at: int, end: int) -> Iterator[Page]:
    while at < end:
        head, at = decoded(data, at)
        body = data[at : at + of(head, PAGE_PACKED)]
        at += len(body)
        yield Page(head, body)


def relist(path: Path, rows: int) -> None:
    """Let the manifest of the run, where there is one, have size, hash and rows of the part."""
    manifest, name = path.parents[1] / NAME, f"{path.parent.name}/{path.name}"
    if not manifest.is_file():
        return
    told = json.loads(manifest.read_bytes())
    told.pop("digest", None)
    data = path.read_bytes()
    for file in told["files"]:
        if file["path"] == name:
            file |= {"bytes": len(data), "sha256": sha256(data).hexdigest(), "rows": rows}
    plain = json.dumps(told, indent=1) + "\n"
    manifest.write_text(
        plain.removesuffix(END.decode()) + DIGEST % sha256(plain.encode()).hexdigest()
    )


# -- forgeries -------------------------------------------------------------------------------------

Bomb = Callable[[Path], None]


def _each(change: Callable[[Page], None], *, dictionaries: bool = False) -> Bomb:
    """Change each page of data, or each dictionary."""

    def changed(_: str, pages: list[Page]) -> list[Page]:
        for page in pages:
            if page.is_dictionary == dictionaries:
                change(page)
        return pages

    return lambda path: forge(path, changed)


def _head(number: int, value: int) -> Callable[[Page], None]:
    return lambda page: put(page.head, number, value)


def _about(number: int, value: int) -> Callable[[Page], None]:
    return lambda page: put(page.about, number, value)


def _doubled(_: str, pages: list[Page]) -> list[Page]:
    return [page for page in pages if page.is_dictionary] + pages


def _behind(_: str, pages: list[Page]) -> list[Page]:
    return sorted(pages, key=lambda page: page.is_dictionary)


def _empty(_: str, pages: list[Page]) -> list[Page]:
    """Four thousand pages with nothing in them before the first one of data."""
    first = next(page for page in pages if not page.is_dictionary)
    levels = bytes(4)  # of no bytes, where the column has levels
    nothing = first.copy(pa.compress(levels, codec="zstd", asbytes=True))
    put(nothing.head, PAGE_UNPACKED, len(levels))
    put(nothing.about, PAGE_VALUES, 0)
    put(nothing.about, PAGE_ENCODING, PLAIN)
    put(nothing.about, PAGE_STATISTICS, None)
    place = pages.index(first)
    return [*pages[:place], *[nothing] * 4000, *pages[place:]]


def _shared(footer: Fields) -> None:
    """Each row group thirty times, at the same place of the file."""
    kind, groups = of(footer, GROUPS)
    put(footer, GROUPS, (kind, groups * 30))
    put(footer, ALL_ROWS, sum(of(group, ROWS) for group in groups) * 30)


def _as_data(page: Page) -> None:
    """A dictionary whose header says, beside what it is, that it is a page of plain texts: who goes
    by that takes it for harmless.
    """
    nothing = [(number, I32, 0) for number in range(1, 7)]
    page.head.append((OF_DATA_2, STRUCT, nothing))


def _two_headers(path: Path) -> None:
    """180 GB of text, written out, in a dictionary that is said to be none."""
    rows = 200_000
    word = pa.DictionaryArray.from_arrays(
        pa.repeat(pa.scalar(0, pa.int32()), rows), [" " * 900_000]
    )
    write(path, rows, rows, {"station": word})
    _each(_as_data, dictionaries=True)(path)


def _many_groups(path: Path) -> None:
    """Row groups of one row, 1700 of them."""
    write(path, 1700, 1, use_dictionary=False)
    relist(path, 1700)


def _own_texts(*columns: str) -> Bomb:
    """Rows of which each has a text of its own in these columns, as far as a table has them."""

    def made(path: Path) -> None:
        rows = 200_000
        texts = pa.array([f"temperature_c=text {number}" for number in range(rows)])
        there = {name: texts for name in columns if name in SCHEMAS[path.parent.name].names}
        write(path, rows, 50_000, there)
        relist(path, rows)

    return made


def _in_one_group(path: Path) -> None:
    """Rows with long texts of their own, as many as a row group may have: objects of Python take
    several times what the table takes.
    """
    rows = 262_144
    texts = pa.array([f"{number:060}" for number in range(rows)])
    own = ("text", "raw", "reasons", "setting", "readback")
    there = {name: texts for name in own if name in SCHEMAS[path.parent.name].names}
    write(path, rows, rows, there)
    relist(path, rows)


def write(
    path: Path,
    rows: int,
    group: int,
    instead: Mapping[str, pa.Array] = MappingProxyType({}),
    **how: object,
) -> None:
    """Write a part with rows that are all alike but for the columns `instead`, and with the keys of
    the one that it replaces.
    """
    known = (pq.read_metadata(path).metadata or {}) if path.exists() else {}
    columns = {field.name: _alike(field.type, rows) for field in SCHEMAS[path.parent.name]}
    columns |= instead
    schema = pa.schema(
        [
            pa.field(field.name, columns[field.name].type, field.nullable)
            for field in SCHEMAS[path.parent.name]
        ]
    )
    with pq.ParquetWriter(
        path,
        schema,
        compression="zstd",
        write_statistics=False,
        write_page_checksum=True,
        store_schema=False,
        **how,
    ) as made:
        made.write_table(pa.table(columns, schema=schema), row_group_size=group)
        made.add_key_value_metadata({THROUGH: known.get(THROUGH, b"1")})


def _alike(kind: pa.DataType, rows: int) -> pa.Array:
    one = pa.array(["x"] if pa.types.is_string(kind) else [0])
    return pa.repeat(one.cast(kind)[0], rows)


def _element(footer: Fields, name: bytes) -> Fields:
    found = next(one for one in of(footer, SCHEMA)[1] if of(one, ELEMENT_NAME) == name)
    assert isinstance(found, list)
    return found


def _repeated(footer: Fields) -> None:
    put(_element(footer, b"station"), ELEMENT_REPEATS, REPEATED)


def _renamed(footer: Fields) -> None:
    """The chunks of texts have a name that nobody asks for; the schema, by which the library reads
    them, has the right one.
    """
    for chunk in _chunks(footer):
        if of(of(chunk, ABOUT), CHUNK_KIND) == OF_TEXTS:
            put(of(chunk, ABOUT), PATH, (BINARY, [b"elsewhere"]))


def _retyped(footer: Fields) -> None:
    for chunk in _chunks(footer):
        put(of(chunk, ABOUT), CHUNK_KIND, OF_NUMBERS)


def _of_one_name(footer: Fields) -> None:
    """Two columns with the name of one."""
    put(_element(footer, b"port"), ELEMENT_NAME, b"station")
    for chunk in _chunks(footer):
        if of(of(chunk, ABOUT), PATH)[1] == [b"port"]:
            put(of(chunk, ABOUT), PATH, (BINARY, [b"station"]))


def _chunks(footer: Fields) -> list[Fields]:
    return [chunk for group in of(footer, GROUPS)[1] for chunk in of(group, CHUNKS)[1]]


def _long_word(name: str, pages: list[Page]) -> list[Page]:
    """A word of 900 kB in place of each in the dictionaries of stations, of which the footer knows
    nothing.
    """
    if not name.startswith("station"):
        return pages
    word = (900_000).to_bytes(4, "little") + b" " * 900_000
    packed = pa.compress(word, codec="zstd", asbytes=True)
    found = [page.copy(packed) if page.is_dictionary else page for page in pages]
    for page in found:
        if page.is_dictionary:
            put(page.head, PAGE_UNPACKED, len(word))
    return found


def _uncounted(path: Path) -> None:
    """180 GB of text, written out, in a column that the footer says to have some hundred bytes."""
    write(path, 200_000, 200_000)
    forge(path, _long_word)


def _in_a_structure(path: Path) -> None:
    """The same in a structure in place of a column."""
    rows = 200_000
    stations = pa.StructArray.from_arrays([_alike(pa.string(), rows)], ["a"])
    write(path, rows, rows, {"station": stations})
    forge(path, _long_word)


def _childless(footer: Fields) -> None:
    put(of(footer, SCHEMA)[1][0], ELEMENT_CHILDREN, MOST)


def _without_dictionary(_: str, pages: list[Page]) -> list[Page]:
    return [page for page in pages if not page.is_dictionary]


FORGED: Final[dict[str, Bomb]] = {
    "a negative packed size": _each(_head(PAGE_PACKED, -1)),
    "a negative unpacked size": _each(_head(PAGE_UNPACKED, -(2**31))),
    "a negative number of values": _each(_about(PAGE_VALUES, -1)),
    "a page beyond its column": _each(_head(PAGE_PACKED, MOST)),
    "2 GB in a small page": _each(_head(PAGE_UNPACKED, MOST)),
    "nothing in a page that has much": _each(_head(PAGE_UNPACKED, 1)),
    "2**31 - 1 values in a small page": _each(_about(PAGE_VALUES, MOST)),
    "2**31 - 1 words in a small dictionary": _each(_about(PAGE_VALUES, MOST), dictionaries=True),
    "a page without a type": _each(lambda page: put(page.head, TYPE, None)),
    "a page of another type": _each(_head(TYPE, DICTIONARY)),
    "a page of no type": _each(_head(TYPE, 77)),
    "an encoding that there is not": _each(_about(PAGE_ENCODING, 77)),
    "two dictionaries": lambda path: forge(path, _doubled),
    "a dictionary behind its data": lambda path: forge(path, _behind),
    "no dictionary": lambda path: forge(path, _without_dictionary),
    "no pages": lambda path: forge(path, lambda *_: []),
    "a header of two kinds": _two_headers,
    "empty pages that all row groups share": lambda path: forge(path, _empty, _shared),
    "row groups of one row": _many_groups,
    "a station of its own in each row": _own_texts("station"),
    "texts of their own in each row": _own_texts(
        *("quality", "reasons", "status", "kind", "text", "setting", "readback", "counter", "raw")
    ),
    "a long word that the footer does not count": _uncounted,
    "a long word in a structure": _in_a_structure,
    "columns by other names": lambda path: forge(path, footer=_renamed),
    "columns of another type": lambda path: forge(path, footer=_retyped),
    "two columns of one name": lambda path: forge(path, footer=_of_one_name),
    "a large row group": _in_one_group,
    "levels that repeat": lambda path: forge(path, footer=_repeated),
    "columns that are not there": lambda path: forge(path, footer=_childless),
}
"""What is made of the part at a path."""
