"""The sixth plant keeps its heat and looks like a station; a third of its matrix is a campaign.

`pytest -m campaign tests/unit/analysis/joints/test_sixth_plant.py -n0` prints all tables.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from support.plants import joint_matrix, sixth_plant
from support.plants.joint_matrix import Cell
from support.plants.sixth_plant import BOARD_C, Lived, Load
from support.plants.third_plant import Script, Trial

CELLS = [
    Cell("sixth", *place)
    for place in (
        ("small", 0.3, 0.5),
        ("small", 1.0, 1.0),
        ("medium", 0.8, 1.0),
        ("medium", 3.0, 1.0),
        ("large", 1.0, 2.0),
    )
]
# each tip at rest for 30 s: hot from the beginning, then from cold
RESTS = [
    Script(tip, 30.0, begins_hot, [(0.0, 350.0)])
    for begins_hot in (True, False)
    for tip in joint_matrix.TIPS
]
REST_SEEDS = list(range(1, 7))
SEEDS = [cell.seed for cell in CELLS]
NUMBER = "number of joints wrong, worst tip"
F1_ROWS = (
    *(name for name, *_ in joint_matrix.ROWS if name.endswith("listed")),
    "with a feeder, all of these: F1",
)
# what is true of finding joints as it is, not what is asked of it: F1 of F1_ROWS, at 10, 5 and 2 Hz
HOLDS = ((0.87, 0.90, 0.89, 0.98), (0.88, 0.89, 0.90, 0.97), (0.79, 0.75, 0.55, 0.945))
NUMBER_OFF = (0.03, 0.05, 0.10)  # of the worst tip, where known
HEAT_UP_S = {"small": (1.5, 4.5), "medium": (2.0, 5.0), "large": (5.0, 10.0)}


@pytest.fixture(scope="module")
def rested() -> Lived:
    return sixth_plant.simulate(RESTS, REST_SEEDS)


@pytest.fixture(scope="module")
def scripts() -> list[Script]:
    return [joint_matrix.script_of(cell) for cell in CELLS]


@pytest.fixture(scope="module")
def lived(scripts: list[Script]) -> Lived:
    return sixth_plant.simulate(scripts, SEEDS)


@pytest.fixture(scope="module")
def trials(lived: Lived, scripts: list[Script]) -> list[Trial]:
    return sixth_plant.recorded(lived, scripts, SEEDS, (10.0,))[10.0]


# -- heat ------------------------------------------------------------------------------------------


def test_heat_is_kept(lived: Lived) -> None:
    """What the heater gives is lost, drawn or still there."""
    assert (lived.supplied_j > 300).all()
    assert (lived.drawn_j > 50).all()
    assert lived.supplied_j == pytest.approx(
        lived.lost_j + lived.drawn_j + lived.stored_j, rel=1e-9
    )


def test_a_known_conductance_draws_what_it_must() -> None:
    """Contact and the tip's narrow end, one after the other, into an endless work."""
    load = Load(
        10.0, 30.0, 0.2, 1e9, 0.0, BOARD_C, dry_share=1.0, wets_at=10.0, around=1e9, around_leak=0.0
    )
    script = Script("medium", 30.0, True, [(0.0, 350.0)], touches=[load])
    lived = sixth_plant.simulate([script], [5])
    end = float(lived.plants.end[0])
    through = 0.2 * end / (0.2 + end)
    assert float(lived.drawn_j[0]) / 20 == pytest.approx(through * (350 - BOARD_C), rel=0.15)


def test_it_comes_up_and_holds_its_setting(rested: Lived) -> None:
    for trial in sixth_plant.recorded(rested, RESTS, REST_SEEDS, (10.0,))[10.0]:
        script = trial.script
        if not script.begins_hot:
            least, most = HEAT_UP_S[script.tip]
            assert least < trial.seconds[trial.temperature > 340][0] < most
        settled = trial.seconds > 15
        assert np.nanmax(trial.temperature) <= 360
        assert abs(float(np.nanmean(trial.temperature[settled])) - 350) <= 3
        assert 60 < float(np.nanmean(trial.power[settled])) < 200


# -- scripts and records ---------------------------------------------------------------------------


def test_the_scripts_are_what_their_cell_says(scripts: list[Script]) -> None:
    for cell, script in zip(CELLS, scripts, strict=True):
        joints = [truth for truth in script.truths if truth.is_joint]
        lengths = [joint.end - joint.start for joint in joints]
        gaps = [
            later.start - earlier.end
            for earlier, later in pairwise(script.truths)
            if later.is_joint
        ]
        assert len(joints) >= 20 or script.stands
        assert cell.length - 1e-9 <= min(lengths) <= max(lengths) <= 1.1 * cell.length + 1e-9
        assert min(gaps) >= cell.gap - 1e-9
        assert all(end <= start for (_, end), (start, _) in pairwise(script.feeds))
        assert all(
            any(joint.start < start < end <= joint.end + 1e-9 for joint in joints)
            for start, end in script.feeds
            if (start, end) not in script.dry_feeds
        )


def test_a_reader_gets_whole_numbers_in_range(trials: list[Trial]) -> None:
    for trial in trials:
        known = ~np.isnan(trial.temperature)
        assert 0.98 < known.mean() < 1.0
        for read in (trial.temperature[known], trial.power[known]):
            assert np.array_equal(read, np.round(read))
        assert trial.power[known].min() >= 0
        assert trial.power[known].max() <= 1000
        read_s = trial.seconds[~np.isnan(trial.cycles)][-1]
        assert np.nanmax(trial.cycles) == sum(start <= read_s for start, _ in trial.script.feeds)


def test_a_trial_is_the_same_in_any_company(rested: Lived) -> None:
    alone = sixth_plant.simulate(RESTS[1:2], REST_SEEDS[1:2])
    assert alone.power[0].tolist() == rested.power[1].tolist()
    assert alone.shown_c[0].tolist() == rested.shown_c[1].tolist()
    assert joint_matrix.script_of(CELLS[0]) == joint_matrix.script_of(CELLS[0])


# -- what is found ---------------------------------------------------------------------------------


@pytest.mark.campaign
@pytest.mark.timeout(600)
def test_a_third_of_the_matrix(
    counted: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    cells = joint_matrix.cells_of("sixth", 1)
    found = joint_matrix.outcomes(cells)
    tables = [joint_matrix.rows_told(found)]
    tables += [joint_matrix.apart_told(found)]
    with capsys.disabled():
        print("\n" + "\n\n".join(tables))
    at_ten = [one for one in found if one.hz == 10.0]
    counted(
        trials=len(cells),
        **{"joints on the sixth plant": sum(one.truths for one in at_ten if not one.fed)},
    )
    for hz, least, off in zip(joint_matrix.RATES, HOLDS, NUMBER_OFF, strict=True):
        figures = joint_matrix.figures(found, hz)
        assert figures[NUMBER] <= off, hz
        for name, figure in zip(F1_ROWS, least, strict=True):
            assert figures[name] >= figure, (name, hz)
