"""How old the last mark is, however late it is seen and however the clocks are set."""

from __future__ import annotations

import pytest

from jbclog.core.clock import VirtualClock
from jbclog.live.recorder_clock import RecorderClock

BEGAN_S = 1_790_000_000.0


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock(0.0, BEGAN_S)


def seen(clock: VirtualClock, *marks: tuple[float, float]) -> RecorderClock:
    """Of a recorder whose marks, in seconds since its begin, are seen at these moments."""
    recorder = RecorderClock(clock)
    for mark_s, moment in marks:
        clock.advance_to(moment)
        recorder.see(BEGAN_S + mark_s)
    return recorder


def test_a_commit_that_took_long_is_as_old_as_its_begin(clock: VirtualClock) -> None:
    """Rows handed over before its begin are safe; none that is shown is younger."""
    recorder = seen(clock, (0.0, 0.1), (0.6, 0.7), (1.2, 3.7))
    assert recorder.age_s == pytest.approx(2.4)
    assert recorder.now_s == pytest.approx(BEGAN_S + 3.6)
    assert not recorder.is_alive  # whether there is a recorder, its lock says
    clock.advance_to(4.7)
    assert recorder.age_s == pytest.approx(3.4)


def test_a_first_mark_is_as_old_as_the_wall_clock_says(clock: VirtualClock) -> None:
    assert seen(clock, (0.0, 9.0)).age_s == pytest.approx(9.0)


@pytest.mark.parametrize("ahead_s", [-3600.0, 3600.0])
def test_a_recorder_on_another_machine_has_another_clock(
    clock: VirtualClock, ahead_s: float
) -> None:
    recorder = seen(clock, (ahead_s, 0.1), (ahead_s + 0.6, 0.7))
    assert recorder.age_s == pytest.approx(0.0)
    assert recorder.is_alive


@pytest.mark.parametrize("step_s", [-3600.0, -20.0, 3600.0])
def test_a_clock_that_is_set_makes_no_mark_old(clock: VirtualClock, step_s: float) -> None:
    recorder = seen(clock, (0.0, 0.1), (0.6, 0.7), (1.2 + step_s, 1.3))
    assert recorder.age_s == pytest.approx(0.0)


def test_a_clock_that_drifts_is_followed_within_a_minute(clock: VirtualClock) -> None:
    """One second in an hour."""
    marks = [(second * (1 - 1 / 3600), float(second)) for second in range(7200)]
    age_s = seen(clock, *marks).age_s
    assert age_s is not None
    assert age_s < 0.05
