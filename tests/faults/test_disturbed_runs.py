"""Whole runs on a line that disturbs answers in every way that the injector knows: nothing wrong is
recorded.

The answers come at their own time (`Injector.forged` stays empty), or as copies so early that the
same question has not been asked again. `test_wrong_answers.py` has what an unlucky copy can do
beyond that.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from random import Random

import pytest

from support.links.injector import FORGING, KINDS, Deed, Injector
from support.oracles.account import wrong_values
from support.oracles.sane import assert_memory_is_bounded, assert_sane, must_end_within
from support.virtual.virtual_run import RECIPE, VirtualRun, line_text, prepare

SECONDS = 12
QUESTIONS, STARTED = 2000, 180  # that a run asks at the most; after so many it samples
TWO_SETTINGS = RECIPE + "\n[port.2.temperature]\nselect_c = 330\n"
# behind the answer; the same question is asked a whole tick later, or not before another
SOON_S = 0.005
AT_HAND_S = (0.0, 0.02, 0.0999, 0.1001, 0.11)


def _plan(random: Random) -> dict[int, Deed]:
    often, first = random.choice([0.005, 0.02, 0.1, 0.3]), random.choice([0, *3 * [STARTED]])
    kinds = random.sample(KINDS, random.randint(1, len(KINDS)))
    return {
        number: _deed(random, random.choice(kinds))
        for number in range(first, QUESTIONS)
        if random.random() < often
    }


def _deed(random: Random, kind: str) -> Deed:
    if kind in FORGING:
        return Deed(kind, SOON_S if kind == "twice" else 0.0, instead=False)
    by_s = random.choice([random.choice(AT_HAND_S), random.uniform(0, 0.3), random.uniform(0, 3)])
    return Deed(kind, by_s, random.random(), random.random() < 0.3)


def disturbed(number: int) -> tuple[VirtualRun, Counter[str]]:
    random = Random(number)
    sim = f"noise_c = 3.0\nseed = {number}\n"
    run = prepare(
        line_text(sim),
        TWO_SETTINGS,
        duration_s=SECONDS,
        rate=random.choice([None, None, 3, "fit", "max"]),
    )
    must_end_within(run, 10 * SECONDS)
    (tap,) = run.taps.values()
    injector = Injector(tap.receive, _plan(random))
    tap.receive = injector.receive  # type: ignore[method-assign]
    return run.go(), injector.did


@pytest.mark.parametrize("number", range(25))
def test_a_disturbed_run(number: int) -> None:
    run, did = disturbed(number)
    assert_sane(run)
    assert wrong_values(run) == []
    assert did


@pytest.mark.campaign
@pytest.mark.parametrize("block", range(25))
def test_many_disturbed_runs(block: int, counted: Callable[..., None]) -> None:
    for number in range(1000 + 50 * block, 1050 + 50 * block):
        run, did = disturbed(number)
        assert_sane(run)
        assert wrong_values(run) == [], number
        assert_memory_is_bounded()
        counted(
            runs=1,
            questions=len(run.heard),
            disturbed_answers=did.total(),
            rows=len(run.memory.samples),
            wrong_values=0,
        )
