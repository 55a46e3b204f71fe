from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.command import BENCH, WireLog
from support.product import SimProcess, patch
from support.warm_start import fork_modules

fork_modules(sys.modules[SimProcess.__module__])

PATIENT_S = 1.5


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let sessions in this process wait longer for an answer than the 0.1 s of the product.

    For tests that do not depend on this time: virtual stations may wait for a processor, and a
    station with three unanswered questions in a row counts as silent.
    """
    for name in ("dialogue.UNMEASURED_S", "dialogue.LEAST_S", "dialogue.MOST_S"):
        patch(monkeypatch, name, PATIENT_S)


@pytest.fixture
def unhurried(patient: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Give each station more than three seconds to confirm: a tool whose state is not read in time
    is ordered again, or not confirmed.
    """
    patch(monkeypatch, "secure.ALLOWED_S", 7.0)  # a guard waits 8


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[tuple[Path, WireLog]]:
    """Serve a bench of four virtual stations from a child process; return the line file for a run,
    and the stations' log.
    """
    log = tmp_path / "wire.jsonl"
    with SimProcess(BENCH, tmp_path / "bench", log=log) as stations:
        yield stations.line_path, WireLog(log)
