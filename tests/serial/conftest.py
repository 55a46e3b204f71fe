from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from jbclog.sim import process
from jbclog.sim.process import SimProcess
from support.command import BENCH, WireLog
from support.warm_start import fork_modules

fork_modules(process)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[tuple[Path, WireLog]]:
    """The bench of four virtual stations in a process of their own: the line file for a run, and
    the stations' log.
    """
    log = tmp_path / "wire.jsonl"
    with SimProcess(BENCH, tmp_path / "bench", log=log) as stations:
        yield stations.line_path, WireLog(log)
