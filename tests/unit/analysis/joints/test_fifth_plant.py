"""The fifth plant keeps its heat, and what it says of each draw holds; a slice of what is found on
it.

All of its matrix is found in the campaign `test_joint_matrix`.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from support.plants import fifth_plant, joint_matrix
from support.plants.fifth_plant import BEFORE_S, BOARD_C, EVERY, STEP_S, WIRE_ON_TIP, Lived, Load
from support.plants.joint_matrix import Cell
from support.plants.third_plant import Floats, Script, Trial

CELLS = [
    Cell("fifth", *place)
    for place in (
        ("small", 0.5, 1.0),
        ("small", 1.0, 1.0),
        ("medium", 0.8, 1.0),
        ("medium", 1.0, 0.5),
        ("large", 0.8, 1.0),
        ("large", 1.0, 1.0),
    )
]
SEEDS = [cell.seed for cell in CELLS]
FIRST = round(BEFORE_S / STEP_S)
SLICE_HOLDS = (0.6, 0.9, 0.9, 0.95)  # F1 of the first four rows


@pytest.fixture(scope="module")
def scripts() -> list[Script]:
    return [joint_matrix.script_of(cell) for cell in CELLS]


@pytest.fixture(scope="module")
def lived(scripts: list[Script]) -> Lived:
    return fifth_plant.simulate(scripts, SEEDS, keeps_flow=True)


@pytest.fixture(scope="module")
def trials(lived: Lived, scripts: list[Script]) -> list[Trial]:
    return fifth_plant.recorded(lived, scripts, SEEDS, (10.0,))[10.0]


def flow_of(lived: Lived, n: int) -> Floats:
    """W out of the tip's end, by step of the record."""
    assert lived.drawn_w is not None
    flow: Floats = lived.drawn_w[n, FIRST:]
    return flow


# -- heat ------------------------------------------------------------------------------------------


def test_heat_is_kept(lived: Lived) -> None:
    """What the heater gives is lost, drawn or still there; what is drawn from the tip, work and
    wire have taken.
    """
    assert (lived.supplied_j > 1000).all()
    assert lived.supplied_j == pytest.approx(
        lived.lost_j + lived.drawn_j + lived.stored_j, rel=1e-9
    )
    assert lived.taken_j == pytest.approx(lived.drawn_j, rel=1e-9)


def test_the_heat_of_each_draw_is_the_integral_of_its_flow(
    lived: Lived, scripts: list[Script]
) -> None:
    for n, script in enumerate(scripts):
        flow = flow_of(lived, n)
        for truth, heat in zip(script.truths, lived.heat_j[n], strict=True):
            first, last = round(truth.start / STEP_S), round(truth.end / STEP_S)
            assert heat == pytest.approx(
                STEP_S * float(flow[first - 1 : last + 2].sum()), rel=1e-6
            ), truth
            assert (flow[first + 1 : last - 1] > 0).mean() > (
                0.3 if truth.kind == "wipe" else 0.999
            ), truth
        assert sum(lived.heat_j[n]) == pytest.approx(float(lived.drawn_j[n]), rel=1e-6), (
            "and nothing else draws heat"
        )


LOAD = Load(10.0, 40.0, 0.2, 1e12, 0.0, BOARD_C, wets_s=0.01)  # an endless work, wetted at once
MELTING = Load(10.0, 12.0, 0.2, 0.1, 0.02, BOARD_C, 4.0, 0.1, 10.2, 1.0)
HOT = Script("medium", 40.0, True, [(0.0, 350.0)])
BENCH = [
    replace(HOT, tip="large", touches=[LOAD]),
    replace(HOT, touches=[MELTING]),
    replace(HOT, touches=[replace(MELTING, wire_w=0.0)]),
    *(replace(HOT, tip=tip, begins_hot=False) for tip in fifth_plant.TIPS for _ in range(5)),
]
BENCH_SEEDS = [7, 8, 8, *range(20, 35)]


@pytest.fixture(scope="module")
def bench() -> Lived:
    return fifth_plant.simulate(BENCH, BENCH_SEEDS, keeps_flow=True)


def test_a_known_conductance_draws_what_it_must(bench: Lived) -> None:
    """Conductance × difference, but for the tip's own resistance and the hand; the heater gives it,
    but for the line's voltage.
    """
    drawn = float(flow_of(bench, 0)[3000:].mean())
    assert (
        0.85 * LOAD.conductance * (350 - BOARD_C) < drawn < 1.1 * LOAD.conductance * (350 - BOARD_C)
    )
    rest, loaded = (
        1000 * float(bench.power[0, (FIRST + at) // EVERY : (FIRST + at + 900) // EVERY].mean())
        for at in (0, 3000)
    )
    assert loaded - rest == pytest.approx(1000 * drawn / float(bench.plants.rated[0]), rel=0.25)


def test_wire_is_drawn_with_the_work(bench: Lived) -> None:
    """One second of 4 W: its share on the tip at once, the other from the work, which takes it from
    tip and board.
    """
    more = float(bench.drawn_j[1] - bench.drawn_j[2])
    assert MELTING.wire_w * WIRE_ON_TIP * 0.8 < more < MELTING.wire_w


def test_it_comes_up_and_holds_its_setting(bench: Lived) -> None:
    for trial in fifth_plant.recorded(bench, BENCH, BENCH_SEEDS, (10.0,))[10.0][3:]:
        assert trial.seconds[trial.temperature > 340][0] < 10
        assert np.nanmax(trial.temperature) <= 357
        assert abs(float(np.nanmedian(trial.temperature[200:])) - 350) <= 2


# -- scripts and records ---------------------------------------------------------------------------


def test_the_scripts_are_what_their_cell_says(scripts: list[Script]) -> None:
    for cell, script in zip(CELLS, scripts, strict=True):
        joints = [truth for truth in script.truths if truth.is_joint]
        assert len(joints) >= 20
        assert min(joint.end - joint.start for joint in joints) >= cell.length
        assert max(joint.end - joint.start for joint in joints) <= 1.15 * cell.length + 1e-9
        assert (
            min(
                later.start - earlier.end
                for earlier, later in pairwise(script.truths)
                if later.is_joint
            )
            >= cell.gap - 1e-9
        )
        feeds = [feed for feed in script.feeds if feed not in script.dry_feeds]
        assert all(
            any(joint.start < start < end <= joint.end + 1e-9 for joint in joints)
            for start, end in feeds
        )
    assert {"wipe", "touch"} <= {truth.kind for script in scripts for truth in script.truths}


def test_a_reader_gets_whole_numbers_in_range(trials: list[Trial]) -> None:
    for trial in trials:
        known = ~np.isnan(trial.temperature)
        assert 0.98 < known.mean() < 1.0
        for read in (trial.temperature[known], trial.power[known]):
            assert np.array_equal(read, np.round(read))
        assert trial.power[known].min() >= 0
        assert trial.power[known].max() <= 1000
        read_s = trial.seconds[~np.isnan(trial.cycles)][-1]
        assert np.nanmax(trial.cycles) == sum(
            start <= read_s + 0.025 for start, _ in trial.script.feeds
        )


def test_a_trial_is_the_same_in_any_company(bench: Lived) -> None:
    alone = fifth_plant.simulate([replace(BENCH[1], seconds=14.0)], BENCH_SEEDS[1:2])
    assert alone.power[0].tolist() == bench.power[1, : alone.power.shape[1]].tolist()
    assert alone.felt_c[0].tolist() == bench.felt_c[1, : alone.power.shape[1]].tolist()
    assert joint_matrix.script_of(CELLS[0]) == joint_matrix.script_of(CELLS[0])
    assert joint_matrix.script_of(CELLS[0]) != joint_matrix.script_of(replace(CELLS[0], repeat=1))


# -- what is found ---------------------------------------------------------------------------------


def test_what_is_found_on_the_fifth_plant(trials: list[Trial]) -> None:
    """What is true of finding joints as it is, not what is asked of it."""
    found = joint_matrix.found_in(CELLS, {10.0: trials})
    print(f"\n{joint_matrix.rows_told(found, (10.0,))}\n")
    figures = joint_matrix.figures(found, 10.0)
    assert sum(one.truths for one in found if not one.fed) > 200
    for row, least in zip(joint_matrix.ROWS, SLICE_HOLDS, strict=False):
        assert figures[row[0]] >= least, (row[0], figures[row[0]])
