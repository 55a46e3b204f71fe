"""What `jbclog demo` says that it has shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.run.run_record import Result
from jbclog.cli import demo_units
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


def test_the_barcode_reader_types_each_serial_once(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(demo_units, "monotonic", lambda: now)
    reader = demo_units.BarcodeReader(("SN-1", "SN-2"), 8.0)
    now += 3.0  # until the first look
    typed = []
    for _ in range(200):
        typed.append(reader.read())
        now += 0.1
    assert [typed[0], typed[80], typed[81]] == [b"SN-1\n", b"", b"SN-2\n"]
    assert b"".join(typed) == b"SN-1\nSN-2\n"
