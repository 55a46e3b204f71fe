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
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
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
from jbclog.core.serial_line import BAUDRATES
from jbclog.core.toml import MAX_PROBLEMS
from jbclog.guard.lease import NAME as LEASE
from jbclog.guard.lease import StationLease, read_leases, why_unreadable
from jbclog.protocol import omega
from jbclog.protocol.commands.family import FAMILIES
from jbclog.protocol.frame import MOST_HELD, Frame, FrameReader
from jbclog.record import conclude
from jbclog.record.check import check
from jbclog.record.damage import read_damage
from jbclog.record.find_runs import find
from jbclog.record.frames import FRAME, MARK
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import RunState, manifest_text, read_manifest, write_manifest
from jbclog.record.recover import recover
from jbclog.record.segments import segments
from support.faults.mutations import CORPUS, altered, cases, corpus, json_cases
from support.records import few_rows, journals

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


# -- the journal: rows as written, each once, the missing ones reported ----------------------------

JOURNAL_ROWS = 30


def _seeds_of_alterations() -> st.SearchStrategy[Any]:
    return st.tuples(st.integers(0, 2**32), st.integers(1, 6))


def journal(case: Any, folder: Path) -> None:
    """Altered bytes in one of two segments."""
    rng, whole = Random(case[0]), folder / "whole"
    if not whole.exists():
        whole.mkdir()
        journals.journal(whole, [[(JOURNAL_ROWS // 6, 1)] * 3] * 2)
    (run,) = whole.iterdir()
    copy = folder / "copy" / run.name
    shutil.rmtree(copy.parent, ignore_errors=True)
    shutil.copytree(run, copy)
    path = rng.choice(segments(copy))
    data = path.read_bytes()
    words = [FRAME, MARK, b"\xff" * 8, b"\0" * 8]
    path.write_bytes(altered(data, [data], words, rng, case[1]))
    recover(copy)
    rows = few_rows.sealed_numbers(copy)  # each row is as written, and there once
    assert set(rows) <= {*range(JOURNAL_ROWS)}
    if rows != [*range(len(rows))]:  # what is missing is not the end
        assert read_damage(copy)
        assert read_manifest(copy).lost is not None


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
    Target("journal", _seeds_of_alterations, journal, 5.0, 8),
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
