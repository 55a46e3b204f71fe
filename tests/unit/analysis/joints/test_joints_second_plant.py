"""Joints on a plant that was not used to tune their finding: per class, the worst tenth, and how it
falls with the rate.

`pytest tests/unit/analysis/joints/test_joints_second_plant.py -s -n0` prints the tables; with
`-m campaign` of all trials.
"""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from jbclog.analysis.joints.joints import find_joints
from jbclog.analysis.joints.recovery import Joint
from support.plants.joint_score import Score, all_of, overlap, told, worst_tenth
from support.plants.second_plant import CAMPAIGN_SEEDS, SEEDS, Trial, trials
from support.plants.second_record import scores, series_of

RATES = (10.0, 5.0, 2.0, 1.0)
FEWER = 8  # trials show a change; campaigns have 21 at ten hertz, and two hundred of each rate
LEAST = {10.0: 0.99, 5.0: 0.98, 2.0: 0.96, 1.0: 0.90}


@pytest.fixture(scope="module")
def records() -> dict[float, list[Trial]]:
    return trials(SEEDS[:FEWER], rates=RATES)


@pytest.fixture(scope="module")
def found(records: dict[float, list[Trial]]) -> dict[float, list[Score]]:
    return {hz: scores(records[hz], hz) for hz in RATES}


def shown(hz: float, found: Sequence[Score]) -> None:
    print(f"\n{hz:g} Hz\n{told(found)}")


def curve(found: dict[float, list[Score]]) -> None:
    print("\n| rate | F1 | worst tenth | found | missed | false |\n|---|---|---|---|---|---|")
    for hz, several in found.items():
        every = all_of(several)
        numbers = f"{every.hit.total()} | {every.missed.total()} | {every.false.total()}"
        print(f"| {hz:g} Hz | {every.f1:.3f} | {worst_tenth(several).f1:.3f} | {numbers} |")


def test_joints_are_found_at_ten_hertz(found: dict[float, list[Score]]) -> None:
    assert_found(found[10.0], least_events=300)


@pytest.mark.campaign
def test_joints_are_found_in_all_trials_at_ten_hertz() -> None:
    assert_found(scores(trials(SEEDS, rates=RATES[:1])[10.0], 10.0), least_events=500)


def assert_found(several: Sequence[Score], least_events: int) -> None:
    shown(10.0, several)
    every = all_of(several)
    assert every.events.total() > least_events
    assert every.f1 >= 0.99
    assert worst_tenth(several).f1 >= 0.95
    for kind in ("large", "medium", "saturated", "double"):
        assert every.hit[kind] >= 0.97 * every.events[kind], kind
    for kind in ("set", "sleep"):
        assert every.false[kind] <= 0.15 * every.events[kind], kind
    assert every.false["idle"] <= 10


def test_what_draws_heat_is_a_draw_whether_it_takes_solder_or_not(
    records: dict[float, list[Trial]], found: dict[float, list[Score]]
) -> None:
    """What the definition of a joint says of itself: a rest in a sponge as long as a joint is one;
    wipes are of no known kind.
    """
    every = all_of(found[10.0])
    assert every.untold["soak"] >= 0.9 * every.events["soak"]
    wipes = [joint for trial in records[10.0] for joint in _in(trial, ("sponge", "brass", "touch"))]
    assert wipes
    assert sum(joint.kind == "not known" for joint in wipes) >= 0.6 * len(wipes)


def _in(trial: Trial, kinds: Sequence[str]) -> list[Joint]:
    """The joints found in what happened of these kinds."""
    spans = [(one.start, one.end) for one in trial.truths if one.kind in kinds]
    found = find_joints(series_of(trial, 10.0)).joints
    return [
        joint
        for joint in found
        if any(overlap(span, (joint.start_s, joint.end_s)) > 0 for span in spans)
    ]


@pytest.mark.parametrize("hz", RATES[1:])
def test_how_it_falls_with_the_rate(found: dict[float, list[Score]], hz: float) -> None:
    assert all_of(found[hz]).f1 >= LEAST[hz]


def test_the_curve_falls(found: dict[float, list[Score]]) -> None:
    curve(found)
    falling = [all_of(several).f1 for several in found.values()]
    assert falling == sorted(falling, reverse=True)


@pytest.mark.campaign
def test_two_hundred_more_trials() -> None:
    records = trials(CAMPAIGN_SEEDS, rates=RATES)
    found = {hz: scores(records[hz], hz) for hz in RATES}
    shown(10.0, found[10.0])
    curve(found)
    for hz, several in found.items():
        assert all_of(several).f1 >= LEAST[hz], hz
