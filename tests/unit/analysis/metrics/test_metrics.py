"""Each metric on a series made by hand whose right answer is known, with gaps, at 1 Hz, and at the
resolution's limit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from jbclog.analysis.joints.figure import Figure
from jbclog.analysis.joints.joints import find_joints
from jbclog.analysis.joints.series import Cycles, Series
from jbclog.analysis.joints.solder_wire import Wire
from jbclog.analysis.metrics.measures import METRICS, measure_port
from support.records.made_series import Floats, joints_at, line, lose, made, rest, steps


def figures(series: Series, kind: str = "tip", wire: Wire | None = None) -> dict[str, Figure]:
    return {figure.name: figure for figure in measure_port(series, kind, wire).figures}


def value(series: Series, name: str) -> float | None:
    return figures(series)[name].value


# -- what every figure carries ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["tip", "air", "omega"])
def test_every_metric_is_told_in_the_order_of_its_definition_with_a_value_or_a_reason(
    kind: str,
) -> None:
    found = measure_port(made(60), kind).figures
    assert [(figure.name, figure.unit) for figure in found] == [
        (one.name, one.unit) for one in METRICS.values()
    ]
    assert all((figure.value is None) == bool(figure.why) for figure in found)


def test_an_omega_has_none_and_hot_air_has_no_joints() -> None:
    assert {figure.value for figure in measure_port(made(60), "omega").figures} == {None}
    air = figures(made(60), "air")
    assert air["joints"].value is None
    assert "Hot air" in str(air["joints"].why)
    assert air["idle_error_c"].value == 0


def test_nothing_was_read() -> None:
    found = figures(lose(made(60), (0, 60)))
    assert {figure.value for figure in found.values()} == {None}
    assert all(figure.why for figure in found.values())


def test_no_rows_at_all() -> None:
    assert {figure.value for figure in figures(made(0)).values()} == {None}


# -- heating up ------------------------------------------------------------------------------------


def heat_up(overshoot: float = 6.0, hz: float = 10.0) -> Series:
    """Rests at 100 °C, goes to work at 10 s, rises by 50 °C a second to 350 plus `overshoot`, is
    calm from 20 s on.
    """
    top = 15 + overshoot / 50
    course = line((0, 100), (10, 100), (top, 350 + overshoot), (20, 350), (60, 350))
    return rest(made(60, course, steps((0, 0), (10, 1000), (15, 100)), hz=hz), (0, 10))


def test_heat_up_time_is_from_the_order_to_the_band() -> None:
    found = figures(heat_up())["heat_up_time_s"]
    assert found.value == pytest.approx(4.8)  # 240 of 250 °C at 50 °C/s
    assert (found.n, found.coverage, found.resolution) == (1, 100.0, pytest.approx(0.1))


def test_overshoot_and_settling() -> None:
    found = figures(heat_up(6.0))
    assert found["overshoot_c"].value == pytest.approx(6.0, abs=0.15)
    # it falls from 6 to 3 in half of the way to 20 s
    assert found["settling_time_s"].value == pytest.approx(7.5, abs=0.15)


def test_a_tip_that_leaves_the_band_again_has_not_entered_it() -> None:
    course = line((0, 100), (10, 100), (15, 350), (15.4, 390), (17, 390), (18, 350), (60, 350))
    series = rest(made(60, course), (0, 10))
    assert value(series, "heat_up_time_s") == pytest.approx(7.8)  # 10 s to 17.75 s


def test_a_gap_in_a_heat_up_is_no_figure_and_a_single_lost_row_is_none() -> None:
    found = figures(lose(heat_up(), (12.0, 12.5)))["heat_up_time_s"]
    assert found.value is None
    assert "gap" in str(found.why)
    assert value(lose(heat_up(), (12.0, 12.1)), "heat_up_time_s") == pytest.approx(4.8)
    # three periods from reading to reading
    assert value(lose(heat_up(), (12.0, 12.2)), "heat_up_time_s") is None


def test_the_first_heat_up_counts_from_the_order_where_that_is_known() -> None:
    cold = made(60, line((0, 150), (4, 350), (60, 350)))
    assert value(cold, "heat_up_time_s") is None
    assert "beginning" in str(figures(cold)["heat_up_time_s"].why)
    assert value(replace(cold, ordered_s=-0.5), "heat_up_time_s") == pytest.approx(0.5 + 3.8)
    assert value(replace(cold, ordered_s=-60.0), "heat_up_time_s") is None


def test_a_raised_setting_is_a_heat_up_and_a_lowered_one_is_none() -> None:
    raised = made(
        60, line((0, 300), (20, 300), (25, 350), (60, 350)), setting=steps((0, 300), (20, 350))
    )
    assert value(raised, "heat_up_time_s") == pytest.approx(4.0)
    lowered = made(
        60, line((0, 350), (20, 350), (25, 300), (60, 300)), setting=steps((0, 350), (20, 300))
    )
    assert value(lowered, "heat_up_time_s") is None


def test_a_tip_that_never_arrives() -> None:
    found = figures(rest(made(90, line((0, 100), (10, 100), (15, 300), (90, 300))), (0, 10)))[
        "heat_up_time_s"
    ]
    assert found.value is None
    assert "did not reach" in str(found.why)


def test_heat_up_at_one_hertz() -> None:
    found = figures(heat_up(hz=1.0))["heat_up_time_s"]
    assert found.value == pytest.approx(5.0)  # the first reading in the band
    assert found.resolution == pytest.approx(1.0)


# -- idle ------------------------------------------------------------------------------------------


def test_idle_error_spread_and_range() -> None:
    series = made(120, lambda at: 348.0 + 2 * (np.round(at * 10) % 2))  # 348 and 350 in turn
    found = figures(series)
    assert found["idle_error_c"].value == pytest.approx(-1.0)
    assert found["idle_sd_c"].value == pytest.approx(1.0, rel=1e-3)
    assert found["idle_range_c"].value == 2
    assert found["idle_error_c"].resolution == 1.0


def test_a_spread_below_the_resolution_is_unknown_not_zero() -> None:
    found = figures(made(120))["idle_sd_c"]
    assert found.value is None
    assert "whole degrees" in str(found.why)


def test_drift_is_the_slope_and_takes_its_time() -> None:
    drifting = made(1800, lambda at: 350 + at / 600.0)  # 6 °C in an hour
    assert value(drifting, "drift_c_per_h") == pytest.approx(6.0, rel=0.01)
    rounded = made(1800, lambda at: np.round(350 + at / 600.0))
    assert value(rounded, "drift_c_per_h") == pytest.approx(6.0, abs=2.0)
    assert value(made(200, lambda at: 350 + at / 600.0), "drift_c_per_h") is None


def test_drift_does_not_mind_an_outlier() -> None:
    def course(at: Floats) -> Floats:
        return 350 + at / 600.0 + np.where((at > 900) & (at < 920), 2.0, 0.0)

    assert value(made(1800, course), "drift_c_per_h") == pytest.approx(6.0, rel=0.02)


# -- joints ----------------------------------------------------------------------------------------

STARTS = [10.0 + 6 * number for number in range(18)]


def soldering(hz: float = 10.0) -> Series:
    temperature, power = joints_at(STARTS)
    return made(120, temperature, power, hz=hz)


@pytest.mark.parametrize("hz", [10.0, 5.0, 2.0])
def test_every_joint_is_found_where_it_is(hz: float) -> None:
    found = find_joints(soldering(hz)).joints
    assert [joint.start_s for joint in found] == pytest.approx(STARTS, abs=1.2 / hz)
    assert [joint.end_s for joint in found] == pytest.approx(
        [start + 1.5 for start in STARTS], abs=1.2 / hz
    )


def test_depth_recovery_heat_and_energy_of_joints() -> None:
    found = figures(soldering())
    assert found["joints"].value == 18
    assert found["joint_depth_c"].value == pytest.approx(20.0)
    # back to 347 °C at 17 of 20 °C in a second
    assert found["recovery_s"].value == pytest.approx(1.5 + 0.9, abs=0.11)
    assert found["recovery_p95_s"].value == pytest.approx(2.4, abs=0.11)
    assert found["joint_heat_permille_s"].value == pytest.approx(750, rel=0.06)  # 500 ‰ for 1.5 s
    # the tip is 3 °C short of all
    assert found["joint_energy_permille_s"].value == pytest.approx(750 - 200 + 180, rel=0.08)
    assert found["joint_dwell_s"].value == pytest.approx(1.5, abs=0.1)
    assert found["joint_share_percent"].value == pytest.approx(100 * 18 * 1.5 / 120, rel=0.06)


def test_a_joint_beside_a_gap_has_no_recovery_and_the_count_has_no_value() -> None:
    found = figures(lose(soldering(), (12.0, 13.0)))
    assert found["recovery_s"].n == 17
    assert found["recovery_s"].coverage == pytest.approx(100 * 17 / 18, abs=0.01)
    assert found["joints"].value is None
    assert "18 were found" in str(found["joints"].why)


def power_for(
    course: Callable[[Floats], Floats], starts: Sequence[float]
) -> Callable[[Floats], Floats]:
    """The power of a tip of 10 ‰·s/K that goes through this course and gives 500 ‰ away for 1.5 s
    from each start on.
    """

    def power(at: Floats) -> Floats:
        into = sum(np.where((at >= start) & (at < start + 1.5), 500.0, 0.0) for start in starts)
        return (
            100 * (course(at) - 25) / 325
            + 10 * (course(at + 0.05) - course(at - 0.05)) / 0.1
            + into
        )

    return power


def test_the_next_joint_came_before_the_tip_was_back() -> None:
    course = line(
        (0, 350),
        (10, 350),
        (11.5, 330),
        (12.5, 340),
        (20, 340),
        (21.5, 325),
        (22.5, 350),
        (30, 350),
        (31.5, 330),
        (32.5, 350),
    )
    measured = measure_port(made(60, course, power_for(course, [10.0, 20.0, 30.0])), "tip").joints
    assert (measured[0].recovered, measured[0].recovery_s, measured[0].had_s) == (
        False,
        None,
        pytest.approx(10.0, abs=0.2),
    )
    assert "next joint" in str(measured[0].why)
    assert (measured[1].deficit_c, measured[1].resting_below_c) == (
        pytest.approx(10.0),
        pytest.approx(10.0),
    )
    assert measured[-1].recovery_s == pytest.approx(2.4, abs=0.11)


def test_a_tip_that_does_nothing_has_no_joints() -> None:
    quiet = figures(made(120))
    assert quiet["joints"].value == 0
    assert quiet["recovery_s"].value is None


def test_wire_decides_where_a_feeder_tells() -> None:
    wired = lambda at: ((at % 6 >= 4.2) & (at % 6 < 5.0) & (at < 70)).astype(float)  # noqa: E731  # in the first ten joints
    series = soldering()
    found = find_joints(replace(series, feeding=wired(series.seconds)))
    assert found.settings.wire_decides
    alone, *others = found.joints
    # a feed of which no draw was found
    assert (alone.start_s, alone.draw.heat) == (pytest.approx(4.2), None)
    assert alone.draw.confidence < 0.5
    assert [joint.start_s for joint in others] == pytest.approx(STARTS, abs=0.2)
    # without wire they may as well be wipes
    assert [joint.kind for joint in others] == ["joint"] * 10 + ["not known"] * 8
    assert (alone.kind, alone.dwell_s, alone.recovered, alone.deficit_c) == (
        "not known",
        None,
        None,
        None,
    )
    assert "feeder" in str(alone.why)
    seen = found.feeder
    assert seen is not None
    assert (seen.feeds, seen.feeds_without_draw, seen.draws_without_feed) == (11, 1, 8)
    silent = find_joints(replace(series, feeding=np.zeros(len(series.seconds))))
    assert not silent.settings.wire_decides  # nobody feeds here: the wire says nothing
    assert len(silent.joints) == 18


# -- power and energy ------------------------------------------------------------------------------


def test_energy_is_the_integral_and_joules_only_with_a_declared_power() -> None:
    series = made(61, power=line((0, 0), (60, 600), (61, 600)), hz=10.0)
    found = figures(series)
    assert found["energy_permille_s"].value == pytest.approx(18_000 + 0.9 * 600)
    assert found["energy_j"].value is None
    assert "rated_power_w" in str(found["energy_j"].why)
    assert figures(replace(series, rated_w=130.0))["energy_j"].value == pytest.approx(18_540 * 0.13)


def test_energy_with_a_gap_is_unknown_and_its_recorded_part_is_not() -> None:
    found = figures(lose(made(100.1, power=200.0), (40, 50)))
    assert found["energy_permille_s"].value is None
    assert "gap" in str(found["energy_permille_s"].why)
    assert found["energy_recorded_permille_s"].value == pytest.approx(200 * (39.9 + 50.0))
    assert found["energy_recorded_permille_s"].coverage == pytest.approx(90.01, abs=0.05)


@pytest.mark.parametrize("hz", [10.0, 1.0])
def test_duty_mean_power_and_utilisation(hz: float) -> None:
    series = rest(made(100, power=steps((0, 1000), (25, 100), (80, 0)), hz=hz), (80, 100))
    found = figures(series)
    assert found["duty_percent"].value == pytest.approx(100 * 25 / 80)
    assert found["power_mean_permille"].value == pytest.approx((25 * 1000 + 55 * 100) / 80)
    assert found["utilisation_percent"].value == pytest.approx(80)
    assert found["duty_percent"].n == 80 * hz


def test_a_state_that_was_not_read_is_neither_work_nor_rest() -> None:
    series = lose(rest(made(100), (50, 100)), (0, 25))
    assert value(series, "utilisation_percent") == pytest.approx(100 * 25 / 75)


# -- wire ------------------------------------------------------------------------------------------


def fed(mm: list[float], cycles: list[float], set_mm: float | None = 5.0) -> tuple[Series, Wire]:
    """Joints each 6 s, each fed for 0.5 s; counters read each 30 s."""
    series = soldering()
    motor = ((series.seconds % 6 >= 4.2 - 1e-9) & (series.seconds % 6 < 4.7 - 1e-9)).astype(float)
    at = np.arange(len(mm)) * 30.0
    counted = Cycles(at, np.array(cycles))
    return replace(series, feeding=motor, cycles=counted), Wire(at, np.array(mm), set_mm)


def test_wire_per_joint_per_feed_delivered_and_speed() -> None:
    series, wire = fed([100, 124, 148, 172, 196], [40, 45, 50, 55, 60])
    found = figures(
        series, wire=replace(wire, length_s=wire.length_s[:4], length_mm=wire.length_mm[:4])
    )
    assert found["wire_mm"].value == 72
    counted = Cycles(np.arange(4) * 30.0, np.array([40.0, 45.0, 50.0, 55.0]))
    found = figures(
        replace(series, cycles=counted), wire=Wire(wire.length_s[:4], wire.length_mm[:4], 5.0)
    )
    assert found["wire_feeds"].value == 15
    assert found["wire_per_feed_mm"].value == pytest.approx(4.8)
    assert found["wire_delivered_percent"].value == pytest.approx(96.0)
    # joints at 10, 16, ... 88 s, and a feed at 4 s
    assert found["wire_per_joint_mm"].value == pytest.approx(72 / 15)
    assert found["wire_speed_mm_s"].value == pytest.approx(72 / (15 * 0.5))
    assert found["wire_clog_suspicions"].value == 0


def test_a_motor_that_pushes_without_progress_is_suspicious() -> None:
    series, wire = fed([100, 124, 124, 148], [40, 45, 45, 50])
    assert figures(series, wire=wire)["wire_clog_suspicions"].value == 1


def test_a_reset_counter_gives_no_figure() -> None:
    series, wire = fed([100, 124, 10, 20], [40, 45, 0, 5])
    found = figures(series, wire=wire)
    assert found["wire_mm"].value is None
    assert "reset" in str(found["wire_mm"].why)
    assert found["wire_per_joint_mm"].value is None


def test_an_unknown_length_and_a_gap() -> None:
    series, wire = fed([100, 124, 148, 172], [40, 45, 50, 55], None)
    assert figures(series, wire=wire)["wire_delivered_percent"].value is None
    gappy = figures(lose(series, (31, 33)), wire=wire)
    assert gappy["wire_per_joint_mm"].value is None
    assert gappy["wire_speed_mm_s"].value is None
    assert gappy["wire_per_feed_mm"].value == pytest.approx(4.8)


# -- without a grid --------------------------------------------------------------------------------


def test_rows_without_a_grid_are_found_to_have_joints_too() -> None:
    """With ``--rate max`` rows are 40 to 90 ms apart."""
    rng = np.random.default_rng(5)
    at = np.cumsum(rng.uniform(0.04, 0.09, 1800))
    temperature, power = joints_at([start for start in STARTS if start < at[-1] - 5])
    even = made(1, temperature, power)
    block = replace(
        even.rows,
        seconds=at,
        temperature=temperature(at),
        power=power(at),
        setting=np.full(len(at), 350.0),
        working=at > 0,
    )
    series = Series(block, at > 0, float(np.median(np.diff(at))), on_grid=False)
    found = figures(series)
    assert found["joints"].n == len([start for start in STARTS if start < at[-1] - 5])
    assert found["recovery_s"].value == pytest.approx(2.4, abs=0.11)
