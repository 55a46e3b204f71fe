"""The audit of a fleet that is simulated over two years, with the truth beside it.

`-s` prints the figures. `SHIFTS` with the seeds of `TUNED` is what the constants of `pace.py` and `forecast.py` were set by; all
others were never looked at before they were counted here, but for (SHIFTS, MONTHLY, 302): by it was learned that another unit can
happen to fit in one counter of hours, and every other counter beside one that cannot be is in doubt since.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from audit_fleet import BATCHES, SHIFTS, Fleet, Used
from audit_score import due_score, odometer_score

DAILY, WEEKLY, MONTHLY = 24.0, 168.0, 730.0
TUNED = (11, 12, 14)
OTHERS = [
    *[(SHIFTS, DAILY, seed) for seed in (101, 102)],
    *[(SHIFTS, WEEKLY, seed) for seed in (201, 202)],
    *[(SHIFTS, MONTHLY, seed) for seed in (301, 302, 303, 304)],
    *[(BATCHES, DAILY, 401), (BATCHES, WEEKLY, 402), (BATCHES, MONTHLY, 403), (BATCHES, MONTHLY, 404)],
]
IDS = [f"{pattern.__name__}-{every:.0f}h-{seed}" for pattern, every, seed in OTHERS]
Counted = Callable[..., None]
Pattern = Callable[[np.random.Generator, int], Used]


def odometers_hold(fleet: Fleet, seed: int, stations: int, counted: Counted) -> None:
    score = odometer_score(fleet, seed, stations)
    print(f"\n{fleet.pattern.__name__}, every {fleet.every_h:.0f} h, seed {seed}: {score}")
    assert (score.wrong, score.sums["wrong"]) == ([], 0)
    assert score.steps["known"] > (0.9 if fleet.every_h <= WEEKLY else 0.6) * (score.steps["known"] + score.steps["flagged"])
    assert score.steps["outside"] <= 0.05 * score.steps["flagged"] + 5
    counted(differences=score.steps["known"] + score.steps["flagged"], flagged=score.steps["flagged"], wrong=len(score.wrong))


@pytest.mark.parametrize("every_h", [WEEKLY, MONTHLY])
def test_what_is_called_known_is_right(every_h: float, counted: Counted) -> None:
    odometers_hold(Fleet(every_h=every_h), 501, 6, counted)


@pytest.mark.campaign
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(("pattern", "every_h", "seed"), OTHERS, ids=IDS)
def test_what_is_called_known_is_right_of_many(pattern: Pattern, every_h: float, seed: int, counted: Counted) -> None:
    odometers_hold(Fleet(pattern=pattern, every_h=every_h), seed, 40 if every_h > DAILY else 15, counted)


def test_a_fleet_to_which_nothing_happens_is_known_whole() -> None:
    nothing = {"resets": 0, "swaps": 0, "silent_swaps": 0, "updates": 0, "gaps": 0, "clocks": 0, "misread": 0, "near_top": 0}
    score = odometer_score(Fleet(every_h=DAILY, years=0.5, truth_years=0.5, **nothing), 601, 6)
    young = score.steps["flagged"]
    assert (score.wrong, score.sums["outside"], score.sums["wrong"]) == ([], 0, 0)
    assert young < 0.03 * score.steps["known"]


def test_due_ranges_hold_what_they_say(counted: Counted) -> None:
    score = due_score(Fleet(every_h=WEEKLY), 502, 8, 4)
    print(f"\n{score}")
    assert 0.65 <= score.held <= 0.95
    counted(forecasts=len(score.rows))


@pytest.mark.campaign
@pytest.mark.timeout(3000)
@pytest.mark.parametrize(("pattern", "every_h"), [(SHIFTS, DAILY), (SHIFTS, WEEKLY), (SHIFTS, MONTHLY), (BATCHES, WEEKLY)])
def test_due_ranges_hold_80_percent_within_5(pattern: Pattern, every_h: float, counted: Counted) -> None:
    stations = 80 if every_h > DAILY else 60
    score = due_score(Fleet(pattern=pattern, every_h=every_h), 701, stations)
    print(f"\n{pattern.__name__}, every {every_h:.0f} h: {score}")
    assert 0.75 <= score.held <= 0.85
    counted(forecasts=len(score.rows))
