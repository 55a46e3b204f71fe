"""Joints of every length, gap and rate on six plants and three tips (`joint_matrix`).

On the third plant and the fifth nothing is tuned.

`pytest -m campaign tests/unit/analysis/joints/test_joint_matrix.py -n0` prints all tables.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from support.plants import joint_matrix, third_plant
from support.plants.joint_matrix import GAPS, LENGTHS, Cell, Said, judged
from support.plants.third_plant import Script, Trial, Truth

# 432 trials a plant; the first third of them (`repeat` 0) was fixed before anything was run
REPEATS = 3
SLICE = [
    Cell("third", tip, *place)
    for tip in joint_matrix.TIPS
    for place in ((0.5, 2.0), (0.8, 1.0), (2.0, 1.2), (1.0, 0.5))
]
LONG, DENSE, BUSY, FED, WORST, NUMBER, EDGES = (name for name, *_ in joint_matrix.ROWS[:7])
LONG_LISTED, DENSE_LISTED, BUSY_LISTED = (
    name for name, *_ in joint_matrix.ROWS if name.endswith("listed")
)
# of the joints that are listed, whether their number is known or not
F1_ROWS = (LONG_LISTED, DENSE_LISTED, BUSY_LISTED, FED)
SLICE_HOLDS = {LONG_LISTED: 0.80, DENSE_LISTED: 0.66, BUSY_LISTED: 0.61, FED: 0.95, EDGES: 0.69}
# what is true of finding joints as it is, not what is asked of it: F1 of F1_ROWS, at 10, 5 and 2 Hz
HOLDS = {
    "sim": ((0.95, 0.95, 0.93, 0.99), (0.94, 0.94, 0.93, 0.99), (0.80, 0.74, 0.43, 0.96)),
    "second": ((0.96, 0.96, 0.95, 0.99), (0.95, 0.95, 0.92, 0.99), (0.83, 0.79, 0.56, 0.97)),
    "family": ((0.90, 0.91, 0.90, 0.97), (0.86, 0.86, 0.86, 0.95), (0.70, 0.70, 0.55, 0.93)),
    "late": ((0.93, 0.95, 0.88, 0.98), (0.93, 0.95, 0.95, 0.98), (0.83, 0.79, 0.60, 0.96)),
    "third": ((0.88, 0.87, 0.66, 0.95), (0.78, 0.79, 0.68, 0.93), (0.55, 0.55, 0.38, 0.91)),
    "fifth": ((0.86, 0.94, 0.96, 0.96), (0.83, 0.89, 0.93, 0.94), (0.88, 0.83, 0.61, 0.95)),
}
# of the worst tip, where known, at each rate: what is asked of every plant
NUMBER_OFF = (0.03, 0.05, 0.10)
HERE = Cell("third", "small", 1.0, 1.0)
LINE = Script(
    "small",
    60.0,
    True,
    [(0.0, 350.0)],
    [
        Truth(10, 11, "pin"),
        Truth(12, 13, "pin"),
        Truth(15, 15.4, "wipe"),
        Truth(20, 25, "drag"),
        Truth(30, 30.8, "touch"),
    ],
    dry_feeds=[(40.0, 40.5)],
)


def scored(
    *found: tuple[float, float], kind: str = "joint", fed: bool = False
) -> joint_matrix.Outcome:
    return judged(HERE, LINE, 10.0, fed, [Said(*one, kind) for one in found])


# -- the rule of scoring ---------------------------------------------------------------------------


def test_what_is_found_as_it_is_counts_once() -> None:
    all_found = scored((10, 11), (12, 13), (20, 25))
    assert (all_found.hits, all_found.missed, all_found.false, all_found.f1) == (3, 0, 0, 1.0)
    twice = scored((10, 10.5), (10.5, 11), (12, 13), (20, 25))
    assert (twice.hits, twice.false) == (3, 1)


def test_two_joints_found_as_one_are_one_hit_and_one_miss() -> None:
    merged = scored((10, 13), (20, 25))
    assert (merged.hits, merged.missed, merged.false) == (2, 1, 0)


def test_a_drag_found_in_pieces_is_found_once() -> None:
    pieces = scored((10, 11), (12, 13), (20, 21.5), (22, 23), (24, 25))
    assert (pieces.hits, pieces.missed, pieces.false) == (3, 0, 2)
    assert joint_matrix.number_wrong([pieces]) == pytest.approx(2 / 3)


def test_less_than_half_of_the_shorter_is_another_place() -> None:
    beside = scored((10.6, 11.6))
    assert (beside.hits, beside.false) == (0, 1)


def test_wipes_touches_and_feeds_without_a_draw_are_apart() -> None:
    apart = scored((15.0, 15.5), (30.1, 30.6), (40.0, 40.5), kind="not known", fed=True)
    assert (apart.hits, apart.false) == (0, 0)
    assert apart.called == {"wipe": (1, 1, 0), "touch": (1, 1, 0), "feed": (1, 1, 0)}
    assert scored((15.0, 15.5)).called["wipe"] == (1, 1, 1)
    assert scored((40.0, 40.5), fed=True).false == 1, (
        "a joint, without a doubt, of which there is only a feed"
    )
    assert scored((50.0, 51.0)).false == 1


def test_not_known_is_missed_and_its_number_is_not_wrong() -> None:
    outcome = judged(HERE, LINE, 10.0, False, [], "the model does not fit")
    assert (
        outcome.f1,
        outcome.missed,
        joint_matrix.number_wrong([outcome]),
        joint_matrix.not_known([outcome]),
    ) == (0, 3, 0, 1)
    assert joint_matrix.number_wrong([scored()]) == 1, "none, and known, is wrong"


def test_edges_are_held_against_first_touch_and_withdrawal() -> None:
    edges = scored((10.1, 11.5), (12, 13.15))
    assert joint_matrix.edges_near([edges]) == pytest.approx(3 / 4)


# -- the plant -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def lived() -> list[Trial]:
    return joint_matrix.records(SLICE, (10.0,))[10.0]


def test_the_plant_shows_what_the_wire_shows(lived: list[Trial]) -> None:
    for trial in lived:
        known = ~np.isnan(trial.temperature)
        assert 0.98 < known.mean() < 1.0
        for told in (trial.temperature[known], trial.power[known]):
            assert np.array_equal(told, np.round(told))
        assert trial.power[known].min() >= 0
        assert trial.power[known].max() <= 1000
        assert np.array_equal(
            np.nanmax(trial.cycles),
            sum(
                start <= trial.seconds[~np.isnan(trial.cycles)][-1]
                for start, _ in trial.script.feeds
            ),
        )


def test_heat_is_kept() -> None:
    """What a tip at rest is given is what its loss takes; a joint of so many W/K takes as much
    more.
    """
    script = Script(
        "large",
        40.0,
        True,
        [(0.0, 350.0)],
        touches=[third_plant.Touch(15.0, 40.0, 0.4, 1e9, 0.0, 100.0)],
    )
    seen = third_plant.simulate([script], [5])
    rest, loaded = (
        float(seen.power[0, start:end].mean()) for start, end in ((400, 1400), (1800, 3900))
    )
    drawn = 1000 * float(seen.flow[0, 1800:3900].mean()) / float(seen.plants.rated_w[0])
    assert drawn == pytest.approx(1000 * 0.4 * 250 / float(seen.plants.rated_w[0]), rel=0.1)
    assert loaded - rest == pytest.approx(drawn, rel=0.15)


def test_the_same_seeds_are_the_same_trials(lived: list[Trial]) -> None:
    again = joint_matrix.script_of(SLICE[0])
    assert again == lived[0].script
    assert joint_matrix.script_of(replace(SLICE[0], repeat=1)) != again


# -- what is found ---------------------------------------------------------------------------------


def test_what_is_found_on_the_third_plant(lived: list[Trial]) -> None:
    """A slice of the campaign: joints of 0.5 to 2 s on each tip at 10 Hz, dense ones among them."""
    found = joint_matrix.found_in(SLICE, {10.0: lived})
    print(f"\n{joint_matrix.rows_told(found, (10.0,))}\n")
    print(*joint_matrix.matrix_rows(found, "third", 10.0), sep="\n")
    figures = joint_matrix.figures(found, 10.0)
    assert sum(one.truths for one in found if not one.fed) > 250
    for name, least in SLICE_HOLDS.items():
        assert figures[name] >= least, (name, figures[name])


@pytest.mark.campaign
@pytest.mark.timeout(600)
@pytest.mark.parametrize("plant", joint_matrix.PLANTS)
def test_the_whole_matrix(
    plant: str, counted: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    cells = joint_matrix.cells_of(plant, REPEATS)
    lived = joint_matrix.records(cells)
    found = joint_matrix.found_in(cells, lived)
    tables = [joint_matrix.rows_told(found)]
    parts = [(hz, fed) for fed in (False, True) for hz in joint_matrix.RATES]
    rows = {part: joint_matrix.matrix_rows(found, plant, *part) for part in parts}
    tables += ["\n".join(lines) for lines in rows.values()]
    tables += [joint_matrix.apart_told(found)]
    with capsys.disabled():
        print("\n" + "\n\n".join(tables))
    at_ten = [one for one in found if one.hz == 10.0]
    counted(
        trials=len(cells),
        **{f"joints on the {plant} plant": sum(one.truths for one in at_ten if not one.fed)},
    )
    for hz, least, off in zip(joint_matrix.RATES, HOLDS[plant], NUMBER_OFF, strict=True):
        figures = joint_matrix.figures(found, hz)
        assert figures[NUMBER] <= off, hz
        for name, figure in zip(F1_ROWS, least, strict=True):
            assert figures[name] >= figure, (name, hz)
    for part, lines in rows.items():
        recorded = joint_matrix.mean_f1(joint_matrix.recorded_rows(plant, *part))
        assert joint_matrix.mean_f1(lines) >= recorded - 0.01, part


def test_the_recorded_matrix_has_each_cell_once() -> None:
    header, *lines = joint_matrix.MATRIX.read_text(encoding="utf-8").splitlines()
    assert header == "plant,hz,feeder,length_s,gap_s,small,medium,large"
    cells = [tuple(line.split(",")[:5]) for line in lines]
    places = [(f"{length:g}", f"{gap:g}") for length, gap in product(LENGTHS, GAPS)]
    assert cells == [
        (plant, f"{hz:g}", feeder, *place)
        for plant in joint_matrix.PLANTS
        for feeder in ("no", "yes")
        for hz in joint_matrix.RATES
        for place in places
    ]
    for plant, holds in HOLDS.items():
        for hz, (least, *_) in zip(joint_matrix.RATES, holds, strict=True):
            long = [
                line
                for line in joint_matrix.recorded_rows(plant, hz, False)
                if float(line.split(",")[3]) >= 0.5 and float(line.split(",")[4]) >= 1.0
            ]
            assert joint_matrix.mean_f1(long) >= least - 0.01, (plant, hz)


@pytest.mark.campaign
def test_what_an_observer_tells_apart_is_as_recorded() -> None:
    """Who knows the third plant and every place; the finder is not asked."""
    cells = joint_matrix.cells_of("third", REPEATS)
    _, *recorded = joint_matrix.OBSERVER.read_text(encoding="utf-8").splitlines()
    assert joint_matrix.apart_at_best(cells, joint_matrix.records(cells)) == recorded


@pytest.mark.campaign
def test_joints_are_neither_invisible_nor_all_large(capsys: pytest.CaptureFixture[str]) -> None:
    """As `third_plant` says."""
    cells = joint_matrix.cells_of("third")
    ratios = third_plant.loudness(
        [joint_matrix.script_of(cell) for cell in cells], third_plant.SEEDS
    )
    quantiles = np.quantile(ratios, [0.05, 0.25, 0.5, 0.75, 0.95])
    with capsys.disabled():
        print("\nmean flow of the last 0.2 s over the noise of the told power:", quantiles.round(2))
    assert quantiles == pytest.approx([0.6, 1.3, 2.3, 3.9, 10.0], rel=0.15)
