"""Plant stores, run indexes and batch stores from others: one that expands too much is refused in
one line, before a library reads it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable
from contextlib import closing
from hashlib import blake2b
from pathlib import Path

import msgspec
import pytest

from jbclog.app.index.index_file import IndexFile
from support.campaigns.foreign_matrix import Ended, Pairs
from support.faults.bombs import BATCHES, INDEXES
from support.faults.store_bombs import BOMBS, put, told
from support.records.plant_store import filled, run, store

__all__ = ["filled", "run", "store"]  # fixtures

VERBS = {
    "runs": ["runs", "{store}"],
    "trend": ["trend", "{store}"],
    "where-used": ["where-used", "{store}", "--station", "dde-1", "--since", "2026-01-01"],
    "compare": ["compare", "{store}/{name}", "{store}/{name}"],
    "chart": ["chart", "{store}", "--metric", "idle_error_c"],
    "store check": ["store", "check", "{store}"],
    "store compact": ["store", "compact", "{store}"],
    "publish": ["publish", "{run}", "{store}"],
}
NEEDS = {
    ("metrics", "many rows"): ("trend", "chart", "compare", "store check", "store compact"),
    ("samples", "many rows"): ("compare", "store check", "store compact"),
    ("runs", "long kept files"): ("compare",),
}
"""What needs the file that is a bomb, for some; all need one of the table of runs."""


def ended(pairs: Pairs, verb: str, store: Path, run: Path) -> Ended:
    places = {"store": store, "run": run, "name": run.name}
    return pairs.run([word.format(**places) for word in VERBS[verb]])


def wrong(verb: str, bomb: tuple[str, str], found: Ended) -> str | None:
    """Return the fault of an answer; a command that needs the file with the bomb must refuse in one
    line.
    """
    if found.trouble:
        return found.trouble
    if verb in NEEDS.get(bomb, VERBS if bomb[0] == "runs" else ()):
        if found.code not in (1, 4):
            return f"ended with {found.code}: {found.output}"
        if verb != "store check" and found.output.count("\n") != 1:
            return f"more than one line: {found.output}"
    return None


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("bomb", BOMBS, ids=" ".join)
def test_every_verb_answers_whatever_a_store_holds(
    bomb: tuple[str, str], store: Path, run: Path, pairs: Pairs
) -> None:
    put(store, bomb[0], BOMBS[bomb])
    answers = {verb: ended(pairs, verb, store, run) for verb in VERBS}
    print(*(f"{verb}: {one}" for verb, one in answers.items()), sep="\n")
    assert {
        verb: trouble for verb, one in answers.items() if (trouble := wrong(verb, bomb, one))
    } == {}


@pytest.mark.parametrize(
    ("table", "name", "verb", "said"),
    [
        ("runs", "many rows", "runs", "rows in"),
        ("runs", "a long list", "runs", "unpacks to more than"),
        ("runs", "a long word", "runs", "at once"),
        ("runs", "texts that begin alike", "runs", "at once"),
        ("runs", "long kept files", "compare", "MiB"),
        ("runs", "a deep schema", "runs", "unreadable footer"),
        ("samples", "many rows", "store check", "rows in"),
        ("metrics", "a long word", "trend", "at once"),
    ],
)
def test_a_slice_of_that(
    table: str, name: str, verb: str, said: str, store: Path, run: Path, pairs: Pairs
) -> None:
    path = put(store, table, BOMBS[table, name])
    found = ended(pairs, verb, store, run)
    assert wrong(verb, (table, name), found) is None
    assert said in found.output
    assert found.code == (1 if verb == "store check" else 4)
    assert table == "runs" or path.name in found.output


@pytest.mark.parametrize("rows", [2**60, -1, 299])
def test_rows_that_a_log_invents(rows: int, store: Path, run: Path, pairs: Pairs) -> None:
    told(store, "metrics", numRecords=rows)
    found = ended(pairs, "trend", store, run)
    assert (found.trouble, found.code) == (None, 4), found
    assert f"its log says {rows}" in found.output


OF_BATCHES = (
    "endless views",
    "a number for a line",
    "texts, nulls and infinite numbers",
    "deep JSON",
)
OF_INDEXES = ("endless view", "a cell of 97 MiB", "wrong types")


def slices(names: Iterable[str], always: Collection[str]) -> list[object]:
    """Return those of each test run; mark the others for the campaign."""
    marks = pytest.mark.campaign
    return [name if name in always else pytest.param(name, marks=marks) for name in names]


@pytest.mark.parametrize("what", slices(BATCHES, OF_BATCHES))
def test_a_batch_s_store(what: str, tmp_path: Path, pairs: Pairs) -> None:
    """Nothing starts, and `watch` reports what is wrong or what is known."""
    folder = tmp_path / "20260101T000000Z"
    folder.mkdir()
    BATCHES[what](folder / "batch.sqlite")
    for verb in ("@journal", "@queue"):
        found = pairs.run([verb, str(tmp_path)])
        assert (found.trouble, found.output.count("\n")) == (None, 1), (verb, found)
        assert verb == "@queue" or found.code == 4 or found.output == "None\n", found


@pytest.mark.parametrize("what", slices(INDEXES, OF_INDEXES))
def test_an_index_of_runs(what: str, run: Path, pairs: Pairs) -> None:
    """The answers equal those without an index, and a bomb is removed."""
    place = blake2b(os.fsencode(os.path.realpath(run.parent)), digest_size=16).digest()
    pairs.index.parent.mkdir(exist_ok=True, mode=0o700)
    for verb in ("runs", "trend", "where-used"):
        words = [word.format(store=run.parent) for word in VERBS[verb]]
        plain = pairs.run([*words, "--no-cache"])
        INDEXES[what](pairs.index, place)
        found = pairs.run(words)
        assert (found.trouble, found.code, found.output) == (None, plain.code, plain.output), verb
        assert pairs.run(words).output == plain.output


@pytest.mark.parametrize("number", [math.nan, math.inf, 1e308, -1e308])
def test_forged_figures_with_a_right_check_sum(number: float, run: Path, pairs: Pairs) -> None:
    """Only the user can write there; the figures may then be false, but there is an answer."""
    pairs.run(["trend", str(run.parent)])
    with closing(IndexFile(pairs.index)) as file:
        place = blake2b(os.fsencode(os.path.realpath(run.parent)), digest_size=16).digest()
        kind, name = "idle_error_c", os.fsencode(run.name)
        entry = file.entries(place, kind).get(name)
        stamp = entry.stamp if entry else b""
        figures = [("dde-1", 1, number, "\u00b0C", 1, number, number, None)]
        file.put(place, kind, name, stamp, msgspec.msgpack.encode(figures))
    for verb in ("trend", "chart"):
        found = pairs.run([word.format(store=run.parent) for word in VERBS[verb]])
        assert found.trouble is None, found
