"""The minute of a long run that gets a figure of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jbclog.analysis.figures import curves
from jbclog.analysis.figures.curves import Span
from jbclog.analysis.figures.from_samples import trace
from jbclog.analysis.figures.trace import Grid, Mark, MarkKind, Trace
from jbclog.report.captions import closer, description
from support.records import sealed_run


def port(rows: int = 600, **columns: object) -> Trace:
    """The trace of a port that was recorded for `rows` ticks."""
    return trace(
        sealed_run.table(sealed_run.samples(rows) | columns).to_pandas(),
        Grid(sealed_run.micros(0), 0.1),
    )


def test_a_long_run_gets_a_closer_look_at_its_first_alarm() -> None:
    long = replace(port(6000), marks=[Mark(Span(300, 302, "high"), MarkKind.ALARM)])
    near = closer(long)
    assert near is not None
    assert near[1] == "the first alarm"
    assert near[0].start == pytest.approx(271, abs=0.1)
    assert near[0].end == pytest.approx(331, abs=0.2)
    assert closer(port(600)) is None
    hottest = closer(port(6000, temperature_c=np.concatenate([[900.0], np.full(5999, 350.0)])))
    assert hottest is not None
    assert hottest[1] == "the hottest reading"
    assert hottest[0].start == 0


@pytest.mark.parametrize("block", [7, 1 << 17])
def test_extremes_are_found_in_blocks(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The hottest reading is the first that is as hot."""
    monkeypatch.setattr(curves, "BLOCK_ROWS", block)
    celsius = np.full(6000, 350.0)
    celsius[[900, 3000, 3001]], celsius[:20], celsius[5000] = 371, np.nan, 21
    long = port(6000, temperature_c=celsius)
    near = closer(long)
    assert near is not None
    assert near[0].start == pytest.approx(60)
    assert "tip temperature from 21 to 371 °C over" in description("dde-1, port 1", long)
    unread = port(6000, temperature_c=np.full(6000, np.nan))
    assert "tip temperature never read over" in description("dde-1, port 1", unread)
    near = closer(unread)
    assert near is not None
    assert near[1] == "the middle of the run"
