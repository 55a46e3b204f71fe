"""Episodes of samples: gaps, what counts, what changes; the recorder's and a replay's are the same;
a slow second way agrees.
"""

from __future__ import annotations

import random
import time
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jbclog.analysis.alarms import from_record
from jbclog.analysis.alarms.from_record import SampledEpisodes
from jbclog.analysis.alarms.live import LiveAlarms
from jbclog.analysis.alarms.port_watch import BEFORE_ALL, Change, PortWatch
from jbclog.analysis.alarms.state_machine import Detector, Episode, Report, Rules, State
from support.records.alarm_series import (
    PERIOD_S,
    SETTINGS,
    STATION,
    T0_US,
    Series,
    by_the_book,
    lived,
    plain,
    random_series,
    replayed,
    rows_of,
    sample_row,
    setting_rows,
)

B, C = Detector.SAMPLES, Detector.AFTERWARDS


def hot() -> Series:
    """A tool that has come to its 350 °C; its high alarm is above 380 °C for 0.5 s."""
    return Series().walk(340, 350, 350)


def only(series: Series, detector: Detector = B) -> Episode:
    (episode,) = replayed(series, [detector])
    return episode


def at(tick: int) -> int:
    return T0_US + tick * 100_000


# -- delays ----------------------------------------------------------------------------------------


def test_it_is_raised_when_the_delay_is_over_and_began_between_two_readings() -> None:
    episode = only(hot().add(390, times=6))
    assert (episode.onset_earliest_us, episode.onset_us, episode.raised_us) == (at(2), at(3), at(8))
    assert (episode.limit_c, episode.on_delay_s, episode.peak_c, episode.state) == (
        380,
        0.5,
        390,
        State.ACTIVE,
    )


def test_what_is_shorter_than_the_delay_is_an_excursion_and_no_alarm() -> None:
    series = hot().add(390, times=5).add(350, times=20)
    assert replayed(series, [B]) == []
    assert only(series, C).seconds == 0.5


def test_it_ends_when_it_was_back_by_the_dead_band_for_as_long() -> None:
    series = (
        hot().add(390, times=10).add(379, times=30).add(378, times=4).add(379).add(378, times=6)
    )
    assert (only(series).end_earliest_us, only(series).end_us, only(series).cleared_us) == (
        at(47),
        at(48),
        at(53),
    )


def test_two_excursions_close_together_are_one_alarm() -> None:
    series = hot().add(390, times=10).add(350, times=4).add(395, times=3).add(350, times=10)
    assert only(series).peak_c == 395
    assert len(replayed(series, [C])) == 2


@pytest.mark.parametrize("setting", ["alarm_high_limit", "alarm_high_delay"])
def test_an_alarm_that_is_off_is_not_evaluated(setting: str) -> None:
    assert replayed(hot().change(setting, "off").add(450, times=50)) == []


# -- gaps ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gap", [3, 30, 3000])
def test_a_gap_does_not_raise(gap: int) -> None:
    """0.3 s beyond the limit before it and 0.1 s behind it: 0.4 s were seen."""
    series = hot().add(390, times=4).add(None, times=gap).add(390, times=2)
    assert replayed(series, [B]) == []
    assert only(series.add(390)).onset_us == at(3)


def test_a_gap_does_not_clear() -> None:
    series = hot().add(390, times=10).add(350, times=3).add(None, times=40).add(350, times=3)
    assert only(series).end_us is None
    assert only(series.add(350, times=2)).end_us == at(13)


def test_ticks_without_rows_are_a_gap_too() -> None:
    assert replayed(hot().add(390, times=4).skip(100).add(390, times=2), [B]) == []


def test_one_reading_that_is_lost_is_bridged() -> None:
    assert only(hot().walk(390, None, 390, None, 390, None, 390)).onset_us == at(3)


def test_onset_behind_a_gap_may_have_been_in_it() -> None:
    episode = only(hot().add(None, times=20).add(390, times=8))
    assert (episode.onset_earliest_us, episode.onset_us) == (at(2), at(23))


def test_a_status_that_was_not_read_is_a_gap() -> None:
    assert replayed(hot().add(390, status=None, times=100)) == []
    assert only(hot().add(390, times=10).add(390, status=None, times=50)).end_us is None


@pytest.mark.parametrize("rows", [True, False])
def test_after_a_while_without_readings_it_is_uncertain(rows: bool) -> None:
    series = hot().add(390, times=10)
    lost = series.add(None, times=600) if rows else series
    if rows:
        assert (only(lost).state, only(lost).is_uncertain) == (State.UNCERTAIN, True)
    else:
        lost = lost.skip(600)
    episode = only(lost.add(390, times=3))
    assert (episode.state, episode.is_uncertain) == (State.ACTIVE, True)


def test_a_short_gap_leaves_no_doubt() -> None:
    assert not only(hot().add(390, times=10).add(None, times=590).add(390)).is_uncertain


# -- what counts -----------------------------------------------------------------------------------


def test_heating_up_is_no_alarm() -> None:
    assert replayed(Series().add(150, times=50).walk(*range(150, 351, 5)).add(350, times=10)) == []


def test_what_is_lost_after_the_first_arrival_is_one() -> None:
    assert only(hot().add(290, times=20)).side == "low"


def test_a_tip_that_is_found_too_hot_and_does_not_cool_counts() -> None:
    assert only(Series().add(400, times=120)).onset_us == at(100)
    assert replayed(Series().walk(*(450 - 0.5 * n for n in range(220)))) == []


def test_a_tool_that_is_put_down_has_none() -> None:
    episode = only(hot().add(390, times=10).add(390, status="stand", times=50))
    assert (episode.end_earliest_us, episode.end_us, episode.end_reason) == (
        at(12),
        at(13),
        "not working",
    )


def test_another_tool_has_to_come_to_the_setting_first() -> None:
    series = hot().add(390, times=10).change("tool").add(390, times=60)
    assert only(series).end_reason == "tool changed"
    assert len(replayed(series.add(350).add(390, times=20), [B])) == 2


def test_an_alarm_that_is_switched_off_ends() -> None:
    assert (
        only(
            hot().add(390, times=10).change("alarm_high_delay", "off").add(390, times=60)
        ).end_reason
        == "switched off"
    )


def test_a_limit_that_was_changed_holds_from_then_on() -> None:
    series = hot().add(375, times=10).change("alarm_high_limit", "370 °C").add(375, times=10)
    assert (only(series).limit_c, only(series).onset_us) == (370, at(13))


@pytest.mark.parametrize("step_us", [-7_200_000_000, 7_200_000_000])
def test_readings_around_a_clock_step_have_times_of_the_new_clock(step_us: int) -> None:
    watch = PortWatch(STATION, 1, PERIOD_S, Rules(), [C])
    for row in setting_rows():
        watch.change(Change(BEFORE_ALL, row.setting, row.readback))
    watch.row(at(0), 0, 350, True, None)
    watch.step(step_us)
    ((_, episode),) = watch.row(at(1) + step_us, 1, 390, True, None)
    assert (episode.onset_earliest_us, episode.onset_us) == (at(0) + step_us, at(1) + step_us)


# -- the recorder and a replay ---------------------------------------------------------------------


def same(series: Series) -> int:
    """Hold what the recorder told against the replay; how many episodes there were."""
    told, found = lived(series), replayed(series, [B], pieces=3)
    for what, names in (
        ("raised", {one.id for one in found}),
        ("cleared", {one.id for one in found if one.end_us is not None}),
        ("uncertain", {one.id for one in found if one.is_uncertain}),
    ):
        assert {event.raw for event in told if event.kind == f"alarm.episode.{what}"} == names
    by_name = {one.id: one for one in found}
    for event in told:
        one = by_name[str(event.raw)]
        times = (
            (one.cleared_us, one.end_earliest_us)
            if event.kind.endswith("cleared")
            else (one.raised_us, one.onset_earliest_us)
        )
        if not event.kind.endswith("uncertain"):
            assert (event.time, event.earliest) == times
    return len(found)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32))
def test_the_recorder_and_a_replay_give_the_same(seed: int) -> None:
    same(random_series(seed))


@pytest.mark.parametrize(("look", "single"), [(1, 1), (3, 2), (4096, 1)])
def test_rows_that_change_nothing_may_be_passed_by(
    look: int, single: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    series = [random_series(seed) for seed in range(40)]
    steps = dict.fromkeys(range(50, 600, 83), 2_000_000)
    monkeypatch.setattr(PortWatch, "quiet_range", lambda _: None)
    row_by_row = [replayed(one, steps_us=steps) for one in series]
    monkeypatch.undo()
    monkeypatch.setattr(from_record, "LOOK_ROWS", look)
    monkeypatch.setattr(from_record, "SINGLE_ROWS", single)
    assert [replayed(one, pieces=3, steps_us=steps) for one in series] == row_by_row
    assert sum(map(len, row_by_row)) > 100


def test_an_alarm_may_begin_behind_rows_that_were_passed_by() -> None:
    series = Series().change("alarm_high_limit", "355 °C").add(None, None, times=100)
    episode = only(series.add(300, "sleep", times=500).add(358, times=20))
    assert (episode.onset_earliest_us, episode.onset_us) == (at(599), at(600))


def test_rows_in_which_nothing_happens_are_not_looked_at_one_by_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    series = (
        hot().add(350, times=5000, setpoint_c=350).add(40, "sleep", times=5000).add(350, times=5000)
    )
    series.add(None, None, times=5000).add(350, times=5000).add(390, times=10).add(350, times=5000)
    taken: list[int] = []
    row = PortWatch.row

    def counted(watch: PortWatch, time_us: int, *others: Any) -> Sequence[Report]:
        taken.append(time_us)
        return row(watch, time_us, *others)

    monkeypatch.setattr(PortWatch, "row", counted)
    assert [one.detector for one in replayed(series)] == [C, B]
    assert len(taken) < 500


def test_random_series_have_episodes_of_every_kind() -> None:
    found = [episode for seed in range(60) for episode in replayed(random_series(seed))]
    assert {episode.end_reason for episode in found} == {
        None,
        "returned",
        "not working",
        "tool changed",
        "switched off",
    }
    assert {(episode.detector, episode.side) for episode in found} == {
        (d, s) for d in (B, C) for s in ("high", "low")
    }
    assert any(episode.is_uncertain for episode in found)
    assert sum(same(random_series(seed)) for seed in range(60)) > 100


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([290, 299, 300, 301, 302, 350, 378, 379, 380, 381, None]),
            st.integers(1, 9),
        ),
        max_size=40,
    )
)
def test_a_gap_behind_any_series_changes_nothing(values: list[tuple[int | None, int]]) -> None:
    short, long = hot(), hot()
    for value, times in values:
        short.add(value, times=times)
        long.add(value, times=times)
    long.add(None, times=300)
    assert list(map(plain, replayed(short))) == list(map(plain, replayed(long)))


# -- a slow second way -----------------------------------------------------------------------------


def uneventful(seed: int) -> Series:
    """As `random_series`, without changes of settings and tools, on a grid."""
    rng = random.Random(seed)
    series, temperature, lost, status = Series(rules={"stale_s": 86400.0}), 340.0, 0, "working"
    for _ in range(400):
        temperature += (
            rng.gauss(0, 3)
            + 0.02 * (350 - temperature)
            + (rng.choice([-45, 45]) if rng.random() < 0.02 else 0)
        )
        temperature = min(max(temperature, 200), 359) if len(series.rows) < 3 else temperature
        lost = rng.randrange(1, 12) if rng.random() < 0.03 else max(lost - 1, 0)
        if rng.random() < 0.01:
            status = "stand" if status == "working" else "working"
        series.add(None if lost else round(temperature), status)
    return series


@pytest.mark.parametrize("detector", [B, C])
def test_a_slow_second_way_gives_the_same(detector: Detector) -> None:
    count = 0
    for seed in range(60):
        series = uneventful(seed)
        found = [plain(one) for one in replayed(series, [detector])]
        for side, limit, delay in (("high", 380.0, 0.5), ("low", 300.0, 1.0)):
            delay, band = (delay, 2.0) if detector is B else (0.0, 0.0)
            expected = by_the_book(series, side, limit, delay, delay, band)
            assert [one for one in found if one.side == side] == expected, (seed, side)
            count += len(expected)
    assert count > 60


# -- speed -----------------------------------------------------------------------------------------


def replay_s(rows: int) -> float:
    """Seconds of the processor for samples as dense with alarms as no line is: 2 s in each
    minute.
    """
    temperature = [390.0 if 300 < place % 600 < 320 else 350.0 for place in range(rows)]
    readings = [
        (T0_US + 100_000 * tick, tick, value, "working", None)
        for tick, value in enumerate(temperature)
    ]
    columns = rows_of(readings)
    changes = [Change(row.time, row.setting, row.readback) for row in setting_rows()]
    sampled = SampledEpisodes(STATION, 1, PERIOD_S, changes)
    begun = time.process_time()
    sampled.feed(columns)
    took = time.process_time() - begun
    assert len(sampled.found) == 2 * len(range(300, rows, 600))
    return took


def test_ten_times_the_samples_take_ten_times_as_long_and_not_a_hundred_times() -> None:
    assert min(replay_s(200_000) for _ in range(2)) < 30 * min(replay_s(20_000) for _ in range(3))


def test_a_row_costs_the_recorder_next_to_nothing() -> None:
    live = LiveAlarms(lambda event: None)
    for setting in setting_rows():
        live.setting(setting)
    rows = [sample_row(at(tick), tick, 350, "working", None) for tick in range(100_000)]
    begun = time.process_time()
    for row in rows:
        live.sample(row)
    # 0.5 µs measured; a busy machine has its time
    assert (time.process_time() - begun) / len(rows) < 20e-6


def test_the_settings_are_those_that_are_followed() -> None:
    assert set(SETTINGS) == {row.setting for row in setting_rows()}
