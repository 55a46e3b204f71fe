"""A signal that comes while the tools are made safe interrupts nothing of that."""

from __future__ import annotations

from itertools import pairwise

from support.virtual.virtual_run import VirtualRun, prepare

DURATION_S = 3.0
SAFE = {1: "verified", 2: "verified"}


def moments_of_making_safe() -> list[float]:
    """Between each two questions from the first safe order on to the last look at the tools, in
    seconds after the start.
    """
    run = prepare(duration_s=DURATION_S).go()
    assert run.facts.safe_state == SAFE
    begin = min(heard.at for heard in run.writes if heard.at > run.t0 + DURATION_S)
    looks = [heard.at for heard in run.heard if heard.at >= begin and "PS" in heard.text]
    return [(before + after) / 2 - run.t0 for before, after in pairwise(looks)]


def ended_at(second: float) -> VirtualRun:
    run = prepare(duration_s=DURATION_S)
    run.at(second, lambda: run.driver.end("SIGTERM"))
    return run.go()


def test_every_tool_is_verified_whenever_the_end_comes() -> None:
    moments = moments_of_making_safe()
    assert len(moments) > 4
    for moment in moments:
        run = ended_at(moment)
        assert run.facts.safe_state == SAFE, moment
        assert run.facts.unsafe == []
