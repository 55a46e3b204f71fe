"""Episodes by the station's own flags: from the events that a session tells of them."""

from __future__ import annotations

from jbclog.analysis.alarms.from_record import FlagRead, flag_episodes
from jbclog.analysis.alarms.state_machine import Episode, State
from jbclog.core.rows import EventRow, Severity


def event(
    kind: str, at_s: float, since_s: float, value: float | None = None, raw: str = "high"
) -> EventRow:
    text, times = kind, (round(at_s * 1e6), round(since_s * 1e6))
    return EventRow(
        times[0],
        kind,
        Severity.INFO,
        text,
        "dde-1",
        1,
        times[1],
        value=value,
        limit_value=380.0,
        raw=raw,
    )


def read(at_s: float, high: bool) -> FlagRead:
    return FlagRead(round(at_s * 1e6), high, False)


def only(*events: EventRow, reads: tuple[FlagRead, ...] = ()) -> Episode:
    (episode,) = flag_episodes(events, reads)
    return episode


def interval(episode: Episode) -> tuple[float, float, float | None, float | None]:
    ends = [None if one is None else one / 1e6 for one in (episode.end_earliest_us, episode.end_us)]
    return episode.onset_earliest_us / 1e6, episode.onset_us / 1e6, ends[0], ends[1]


def test_onset_and_end_lie_between_two_readings_of_the_flags() -> None:
    episode = only(event("alarm.high", 12, 10, 395), event("alarm.high.ended", 16, 14))
    assert interval(episode) == (10, 12, 14, 16)
    assert (episode.id[:15], episode.side, episode.peak_c, episode.is_confirmed) == (
        "A-high-dde-1-p1",
        "high",
        395,
        True,
    )


def test_one_that_is_still_set_is_active() -> None:
    assert only(event("alarm.low", 12, 10, 240, raw="low")).state is State.ACTIVE


def test_a_flag_without_a_matching_temperature_is_not_confirmed() -> None:
    episode = only(event("alarm.unconfirmed", 12, 10, 350), event("alarm.high.ended", 14, 12))
    assert not episode.is_confirmed
    assert interval(episode) == (10, 12, 12, 14)


def test_an_unconfirmed_one_of_an_unknown_side_counts_as_high() -> None:
    assert only(event("alarm.unconfirmed", 12, 10, raw="sideways")).side == "high"


def test_one_that_is_borne_out_later_is_the_same() -> None:
    episode = only(
        event("alarm.unconfirmed", 12, 10),
        event("alarm.high", 14, 12, 395),
        event("alarm.high.ended", 16, 14),
    )
    assert episode.is_confirmed
    assert interval(episode) == (10, 12, 14, 16)


def test_flags_of_before_the_run_and_of_tools_that_do_not_count_are_none() -> None:
    events = [
        event(kind, 12, 10)
        for kind in ("alarm.before_run", "alarm.high.not_working", "alarm.high.ended")
    ]
    assert flag_episodes(events) == []


def test_high_and_low_are_two() -> None:
    both = flag_episodes(
        [
            event("alarm.high", 12, 10),
            event("alarm.low", 12, 10, raw="low"),
            event("alarm.low.ended", 14, 12),
        ]
    )
    assert [(one.side, one.state) for one in both] == [("high", "active"), ("low", "cleared")]


LOST = (event("alarm.high", 12, 10, 395), event("alarm.unknown", 14, 12))


def test_after_a_lost_answer_it_is_uncertain() -> None:
    episode = only(*LOST)
    assert (episode.state, episode.is_uncertain, episode.end_us) == (State.UNCERTAIN, True, None)


def test_the_next_reading_says_whether_it_ended() -> None:
    assert interval(only(*LOST, reads=(read(10, False), read(12, True), read(16, False)))) == (
        10,
        12,
        12,
        16,
    )


def test_one_that_is_set_again_after_a_lost_answer_continues() -> None:
    episode = only(
        *LOST,
        event("alarm.high", 16, 14, 396),
        event("alarm.high.ended", 20, 18),
        reads=(read(12, True), read(16, True)),
    )
    assert interval(episode) == (10, 12, 18, 20)
    assert (episode.peak_c, episode.is_uncertain) == (396, True)


def test_one_that_was_read_off_in_between_is_another() -> None:
    first, second = flag_episodes(
        [*LOST, event("alarm.high", 18, 16, 396)], (read(16, False), read(18, True))
    )
    assert interval(first) == (10, 12, 12, 16)
    assert interval(second) == (16, 18, None, None)


def test_two_lost_answers_are_a_longer_time_in_which_it_may_have_ended() -> None:
    assert interval(only(*LOST, event("alarm.unknown", 16, 14), reads=(read(18, False),))) == (
        10,
        12,
        12,
        18,
    )


def test_a_lost_answer_without_an_alarm_is_none() -> None:
    assert flag_episodes([event("alarm.unknown", 14, 12)], (read(16, False),)) == []
