"""The audit of a fleet that is simulated over two years, with the truth beside it.

`-s` prints the figures. `SHIFTS` with the seeds of `TUNED`, and `workshop` with 1203 and 1204, are
what the constants of `due.py` were set by; all others were never looked at
before they were counted here, but for (SHIFTS, MONTHLY, 302): by it was learned that another unit
can happen to fit in one counter of hours, and every other counter beside one that cannot be is in
doubt since.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from support.fleets.audit_fleet import BATCHES, SHIFTS, Fleet, Used
from support.fleets.audit_score import (
    TRUTH_YEARS,
    DueScore,
    due_score,
    due_score_of,
    odometer_score,
)
from support.fleets.exchange_fleet import BEGIN as EXCHANGE_BEGIN
from support.fleets.exchange_fleet import Model, Places, contract, workshop

DAILY, WEEKLY, MONTHLY = 24.0, 168.0, 730.0
TUNED = (11, 12, 14, 1201, 1202)
OTHERS = [
    *[(SHIFTS, DAILY, seed) for seed in (101, 102)],
    *[(SHIFTS, WEEKLY, seed) for seed in (201, 202)],
    *[(SHIFTS, MONTHLY, seed) for seed in (301, 302, 303, 304)],
    *[
        (BATCHES, DAILY, 401),
        (BATCHES, WEEKLY, 402),
        (BATCHES, MONTHLY, 403),
        (BATCHES, MONTHLY, 404),
    ],
]
IDS = [f"{pattern.__name__}-{every:.0f}h-{seed}" for pattern, every, seed in OTHERS]
Counted = Callable[..., None]
Pattern = Callable[[np.random.Generator, int], Used]


def odometers_hold(fleet: Fleet, seed: int, stations: int, counted: Counted) -> None:
    score = odometer_score(fleet, seed, stations)
    print(f"\n{fleet.pattern.__name__}, every {fleet.every_h:.0f} h, seed {seed}: {score}")
    assert (score.wrong, score.sums["wrong"]) == ([], 0)
    assert score.steps["known"] > (0.9 if fleet.every_h <= WEEKLY else 0.6) * (
        score.steps["known"] + score.steps["flagged"]
    )
    assert score.steps["outside"] <= 0.05 * score.steps["flagged"] + 5
    counted(
        differences=score.steps["known"] + score.steps["flagged"],
        flagged=score.steps["flagged"],
        wrong=len(score.wrong),
    )


@pytest.mark.parametrize("every_h", [WEEKLY, MONTHLY])
def test_what_is_called_known_is_right(every_h: float, counted: Counted) -> None:
    odometers_hold(Fleet(every_h=every_h), 501, 6, counted)


@pytest.mark.campaign
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(("pattern", "every_h", "seed"), OTHERS, ids=IDS)
def test_what_is_called_known_is_right_of_many(
    pattern: Pattern, every_h: float, seed: int, counted: Counted
) -> None:
    odometers_hold(
        Fleet(pattern=pattern, every_h=every_h), seed, 40 if every_h > DAILY else 15, counted
    )


def test_a_fleet_to_which_nothing_happens_is_known_whole() -> None:
    nothing = {
        "resets": 0,
        "swaps": 0,
        "silent_swaps": 0,
        "updates": 0,
        "gaps": 0,
        "clocks": 0,
        "misread": 0,
        "near_top": 0,
    }
    score = odometer_score(Fleet(every_h=DAILY, years=0.5, truth_years=0.5, **nothing), 601, 6)
    young = score.steps["flagged"]
    assert (score.wrong, score.sums["outside"], score.sums["wrong"]) == ([], 0, 0)
    assert young < 0.03 * score.steps["known"]


def ranges_hold(score: DueScore, least: float, counted: Counted) -> None:
    """The share that they must hold at least; those that are due before P10 are the harmful ones,
    and no more than one in ten.
    """
    print(f"\n{score}")
    assert score.held >= least
    assert score.before <= 0.1
    former = [replace(one, low=one.former[0], high=one.former[1]) for one in score.all]
    assert score.held >= DueScore(former).held + 0.02
    # ranges that say nothing would hold, too
    assert score.width_days <= 1.6 * DueScore(former).width_days
    counted(forecasts=len(score.all))


def places(model: Model, every: str, years: float = TRUTH_YEARS) -> Places:
    """Stations to which little happens but work: what is asked is how even it is."""
    return Places(
        model=model, every=every, truth_years=years, exchanges=0.1, loans=0.0, resets=0.15
    )


def test_due_ranges_hold_what_they_say(counted: Counted) -> None:
    ranges_hold(due_score(Fleet(every_h=WEEKLY), 502, 12, 5), 0.8, counted)


def test_due_ranges_hold_over_shutdowns_and_changes_of_load(counted: Counted) -> None:
    stations = (places(workshop, "weekly").place(503, number) for number in range(12))
    ranges_hold(due_score_of(stations, EXCHANGE_BEGIN, 503, 4), 0.78, counted)


@pytest.mark.campaign
@pytest.mark.timeout(3000)
@pytest.mark.parametrize(
    ("pattern", "every_h"),
    [(SHIFTS, DAILY), (SHIFTS, WEEKLY), (SHIFTS, MONTHLY), (BATCHES, WEEKLY)],
)
def test_due_ranges_hold_80_percent(pattern: Pattern, every_h: float, counted: Counted) -> None:
    stations = 80 if every_h > DAILY else 60
    ranges_hold(due_score(Fleet(pattern=pattern, every_h=every_h), 701, stations), 0.8, counted)


@pytest.mark.campaign
@pytest.mark.timeout(3000)
@pytest.mark.parametrize("every", ["weekly", "monthly"])
@pytest.mark.parametrize(("model", "seed"), [(workshop, 801), (contract, 90_801)])
def test_due_ranges_hold_80_percent_of_other_plants(
    model: Model, seed: int, every: str, counted: Counted
) -> None:
    """`contract` was not looked into before it was counted."""
    stations = (places(model, every).place(seed, number) for number in range(100))
    ranges_hold(due_score_of(stations, EXCHANGE_BEGIN, seed, 6), 0.8, counted)
