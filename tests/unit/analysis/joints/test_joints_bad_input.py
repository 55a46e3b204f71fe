"""Joints where the record is poor: each ends in a figure that holds, or in "not known" with its
reason, and never in 0.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jbclog.analysis.joints.figure import Figure
from jbclog.analysis.joints.joints import find_joints
from jbclog.analysis.joints.parameters import JointOptions
from jbclog.analysis.joints.recovery import UNKNOWN_SETPOINT, joints_of
from jbclog.analysis.joints.series import Series
from jbclog.analysis.metrics.measures import measure_port
from support.plants.scripted_tip import after, soldered
from support.records.made_series import lose

EACH_FIVE = [(15.0 + 5 * number, 16.2 + 5 * number) for number in range(20)]


def figure(series: Series, name: str) -> Figure:
    return next(one for one in measure_port(series, "tip").figures if one.name == name)


def starts(series: Series) -> list[float]:
    return [joint.start_s for joint in find_joints(series).joints]


def test_a_run_of_one_joint() -> None:
    series = soldered([(20.0, 21.5)], 40.0)
    found = find_joints(series)
    assert [joint.start_s for joint in found.joints] == pytest.approx([20.0], abs=0.2)
    assert [joint.end_s for joint in found.joints] == pytest.approx([21.5], abs=0.2)
    assert figure(series, "joints").value == 1


def test_a_run_of_none_is_known_to_have_none() -> None:
    assert figure(soldered([], 60.0), "joints").value == 0


def test_a_run_of_a_minute() -> None:
    assert starts(soldered(EACH_FIVE[:8], 60.0)) == pytest.approx(
        [start for start, _ in EACH_FIVE[:8]], abs=0.2
    )


def test_a_tool_that_is_exchanged_has_another_model() -> None:
    light, heavy = (
        soldered(EACH_FIVE, 120.0, rated_w=130.0),
        soldered(EACH_FIVE, 120.0, rated_w=60.0),
    )
    found = find_joints(after(light, heavy, 6.0))
    assert len(found.joints) == 2 * len(EACH_FIVE)
    first, second = (model.capacity for model in found.models)
    assert second == pytest.approx(first * 130 / 60, rel=0.1)


def test_a_setpoint_that_is_changed_makes_no_joint_and_cuts_recovery_off() -> None:
    series = soldered([*EACH_FIVE[:8], (56.0, 57.0)], 90.0, settings=((0.0, 350.0), (56.6, 380.0)))
    joints = find_joints(series).joints
    assert len(joints) == 9
    assert (joints[-1].recovered, joints[-1].recovery_s) == (None, None)
    assert "setpoint changed" in str(joints[-1].why)
    assert all(joint.recovered for joint in joints[:-1])


def test_without_a_setpoint_a_joint_has_its_depth_and_no_recovery() -> None:
    series = soldered(EACH_FIVE[:8], 60.0)
    draws = [joint.draw for joint in find_joints(series).joints]
    assert len(draws) == 8
    at, read = series.seconds, series.rows.temperature
    unset = replace(series, rows=replace(series.rows, setting=np.full(len(at), np.nan)))
    for joint in joints_of(unset, draws, draws, {}, within_c=5.0):
        start_s, end_s = (second + joint.draw.late_s for second in (joint.start_s, joint.end_s))
        lowest = read[(at >= start_s) & (at <= end_s + 1e-6)].min()
        begin = read[np.searchsorted(at, start_s + 1e-6) - 1]
        assert (joint.lowest_c, joint.depth_c) == (lowest, begin - lowest)
        assert joint.end_c is not None
        assert (joint.setpoint_c, joint.deficit_c, joint.resting_below_c) == (None, None, None)
        assert (joint.recovered, joint.recovery_s, joint.had_s, joint.energy) == (None,) * 4
        assert joint.why == UNKNOWN_SETPOINT


def test_power_at_its_limit_for_ten_seconds_is_one_joint() -> None:
    series = soldered([*EACH_FIVE[:4], (40.0, 50.0)], 80.0, conductance=0.9, leak=0.6, rated_w=60.0)
    assert (series.rows.power[405:495] >= 990).mean() > 0.5
    drag = find_joints(series).joints[-1]
    assert (drag.start_s, drag.end_s) == (
        pytest.approx(40.0, abs=0.3),
        pytest.approx(50.0, abs=0.3),
    )


def test_steps_of_a_degree_at_one_hertz_count_or_say_why() -> None:
    found = find_joints(soldered(EACH_FIVE, 120.0, hz=1.0, noise_c=0.0))
    assert found.why is not None or len(found.joints) == pytest.approx(len(EACH_FIVE), abs=2)


def test_a_gap_in_every_joint_leaves_the_count_unknown() -> None:
    series = lose(
        soldered(EACH_FIVE, 120.0), *((start + 0.3, start + 3.3) for start, _ in EACH_FIVE)
    )
    count = figure(series, "joints")
    assert count.value is None
    assert "gap" in str(count.why)
    assert all(
        joint.recovery_s is None
        for joint in find_joints(series).joints
        if joint.why and "gap" in joint.why
    )


def test_how_long_nobody_could_look() -> None:
    """Gaps, and what is too short between two of them; single readings that are lost are bridged,
    and a tool at rest is no gap.
    """
    whole = soldered(EACH_FIVE[:4], 60.0)
    assert (find_joints(whole).unseen_s, find_joints(whole).unseen) == (0, 0)
    one = find_joints(lose(whole, (20.0, 23.0), (40.0, 40.2)))
    assert (one.unseen_s, one.unseen) == (pytest.approx(3.0), 1)
    between = find_joints(lose(whole, (20.0, 23.0), (25.0, 28.0)))
    assert (between.unseen_s, between.unseen) == (pytest.approx(8.0), 1)
    rows = whole.rows
    gone = (whole.seconds > 30.05) & (whole.seconds < 34.95)
    absent = replace(whole, rows=rows.take(~gone), known=whole.known[~gone])
    assert (find_joints(absent).unseen_s, find_joints(absent).unseen) == (pytest.approx(4.9), 1)
    stood = replace(whole, rows=replace(rows, working=rows.working & ~gone))
    assert find_joints(stood).unseen == 0


def test_a_joint_that_the_record_cuts_off_is_censored() -> None:
    joints = find_joints(soldered([*EACH_FIVE[:6], (45.0, 50.0)], 46.0)).joints
    assert len(joints) == 7
    assert joints[-1].recovered is None
    assert joints[-1].draw.cut is not None


def test_a_heat_up_is_no_joint_and_neither_is_a_joint_in_it() -> None:
    series = soldered([(1.0, 1.6), *EACH_FIVE[:8]], 60.0, rated_w=60.0)
    assert starts(series) == pytest.approx([start for start, _ in EACH_FIVE[:8]], abs=0.2)


@pytest.mark.parametrize(("length", "gap"), [(0.8, 1.0), (2.0, 1.2), (1.0, 0.5)])
def test_a_line_that_never_rests_never_recovers(length: float, gap: float) -> None:
    """The deficit is measured from the setpoint, and the joint that the next one follows is not
    recovered.
    """
    every = [
        (15.0 + (length + gap) * number, 15.0 + length + (length + gap) * number)
        for number in range(25)
    ]
    found = find_joints(
        soldered(every, every[-1][1] + 1.0, conductance=0.8, leak=0.4, rated_w=50.0)
    )
    assert len(found.joints) == pytest.approx(25, abs=1)
    late = [joint for joint in found.joints[3:-1] if joint.recovered is False]
    assert len(late) >= 19
    assert np.median([joint.deficit_c or 0.0 for joint in late]) > 5
    assert all("next joint" in str(joint.why) and joint.recovery_s is None for joint in late)


def test_what_a_recipe_asks_for() -> None:
    series = soldered([(15.0, 15.4), (20.0, 21.0), (21.4, 22.4), (30.0, 31.0)], 45.0)
    assert len(find_joints(series).joints) == 4
    assert len(find_joints(series, JointOptions(least_dwell_s=0.7)).joints) == 3
    assert len(find_joints(series, JointOptions(merge_gap_s=0.8)).joints) == 3
    assert find_joints(series).settings.least_dwell_s == 0.25  # what was taken is said
    narrow, wide = (
        find_joints(series, JointOptions(recovered_within_c=within)).joints[-1]
        for within in (1.0, 20.0)
    )
    assert (narrow.recovery_s or 99.0) > (wide.recovery_s or 0.0)


def test_wire_decides_by_what_the_recipe_says() -> None:
    series = soldered(EACH_FIVE, 120.0)
    at = series.seconds
    few = ((at % 5 >= 0.3) & (at % 5 < 0.9) & (at > 15) & (at < 40)).astype(float)
    fed = replace(series, feeding=few)
    # a quarter of them: the feeder is not what makes the joints
    assert not find_joints(fed).settings.wire_decides
    assert len(find_joints(fed).joints) == 20
    asked = find_joints(fed, JointOptions(wire_decides=True))
    assert (asked.settings.wire_decides, [joint.kind for joint in asked.joints]) == (
        True,
        ["joint"] * 5 + ["not known"] * 15,
    )
