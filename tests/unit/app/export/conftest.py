"""A run to export: three ports of two stations, lost readings, hostile texts, joints with and
without a unit.
"""

from __future__ import annotations

from pathlib import Path

import pytest

import jbclog
from jbclog.app.export.source import Source
from jbclog.core.rows import CounterRow, EventRow, Severity
from jbclog.record.annotations import append
from jbclog.record.manifest import Metadata
from support.records.sealed_run import (
    RECIPE,
    alarm,
    limit,
    lose,
    micros,
    samples,
    seal,
    station,
    table,
)

FORMULAS = ("=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "＝1")
SPLITTING = 'Müller\nK0001/1 9\x14255\x0f1,";'
ROWS = 600


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> jbclog.Run:
    """The sealed and annotated run."""
    stations = [station("dde-1", (1, 2), ROWS), station("dde-2", (1,), ROWS)]
    stations[0].rated_power_w = 130.0
    stations[0].signals = ["temperature_c", "power_permille", "status", "setpoint_c", "alarm_high"]
    ports = [
        samples(ROWS, "dde-1", 1),
        samples(ROWS, "dde-1", 2, seed=2),
        samples(ROWS, "dde-2", 1, seed=3),
    ]
    lose(ports[0], slice(300, 320))
    lose(ports[1], slice(392, ROWS), "timeout")  # cuts off a joint
    events = [
        *(
            EventRow(micros(number), "note", Severity.INFO, text)
            for number, text in enumerate(FORMULAS)
        ),
        EventRow(micros(10), "unit.begin", Severity.INFO, "Unit begins.", raw=SPLITTING),
        EventRow(micros(30), "unit.end", Severity.INFO, "Unit ends.", raw=SPLITTING),
        alarm(31),
    ]
    counters = [CounterRow(micros(1), "dde-1", None, "plugged_min", None, "min", "<timeout>")]
    out = tmp_path_factory.mktemp("runs")
    said = Metadata(
        "=HYPERLINK(1)",
        "WO-1",
        SPLITTING,
        tags={"fingerprint": "forged", "shift": "B"},
        tips=["T245-1"],
    )
    folder = seal(
        out,
        stations,
        table(*ports),
        events,
        [limit("high", "380")],
        counters,
        RECIPE + "recovery_p95_s = 2.5\n",
        metadata=said,
    )
    append(folder, who="Q. A.", what="released", why="seen")
    return jbclog.open_run(folder)


@pytest.fixture(scope="session")
def source(run: jbclog.Run) -> Source:
    return Source(run, is_checked=True)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    return tmp_path / "export"
