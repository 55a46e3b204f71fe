"""Joints whose number hangs on the assumptions: it is not known, the range is said, and no rule
about joints is kept by it.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from jbclog.analysis.joints import joints as finding
from jbclog.analysis.joints.doubt import (
    MOST_DOUBT,
    MOST_DOUBT_SLOW,
    Doubt,
    _count_same,
    why_not_known,
)
from jbclog.analysis.joints.draws import SURE_PEAK, Draw
from jbclog.analysis.joints.figure import Figure
from jbclog.analysis.joints.joints import FoundJoints, find_joints
from jbclog.analysis.joints.parameters import JointOptions
from jbclog.analysis.joints.series import Series
from jbclog.analysis.metrics.measures import measure_port
from jbclog.analysis.run_metrics import MeasuredPort
from jbclog.core.rows import StationFacts
from jbclog.record.manifest import Manifest
from support.plants import joint_matrix
from support.plants.joint_matrix import Cell
from support.plants.scripted_tip import soldered

EACH_FIVE = [(15.0 + 5 * number, 16.2 + 5 * number) for number in range(20)]


@pytest.fixture(scope="module")
def clear() -> Series:
    """Joints that nothing hides."""
    return soldered(EACH_FIVE, 120.0)


@pytest.fixture(scope="module")
def faint() -> Series:
    """Every other joint takes hardly more heat than the noise hides."""
    loud, quiet = (
        soldered(EACH_FIVE[::2], 120.0),
        soldered(EACH_FIVE[1::2], 120.0, conductance=0.014, seed=2),
    )
    rows = loud.rows
    cold = np.array(
        [
            any(start - 0.5 <= at < start + 3.5 for start, _ in EACH_FIVE[1::2])
            for at in rows.seconds
        ]
    )
    temperature, power = (
        np.where(cold, getattr(quiet.rows, name), getattr(rows, name))
        for name in ("temperature", "power")
    )
    return replace(loud, rows=replace(rows, temperature=temperature, power=power))


def figures(series: Series, asked: JointOptions | None = None) -> dict[str, Figure]:
    return {one.name: one for one in measure_port(series, "tip", options=asked).figures}


def doubt(found: FoundJoints) -> Doubt:
    assert found.doubt is not None
    return found.doubt


def test_joints_that_stand_clear_are_the_same_under_every_assumption(clear: Series) -> None:
    found = find_joints(clear)
    assert (found.why, len(found.joints)) == (None, 20)
    assert doubt(found).share <= MOST_DOUBT / 4
    assert doubt(found).least <= 20 <= doubt(found).most <= 21


def test_joints_that_hang_on_a_limit_have_no_number_but_a_range(faint: Series) -> None:
    found, measured = find_joints(faint), figures(faint)
    assert doubt(found).share > 1.2 * MOST_DOUBT
    assert doubt(found).least <= 15 < 20 <= doubt(found).most
    assert found.joints, "they are listed all the same"
    for name in (
        "joints",
        "joints_by_heat",
        "joints_not_recovered",
        "recovered_before_next_percent",
        "joint_dwell_s",
        "joint_share_percent",
    ):
        assert measured[name].value is None, name
        assert f"Between {doubt(found).least} and {doubt(found).most} were found" in str(
            measured[name].why
        ), name
    assert measured["joint_depth_c"].value is not None


def test_listed_joints_have_no_dwell_where_their_number_is_not_known(
    clear: Series, faint: Series
) -> None:
    facts = StationFacts("dde-1", "sim://", "dde", ports=[1])
    for series, is_known in ((clear, True), (faint, False)):
        measured = measure_port(series, "tip")
        edges_us = np.zeros(2 * len(measured.joints), dtype=np.int64)
        table = MeasuredPort(facts, 1, measured, edges_us).joint_table(Manifest("run"))
        assert len(table)
        assert table["dwell_s"].null_count == (0 if is_known else len(table))
        if not is_known:
            assert table["why"].null_count == 0
            assert any("were found as limits" in text for text in table["why"].to_pylist())
        assert table["stop_s"].null_count == 0


def test_a_gap_takes_dwell_and_share_with_the_number(clear: Series) -> None:
    """Also where the feeder decides: what lies in the gap is not known."""
    facts = StationFacts("dde-1", "sim://", "dde", ports=[1])
    in_gap = (clear.seconds > 63) & (clear.seconds < 64)
    temperature = np.where(in_gap, np.nan, clear.rows.temperature)
    gap = replace(clear, rows=replace(clear.rows, temperature=temperature))
    at = clear.seconds
    fed = (at % 5 >= 0.3) & (at % 5 < 0.9) & (at > 15) & (at < 115)
    for series, options in (
        (gap, JointOptions()),
        (replace(gap, feeding=fed.astype(float)), JointOptions(wire_decides=True)),
    ):
        measured = measure_port(series, "tip", options=options)
        assert measured.found is not None
        assert (measured.found.why, len(measured.joints)) == (None, 20)
        by_name = {one.name: one for one in measured.figures}
        for name in ("joints", "joint_dwell_s", "joint_share_percent"):
            assert (by_name[name].value, by_name[name].n) == (None, 20), name
            assert "no reading for 1.0 s" in str(by_name[name].why), name
        assert by_name["joint_depth_c"].value is not None
        edges_us = np.zeros(2 * len(measured.joints), dtype=np.int64)
        table = MeasuredPort(facts, 1, measured, edges_us).joint_table(Manifest("run"))
        assert table["dwell_s"].null_count == len(table) == 20
        assert table["why"].null_count == 0
        assert any("no reading for 1.0 s" in text for text in table["why"].to_pylist())


def test_what_noise_makes_of_a_low_limit_is_no_doubt() -> None:
    """Thirteen minutes with four joints and much noise: half the limit finds it four times, and as
    often upside down.
    """
    found = find_joints(
        soldered(
            [(15.0 + 200 * number, 16.2 + 200 * number) for number in range(4)], 800.0, noise_c=1.8
        )
    )
    assert (len(found.joints), found.why) == (4, None)


def test_the_range_of_a_long_record_is_that_of_its_windows_on_the_whole() -> None:
    text = why_not_known(Doubt(0.2, 45, 60, 50, 40.0), 1000, 0.1)
    assert text is not None
    assert text.startswith("Between 900 and 1200 were found")
    assert "20 % of them come or go, 3 % are allowed" in text
    same = why_not_known(Doubt(0.2, 14, 14, 14, 40.0), 14, 0.1)
    assert same is not None
    assert same.startswith("14 were found as limits")
    some = Doubt((MOST_DOUBT + MOST_DOUBT_SLOW) / 2, 45, 60, 50, 40.0)
    assert why_not_known(some, 50, 0.1) is None
    assert why_not_known(some, 50, 0.5) is not None, "slow rates show less"
    none = Doubt(0.0, 0, 0, 0, 40.0)
    assert why_not_known(none, 0, 0.1) is None
    assert "readings 0.5 s apart do not show" in str(why_not_known(none, 0, 0.5))


def test_none_found_is_not_known_where_a_joint_would_not_stand_out() -> None:
    """A heater that switches, 97 joints of 0.3 s: their flow is below four times the noise."""
    (trial,) = joint_matrix.records([Cell("family", "small", 0.3, 0.5, 1)], (5.0,))[5.0]
    found = find_joints(joint_matrix.series_of(trial, 5.0, False))
    assert not found.joints
    assert doubt(found).share == 0.0, "no assumption shows one either"
    assert re.search(r"only a draw of \d{3} ‰ or more stands out", str(found.why))
    at_limit, above = (Doubt(0.0, 0, 0, 0, SURE_PEAK + more) for more in (0.0, 0.1))
    assert why_not_known(at_limit, 0, 0.1) is None
    assert why_not_known(above, 0, 0.1) is not None
    assert why_not_known(above, 1, 0.1) is None


def test_a_long_contact_at_a_slow_rate_may_be_several() -> None:
    drags = [(20.0 + 30 * number, 32.0 + 30 * number) for number in range(5)]
    slow, fast = (find_joints(soldered(drags, 170.0, hz=hz)) for hz in (2.0, 10.0))
    assert len(slow.joints) == 5
    assert doubt(slow).share >= 1 > 0.1 > doubt(fast).share


def test_a_feeder_that_decides_needs_no_number_by_heat(
    faint: Series, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = faint.seconds
    fed = replace(
        faint, feeding=((at % 5 >= 0.3) & (at % 5 < 0.9) & (at > 15) & (at < 115)).astype(float)
    )
    found = find_joints(fed, JointOptions(wire_decides=True))
    assert (found.settings.wire_decides, found.why, len(found.joints)) == (True, None, 20)
    assert found.number_why is not None, "of heat alone"
    monkeypatch.setattr(finding, "why_not_known", lambda *_: None)
    assert find_joints(fed, JointOptions(wire_decides=True)).number_why is None


def test_draws_are_the_same_where_they_overlap_for_half_of_the_shorter() -> None:
    def draws(*spans: tuple[float, float]) -> list[Draw]:
        return [Draw(start, end, end - start, 100.0, 300.0, 1, 0.9) for start, end in spans]

    assert _count_same(draws((1, 2), (5, 6)), draws((1.4, 2.4), (5.6, 6.6))) == 1
    assert _count_same(draws((1, 4)), draws((1, 2), (3, 4))) == 1
    assert _count_same(draws((1, 2), (3, 4)), draws((1, 4))) == 1
    assert _count_same(draws(), draws((1, 4))) == 0
