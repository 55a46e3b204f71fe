"""Ages of commits, however long a commit takes."""

from __future__ import annotations

import pytest

from jbclog.core.clock import VirtualClock
from jbclog.live.heartbeat import Heartbeat

BEGAN_S = 1_790_000_000.0


def test_a_commit_that_took_long_is_as_old_as_its_begin() -> None:
    """Rows handed over before its begin are safe; none that is shown is younger."""
    clock = VirtualClock(0.0, BEGAN_S)
    heartbeat = Heartbeat(clock)
    heartbeat.see(BEGAN_S, 0.1)
    assert heartbeat.age_s == pytest.approx(0.1)
    clock.advance_to(3.0)
    heartbeat.see(BEGAN_S + 0.5, 2.4)
    assert heartbeat.age_s == pytest.approx(2.4)
    assert heartbeat.recorder_us() == pytest.approx((BEGAN_S + 2.9) * 1e6)
    assert not heartbeat.is_alive  # whether there is a recorder, its lock says
    clock.advance_to(4.0)
    assert heartbeat.age_s == pytest.approx(3.4)
