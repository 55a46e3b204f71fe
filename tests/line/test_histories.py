"""The histories of `.ci/oracle`: each is lived the same every time, and what differs between
two versions is found and named.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.histories import compare, product
from support.histories.compare import Entry, Side, differences
from support.histories.drawn import COUNT, ENDS, FAMILIES, FAULTS, FEW, RATES, history
from support.histories.driver import lived

NUMBER = 0


@pytest.fixture(scope="module")
def text(tmp_path_factory: pytest.TempPathFactory) -> str:
    return "\n".join(lines_of(NUMBER, tmp_path_factory.mktemp("history")))


def lines_of(number: int, home: Path) -> Iterator[str]:
    return map(json.dumps, lived(history(number), product, home))


def side(folder: Path, text: str) -> Side:
    path = folder / "history.jsonl"
    path.write_text(text, encoding="utf-8")
    return Side.read(path)


def test_a_history_is_the_same_once_more(text: str, tmp_path: Path) -> None:
    assert "\n".join(lines_of(NUMBER, tmp_path)) == text
    tables = Counter(json.loads(line)["table"] for line in text.splitlines())
    assert tables["samples"] > 10
    assert tables["settings"] > 10
    assert tables["events"] > 3
    assert tables["frames"] > 200


@pytest.mark.parametrize("count", [FEW, COUNT])
def test_the_histories_have_every_family_fault_rate_and_end(count: int) -> None:
    drawn = [history(number) for number in range(count)]
    assert {bench.family for told in drawn for bench in told.benches} == set(FAMILIES)
    assert {fault for told in drawn for bench in told.benches for fault in bench.faults} >= {
        fault for fault in FAULTS if fault != "none"
    }
    assert {told.rate for told in drawn} >= set(RATES)
    assert {told.ends[0] for told in drawn} >= {*ENDS, "killed"}


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        (
            '"temperature_c": ',
            '"temperature_c": 9',
            r"samples of \S+, row 0: temperature_c was \d+",
        ),
        (
            '"outcome": "confirmed"',
            '"outcome": "unchanged"',
            r"settings of \S+, row \d+: outcome was",
        ),
        ('"what": "said"', '"what": "heard"', r"frames of \S+, row 2: what was 'said'"),
        ('"kind": "run.end"', '"kind": "run.stop"', r"events of the run, row \d+: kind was"),
        ('"late_us", "scan_us"', '"scan_us"', "samples: column late_us only in the oracle"),
    ],
)
def test_one_changed_value_is_named(
    text: str, old: str, new: str, named: str, tmp_path: Path
) -> None:
    assert old in text
    changed = side(tmp_path, text.replace(old, new, 1))
    (first,) = differences(NUMBER, side(tmp_path, text), changed, [])
    assert re.match(named, first)


def test_a_row_that_only_one_has_is_named(text: str, tmp_path: Path) -> None:
    lines = text.splitlines()
    last = max(number for number, line in enumerate(lines) if '"kind": "run.end"' in line)
    without = side(tmp_path, "\n".join(lines[:last] + lines[last + 1 :]))
    (first,) = differences(NUMBER, side(tmp_path, text), without, [])
    assert "only in the oracle" in first


def test_what_is_meant_to_differ_is_no_difference(text: str, tmp_path: Path) -> None:
    oracle = side(tmp_path, text)
    changed = side(tmp_path, text.replace("All stations have ended", "Over"))
    column = Entry("events", "shorter", column="text", rows={"kind": "run.end"})
    row = Entry("events", "shorter", rows={"kind": "run.end"})
    elsewhere = Entry("events", "shorter", history=NUMBER + 1, column="text")
    for entry in (column, row):
        assert [*differences(NUMBER, oracle, changed, [entry])] == []
        assert entry.is_needed
    assert len([*differences(NUMBER, oracle, changed, [elsewhere])]) == 1
    assert not elsewhere.is_needed


def test_an_entry_that_nothing_needs_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    listed = tmp_path / "differences.toml"
    listed.write_text('[[difference]]\ntable = "events"\nreason = "once"\n')
    monkeypatch.setattr(compare, "MEANT", listed)
    for number in range(COUNT):
        (tmp_path / f"{number:03d}.jsonl").touch()
    texts = compare.differing(tmp_path, tmp_path, range(COUNT))
    assert [text for text in texts.values() if text] == [
        "differences.toml: nothing differs any more by:\n   events: once"
    ]
