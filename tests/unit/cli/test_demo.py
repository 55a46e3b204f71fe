"""What `jbclog demo` says that it has shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.run.run_record import Result
from jbclog.cli.demo import DROPPED, _shown
from jbclog.core.outcome import Exit
from jbclog.core.rows import StationFacts
from jbclog.record.manifest import Manifest


@pytest.mark.parametrize(("outages", "expected"), [(0, False), (1, True), (2, True)])
def test_a_busy_computer_adds_outages_and_takes_none_away(outages: int, expected: bool) -> None:
    """A station whose answers were late for a second was out of reach, too."""
    facts = StationFacts(DROPPED, "x", "dde", outcome="completed", outages=outages)
    shown = _shown(Result(Path("x"), Exit.FINE, [], Manifest("x", stations=[facts])))
    assert shown[f"{DROPPED} disconnected for 3 s and reconnected"] is expected
