"""The feeder as a witness: feeds seen in the motor's state, feeds counted between two readings, and
what both make of draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from jbclog.analysis.joints.evidence import feeds_of
from jbclog.analysis.joints.feed_events import feed_events
from jbclog.analysis.joints.figure import Figure
from jbclog.analysis.joints.joints import FoundJoints, find_joints
from jbclog.analysis.joints.parameters import JointOptions
from jbclog.analysis.joints.port_rows import cycles_of
from jbclog.analysis.joints.series import Cycles, Series
from jbclog.analysis.metrics.measures import measure_port
from support.plants.joint_matrix import Cell, Said, judged, records, series_of
from support.plants.scripted_tip import soldered
from support.plants.third_plant import Trial
from support.records.made_series import Floats, joints_at, made, rest

STARTS = [10.0 + 6 * number for number in range(18)]  # joints of 1.5 s
FEEDS = [(start + 0.3, start + 0.9) for start in STARTS]


def fed(
    seen: Sequence[tuple[float, float]],
    counted: Sequence[float] | None = None,
    starts: Sequence[float] = STARTS,
) -> Series:
    """Joints at `starts` with these feeds."""
    return witnessed(made(120, *joints_at(starts)), seen, counted)


def witnessed(
    series: Series, seen: Sequence[tuple[float, float]], counted: Sequence[float] | None
) -> Series:
    """The motor is seen pushing in `seen`, and the counter, read each 2 s, grows at each moment of
    `counted`.
    """
    at = series.seconds
    motor = sum(
        (((at >= start) & (at < end)).astype(float) for start, end in seen), np.zeros(len(at))
    )
    read = np.arange(0.7, at[-1], 2.0)
    cycles = (
        None
        if counted is None
        else Cycles(read, 40.0 + np.searchsorted(np.sort(counted), read, side="right"))
    )
    return replace(series, feeding=motor, cycles=cycles)


def figures(series: Series) -> dict[str, Figure]:
    return {one.name: one for one in measure_port(series, "tip").figures}


def counts(found: FoundJoints) -> tuple[int, int | None, int, int]:
    seen = found.feeder
    assert seen is not None
    return seen.feeds, seen.counted, seen.feeds_without_draw, seen.draws_without_feed


# -- what is known of feeds ------------------------------------------------------------------------


@pytest.mark.parametrize("side", [0, 1])
def test_a_feed_that_was_seen_and_counted_is_one_whether_it_counts_as_it_begins_or_as_it_ends(
    side: int,
) -> None:
    events = feed_events(fed(FEEDS, [feed[side] for feed in FEEDS]))
    assert events is not None
    assert (len(events.seen), events.counted_only, events.counted, events.number) == (
        18,
        [],
        18,
        18,
    )


def test_a_feed_that_was_not_seen_lies_between_two_readings_of_the_counter() -> None:
    events = feed_events(fed([*FEEDS[:4], *FEEDS[5:]], [end for _, end in FEEDS]))
    assert events is not None
    (one,) = events.counted_only
    assert (one.feeds, one.end_s - one.start_s) == (1, pytest.approx(2.3))
    assert one.start_s < FEEDS[4][1] <= one.end_s


def test_several_pushes_of_one_cycle_are_one_feed() -> None:
    twice = [push for start, end in FEEDS for push in ((start, start + 0.2), (end, end + 0.2))]
    events = feed_events(fed(twice, [end for _, end in FEEDS]))
    assert events is not None
    assert (len(events.seen), events.number) == (18, 18)
    alone = feed_events(fed(twice))
    assert alone is not None
    assert alone.number == 36, "without the counter nobody knows"


def test_a_counter_that_counts_both_pushes_of_a_feed_makes_no_other_feed() -> None:
    """The motor stops for 0.1 s: its readings show that in the first, and do not in the second."""
    pauses = [(STARTS[3] + 0.6, True), (STARTS[9] + 0.6, False)]
    pushes = [
        part
        for start, end in FEEDS
        for part in next(
            (
                [(start, moment), (moment + 0.09, end)]
                for moment, is_shown in pauses
                if start < moment < end and is_shown
            ),
            [(start, end)],
        )
    ]
    counted = sorted([*(end for _, end in FEEDS), *(moment for moment, _ in pauses)])
    events = feed_events(fed(pushes, counted))
    assert events is not None
    assert (len(events.seen), events.counted_only, events.counted) == (18, [], 20)
    series = fed(FEEDS[:9] + FEEDS[10:], [end for _, end in FEEDS])
    assert series.feeding is not None
    lost = (series.seconds >= FEEDS[9][0]) & (series.seconds < FEEDS[9][1])
    unread = feed_events(replace(series, feeding=np.where(lost, np.nan, series.feeding)))
    assert unread is not None
    assert sum(one.feeds for one in unread.counted_only) == 1, "no reading shows that push"


def test_a_counter_that_was_reset_tells_nothing_of_that_time() -> None:
    series = fed([], [end for _, end in FEEDS])
    assert series.cycles is not None
    counted = np.where(
        series.cycles.seconds > 60, series.cycles.counted - 45, series.cycles.counted
    )
    events = feed_events(replace(series, cycles=Cycles(series.cycles.seconds, counted)))
    assert events is not None
    assert events.is_counted(10, 50)
    assert events.is_counted(70, 100)
    assert not events.is_counted(50, 70)
    assert events.counted in (17, 18)


def test_counts_stand_on_the_grid_of_the_rows_also_where_the_clock_was_stepped() -> None:
    seconds: Floats = np.arange(100) / 10
    rows_us = (1_790_000_000_000_000 + 1e6 * seconds + np.where(seconds >= 5, 3600e6, 0)).astype(
        np.int64
    )
    at = rows_us[[20, 70]]
    placed = cycles_of(
        np.array([rows_us[0] - 500_000, *at, rows_us[-1] + 400_000]),
        np.arange(4.0),
        rows_us,
        seconds,
    )
    assert placed.seconds == pytest.approx([-0.5, 2.0, 7.0, 10.3])


# -- feeds and draws -------------------------------------------------------------------------------


def test_a_counted_feed_without_a_draw_is_a_joint_somewhere_between_two_readings() -> None:
    found = find_joints(fed([], [4.0, *(end for _, end in FEEDS)]))
    alone, *others = found.joints
    assert alone.start_s <= 4.0 <= alone.end_s
    assert alone.end_s - alone.start_s < 2.5
    assert (alone.heat, alone.dwell_s, alone.kind, alone.draw.confidence < 0.5) == (
        None,
        None,
        "not known",
        True,
    )
    assert [joint.start_s for joint in others] == pytest.approx(STARTS, abs=0.15)
    assert all(joint.draw.fed and joint.kind == "joint" for joint in others)
    assert counts(found) == (19, 19, 1, 0)


def test_a_draw_of_which_the_counter_says_that_it_had_no_feed_is_told() -> None:
    found = find_joints(fed([], [end for _, end in (*FEEDS[:7], *FEEDS[8:])]))
    assert [number for number, joint in enumerate(found.joints) if joint.draw.fed is False] == [7]
    assert found.joints[7].kind == "not known"
    assert counts(found) == (17, 17, 0, 1)


def test_two_feeds_in_one_draw_are_two_joints_cut_where_the_flow_is_lowest() -> None:
    contacts = [(start, start + 1.0) for start in (15.0, 17.0, 19.0, 21.0, 22.5, 24.5, 26.5)]
    asked, feeds = (
        JointOptions(merge_gap_s=0.8),
        [(start + 0.2, start + 0.6) for start, _ in contacts],
    )
    series = soldered(contacts, 40.0)
    assert len(find_joints(series, asked).joints) == 6
    found = find_joints(witnessed(series, feeds, [end for _, end in feeds]), asked)
    parts = found.joints[3:5]
    assert (len(found.joints), len(found.by_heat)) == (7, 6)
    assert [joint.start_s for joint in parts] == pytest.approx([21.0, 22.3], abs=0.25)
    assert all(joint.draw.confidence <= 0.5 and joint.kind == "joint" for joint in parts)


def test_a_drag_in_which_wire_is_pushed_again_and_again_is_one() -> None:
    """Its flow does not fall between the pushes."""
    drags = [15.0 + 12 * number for number in range(5)]
    series = soldered([(start, start + 5.0) for start in drags], 75.0, leak=0.4)
    pushes = [(start + more, start + more + 0.4) for start in drags for more in (0.5, 2.0, 3.5)]
    found = find_joints(witnessed(series, pushes, None))
    assert [joint.start_s for joint in found.joints] == pytest.approx(drags, abs=0.2)
    assert [joint.end_s for joint in found.joints] == pytest.approx(
        [start + 5.0 for start in drags], abs=0.3
    )


def test_feeds_of_a_tool_that_rests_are_no_joints() -> None:
    series = rest(fed([(4.0, 4.6), *FEEDS], [4.6, *(end for _, end in FEEDS)]), (3.0, 6.0))
    found = find_joints(series)
    assert (len(found.joints), counts(found)[2]) == (18, 1)


def test_a_joint_that_a_feed_follows_before_the_tip_is_back_is_cut_off_not_late() -> None:
    found = find_joints(fed([*FEEDS, (12.2, 12.5)], [*(end for _, end in FEEDS), 12.5]))
    first = found.joints[0]
    assert (first.recovered, first.recovery_s) == (None, None)
    assert "feed" in str(first.why)


def test_where_heat_cannot_tell_the_feeder_does_and_that_is_said() -> None:
    rng = np.random.default_rng(3)
    series = made(
        120,
        lambda at: 350 + rng.integers(-40, 40, len(at)),
        lambda at: rng.integers(0, 1000, len(at)).astype(float),
    )
    assert find_joints(series).why is not None
    found = figures(witnessed(series, FEEDS, [end for _, end in FEEDS]))
    assert (
        found["joints"].value,
        found["joints_fed_alone"].value,
        found["joints_by_feeder"].value,
    ) == (18, 18, 18)
    assert found["joints_by_heat"].value is None
    assert found["recovery_s"].value is None
    asked = find_joints(witnessed(series, FEEDS, None), JointOptions(wire_decides=False))
    assert (asked.joints, asked.why) == ([], asked.heat_why)


def test_joints_are_held_against_the_counter_by_heat_alone() -> None:
    """Half of the feeds have no draw; that the feeder made joints of them keeps no limit."""
    series = fed([], [end for _, end in FEEDS], STARTS[::2])
    found = find_joints(series, JointOptions(wire_decides=True))
    assert len(found.joints) == 18
    against = feeds_of(series, found.by_heat)
    assert (against.found, against.counted) == (9, 18)


# -- where heat shows little -----------------------------------------------------------------------


def lived(cell: Cell, hz: float) -> tuple[Trial, FoundJoints]:
    (trial,) = records([cell], (hz,))[hz]
    return trial, find_joints(series_of(trial, hz, True))


def test_feeds_without_a_draw_decide_though_a_single_draw_has_no_feed() -> None:
    found = find_joints(fed(FEEDS[:6] + FEEDS[7:], starts=STARTS[6:7]))
    assert found.settings.wire_decides
    assert counts(found)[2:] == (17, 1)
    assert len(found.joints) == 18
    more = find_joints(fed(FEEDS[:2], starts=STARTS[2:]))
    assert not more.settings.wire_decides, "sixteen draws without a feed, and two feeds"


def test_a_weak_draw_without_a_feed_is_told_and_is_no_joint() -> None:
    """A heater that overshoots makes short draws of little heat."""
    _, found = lived(Cell("family", "small", 1.0, 2.0), 10.0)
    weak = [draw for draw in found.others if draw.is_unfed]
    assert len(weak) >= 5
    assert all(draw.dwell_s < 0.5 or draw.heat < 65 or draw.peak < 80 for draw in weak)
    assert counts(found)[3] >= len(weak)


def test_feeds_cut_a_draw_in_which_noise_hides_whether_the_flow_fell() -> None:
    trial, found = lived(Cell("third", "large", 1.0, 0.5), 10.0)
    assert sum(truth.is_joint for truth in trial.script.truths) == 48
    assert len(found.joints) >= 40, "46 feeds were seen"


def test_draws_that_are_shown_after_their_feeds_are_moved_to_them() -> None:
    """A station that shows its temperature 0.2 to 0.5 s late: F1 0.71 before."""
    cell = Cell("fifth", "medium", 0.5, 2.0)
    trial, found = lived(cell, 5.0)
    assert found.feeder is not None
    late = {draw.late_s for draw in found.feeder.draws if draw.heat is not None}
    assert len(late) == 1
    assert 0.05 < late.pop() < 0.4
    said = [Said(joint.start_s, joint.end_s, joint.kind) for joint in found.joints]
    assert judged(cell, trial.script, 5.0, True, said).f1 > 0.9
