"""The serial capture of a station as a DataFrame."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from jbclog.analysis.run import open_run
from jbclog.core.errors import RecordError, UsageError
from support.product import ResultRow, captured_rows
from support.records.small_run import make_run
from support.virtual.recorded_run import run_in
from support.virtual.virtual_run import line_text

OUTAGE = '[[station.sim.fault]]\nkind = "dropout"\nat_s = 1\nfor_s = 0.5'


def test_every_byte_with_its_time_in_utc(tmp_path: Path) -> None:
    folder = run_in(tmp_path, line_text(OUTAGE), duration_s=2.0, wire=True)
    run = open_run(folder)
    wire = run.wire("dde-1")
    assert list(wire.columns) == ["time", "what", "data", "text"]
    assert str(wire["time"].dtype) == "datetime64[us, UTC]"
    rows = [row for row in captured_rows(folder, "dde-1") if not isinstance(row, ResultRow)]
    assert list(wire["what"]) == [row.what for row in rows]
    assert list(wire["data"]) == [row.data for row in rows]
    assert list(wire["text"]) == [row.text for row in rows]
    assert {"sent", "heard", "opened", "lost"} <= set(wire["what"])
    asked = wire[wire["what"] == "sent"]
    assert asked["data"].iloc[0] == b"\x020001RSMN\x03\x02"
    t0 = run.manifest.t0_utc or 0.0
    seconds = [row.at_s - (run.manifest.t0_mono or 0.0) + t0 for row in rows]
    assert list(wire["time"]) == [
        pd.Timestamp(round(one * 1e6), unit="us", tz="UTC") for one in seconds
    ]


def test_a_run_without_a_capture(tmp_path: Path) -> None:
    run = open_run(make_run(tmp_path, seconds=2.0))
    with pytest.raises(RecordError, match="no serial capture of dde-1; `jbclog run --capture`"):
        run.wire("dde-1")
    with pytest.raises(UsageError, match="dde-9"):
        run.wire("dde-9")
