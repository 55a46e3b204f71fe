"""The detectors side by side, what they do not agree on, and the figures of floods and chatter."""

from __future__ import annotations

import pytest

from jbclog.analysis.alarms.kpi import Figures, figures
from jbclog.analysis.alarms.match import Incident, Unknown, incidents
from jbclog.analysis.alarms.state_machine import Detector, Episode, Side

A, B, C = Detector


def episode(
    detector: Detector,
    begin_s: float,
    end_s: float | None,
    *,
    side: Side = Side.HIGH,
    port: int = 1,
    apart_s: float = 0.1,
) -> Episode:
    begin = round(begin_s * 1e6)
    one = Episode(
        "dde-1",
        port,
        side,
        detector,
        begin - round(apart_s * 1e6),
        begin,
        380,
        0.5,
        raised_us=begin,
        peak_c=390,
    )
    if end_s is not None:
        end = round(end_s * 1e6)
        one.end(end - round(apart_s * 1e6), end, end, "returned")
    return one


def matched(
    *episodes: Episode, lost: tuple[float, float] | None = None, flags: bool = True
) -> list[Incident]:
    unknown = (
        {}
        if lost is None
        else {("dde-1", 1): [Unknown(round(lost[0] * 1e6), round(lost[1] * 1e6))]}
    )
    return incidents(episodes, unknown, ["dde-1"] if flags else [])


def test_what_overlaps_is_one_incident() -> None:
    (one,) = matched(episode(A, 12, 16, apart_s=2), episode(B, 11, 13), episode(C, 11, 12.5))
    assert [detector for detector, those in one.by.items() if those] == [A, B, C]
    assert one.finding is None
    assert one.name == one.by[B][0].id


def test_ports_sides_and_times_are_separate_incidents() -> None:
    found = matched(
        episode(B, 11, 13),
        episode(B, 11, 13, side=Side.LOW),
        episode(B, 11, 13, port=2),
        episode(B, 20, 21),
        flags=False,
    )
    assert [(one.number, one.port, one.side, len(one.episodes)) for one in found] == [
        (1, 1, "high", 1),
        (2, 1, "low", 1),
        (3, 2, "high", 1),
        (4, 1, "high", 1),
    ]


def test_several_of_our_alarms_may_be_one_of_the_station() -> None:
    (one,) = matched(
        episode(A, 12, 30, apart_s=2), episode(B, 11, 13), episode(B, 20, 21), episode(C, 20, 20.5)
    )
    assert len(one.by[B]) == 2


def test_a_flag_that_was_read_late_belongs_to_what_it_may_have_seen() -> None:
    assert len(matched(episode(B, 10.5, 11.8), episode(A, 13, 15, apart_s=2))) == 1
    assert len(matched(episode(B, 10.5, 11.8), episode(A, 14, 16, apart_s=2))) == 2


def test_an_active_one_holds_all_that_follows() -> None:
    assert (
        len(matched(episode(A, 12, None, apart_s=2), episode(B, 11, 13), episode(B, 200, 201))) == 1
    )


def finding(
    *episodes: Episode, lost: tuple[float, float] | None = None, flags: bool = True
) -> str | None:
    (one,) = matched(*episodes, lost=lost, flags=flags)
    return one.finding


def test_a_flag_that_no_sample_shows() -> None:
    said = finding(episode(A, 12, 16, apart_s=2))
    assert said is not None
    assert (
        "no sample is beyond 380 °C: it was between two of our readings, or is left from before"
        in said
    )


def test_a_flag_of_which_our_samples_show_too_little() -> None:
    said = finding(episode(A, 12, 16, apart_s=2), episode(C, 11, 11.3))
    assert said is not None
    assert "not for the whole delay (longest 0.3 s)" in said


def test_samples_without_a_flag() -> None:
    said = finding(episode(B, 11, 13), episode(C, 11, 13))
    assert (
        said
        == "our samples were beyond 380 °C for longer than 0.5 s; the station's high-temperature"
        " flag was not read as set: its limit or delay differs from what was read back, or the"
        " flag was lost"
    )


def test_samples_without_a_flag_whose_answer_was_lost() -> None:
    assert "an answer with the flags was lost meanwhile" in str(
        finding(episode(B, 11, 13), lost=(12, 14))
    )
    assert "an answer" not in str(finding(episode(B, 11, 13), lost=(20, 22)))


def test_no_finding_where_nothing_is_at_odds() -> None:
    assert finding(episode(C, 11, 11.2)) is None  # shorter than the delay
    assert finding(episode(B, 11, 13), flags=False) is None  # a station without flags


# -- figures ---------------------------------------------------------------------------------------


def of(starts: list[float], lasts_s: float | None = 10.0, end_s: float = 7200.0) -> Figures:
    those = [episode(B, start, None if lasts_s is None else start + lasts_s) for start in starts]
    return figures("dde-1", B, [*those, episode(A, 5, 6)], 0, round(end_s * 1e6))


def test_counts_and_rates() -> None:
    found = of([0, 300, 900, 3600])
    assert (found.count, found.active, found.most_in_10_min) == (4, 0, 2)
    assert found.per_10_min == pytest.approx(4 / 12)
    assert figures("dde-1", B, [], None, None).per_10_min is None
    assert figures("dde-2", B, [episode(B, 1, 2)], 0, 10).count == 0


def test_ten_in_ten_minutes_are_no_flood_and_eleven_are() -> None:
    assert of([60.0 * n for n in range(10)]).floods == ()
    (flood,) = of([50.0 * n for n in range(11)]).floods
    # with the seventh gone there are four
    assert flood == (500_000_000, (600 + 50 * 6) * 1_000_000)


def test_a_flood_that_has_not_ended_has_no_end() -> None:
    assert of([50.0 * n for n in range(11)], end_s=700).floods == ((500_000_000, None),)


def test_two_floods() -> None:
    assert (
        len(of([*(10.0 * n for n in range(12)), *(3000 + 10.0 * n for n in range(12))]).floods) == 2
    )


def test_chattering_is_three_within_a_minute_at_one_limit() -> None:
    assert of([0, 30, 60]).chattering == {}
    assert of([0, 30, 59.9]).chattering == {"port 1 high": 3}
    spread = [episode(B, n, n + 1, port=n) for n in (1, 2, 3)]
    assert figures("dde-1", B, spread, 0, 10_000_000).chattering == {}


def test_fleeting_and_stale() -> None:
    assert (of([0, 100], 4.9).fleeting, of([0, 100], 5.0).fleeting) == (2, 0)
    assert of([0], None, 86_400).stale == 0
    assert (of([0], None, 86_401).stale, of([0], None, 86_401).active) == (1, 1)
    assert of([0], 86_401, 90_000).stale == 1


def test_those_that_raise_most_are_named() -> None:
    those = [episode(B, n, n + 1) for n in range(0, 30, 10)] + [
        episode(B, 1, 2, port=2, side=Side.LOW)
    ]
    assert [
        (one.name, one.count, one.percent) for one in figures("dde-1", B, those, 0, 10).top
    ] == [
        ("port 1 high", 3, 75.0),
        ("port 2 low", 1, 25.0),
    ]


def test_the_time_between_alarms_is_the_record_over_their_number() -> None:
    assert (of([0, 300, 900, 3600]).apart.value, of([0, 300, 900, 3600]).apart.n) == (1800, 4)
    assert (of([]).apart.value, of([]).apart.why) == (None, "No alarm was raised in 7200 s.")
    assert figures("dde-1", B, [], None, None).apart.why == "Nothing was recorded."


def test_how_long_alarms_waited_for_a_person() -> None:
    those = [episode(B, 60.0 * n, 60.0 * n + 5) for n in range(5)]
    seen = {
        one.id: one.onset_us + round(1e6 * waited)
        for one, waited in zip(those, (10, 20, 30, 40, -5), strict=True)
    }
    found = figures("dde-1", B, those, 0, 3_600_000_000, seen)
    # no answer comes before its question
    assert (found.ack_p50.value, found.ack_p95.value, found.ack_p50.n) == (25, 38.5, 4)
    alone = figures(
        "dde-1", B, those, 0, 3_600_000_000, {those[0].id: those[0].onset_us + 7_000_000}
    )
    assert (alone.ack_p50, alone.ack_p95.value) == (alone.ack_p95, 7)
    assert figures("dde-1", B, those, 0, 1, {}).ack_p95.why == "None of 5 was acknowledged."
    assert figures("dde-1", B, [], 0, 1, seen).ack_p50.why == "No alarm was raised."
