"""A soak test that anyone can run: ``pytest -m soak -n0 -s tests/faults/test_soak.py``, for an
hour, or ``JBCLOG_SOAK_S`` seconds.

Sixteen stations of all families with every fault of the virtual stations: cables that come back as
new terminals, flooded links, a stepped wall clock, a guard that is killed and stopped, another
program that reads the open run. At the end every tick and reading is accounted for, every value is
what its station sent, every event about a station, the clock or the guard has a real cause, memory
and descriptors do not grow, and nothing is hot (`soak`). A default run does some seconds of it on
six stations.
"""

from __future__ import annotations

import os
import random
from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from statistics import median

import pytest

from support.campaigns.soak import FLOOD, RECIPES, Soak, kinds_of
from support.oracles.invariants import counted as readings_in
from support.oracles.invariants import kept_in
from support.product import load_line

SOAK_S = float(os.environ.get("JBCLOG_SOAK_S", "3600"))
STATIONS = 16
SLICE_S, SLICE_STATIONS, SLICE_CALM_S = 22.0, 6, 0.0


def soaked(home: Path, seconds: float, stations: int, calm_s: float) -> Soak:
    seed = int(os.environ.get("JBCLOG_SOAK_SEED", random.randrange(1 << 32)))
    print(f"seed {seed}")
    soak = Soak(home, seconds, stations, seed, calm_s)
    soak.go()
    return soak


def test_some_seconds_of_it(tmp_path: Path) -> None:
    soak = soaked(tmp_path, SLICE_S, SLICE_STATIONS, SLICE_CALM_S)
    assert soak.wrong() == []
    assert soak.steps
    assert soak.guards
    assert min(soak.read) > 0


def test_every_kind_of_fault_has_its_turn(tmp_path: Path) -> None:
    """The faults of an hour: every kind that each station supports, each followed by calm."""
    soak = Soak(tmp_path, 3600.0, STATIONS, 1)
    for name, history in soak.histories.items():
        kinds = set(kinds_of(soak.families[name]))
        assert {one.kind for one in history} == (
            kinds - {"dropout"} | {FLOOD} if name in soak.flooded else kinds
        )
        assert (
            min(after.begin - before.end for before, after in pairwise(history)) > soak.calm_s / 2
        )
    (tmp_path / "tip.toml").write_text(RECIPES["tip"])
    names = [spec.name for part in soak.write_line() for spec in load_line(part).stations]
    assert names == list(soak.histories), (
        "a part with its faults is larger than a line file may be, or missing"
    )


@pytest.mark.soak
@pytest.mark.timeout(SOAK_S + 1800)
def test_the_whole_soak(tmp_path: Path, counted: Callable[..., None]) -> None:
    soak = soaked(tmp_path, SOAK_S, STATIONS, 20.0)
    kept = kept_in(soak.folder)
    quarter = len(soak.looks) // 4
    done = Counter(one.kind for history in soak.histories.values() for one in history)
    readings = sum(map(Counter.total, readings_in(kept).values()))
    counted(seconds=round(SOAK_S), stations=STATIONS, rows=len(kept.samples), readings=readings)
    counted(
        faults=done.total(),
        floods=done[FLOOD],
        unplugged=soak.replugged,
        onto_a_new_terminal=soak.new_terminals,
    )
    counted(
        steps_of_the_clock=len(soak.steps),
        guards_killed_or_stopped=len(soak.guards),
        reads_of_the_open_run=soak.read[0],
    )
    counted(
        MB_in_the_second_quarter=round(
            median(look.memory_mb for look in soak.looks[quarter : 2 * quarter])
        )
    )
    counted(MB_in_the_last=round(median(look.memory_mb for look in soak.looks[-quarter:])))
    counted(
        descriptors_in_the_second_quarter=max(
            look.descriptors for look in soak.looks[quarter : 2 * quarter]
        )
    )
    counted(descriptors_in_the_last=max(look.descriptors for look in soak.looks[-quarter:]))
    wrong = soak.wrong()
    counted(wrong=len(wrong))
    assert wrong == []
