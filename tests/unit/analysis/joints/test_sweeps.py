"""A port that is read piece by piece has the joints of one that is read as a whole, in memory that
does not grow with its rows.
"""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from jbclog.analysis.joints.heat_up_end import (
    ReadyStretch,
    ready_stretches,
    ready_stretches_of_window,
)
from jbclog.analysis.joints.joints import FoundJoints, find_joints
from jbclog.analysis.joints.parameters import JointOptions
from jbclog.analysis.joints.series import Series, Stretch
from jbclog.analysis.joints.sweeps import PortSweeps
from jbclog.analysis.joints.windows import WINDOW_S, rows_of
from jbclog.analysis.verdict.idle import Block
from support.plants.scripted_tip import after, shown_late, soldered

UNEVEN = [(15 + 4 * n + 0.3 * (n % 3), 16.2 + 4 * n + 0.3 * (n % 5)) for n in range(60)]
LONG = (262.0, 430.0)  # longer than a window of these tests with what is beside it
WINDOWS = (37.0, 61.0, 130.0)
MOST_BYTES = 16e6
BYTES_A_JOINT = 350.0
WEEK_S = 604_800.0


@cache
def record(name: str) -> Series:
    if name == "uneven":  # at 5 Hz, with setpoint changes, one of them in a joint
        changes = ((0.0, 350.0), (120.0, 380.0), (199.9, 330.0), (201.0, 350.0))
        return soldered([*UNEVEN, LONG, (435.0, 436.0)], 450.0, hz=5.0, settings=changes)
    if name == "dense":
        return soldered([(15 + 1.5 * n, 16 + 1.5 * n) for n in range(120)], 230.0)
    if name == "late":
        return shown_late(soldered(UNEVEN[:40], 200.0), 4)
    # another tool
    return after(soldered(UNEVEN[:35], 160.0), soldered(UNEVEN[:30], 150.0, rated_w=60.0), 6.0)


def with_gaps(series: Series, begins: list[int], lost: int) -> Series:
    """Nothing was read in the rows behind each of these; `lost` are single rows.

    The scripted tip repeats itself to the last bit in a long contact. Which of two equal rises is
    its start would hang on the order of a sum, so each power moves by a millionth of a per mille.
    """
    moved = np.random.default_rng(lost).normal(0.0, 1e-6, len(series.seconds))
    temperature, power = series.rows.temperature.copy(), series.rows.power + moved
    for number, begin in enumerate(begins):
        temperature[begin % len(temperature) :][: 6 + 9 * number] = np.nan
    temperature[lost :: 2 * lost] = np.nan
    return replace(series, rows=replace(series.rows, temperature=temperature, power=power))


def joints_in(
    sweep: Callable[[], Iterable[Series]],
    options: JointOptions | None = None,
    window_s: float = WINDOW_S,
) -> FoundJoints:
    """The joints of a port whose rows `sweep` reads in pieces, the same ones each time it is
    called.
    """
    port = PortSweeps(options or JointOptions(), window_s)
    while (windows := port.next_sweep()) is not None:
        for piece in sweep():
            windows.take(piece)
        windows.end()
    return port.found


def in_pieces(series: Series, cuts: list[int]) -> Iterator[Series]:
    places = [0, *sorted(cut % len(series.seconds) for cut in cuts), len(series.seconds)]
    return (rows_of(series, slice(first, last)) for first, last in pairwise(places))


def numbers(found: FoundJoints) -> list[float]:
    """Every number of every joint, draw and level; what is not known as -1, and what is text by
    itself.
    """
    joints = [one for joint in found.joints for one in joint if not isinstance(one, tuple | str)]
    draws = [value for draw in [*(j.draw for j in found.joints), *found.others] for value in draw]
    models = [value for model in found.models for value in model.values.tolist()]
    every = [
        *joints,
        *draws,
        *models,
        *found.levels,
        *found.levels.values(),
        found.unseen_s,
        found.unseen,
    ]
    return [-1.0 if one is None else float(one) for one in every if not isinstance(one, str)]


def texts(found: FoundJoints) -> list[str | None]:
    return [
        found.why,
        found.heat_why,
        *(text for joint in found.joints for text in (joint.why, joint.draw.cut, joint.kind)),
    ]


# shrinking takes minutes
@example("uneven", [332], [1828, 2021, 779, 1259], 187, 37.0)
@settings(max_examples=6, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(
    st.sampled_from(["uneven", "dense", "late", "exchanged"]),
    st.lists(st.integers(1, 5000), max_size=30),
    st.lists(st.integers(1, 5000), max_size=5),
    st.integers(20, 400),
    st.sampled_from(WINDOWS),
)
def test_the_joints_do_not_depend_on_how_the_rows_are_read(
    name: str, cuts: list[int], gaps: list[int], lost: int, window_s: float
) -> None:
    series = with_gaps(record(name), gaps, lost)
    whole, found = (
        find_joints(series),
        joints_in(lambda: in_pieces(series, cuts), window_s=window_s),
    )
    assert len(found.joints) == len(whole.joints)
    assert numbers(found) == pytest.approx(numbers(whole), rel=1e-6, abs=1e-6)
    assert texts(found) == texts(whole)
    assert replace(found.settings, every_s=None) == replace(whole.settings, every_s=None)
    assert found.settings.every_s == (
        None if whole.settings.every_s is None else pytest.approx(whole.settings.every_s)
    )


def test_a_draw_longer_than_a_window_is_one_joint_and_keeps_its_heat() -> None:
    series = record("uneven")
    longest = max(
        joints_in(lambda: [series], window_s=37.0).joints, key=lambda joint: joint.dwell_s or 0.0
    )
    assert (longest.start_s, longest.end_s) == pytest.approx(LONG, abs=0.3)
    assert longest.heat == pytest.approx(
        max(joint.heat or 0.0 for joint in find_joints(series).joints), rel=1e-6
    )


def test_what_is_asked_for_holds() -> None:
    series, asked = record("dense"), JointOptions(least_dwell_s=1.1, recovered_within_c=8.0)
    assert numbers(joints_in(lambda: [series], asked, 61.0)) == pytest.approx(
        numbers(find_joints(series, asked)), rel=1e-6
    )


def test_a_tool_that_left_its_port_before_the_window_is_still_out_of_it() -> None:
    series = record("uneven")
    tool = np.full(len(series.seconds), np.nan)
    tool[:450:25], tool[450] = 1.0, 0.0  # after 90 s, and never read again
    series = replace(series, rows=replace(series.rows, tool=tool, port_error=np.zeros(len(tool))))
    found = joints_in(lambda: [series], window_s=37.0)
    assert found.unseen == 0
    assert 80.0 < max(joint.end_s for joint in found.joints) <= 90.0


def test_a_tip_that_never_gets_near_its_setpoint_stays_ready_in_the_next_window() -> None:
    at = np.arange(600) / 10
    swings = Stretch(0.1, at, 200.0 + 1.8 * at, np.full(600, 900.0), np.full(600, 350.0))
    before = ReadyStretch(swings, np.ones(600, dtype=np.bool_))
    following = swings.take(slice(300, 600))
    assert not ready_stretches([following])[0].ready.any()
    assert ready_stretches_of_window([following], [before])[0].ready.all()


def test_of_a_port_without_rows_nothing_is_known() -> None:
    assert joints_in(list).why == find_joints(rows_of(record("dense"), slice(0, 0))).why


def repeated(seconds: float) -> Iterator[Series]:
    """A tip that is soldered with each 6 s for so long, in pieces of 17 minutes."""
    one = record_of_ten_minutes()
    rows = one.rows
    columns = [
        np.concatenate([column[3000:], column[150:3000]])
        for column in (rows.temperature, rows.power, rows.setting)
    ]
    length = len(columns[0])
    for first in range(0, round(seconds * 10), 10_200):
        at = np.arange(first, min(first + 10_200, round(seconds * 10)))
        there = np.ones(len(at), dtype=np.bool_)
        begun = [
            column[at] if at[-1] < 3000 else None
            for column in (rows.temperature, rows.power, rows.setting)
        ]
        cyclic = [
            column[at % length] if start is None else start
            for column, start in zip(columns, begun, strict=True)
        ]
        yield Series(Block(at / 10, *cyclic, there), there, 0.1, rated_w=130.0)


@cache
def record_of_ten_minutes() -> Series:
    return soldered([(15 + 6 * n, 16.2 + 6 * n) for n in range(97)], 600.0)


def looked_at(seconds: float) -> tuple[float, float, int]:
    """The most memory in bytes, what is left of it, and joints."""
    joints_in(lambda: repeated(300.0))  # what is imported by it is no memory of rows
    tracemalloc.start()
    found = joints_in(lambda: repeated(seconds))
    left, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.why is None
    return most, left, len(found.joints)


def test_memory_does_not_grow_with_the_rows() -> None:
    short, kept_of_few, few = looked_at(1.2 * WINDOW_S)
    long, kept_of_many, many = looked_at(4 * WINDOW_S)
    assert many > 3 * few
    assert short < MOST_BYTES
    assert long - BYTES_A_JOINT * (many - few) < 1.1 * short
    assert kept_of_many - kept_of_few < BYTES_A_JOINT * (many - few)


@pytest.mark.campaign
@pytest.mark.timeout(3600)
def test_a_week_of_a_port_at_10_hz() -> None:
    most, _, joints = looked_at(WEEK_S)
    print(f"week: {most / 1e6:.0f} MB, {joints} joints")
    assert most - BYTES_A_JOINT * joints < MOST_BYTES
