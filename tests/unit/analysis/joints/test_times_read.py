"""Joints are fitted and placed by when a reading was made, not by when it was due; and they keep
the bounds that the raw power sets.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jbclog.analysis.joint_bounds import JointTimes, PortBounds
from jbclog.analysis.joints.joints import FoundJoints, find_joints
from jbclog.analysis.joints.packed import floats_of
from jbclog.analysis.joints.port_rows import Clock
from jbclog.analysis.joints.series import Series, stretches
from jbclog.analysis.joints.windows import whole
from jbclog.analysis.metrics.measures import measure_port
from jbclog.analysis.port_data import Floats
from support.plants import joint_matrix, scripted_tip
from support.records import second_port

DUE_S = np.array([2.0, 2.2, 2.4, 2.6])


def by_due_times(series: Series) -> Series:
    return replace(series, read_s=None)


def bounds_of(series: Series, found: FoundJoints) -> list[str]:
    """Return what breaks the bounds, of these joints in these rows."""
    joints = found.joints
    starts, dwells, recoveries, late_s = (
        floats_of(joints, name) for name in ("start_s", "dwell_s", "recovery_s", "late_s")
    )
    share = 100 * float(np.nansum(dwells)) / (series.rows.working.sum() * series.period_s)
    assert found.model is not None
    delay_s = float(late_s[0]) if len(late_s) else 0.0
    times = JointTimes(starts, dwells, recoveries)
    bounds = PortBounds(found.model.loss, delay_s, times, share)
    bounds.look(whole(series))
    return list(bounds.texts())


def test_the_dwell_of_a_second_port_is_what_it_solders() -> None:
    series = second_port.second_port()
    found = {one.name: one for one in measure_port(series, "tip").figures}
    assert found["joints"].value == second_port.JOINTS
    assert found["joint_dwell_s"].value == pytest.approx(second_port.DWELL_S, abs=0.2)
    assert 20 < (found["joint_share_percent"].value or 0) < 30


def test_by_due_times_it_would_be_twice_as_long_and_break_both_bounds() -> None:
    series = second_port.second_port()
    wrong = find_joints(by_due_times(series))
    assert np.median(floats_of(wrong.joints, "dwell_s")) > 1.7 * second_port.DWELL_S
    dwell, share = bounds_of(series, wrong)
    assert "joints last after their tip was back" in dwell
    assert "of the working time, but the power shows work in" in share
    assert bounds_of(series, find_joints(series)) == []


def test_readings_that_are_late_by_turns_give_the_joints_of_those_in_time() -> None:
    contacts = [(15.0 + 6 * number, 16.5 + 6 * number) for number in range(20)]
    fine = scripted_tip.soldered(contacts, 140.0, hz=100.0)
    rows = 10 * np.arange(len(fine.seconds) // 10) + np.tile([0, 4, 1, 7], 350)
    columns = (fine.rows.temperature, fine.rows.power, fine.rows.setting, fine.rows.working)
    temperature, power, _, working = (column[rows] for column in columns)
    due_s = np.arange(len(rows)) / 10
    setting = np.where(np.arange(len(rows)) % 50 == 0, 350.0, np.nan)
    block = replace(
        fine.rows,
        seconds=due_s,
        temperature=temperature,
        power=power,
        setting=setting,
        working=working,
    )
    series = Series(block, working, 0.1, rated_w=130.0, read_s=rows / 100)
    joints = find_joints(series).joints
    assert len(joints) == len(contacts)
    starts, ends = (floats_of(joints, name) for name in ("start_s", "end_s"))
    truth = np.array(contacts)
    assert np.abs(starts - truth[:, 0]).max() < 0.1
    assert np.abs(ends - truth[:, 1]).max() < 0.2


def read_s(utc_s: Floats, late_s: Floats, scan_s: Floats) -> Floats:
    read = Clock(0.2, (), 0).read_s(
        DUE_S, np.round(utc_s * 1e6).astype(np.int64), late_s * 1e6, scan_s * 1e6
    )
    assert read is not None
    return read


def test_a_reading_has_its_recorded_time() -> None:
    later_s, scan_s = np.array([0.062, 0.046, 0.047, 0.046]), np.full(4, 0.01)
    assert read_s(DUE_S + later_s, later_s - 0.004, scan_s) == pytest.approx(DUE_S + later_s)


def test_a_corrected_wall_clock_moves_no_reading_out_of_its_row() -> None:
    """By less than half a second it is corrected without an event."""
    later_s, scan_s = np.full(4, 0.046), np.full(4, 0.01)
    utc_s = DUE_S + later_s + np.array([0.0, 0.3, 0.3, -7200.0])
    found = read_s(utc_s, later_s - 0.004, scan_s)
    assert np.abs(found - DUE_S - later_s).max() <= 0.01


def test_a_row_without_a_question_keeps_its_due_time_and_time_never_falls() -> None:
    late_s = np.array([0.0, 0.0, np.nan, 0.0])
    scan_s = np.array([0.01, 0.5, np.nan, 0.01])
    found = read_s(DUE_S + np.array([0.0, 0.45, 0.0, 0.1]), late_s, scan_s)
    assert found == pytest.approx([2.0, 2.65, 2.65, 2.65])
    none = np.array([np.nan])
    assert Clock(None, (), 0).read_s(DUE_S[:1], np.array([2_000_000]), none, none) is None


@pytest.mark.parametrize("plant", ["sim", "second", "late", "third", "fifth"])
def test_joints_whose_number_is_known_keep_the_bounds_on_every_plant(plant: str) -> None:
    """Also where the regulator brings the tip back while the work still draws heat."""
    cells = [one for one in joint_matrix.cells_of(plant) if one.gap == 2.0][::3]
    known = 0
    for hz, trials in joint_matrix.records(cells, (10.0, 5.0)).items():
        for trial in trials:
            series = joint_matrix.series_of(trial, hz, fed=False)
            found = find_joints(series)
            if found.why is None and found.model is not None:
                known += 1
                assert bounds_of(series, found) == [], trial
    assert known


def test_joints_that_begin_in_an_overheat_are_not_compared() -> None:
    series = second_port.second_port()
    found = find_joints(series)
    assert found.model is not None
    names = ("start_s", "dwell_s", "recovery_s")
    starts, dwells, recoveries = (floats_of(found.joints, name) for name in names)
    for hot, texts in ((np.nan, 0), (1.0, 1)):
        times = JointTimes(starts, dwells + 1.5, recoveries * hot)
        bounds = PortBounds(found.model.loss, 0.0, times, None)
        bounds.look(whole(series))
        assert len(list(bounds.texts())) == texts


LATE_CONTACTS = [(15.0 + 5 * number, 16.6 + 5 * number) for number in range(20)]
LATE_TICK = 40 * 5 + 3  # due at 40.6 s, in a joint


def with_late_reading(late_s: float, hz: float = 5.0) -> Series:
    """Return a record in which the reading due at 40.6 s came late, and the rows that were due
    until then are skipped: stamped with the time at which they were due.
    """
    fine = scripted_tip.soldered(LATE_CONTACTS, 120.0, hz=100.0)
    step = round(100 / hz)
    ticks = np.arange(len(fine.seconds) // step)
    due_s = ticks / hz
    late_tick = round(LATE_TICK / 5 * hz)
    after_s = np.full(len(ticks), 0.02)
    after_s[late_tick] = late_s
    skipped = (ticks > late_tick) & (due_s < due_s[late_tick] + late_s)
    rows = step * ticks + np.round(100 * after_s).astype(np.int64)
    temperature, power = (
        np.where(skipped, np.nan, column[rows])
        for column in (fine.rows.temperature, fine.rows.power)
    )
    working = ~skipped
    setting = np.where((ticks % 25 == 0) & working, 350.0, np.nan)
    block = replace(
        fine.rows,
        seconds=due_s,
        temperature=temperature,
        power=power,
        setting=setting,
        working=working,
    )
    after_s[skipped] = 0.0
    nan = np.where(skipped, np.nan, 0.0)
    utc_us = np.round((due_s + after_s) * 1e6).astype(np.int64)
    read = Clock(1 / hz, (), 0).read_s(due_s, utc_us, nan, nan + 1e6 * (after_s + 0.01))
    return Series(block, working, 1 / hz, rated_w=130.0, read_s=read)


@pytest.mark.parametrize(("hz", "late_s"), [(5.0, 0.6), (10.0, 0.62)])
def test_a_late_reading_cuts_no_joint_at_the_rows_that_were_skipped_for_it(
    hz: float, late_s: float
) -> None:
    series = with_late_reading(late_s, hz)
    assert np.diff(series.rows.seconds[series.known]).max() > 0.5
    found = find_joints(series)
    assert len(found.joints) == len(LATE_CONTACTS)
    assert not any(joint.draw.cut for joint in found.joints)
    (late,) = (joint for joint in found.joints if 39 < joint.start_s < 43)
    truth_s = next(end for start, end in LATE_CONTACTS if start == 40.0)
    assert late.draw.end_s == pytest.approx(truth_s, abs=0.3)


def test_the_time_before_a_very_late_reading_is_a_gap_that_was_not_seen() -> None:
    at_work = with_late_reading(9.0)
    rests = (at_work.seconds > 36) & (at_work.seconds < 60)
    at_rest = replace(at_work, rows=replace(at_work.rows, working=at_work.rows.working & ~rests))
    for series in (at_work, at_rest):
        found = find_joints(series)
        starts = floats_of(found.joints, "start_s")
        assert not ((starts > 41) & (starts < 49)).any()
        assert found.unseen_s == pytest.approx(9.0, abs=0.5)
        assert found.unseen == 1


def test_rows_absent_between_readings_in_time_cut_a_stretch() -> None:
    series = with_late_reading(0.0)
    absent = (series.seconds > 40.7) & (series.seconds < 41.3)
    temperature = np.where(absent, np.nan, series.rows.temperature)
    gap = replace(series, rows=replace(series.rows, temperature=temperature))
    assert [len(stretches(one)) for one in (series, gap)] == [1, 2]
