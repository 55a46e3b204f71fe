"""Runs under random faults of link and station keep I1, I2, I4, I7 and S-2 of
docs/reference/faults.md.

The number of a run decides all of its faults. By default the first numbers are tried; `-m campaign`
tries the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random

import pytest

from support.campaigns.slices import first
from support.oracles.account import assert_account_holds, wrong_values
from support.oracles.sane import (
    assert_memory_is_bounded,
    assert_sane,
    assert_writes_are_few,
    must_end_within,
)
from support.virtual.virtual_run import RECIPE, VirtualRun, line_text, prepare

SECONDS = 25
COMMANDS = (
    "tip_temperature",
    "power",
    "status",
    "alarm_flags",
    "selected_temperature",
    "tool",
    "work_hours",
    "model",
)

OTHERWISE = (
    "addresses_swapped",
    "refusal_without_code",
    "transformer_padded_with_zero",
    "delay_without_dot",
    "alarm_not_set_is_zero",
    "alarm_delay_answers_ald",
    "status_acknowledged_with_value",
    "countdown_65535",
    "model_unpadded",
)


def tape(random: Random) -> str:
    """Return one to four faults at random times, which may overlap."""
    return "".join(_fault(random) for _ in range(random.randint(1, 4)))


def _fault(random: Random) -> str:
    kind = random.choice(
        [
            "silence",
            "noise",
            "flip",
            "late",
            "nak",
            "dropout",
            "restart",
            "tool",
            "stuck",
            "overheat",
        ]
    )
    keys: dict[str, object] = {
        "kind": kind,
        "at_s": round(random.uniform(0, SECONDS), 2),
        "for_s": round(random.uniform(0.1, 9), 2),
    }
    if kind in ("silence", "noise", "flip", "late", "nak"):
        keys["every"] = random.choice([1, 1, 2, 3, 7, 40])
        if random.random() < 0.4:
            keys["command"] = random.choice(COMMANDS)
        if random.random() < 0.2:
            keys["only"] = random.choice(["read", "write"])
    keys |= {
        "noise": {"bytes_count": random.randint(1, 100)},
        "late": {"by_s": round(random.uniform(0.02, 2.5), 3)},
        "nak": {"code": random.choice([1, 2, 3, 4, 5, 6, 99999])},
        "tool": {"code": random.choice([0, 1, 3]), "port": random.choice([1, 2])},
    }.get(kind, {})
    return "\n[[station.sim.fault]]\n" + "".join(
        f"{key} = {value!r}\n" for key, value in keys.items()
    )


def run_number(number: int, more: str = "", quirks: Sequence[str] = ()) -> VirtualRun:
    random = Random(number)
    recipe = RECIPE + f'on_difference = "{random.choice(["stop", "continue"])}"\n'
    sim = f"noise_c = 3.0\nseed = {number}\nquirks = {list(quirks)}\n" + tape(random) + more
    run = prepare(
        line_text(sim),
        recipe,
        duration_s=SECONDS,
        rate=random.choice([None, None, 2, "fit", "max"]),
    )
    must_end_within(run, 10 * SECONDS)
    if random.random() < 0.3:
        run.at(random.uniform(0, SECONDS), lambda: run.driver.end("SIGTERM"))
    return run.go()


@pytest.mark.parametrize("number", first(24, range(120)))
def test_a_run_under_faults(number: int) -> None:
    run = run_number(number)
    assert_sane(run)
    assert wrong_values(run) == []


@pytest.mark.parametrize("number", first(6, range(2000, 2030)))
def test_a_run_under_faults_on_a_station_that_does_everything_otherwise(number: int) -> None:
    run = run_number(number, quirks=OTHERWISE)
    assert_sane(run)
    assert wrong_values(run) == []


@pytest.mark.parametrize("number", first(4, range(20)))
def test_flipped_pairs_of_bits_are_all_that_can_be_wrong(number: int) -> None:
    """Two flipped bits pass the check byte once in eleven times. The record then has the value as
    it arrived, and no other wrong value.
    """
    run = run_number(
        1000 + number,
        '\n[[station.sim.fault]]\nkind = "flip"\nbits = 2\nat_s = 3\nevery = 5\nonly = "read"\n',
    )
    assert_account_holds(run)
    assert_writes_are_few(run)
    assert wrong_values(run, as_sent=True) == []


@pytest.mark.campaign
@pytest.mark.parametrize("block", range(200))
def test_many_runs_under_faults(block: int, counted: Callable[..., None]) -> None:
    for number in range(10_000 + 50 * block, 10_050 + 50 * block):
        run = run_number(number)
        assert_sane(run)
        assert wrong_values(run) == [], number
        assert_memory_is_bounded()
        counted(runs=1, questions=len(run.heard), rows=len(run.memory.samples), wrong_values=0)
