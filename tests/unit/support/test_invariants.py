"""The checker that every campaign uses, itself: a good run has no violation, and each thing done to
it is one.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.core.rows import COLUMN
from support.oracles.invariants import (
    Ended,
    Kept,
    _common,
    _due,
    _unlisted,
    kept_in,
    violations,
    violations_of,
)
from support.virtual.recorded_run import run_in
from support.virtual.virtual_run import RECIPE, Heard, VirtualRun, line_text, prepare

SIM = "joints_per_minute = 20\nnoise_c = 2.0\n"


@pytest.fixture(scope="module")
def good() -> VirtualRun:
    return prepare(line_text(SIM), duration_s=8).go()


def kept(run: VirtualRun) -> Kept:
    return Kept(
        [list(row) for row in run.memory.samples], [], [], [run.facts], run.t0, run.utc_s(run.t0)
    )


def test_a_good_run_has_none(good: VirtualRun) -> None:
    assert violations_of(good) == []


@pytest.mark.parametrize(
    ("column", "change", "which"),
    [
        ("temperature_c", 1, "I4"),
        ("power_permille", 1, "I4"),
        ("tick", -1, "I5"),
        ("time", -600_000, "I5"),
        ("time", 600_000, "I5"),
    ],
)
def test_a_value_that_is_not_what_was_said(
    good: VirtualRun, column: str, change: int, which: str
) -> None:
    record = kept(good)
    place = COLUMN[column]
    record.samples[100][place] = int(str(record.samples[100][place])) + change
    wires = {name: tap.heard for name, tap in good.taps.items()}
    assert {text[:2] for text in _common(record, wires, as_sent=False)} >= {which}


def test_rows_that_are_not_there(good: VirtualRun) -> None:
    record = kept(good)
    del record.samples[100]
    assert any("have no row" in text for text in _due(record))
    record = kept(good)
    del record.samples[-1]
    assert any("were due" in text for text in _due(record))


def test_another_write(good: VirtualRun) -> None:
    wires = {"dde-1": [*good.heard, Heard(1e6, "WMAT00400", None, None)]}
    assert list(_unlisted([good.facts], wires, {"dde-1": RECIPE})) == [
        "I7: dde-1: WMAT00400 was written"
    ]


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, list[Heard]]]:
    """A run in a folder; what its station said is rebuilt from nothing but the record: only writes
    are of interest here.
    """
    return run_in(tmp_path_factory.mktemp("sealed"), line_text(SIM), duration_s=4.0), {}


def test_a_sealed_run_against_another_wire(sealed: tuple[Path, dict[str, list[Heard]]]) -> None:
    folder, wires = sealed
    assert len(kept_in(folder).samples) > 50
    # nobody is known to have said anything
    assert {text[:2] for text in violations(folder, wires)} == {"I4"}


def test_how_a_program_may_not_end(sealed: tuple[Path, dict[str, list[Heard]]]) -> None:
    folder, wires = sealed
    assert any(
        text.startswith("I9")
        for text in violations(folder, wires, ended=Ended(0, "Traceback (most recent call last)"))
    )
    assert any(text.startswith("I9") for text in violations(folder, wires, ended=Ended(4, "")))
    assert any(
        text.startswith("I9") for text in violations(folder, wires, ended=Ended(7, "exit 7: so"))
    )


def test_a_tool_that_is_left_at_work(sealed: tuple[Path, dict[str, list[Heard]]]) -> None:
    folder, _ = sealed
    left = {"dde-1": [Heard(0.0, "WPS100001", None, None), Heard(1.0, "WPS100000", None, None)]}
    assert any(text.startswith("unsafe: dde-1 port 1") for text in violations(folder, left))
