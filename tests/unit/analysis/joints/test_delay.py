"""A temperature that is shown later than the power: the delay is found from the record, and joints
stand where they were.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jbclog.analysis.joints.delay import LEAST_S, delay_of
from jbclog.analysis.joints.heat_up_end import ready_stretches
from jbclog.analysis.joints.joints import FoundJoints, find_joints
from jbclog.analysis.joints.series import Series, stretches
from jbclog.analysis.joints.thermal import Delay
from jbclog.analysis.joints.windows import rows_of
from jbclog.analysis.metrics.measures import measure_port
from support.plants.scripted_tip import shown_late, soldered

CONTACTS = [(15.0 + 3.1 * number, 16.0 + 3.1 * number + 0.2 * (number % 4)) for number in range(20)]


@pytest.fixture(scope="module")
def in_time() -> Series:
    return soldered(CONTACTS, 85.0)


def found_delay(series: Series) -> Delay:
    return delay_of(ready_stretches(stretches(series)))


def edges(found: FoundJoints) -> tuple[float, float]:
    """How much later than they were the joints begin and end, in the median."""
    assert len(found.joints) == len(CONTACTS)
    pairs = zip(found.joints, CONTACTS, strict=True)
    off = np.array([(joint.start_s - start, joint.end_s - end) for joint, (start, end) in pairs])
    return float(np.median(off[:, 0])), float(np.median(off[:, 1]))


@pytest.mark.parametrize("rows", [2, 4, 6])
def test_a_late_temperature_is_found_and_joints_stand_where_they_were(
    in_time: Series, rows: int
) -> None:
    before, late = find_joints(in_time), find_joints(shown_late(in_time, rows))
    assert before.model is not None
    assert late.model is not None
    assert before.model.delay.rows == 0
    assert late.model.delay.seconds == pytest.approx(0.1 * rows, abs=0.06)
    assert edges(late) == pytest.approx(edges(before), abs=0.08)
    for name in ("deficit_c", "depth_c", "lowest_c", "recovery_s", "heat", "energy"):
        one, other = (
            np.array([getattr(joint, name) for joint in found.joints[1:]], dtype=float)
            for found in (before, late)
        )
        assert np.nanmedian(other) == pytest.approx(np.nanmedian(one), rel=0.1, abs=0.5), name


def test_a_power_that_is_late_moves_nothing(in_time: Series) -> None:
    rows = in_time.rows
    power = np.concatenate([np.full(3, rows.power[0]), rows.power[:-3]])
    delay = found_delay(replace(in_time, rows=replace(rows, power=power)))
    assert delay.seconds == pytest.approx(-0.3, abs=0.1)
    assert (delay.rows, delay.moved_s) == (0, 0.0)


def test_what_is_less_than_a_regulator_may_lead_by_is_no_delay(in_time: Series) -> None:
    delay = found_delay(in_time)
    assert delay.seconds is not None
    assert abs(delay.seconds) < LEAST_S
    assert (delay.rows, delay.moved_s) == (0, 0.0)


def test_where_the_record_cannot_tell_the_delay_is_not_known(in_time: Series) -> None:
    slow = found_delay(soldered(CONTACTS, 85.0, hz=2.0))
    assert (slow.seconds, slow.rows) == (None, 0)
    assert "0.5 s apart" in str(slow.why)
    noise = np.random.default_rng(4)
    power = noise.uniform(100, 900, len(in_time.seconds))
    loose = found_delay(replace(in_time, rows=replace(in_time.rows, power=power)))
    assert (loose.seconds, loose.rows) == (None, 0)
    assert "it takes 0.6" in str(loose.why)
    full = found_delay(
        replace(in_time, rows=replace(in_time.rows, power=np.full(len(power), 1000.0)))
    )
    assert (full.seconds, "it takes 100" in str(full.why)) == (None, True)


def test_the_delay_is_a_figure_of_the_run(in_time: Series) -> None:
    late, slow = (
        {one.name: one for one in measure_port(series, "tip").figures}["temperature_delay_s"]
        for series in (shown_late(in_time, 4), soldered(CONTACTS, 85.0, hz=2.0))
    )
    assert late.value == pytest.approx(0.4, abs=0.06)
    assert late.resolution is not None
    assert 0 < late.resolution < 0.1
    assert slow.value is None
    assert slow.why


def test_a_delay_that_only_the_heat_balance_shows_moves_joints_as_well(in_time: Series) -> None:
    """Of 0.1 s the regulator, which hesitates, shows 0.055 s: too little to count."""
    before, late = find_joints(in_time), find_joints(shown_late(in_time, 1))
    assert before.model is not None
    assert late.model is not None
    assert late.model.delay.rows == 0
    assert late.model.delay.moved_s > 2 * late.model.uncertainties[3]
    assert edges(late) == pytest.approx(edges(before), abs=0.05)


def test_without_a_heat_up_the_heat_balance_moves_nothing(in_time: Series) -> None:
    hot = find_joints(rows_of(shown_late(in_time, 1), slice(140, None)))
    assert hot.model is not None
    assert hot.model.lag_s < -2 * hot.model.uncertainties[3]
    assert hot.model.delay.moved_s == 0.0
