"""Which readings are at rest, on a plant whose idle error is zero: between joints that come fast,
slowly, and with breaks.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from jbclog.analysis.port_data import Floats
from jbclog.analysis.verdict.idle import Block, idle_readings
from support.plants import second_plant as plant
from support.plants.second_plant import BOARD_C, Contact, Script, Trial, Truth, plants_of, simulate

SEEDS = tuple(range(71_001, 71_005))
SECONDS, SET_C, FIRST_S = 240.0, 350.0, 20.0


def worked(seed: int, dwell_s: float, pause_s: float, break_s: float = 0.0) -> Script:
    """A joint after the other with the same pause; after every tenth a break, if there is one."""
    rng, script, now, number = np.random.default_rng([seed, 9]), Script(), FIRST_S, 0
    script.settings.append((0.0, SET_C))
    while now < SECONDS - 3:
        size = rng.uniform(0.8, 1.2, 3)
        script.contacts.append(
            Contact(now, now + dwell_s, 0.35 * size[0], 0.12 * size[1], 0.06 * size[2], BOARD_C)
        )
        script.truths.append(Truth(now, now + dwell_s, "medium"))
        number += 1
        now += dwell_s + pause_s + (break_s if number % 10 == 0 else 0.0)
    return script


@cache
def lived() -> tuple[plant.Plants, list[Script], plant.Recorded]:
    """All trials, simulated at once: a step of many costs as much as one of a few."""
    plants, scripts = (
        plants_of(SEEDS * len(WORK)),
        [worked(seed, *work) for work in WORK for seed in SEEDS],
    )
    return plants, scripts, simulate(plants, scripts, round(SECONDS / plant.STEP_S))


def trials(dwell_s: float, pause_s: float, break_s: float, hz: float) -> list[Trial]:
    plants, scripts, seen = lived()
    first = WORK.index((dwell_s, pause_s, break_s)) * len(SEEDS)
    return [
        plant._recorded(plants, scripts[first + n], seen, first + n, seed, hz)
        for n, seed in enumerate(SEEDS)
    ]


def readings(trial: Trial, hz: float) -> Floats:
    return idle_readings(block_of(trial), 1 / hz)[1]


def moments(trial: Trial, hz: float) -> Floats:
    return idle_readings(block_of(trial), 1 / hz)[0]


def block_of(trial: Trial) -> Block:
    return Block(trial.seconds, trial.temperature, trial.power, trial.setting, trial.working)


BUSY = [(0.8, 1.0), (2.0, 1.2), (1.0, 3.0)]
WITH_REST = [(1.0, 30.0, 0.0), (0.8, 1.0, 30.0)]
HARDLY = (1.0, 12.0, 0.0)
WORK = [*((dwell_s, pause_s, 0.0) for dwell_s, pause_s in BUSY), *WITH_REST, HARDLY]
rates = pytest.mark.parametrize("hz", [10.0, 2.0])


@rates
@pytest.mark.parametrize(("dwell_s", "pause_s"), BUSY)
def test_a_line_that_never_rests_has_no_idle_error(
    dwell_s: float, pause_s: float, hz: float
) -> None:
    """It rests only before its first joint."""
    for trial in trials(dwell_s, pause_s, 0.0, hz):
        assert moments(trial, hz).max() <= FIRST_S


@rates
@pytest.mark.parametrize(("dwell_s", "pause_s", "break_s"), WITH_REST)
def test_where_it_rests_the_error_is_that_of_the_rest(
    dwell_s: float, pause_s: float, break_s: float, hz: float
) -> None:
    for trial in trials(dwell_s, pause_s, break_s, hz):
        found = readings(trial, hz)
        assert len(found) / hz > 30
        assert abs(found.mean()) < 0.25
        assert found.std() < 0.9


@rates
def test_pauses_that_are_hardly_long_enough_give_the_true_error_or_none(hz: float) -> None:
    """Two seconds of each pause are rest."""
    for trial in trials(*HARDLY, hz):
        found = readings(trial, hz)
        assert not len(found) or abs(found.mean()) < 0.35


def swinging() -> Block:
    """A slow swing of 3 °C, and a joint now and then, whose recovery lasts 2 s."""
    at = np.arange(6000) / 10
    temperature = np.round(350 + 3 * np.sin(2 * np.pi * at / 45))
    power = np.full(len(at), 100.0)
    for start in range(60, 600, 90):
        here = (at >= start) & (at < start + 1.5)
        power[here], temperature[here] = 600.0, temperature[here] - 15
        after = (at >= start + 1.5) & (at < start + 3.5)
        temperature[after] -= np.round(15 * np.exp(-(at[after] - start - 1.5)))
    setting, working = np.full(len(at), 350.0), np.ones(len(at), dtype=np.bool_)
    return Block(at, temperature, power, setting, working)


def test_what_the_tip_does_in_its_own_time_stays_in() -> None:
    """A slow swing while nothing is soldered is the tip's spread, and no tail."""
    found = idle_readings(swinging(), 0.1)[1]
    assert len(found) > 4500
    assert found.std() == pytest.approx(3 / np.sqrt(2), rel=0.1)
    assert abs(found.mean()) < 0.3


def test_rest_begins_ten_seconds_after_a_draw_and_ends_before_the_next() -> None:
    at = np.arange(600) / 10
    power = np.full(600, 100.0)
    power[200:220] = 600.0
    power[450:460] = 600.0
    setting, working = np.full(600, 350.0), np.ones(600, dtype=np.bool_)
    seconds = idle_readings(Block(at, setting, power, setting, working), 0.1)[0]
    expected = [*range(20, 198), *range(319, 448), *range(559, 600)]
    assert np.rint(10 * seconds).astype(int).tolist() == expected


def test_power_that_is_all_there_is_is_no_rest() -> None:
    at = np.arange(600) / 10
    block = Block(
        at,
        np.full(600, 300.0),
        np.full(600, 1000.0),
        np.full(600, 350.0),
        np.ones(600, dtype=np.bool_),
    )
    assert not len(idle_readings(block, 0.1)[1])
