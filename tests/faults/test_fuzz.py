"""Fuzzed input from others: files and streams of tests/data/fuzz, altered at random, with the rules
of each reader.

For all readers: no error other than the documented one, within the documented time, and no value
accepted that the input does not contain. The slice tries the same cases each time; `-m campaign`
tries new ones each time, `JBCLOG_FUZZ` (20 000) of each. A case that broke something goes into
tests/data/fuzz/TARGET, which is tried first and unaltered.
"""

from __future__ import annotations

import math
import os
import shutil
import sqlite3
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from dataclasses import fields as fields_of
from functools import reduce
from operator import xor
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jbclog.config.line import parse_line
from jbclog.config.load_recipe import parse_recipe
from jbclog.config.recipe_settings import settings_for, station_settings_for
from jbclog.core.errors import Problems, RecordError
from jbclog.core.json_files import json_of
from jbclog.core.rows import TABLES
from jbclog.core.serial_line import BAUDRATES
from jbclog.core.toml import MAX_PROBLEMS
from jbclog.guard.lease import NAME as LEASE
from jbclog.guard.lease import StationLease, read_leases, why_unreadable
from jbclog.protocol import omega
from jbclog.protocol.commands.family import FAMILIES
from jbclog.protocol.frame import MOST_HELD, Frame, FrameReader
from jbclog.record import conclude
from jbclog.record.capture import (
    Hole,
    count_rows,
    is_done,
    mend,
    read_head,
    read_to_hole,
    rows_and_holes,
    wire_path,
)
from jbclog.record.capture_file import packed
from jbclog.record.check import check
from jbclog.record.find_runs import find
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import RunState, manifest_text, read_manifest, write_manifest
from jbclog.record.recover import recover
from jbclog.record.sealed_files import losses
from jbclog.record.store_reader import StoreReader
from support.faults.mutations import CORPUS, JUNK, altered, cases, corpus, json_cases
from support.links.small_wire import ROWS
from support.records import few_rows

MANY = int(os.environ.get("JBCLOG_FUZZ", "20000"))


@dataclass(frozen=True)
class Target:
    """One reader: its cases, the rules for each, the CPU seconds one may take, and the number in
    the slice.
    """

    name: str
    strategy: Callable[[], st.SearchStrategy[Any]]
    holds: Callable[[Any, Path], None]
    seconds: float
    slice: int

    def tried(self, folder: Path, count: int, *, same: bool) -> int:
        """Try `count` cases after those of the corpus; return the number tried."""
        done = 0

        def one(case: Any) -> None:
            nonlocal done
            done += 1
            began = time.process_time()
            self.holds(case, folder)
            took = time.process_time() - began
            assert took < self.seconds, f"{self.name}: {took:.2f} s of CPU, at most {self.seconds}"

        for case in corpus(self.name) if (CORPUS / self.name).is_dir() else ():
            one(case)
        unhurried = settings(
            max_examples=count,
            deadline=None,
            database=None,
            derandomize=same,
            suppress_health_check=list(HealthCheck),
        )
        unhurried(given(case=self.strategy())(one))()
        return done


# -- frames: each result is in the input, with its check byte --------------------------------------

CONTROL = (
    b"\x02",
    b"\x03",
    b"\x02\x03",
    b"\x00",
    b"\xff",
    b"\x02\x02",
    b"A",
    b"N1",
    b"0001",
    b"\x02" + b"0" * 70,
    b"00",
    b"FF",
)


def _stream(name: str) -> st.SearchStrategy[bytes]:
    return cases(corpus(name), CONTROL)


def _framed(stream: bytes, longest: int) -> Iterator[tuple[bytes, bytes]]:
    """Every stretch from STX to ETX with only printable characters between, and the two bytes
    behind it.
    """
    for start in (place for place, byte in enumerate(stream) if byte == 2):
        end = stream.find(b"\x03", start)
        content = stream[start + 1 : end]
        if end > 0 and len(content) <= longest and all(32 <= byte <= 126 for byte in content):
            yield content, stream[end + 1 : end + 3]


def jbc(stream: bytes, _: Path) -> None:
    found, one = [], FrameReader()
    for start in range(0, len(stream), 7):
        found += one.feed(stream[start : start + 7])
    right = [
        content
        for content, behind in _framed(stream, 64)
        if behind and reduce(xor, b"\x02" + content + b"\x03") == behind[0]
    ]
    for frame in (frame for frame in found if isinstance(frame, Frame)):
        assert frame.encode()[1:-2] in right
        right.remove(frame.encode()[1:-2])
    assert one.reset() <= MOST_HELD
    assert one.garbage <= len(stream)


def omega_frames(stream: bytes, _: Path) -> None:
    found, one = [], omega.OmegaReader()
    for start in range(0, len(stream), 7):
        found += one.feed(stream[start : start + 7])
    right = [
        content
        for content, behind in _framed(stream, 64)
        if behind == b"%02X" % (sum(content) % 256)
    ]
    for text in (text for text in found if isinstance(text, str)):
        assert text.encode() in right
        right.remove(text.encode())
    assert one.reset() <= omega.MOST_HELD
    assert one.garbage <= len(stream)


# -- the manifest: NoManifest, or the contents of the file -----------------------------------------


def _manifests() -> st.SearchStrategy[bytes]:
    seeds = corpus("manifest")
    words = [
        b'"digest"',
        b"null",
        b"1e999",
        b"NaN",
        b"-",
        b"{",
        b"]",
        b'"state": "open"',
        b'"rules": 2',
        b"9" * 30,
        b"\\ud800",
    ]
    return st.one_of(cases(seeds, words), json_cases(seeds))


def manifest(data: bytes, folder: Path) -> None:
    """Read, list and check; a manifest that differs from the recorder's always has a finding."""
    folder, again = folder / "20260921T131320Z-bench-k7qd", folder / "again"
    shutil.rmtree(again, ignore_errors=True)
    folder.mkdir(exist_ok=True)
    (folder / MANIFEST).write_bytes(data)
    (listed,) = find(folder.parent)
    assert "\n" not in str(getattr(listed, "why", ""))
    try:
        told = read_manifest(folder)
    except RecordError:
        return
    assert isinstance(told.state, RunState)
    assert all(
        math.isfinite(number) for number in (told.t0_mono, told.t0_utc) if number is not None
    )
    assert all(isinstance(text, str) for text in (*told.serials(), *told.metadata.said().values()))
    assert check(folder)  # its files are missing
    again.mkdir()
    write_manifest(again, told)
    assert manifest_text(read_manifest(again)) == manifest_text(told)


def changed_manifest(case: Any, folder: Path) -> None:
    """Of a whole run: any change is a finding, or `RecordError`."""
    rng, place = Random(case[0]), folder / "sealed"
    if not place.exists():
        recover(few_rows.abandoned(place))
    (run,) = place.iterdir()
    whole = (run / MANIFEST).read_bytes()
    data = altered(whole, [whole], [b"1", b"null", b"\n", b"sealed", b"{}", b"00"], rng, case[1])
    (run / MANIFEST).write_bytes(data)
    try:
        assert bool(check(run)) == (data != whole)
    except RecordError:
        pass
    finally:
        (run / MANIFEST).write_bytes(whole)


# -- the lease: never an error; each station of it is a line of the file, value by value -----------


def _leases() -> st.SearchStrategy[bytes]:
    seeds = corpus("lease")
    return st.one_of(
        cases(seeds, [b"null", b"[]", b'"url"', b"1e999", b"\n", b"\xff", b"{}"]), json_cases(seeds)
    )


TYPES = {one.name: str(one.type) for one in fields_of(StationLease)}
IS = {
    "str": lambda value: type(value) is str,
    "int": lambda value: type(value) is int,
    "bool": lambda value: type(value) is bool,
    "int | None": lambda value: value is None or type(value) is int,
    "str | None": lambda value: value is None or type(value) is str,
    "tuple[int, ...]": (
        lambda value: type(value) is tuple and all(type(one) is int for one in value)
    ),
}


def lease(data: bytes, folder: Path) -> None:
    (folder / LEASE).write_bytes(data)
    lines, alone = [], []
    for line in data.splitlines():
        with suppress(ValueError):
            lines.append(json_of(line))
            alone.append(StationLease.from_json(line))
    stations = read_leases(folder)
    assert stations == alone  # an unreadable line hides no other, and is reported
    assert bool(why_unreadable(folder)) == (len(alone) < len(data.splitlines()))
    for station in stations:
        told = {name: getattr(station, name) for name in TYPES}
        assert all(IS[TYPES[name]](value) for name, value in told.items()), told
        plain = {
            name: list(value) if isinstance(value, tuple) else value for name, value in told.items()
        }
        assert any(isinstance(line, dict) and line.items() <= plain.items() for line in lines), told
        assert isinstance(station.is_at("/dev/ttyUSB0"), bool)
        assert StationLease.from_json(station.to_json()) == station
    assert {station.name for station in stations} <= {*conclude.left_leases(folder)}


# -- the serial capture: RecordError, or rows in order, the missing ones reported ------------------

BLOCK_WORDS = (
    b"\x1f\x8b\x08\x04",
    b"JW",
    b"\t",
    b"run",
    b"told\task",
    b"1e999",
    b"nan",
    b"-1",
    b"\n",
    b'"',
    b"{",
    b"sent\t0",
    b"\\ud800",
)


def capture(data: bytes, folder: Path) -> None:
    rows = _looked(data, folder)
    left = iter(ROWS)
    assert all(row in left for row in rows)
    if rows != ROWS:
        path = wire_path(folder, "dde-1")
        assert list(losses(path)) or not is_done(path)


def _looked(data: bytes, folder: Path) -> list[Any]:
    path = wire_path(folder, "dde-1")
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    found: list[Any] = []
    for look in (
        read_head,
        lambda path: found.extend(rows_and_holes(path)),
        lambda path: [*read_to_hole(path)],
    ):
        with suppress(RecordError):
            look(path)
    assert all("\n" not in told for told in losses(path))
    count = count_rows(path)
    rows = [row for row in found if not isinstance(row, Hole)]
    assert count >= len(rows)
    assert all(math.isfinite(row.at_s) for row in rows)
    mend(path)
    assert count_rows(path) == count
    return rows


def _texts() -> st.SearchStrategy[bytes]:
    return cases(corpus("capture_text"), BLOCK_WORDS)


def capture_text(data: bytes, folder: Path) -> None:
    """Lines of somebody who knows the checksums: rows, or a sentence."""
    text = data.decode(errors="replace")
    half = text.find("\n", len(text) // 2) + 1
    head = zlib.crc32(text.split("\n")[1].encode() + b"\n") if text.count("\n") > 1 else 0
    first = packed(text[:half], 0, 1, head)
    _looked(first + packed(text[half:], 1, 1 + text[:half].count("\n"), head), folder)


# -- the live store: RecordError, or rows as written, the missing ones reported --------------------

STORE_ROWS = 30


def _abandoned(folder: Path, *, in_pages: bool) -> Path:
    """A run that was cut off; made once per folder."""
    place = folder / f"whole-{in_pages}"
    if not place.exists():
        few_rows.abandoned(place, commits=3, rows=STORE_ROWS // 3, in_pages=in_pages)
    (run,) = place.iterdir()
    return run


def _seeds_of_alterations() -> st.SearchStrategy[Any]:
    return st.tuples(st.integers(0, 2**32), st.integers(1, 6))


def _copied(folder: Path, *, in_pages: bool = True) -> Path:
    run = _abandoned(folder, in_pages=in_pages)
    copy = folder / "copy" / run.name
    shutil.rmtree(copy.parent, ignore_errors=True)
    shutil.copytree(run, copy)
    return copy


def store(case: Any, folder: Path) -> None:
    """Altered bytes in the file or its log: the remaining rows are as written, and each loss is
    reported.
    """
    rng = Random(case[0])
    name = rng.choice(("live.sqlite", "live.sqlite", "live.sqlite-wal"))
    path = (run := _copied(folder, in_pages=name == "live.sqlite")) / name
    data = path.read_bytes()
    path.write_bytes(altered(data, [data], [b"\xff" * 8, b"batch", b"CREATE VIEW"], rng, case[1]))
    try:
        with StoreReader(run) as stock:
            numbers = [number for table in TABLES for number in stock.numbers_of(table, 0)]
            rows = [
                row
                for table in stock.tables(numbers)
                if "tick" in table.column_names
                for row in table["tick"].to_pylist()
            ]
            damaged = [str(one) for one in stock.damage]
    except RecordError:
        return
    assert set(rows) <= {*range(STORE_ROWS)}
    recover(run)
    sealed = few_rows.sealed_numbers(run)  # each row is as written
    assert sealed == sorted(set(rows))
    lost = read_manifest(run).lost
    assert lost is not None
    assert (
        len(sealed) == STORE_ROWS
        or damaged
        or lost.seconds_at_most is None
        or lost.seconds_at_most > 0
    )


def store_rows(case: Any, folder: Path) -> None:
    """Rows of somebody who knows the checksums: sealed unchanged, or left out; never another error,
    and no row twice.
    """
    rng, run = Random(case[0]), _copied(folder)
    with closing(sqlite3.connect(run / "live.sqlite", isolation_level=None)) as database:
        for _ in range(case[1]):
            _forge(database, rng)
    with suppress(RecordError):
        recover(run)
        check(run)


def _forge(database: sqlite3.Connection, rng: Random) -> None:
    junk = rng.choice(
        [one for one in JUNK if isinstance(one, str | int | float | None) and one != "\ud800"]
    )
    if rng.random() < 0.5:
        kind, key, text = rng.choice(
            database.execute("SELECT kind, key, text FROM note").fetchall()
        )
        column = rng.choice(("kind", "key", "text"))
        new = {"kind": kind, "key": key, "text": text} | {column: str(junk)}
        if column == "text" and str(text).startswith("{"):
            new["text"] = altered(
                str(text).encode(), [b"[]", b"null"], [b"1e300", b"-1", b'"', b"{}"], rng, 2
            ).decode(errors="replace")
        crc = zlib.crc32(f"{new['kind']} {new['key']} {new['text']}".encode(errors="replace"))
        database.execute("DELETE FROM note WHERE kind = ? AND key = ?", (kind, key))
        database.execute(
            "INSERT OR REPLACE INTO note VALUES (?, ?, ?, ?)",
            (new["kind"], new["key"], new["text"], crc),
        )
        return
    number, name, rows, data = rng.choice(
        database.execute("SELECT number, name, rows, data FROM batch").fetchall()
    )
    new = {"number": number, "name": name, "rows": rows, "data": data}
    column = rng.choice([*new])
    new[column] = {
        "number": rng.choice((0, -1, number + 1, 10**6, 2**62)),
        "name": rng.choice((*TABLES, "x", "../x")),
        "rows": rng.choice((0, -1, 1, 2**40)),
        "data": altered(data, [data], [b"\xff" * 8, b"\0" * 8], rng, 3),
    }[column]
    crc = zlib.crc32(
        new["data"], zlib.crc32(f"{new['number']} {new['name']} {new['rows']}".encode())
    )
    database.execute("DELETE FROM batch WHERE number = ?", (number,))
    database.execute(
        "INSERT OR REPLACE INTO batch VALUES (?, ?, ?, ?, ?)",
        (new["number"], new["name"], new["rows"], crc, new["data"]),
    )


# -- line and recipe files: Problems with sentences that can be shown, or values within their limits

TOML = (
    *(
        b"= 1",
        b"= -1",
        b"= 1e400",
        b"= nan",
        b"= inf",
        b'= ""',
        b"= []",
        b"= {}",
        b"= true",
        b'= "off"',
        b"= 99999",
        b"= 1_0",
        b"= 0x7f",
    ),
    *(
        b"[",
        b"]",
        b"[[",
        b"]]",
        b'"""',
        b"'''",
        b"#",
        b".",
        b"=",
        b"\n",
        b"\\",
        b"\\u202e",
        "\u202e".encode(),
        b"\x1b",
        b"= 1979-05-27",
    ),
    *(
        b"[port.1.temperature]\n",
        b"[station.sim]\n",
        b"[[station]]\n",
        b"[acceptance]\n",
        b"[run]\n",
        b'rate_hz = "auto"\n',
        b"a.b.c = 1\n",
    ),
)


def _tomls(name: str) -> st.SearchStrategy[bytes]:
    return cases(corpus(name), TOML)


def _refused(error: Problems) -> None:
    assert 1 <= len(error.problems) <= MAX_PROBLEMS + 1
    for problem in error.problems:
        assert str(problem).isprintable(), str(problem)


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, float):
        yield value
    for one in (
        value.values()
        if isinstance(value, dict)
        else value
        if isinstance(value, list | tuple)
        else ()
    ):
        yield from _numbers(one)


def line(data: bytes, _: Path) -> None:
    text = data.decode(errors="replace")
    try:
        read = parse_line(text, Path("/etc/line.toml"))
    except Problems as error:
        _refused(error)
        return
    names = [station.name for station in read.stations]
    assert len({*names}) == len(names) >= 1
    assert all(
        station.baudrate in BAUDRATES and station.name.isprintable() for station in read.stations
    )
    assert all(math.isfinite(number) for number in _numbers(read.model_dump(exclude={"source"})))
    assert parse_line(text, Path("/etc/line.toml")) == read


# of any tool in the manuals; hot air has its own maximum, which only the station reports
HOTTEST_C = 500


def recipe(data: bytes, _: Path) -> None:
    text = data.decode(errors="replace")
    try:
        read = parse_recipe(text)
    except Problems as error:
        _refused(error)
        return
    assert all(math.isfinite(number) for number in _numbers(read.model_dump(exclude={"source"})))
    for family in (FAMILIES[name] for name in read.recipe.families):
        asked = [
            one for port in (1, 2, 3, 4) for one in settings_for(read, family, port)
        ] + station_settings_for(read, family)
        for one in asked:
            if not one.is_share:
                sent = one.command.quantity.encode(one.value)
                assert all(" " <= sign <= "~" for sign in sent)
            if one.command.name in ("selected_temperature", "sleep_temperature"):
                assert isinstance(one.value, int)
                assert one.value <= HOTTEST_C
    assert parse_recipe(text) == read


TARGETS = [
    Target("jbc", lambda: _stream("jbc"), jbc, 0.5, 300),
    Target("omega", lambda: _stream("omega"), omega_frames, 0.5, 300),
    Target("manifest", _manifests, manifest, 2.0, 60),
    Target("changed_manifest", _seeds_of_alterations, changed_manifest, 2.0, 30),
    Target("lease", _leases, lease, 0.5, 150),
    Target("capture", lambda: cases(corpus("capture"), BLOCK_WORDS), capture, 2.0, 60),
    Target("capture_text", _texts, capture_text, 2.0, 60),
    Target("store", _seeds_of_alterations, store, 5.0, 5),
    Target("store_rows", _seeds_of_alterations, store_rows, 5.0, 5),
    Target("line", lambda: _tomls("line"), line, 1.0, 60),
    Target("recipe", lambda: _tomls("recipe"), recipe, 1.0, 60),
]
each = pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)


@each
def test_a_slice(target: Target, tmp_path: Path) -> None:
    assert target.tried(tmp_path, target.slice, same=True) >= target.slice


@pytest.mark.campaign
@pytest.mark.timeout(36000)
@each
def test_many(target: Target, tmp_path: Path, counted: Callable[..., None]) -> None:
    counted(**{f"cases_of_{target.name}": target.tried(tmp_path, MANY, same=False)})
