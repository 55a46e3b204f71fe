"""The mean time between alarms: from two alarms on; one gives none."""

from __future__ import annotations

import pytest

from jbclog.analysis.alarms.kpi import figures
from jbclog.analysis.alarms.state_machine import Detector, Episode, Side

S = 1_000_000


def alarm(second: int) -> Episode:
    return Episode("dde-1", 1, Side.HIGH, Detector.SAMPLES, second * S, second * S, 380.0)


@pytest.mark.parametrize(("count", "seconds"), [(0, None), (1, None), (2, 20.0), (4, 10.0)])
def test_mean_time_between_alarms(count: int, seconds: float | None) -> None:
    found = figures(
        "dde-1", Detector.SAMPLES, [alarm(3 * number) for number in range(count)], 0, 40 * S
    ).apart
    assert (found.value, found.n) == (seconds, count)
    assert (found.why is None) == (seconds is not None)


def test_one_alarm_says_why() -> None:
    found = figures("dde-1", Detector.SAMPLES, [alarm(3)], 0, 40 * S).apart
    assert found.why == "One alarm was raised in 40 s; a mean time between alarms takes two."
