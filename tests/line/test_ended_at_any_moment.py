"""A run that is ended while any answer is on its way: its rows are whole, and a station that had no
time to answer is not away.
"""

from __future__ import annotations

from itertools import pairwise

import pytest

from support.product import COLUMN
from support.virtual.lines import fault
from support.virtual.virtual_run import VirtualRun, line_text, prepare

ON_EACH_TICK = ("temperature_c", "power_permille", "status")


def ended_at(second: float, sim: str = "") -> VirtualRun:
    run = prepare(line_text(sim=sim))
    run.at(second, lambda: run.driver.end("ended by SIGTERM"))
    return run.go()


def test_no_row_is_left_half_read() -> None:
    usual = prepare().go()
    asked = [heard.at - usual.t0 for heard in usual.heard]
    # each moment at which an answer is on its way, over some ticks
    moments = [before + 0.001 for before, after in pairwise(asked) if 4.0 < before < 4.6]
    assert len(moments) > 20
    for moment in moments:
        run = ended_at(moment)
        assert run.facts.outcome == "completed"
        assert run.memory.samples
        for row in run.memory.samples:
            assert all(row[COLUMN[name]] is not None for name in ON_EACH_TICK), (moment, row)


@pytest.mark.parametrize("kind", ["dropout", "silence"])
@pytest.mark.parametrize("second", [0.0, 0.01])
def test_one_that_had_no_time_to_answer_is_not_away(kind: str, second: float) -> None:
    run = ended_at(second, sim=fault(kind, at_s=0, for_s=1000))
    assert run.facts.outcome == "completed"
    assert "before it had answered" in run.facts.reason
