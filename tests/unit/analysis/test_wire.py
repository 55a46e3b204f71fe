"""What passed over a wire as a DataFrame."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from jbclog.analysis.run import Run, open_run
from jbclog.core.errors import RecordError
from support.records.small_run import make_run
from support.virtual.captured_run import recorded
from support.virtual.virtual_run import line_text


def test_every_byte_with_its_time_in_utc(tmp_path: Path) -> None:
    run = recorded(tmp_path / "run", line_text(), duration_s=2)
    wire = Run(tmp_path / "run").wire("dde-1")
    assert list(wire.columns) == ["time", "what", "data", "text"]
    assert str(wire["time"].dtype) == "datetime64[us, UTC]"
    asked = wire[wire["what"] == "sent"]
    assert len(asked) == len(run.heard)
    assert asked["data"].iloc[0] == b"\x020001RSMN\x03\x02"
    assert asked["time"].iloc[-1] == pd.Timestamp(
        run.utc_s(run.heard[-1].at), unit="s", tz="UTC"
    ).round("us")


def test_a_run_whose_wires_were_not_kept(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="no serial capture of dde-1; `jbclog run --capture`"):
        open_run(make_run(tmp_path, seconds=2.0)).wire("dde-1")
