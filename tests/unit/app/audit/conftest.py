from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.audit import survey
from jbclog.maintenance.counter_totals.observed import Observation
from support.virtual.audit_bench import MakeBench, See, wanted
from support.virtual.manual import Bench


@pytest.fixture
def see(monkeypatch: pytest.MonkeyPatch) -> See:
    monkeypatch.setattr(survey, "run_that_holds", lambda url: None)

    def seen(bench: Bench) -> dict[str, Observation]:
        found: list[Observation] = []
        # one clock for all of them
        survey.Survey(at_once=1, access=bench.access).all(wanted(bench), found.append)
        return {one.station: one for one in found}

    return seen


@pytest.fixture
def bench(tmp_path: Path) -> MakeBench:
    return lambda *stations: Bench(tmp_path, *stations)
