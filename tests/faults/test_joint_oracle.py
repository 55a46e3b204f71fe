"""What the record of the third and of the fifth plant holds: joints by one who knows the plant.

The figures beside those of the product: `pytest -m campaign -n0` of this file prints them. The
product is not chosen by them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np
import pytest

from support.plants import joint_matrix, joint_oracle, third_plant
from support.plants.joint_matrix import Cell, Outcome
from support.plants.joint_oracle import LAW, OBSERVERS, RHYTHM, Observer
from support.plants.third_plant import Script

RATES = (10.0, 5.0)
FEW = 1000  # particles, for a slice
SLICE = {plant: Cell(plant, "small", 0.5, 1.0) for plant in ("third", "fifth")}
# the median of how far a reading is off that was foretold, °C and ‰: less than by a plant whose
# power is told 50 ms early, or whose display lags by half as much
FORETOLD = {"third": (0.8, 55.0), "fifth": (0.75, 20.0)}
# F1 of joints of at least 0.5 s a second apart, and of 0.8 s half a second apart: what is true with
# so many particles
HOLDS = {
    ("third", RHYTHM): (0.98, 0.98),
    ("third", LAW): (0.96, 0.95),
    ("fifth", RHYTHM): (0.97, 0.97),
    ("fifth", LAW): (0.92, 0.90),
}


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    if joint_oracle.COMPILER is None:
        pytest.skip("needs a C compiler, for the particle filter")
    return joint_oracle.compiled(tmp_path_factory.mktemp("joint_oracle"))


@pytest.mark.parametrize("observer", OBSERVERS, ids=lambda one: one.name)
@pytest.mark.parametrize("plant", sorted(SLICE))
def test_who_knows_the_plant_finds_the_joints(
    library: ctypes.CDLL, monkeypatch: pytest.MonkeyPatch, plant: str, observer: Observer
) -> None:
    cell = SLICE[plant]
    monkeypatch.setitem(joint_oracle.PARTICLES, plant, (FEW, FEW))
    trial = joint_matrix.records([cell], (10.0,))[10.0][0]
    told = joint_oracle.tell(library, cell, trial, observer)
    said = joint_oracle.joints(told.contact, told.start, told.end)
    found = joint_matrix.judged(cell, trial.script, 10.0, False, said)
    assert found.truths > 40
    assert found.f1 >= 0.9
    assert joint_matrix.edges_near([found]) >= 0.9
    off_c, off_permille = (float(np.median(np.abs(off))) for off in (told.off_c, told.off_permille))
    most_c, most_permille = FORETOLD[plant]
    assert off_c < most_c, "its plant is another than the trial's"
    assert off_permille < most_permille


def test_who_knows_the_rhythm_says_none_where_none_are(
    library: ctypes.CDLL, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Although joints a second apart are what is expected."""
    cell = Cell("third", "large", 1.0, 1.0)
    monkeypatch.setitem(joint_oracle.PARTICLES, "third", (FEW, FEW))
    script = Script("large", 90.0, True, [(0.0, 350.0)], touches=[third_plant.NO_TOUCH])
    trial = third_plant.trials([script], [cell.seed], (10.0,))[10.0][0]
    found = joint_oracle.outcome_of(library, cell, trial, 10.0, RHYTHM)
    assert (found.truths, found.false) == (0, 0)


def test_other_tests_keep_their_subnormal_numbers(library: ctypes.CDLL) -> None:
    smallest = np.nextafter(np.zeros(1), 1.0)
    assert library is not None
    assert (smallest * 2 / 2 > 0).all()


def test_a_joint_is_from_the_median_of_its_start_to_that_of_its_end() -> None:
    """Two joints whose gap is certain, but not where it is, are two."""
    contact, start, end = np.zeros(100), np.zeros(100), np.zeros(100)
    start[[10, 11, 12]], end[[30, 31, 32]] = (0.2, 0.6, 0.2), (0.2, 0.2, 0.6)
    start[[34, 36]], end[50] = (0.5, 0.5), 1.0
    contact = (start - end).cumsum()
    said = joint_oracle.joints(contact, start, end)
    edges = [edge for one in said for edge in (one.start, one.end)]
    assert edges == pytest.approx([0.44, 1.28, 1.36, 2.0])
    for share, number in ((0.4, 1), (0.2, 0)):  # of two that are hardly expected
        said = joint_oracle.joints(share * contact, share * start, share * end)
        assert len(said) == number


def ninth(plant: str) -> list[Cell]:
    """Each length and gap once, with one tip after the other."""
    places = [(length, gap) for length in joint_matrix.LENGTHS for gap in joint_matrix.GAPS]
    tips = joint_matrix.TIPS
    return [Cell(plant, tips[(n + n // 6) % 3], *place) for n, place in enumerate(places)]


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("observer", OBSERVERS, ids=lambda one: one.name)
@pytest.mark.parametrize("plant", sorted(SLICE))
def test_what_the_record_holds(
    library: ctypes.CDLL,
    plant: str,
    observer: Observer,
    counted: Callable[..., None],
    capsys: pytest.CaptureFixture[str],
) -> None:
    cells = ninth(plant)
    lived = joint_matrix.records(cells, RATES)
    known: list[Outcome] = []
    product: list[Outcome] = []
    for hz in RATES:
        for cell, trial in zip(cells, lived[hz], strict=True):
            known.append(joint_oracle.outcome_of(library, cell, trial, hz, observer))
            product.append(joint_matrix.outcome_of(cell, trial, hz, False))
    with capsys.disabled():
        print(f"\n{plant} plant, who knows {observer.name}; then jbclog\n")
        for found in (known, product):
            print(joint_matrix.rows_told(found, RATES) + "\n")
    counted(trials=len(known))
    for hz in RATES:
        figures = joint_matrix.figures(known, hz)
        rows = (row for row, *_ in joint_matrix.ROWS[:2])
        for row, least in zip(rows, HOLDS[plant, observer], strict=True):
            assert figures[row] >= least, (row, hz)
