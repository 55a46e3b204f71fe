"""What `jbclog demo` says that it has shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.run.run_record import Result
from jbclog.cli.demo import DROPPED, OVERHEATED, _files, _shown
from jbclog.config.line import load_line
from jbclog.core.outcome import Exit
from jbclog.core.rows import StationFacts
from jbclog.record.manifest import Manifest


@pytest.mark.parametrize(("outages", "expected"), [(0, False), (1, True), (2, True)])
def test_a_busy_computer_adds_outages_and_takes_none_away(outages: int, expected: bool) -> None:
    """A station whose answers were late for a second was out of reach, too."""
    facts = StationFacts(DROPPED, "x", "dde", outcome="completed", outages=outages)
    shown = _shown(Result(Path("x"), Exit.FINE, [], Manifest("x", stations=[facts])))
    assert shown[f"{DROPPED} lost its cable for 3 s and was recorded again after that"] is expected


def test_a_start_that_takes_long_does_not_come_too_late_for_its_faults(tmp_path: Path) -> None:
    path, _ = _files(tmp_path, 20.0)
    sims = {one.name: one.sim for one in load_line(path).stations}
    counted_from = {name: sim.faults_from for name, sim in sims.items() if sim and sim.fault}
    assert counted_from == {DROPPED: "order", OVERHEATED: "order"}
