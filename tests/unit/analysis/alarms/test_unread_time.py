"""The length of an alarm has a least and a most where it holds unread time."""

from __future__ import annotations

import pytest

from jbclog.analysis.alarms.from_record import flag_episodes
from jbclog.analysis.alarms.state_machine import Detector, Episode
from jbclog.core.rows import EventRow, Severity
from support.records.alarm_series import PERIOD_S, STATION, T0_US, Series, replayed

SAMPLES, AFTERWARDS = Detector.SAMPLES, Detector.AFTERWARDS
UNREAD = 40  # readings


def hot() -> Series:
    """A tool at its 350 °C; its high alarm is above 380 °C for 0.5 s."""
    return Series().walk(340, 350, 350)


def only(series: Series, detector: Detector) -> Episode:
    (episode,) = replayed(series, [detector])
    return episode


@pytest.mark.parametrize("detector", [SAMPLES, AFTERWARDS])
def test_read_throughout_it_has_one_length(detector: Detector) -> None:
    episode = only(hot().add(390, times=30).add(350, times=20), detector)
    assert episode.seconds == pytest.approx(30 * PERIOD_S)
    assert episode.seconds_least is None
    assert episode.seconds_most is None


@pytest.mark.parametrize("detector", [SAMPLES, AFTERWARDS])
def test_a_gap_within_it_may_be_no_alarm(detector: Detector) -> None:
    series = hot().add(390, times=20).add(None, times=UNREAD).add(390, times=10)
    episode = only(series.add(350, times=20), detector)
    assert episode.seconds == pytest.approx((30 + UNREAD) * PERIOD_S)
    # from the last reading before the gap to the first after it
    assert episode.seconds_least == pytest.approx(episode.seconds - (UNREAD + 1) * PERIOD_S)
    assert episode.seconds_most == pytest.approx(episode.seconds)


@pytest.mark.parametrize("detector", [SAMPLES, AFTERWARDS])
def test_a_gap_at_its_end_may_be_no_alarm(detector: Detector) -> None:
    """As of a tool that was pulled out during an alarm."""
    series = hot().add(390, times=20).add(None, times=UNREAD).add(350, times=20)
    episode = only(series, detector)
    assert episode.seconds == pytest.approx((20 + UNREAD) * PERIOD_S)
    assert episode.seconds_least == pytest.approx(19 * PERIOD_S)
    assert episode.seconds_most == pytest.approx(episode.seconds)


@pytest.mark.parametrize("detector", [SAMPLES, AFTERWARDS])
def test_it_may_have_begun_in_a_gap_before_it(detector: Detector) -> None:
    series = hot().add(None, times=UNREAD).add(390, times=20).add(350, times=20)
    episode = only(series, detector)
    assert episode.seconds == pytest.approx(20 * PERIOD_S)
    assert episode.seconds_least == pytest.approx(episode.seconds)
    assert episode.seconds_most == pytest.approx(episode.seconds + (UNREAD + 1) * PERIOD_S)


def test_a_gap_while_it_clears_is_not_its_own() -> None:
    series = hot().add(390, times=20).add(350, times=2).add(None, times=UNREAD)
    episode = only(series.add(350, times=20), SAMPLES)
    assert episode.seconds == pytest.approx(20 * PERIOD_S)
    assert episode.seconds_least is None


def test_before_its_end_it_has_no_length() -> None:
    episode = only(hot().add(390, times=20).add(None, times=UNREAD).add(390, times=3), SAMPLES)
    assert episode.seconds is episode.seconds_least is episode.seconds_most is None


def event(kind: str, seconds: float, since: float) -> EventRow:
    time, earliest = (T0_US + round(one * 1e6) for one in (seconds, since))
    return EventRow(time, kind, Severity.ERROR, "", STATION, 1, earliest, raw="high")


def test_a_lost_answer_to_the_flags_is_unread_time() -> None:
    (episode,) = flag_episodes(
        [
            event("alarm.high", 10, 9),
            event("alarm.unknown", 13, 12),
            event("alarm.high", 14, 13),
            event("alarm.high.ended", 20, 19),
        ]
    )
    assert episode.seconds == pytest.approx(10)
    assert episode.seconds_least == pytest.approx(9)
    assert episode.seconds_most == pytest.approx(10)
