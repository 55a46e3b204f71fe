from __future__ import annotations

from pathlib import Path

import pytest
from audit_bench import MakeBench, See, wanted
from by_hand import Bench

from jbclog import reach
from jbclog.counting import looking
from jbclog.odometer.observed import Observation


@pytest.fixture
def see(monkeypatch: pytest.MonkeyPatch) -> See:
    monkeypatch.setattr(looking, "run_that_holds", lambda url: None)

    def seen(bench: Bench) -> dict[str, Observation]:
        monkeypatch.setattr(reach, "means", bench.means)
        found: list[Observation] = []
        looking.Looking(at_once=1).all(wanted(bench), found.append)  # one clock for all of them
        return {one.station: one for one in found}

    return seen


@pytest.fixture
def bench(tmp_path: Path) -> MakeBench:
    return lambda *stations: Bench(tmp_path, *stations)
