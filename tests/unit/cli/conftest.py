from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from jbclog.app import connection
from jbclog.app.run.runner import CUT_SHORT
from support.virtual.manual import Bench, Make


@pytest.fixture(autouse=True)
def _signals_as_before() -> Iterator[None]:
    """`run` ignores signals at its end, because its process ends then; the tests' goes on."""
    before = {number: signal.getsignal(number) for number in CUT_SHORT}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """A bench of virtual stations in memory, the program in its folder; no run is in progress."""

    def made(*stations: str) -> Bench:
        bench = Bench(tmp_path, *stations)
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(connection, "run_that_holds", lambda url: None)
        return bench

    return made
