"""Campaign 3, the link: random tapes of all link faults, on every family, over thousands of hours
of a virtual clock.

``pytest -n0 -s -m campaign tests/faults/test_wire_campaign.py`` plays `HOURS` virtual hours from
tape `FIRST` on (environment: WIRE_HOURS, WIRE_FIRST) and prints the numbers; ``python tests/support
campaigns.wire_tapes NUMBER`` plays one tape again. A default run plays the first few.

For each tape: due = ok + each reason, to the row. No value differs from the plant, except those
that the link forged so that no receiver can tell; the link counts these itself: recorded =
injected. Every write is on the recipe's list. Every flag that the station sent is reported or not
known. Every heated tool is at rest or reported.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from random import Random

import pytest

from support.campaigns.wire_tapes import Played, Tally, campaign, judge, play
from support.links.damage import DAMAGES, jbc_holds, omega_holds
from support.links.noisy_wire import ALL_KINDS, OF_ANY_PROTOCOL, Tape
from support.oracles.believed import judge_rows
from support.oracles.sane import assert_memory_is_bounded
from support.product import COLUMN

HOURS, FIRST = float(os.environ.get("WIRE_HOURS", "2000")), int(os.environ.get("WIRE_FIRST", "0"))
SHORT = (7, 15, 18, 22)  # fast ones
FORGED = 18  # a tape with wrong values in its record
ANSWER = b"\x020100ATT100350\x03F"


def test_the_first_tapes(capsys: pytest.CaptureFixture[str]) -> None:
    tally = campaign(SHORT)
    with capsys.disabled():
        print(f"\ntapes {SHORT}: {tally.text()}")
    assert tally.broken == []
    assert tally.did.total() > 100
    assert tally.recorded > 0


@pytest.mark.campaign
@pytest.mark.timeout(6 * 3600)
def test_thousands_of_hours(
    capsys: pytest.CaptureFixture[str], counted: Callable[..., None]
) -> None:
    tally = campaign(range(FIRST, FIRST + 10**6), HOURS)
    with capsys.disabled():
        print(f"\ntapes {FIRST} to {FIRST + tally.tapes - 1}: {tally.text()}")
    assert tally.broken == []
    counted(
        virtual_hours=round(tally.hours),
        disturbed=tally.did.total(),
        forged=tally.injected,
        forged_recorded=tally.recorded,
        wrong=0,
    )
    assert set(tally.did) == set(ALL_KINDS)
    assert 0 < tally.recorded < tally.injected
    assert_memory_is_bounded()


# -- the campaign itself: it must be able to see a fault -------------------------------------------


@pytest.fixture(scope="module")
def played() -> Played:
    return play(FORGED)


def broken(played: Played) -> list[str]:
    tally = Tally()
    judge(FORGED, played, tally)
    return tally.broken


def test_a_number_decides_everything(played: Played) -> None:
    assert play(FORGED).run.memory == played.run.memory


def test_a_wrong_value_is_found(played: Played) -> None:
    rows = [list(row) for row in played.run.memory.samples]
    row = next(row for row in rows if isinstance(row[COLUMN["temperature_c"]], int))
    row[COLUMN["temperature_c"]] = int(str(row[COLUMN["temperature_c"]])) + 1
    changed = replace(
        played, run=replace(played.run, memory=replace(played.run.memory, samples=rows))
    )
    assert any("not even told" in text for text in broken(changed))


def test_a_row_that_is_missing_is_found(played: Played) -> None:
    rows = played.run.memory.samples
    changed = replace(
        played,
        run=replace(
            played.run, memory=replace(played.run.memory, samples=[*rows[:20], *rows[21:]])
        ),
    )
    assert any("tick" in text for text in broken(changed))
    assert any("account" in text for text in broken(changed))


def test_what_was_forged_is_recorded_and_counted(played: Played) -> None:
    verdict = judge_rows(played.run, played.wire)
    assert verdict.recorded == verdict.due_to_be
    assert verdict.recorded
    forgeries, played.wire.forgeries = played.wire.forgeries, []
    unexcused = judge_rows(played.run, played.wire).lies
    played.wire.forgeries = forgeries
    assert len(unexcused) >= len(verdict.recorded)


def test_damage_is_what_its_name_says() -> None:
    random = Random(1)
    for name in ("one_bit", "three_bits"):
        assert not any(jbc_holds(DAMAGES[name](ANSWER, random)) for _ in range(2000))
    assert all(jbc_holds(DAMAGES["swapped"](ANSWER, random)) for _ in range(2000))
    assert sum(jbc_holds(DAMAGES["pair_in_a_column"](ANSWER, random)) for _ in range(2000)) > 1500
    assert omega_holds(b"\x02a0\x0391")
    assert not omega_holds(b"\x02a1\x0391")


def test_a_tape_has_every_kind() -> None:
    assert len(ALL_KINDS) == 44
    assert set(OF_ANY_PROTOCOL) < set(ALL_KINDS)
    tape = Tape(Random(3), ALL_KINDS, 0)
    assert {deed.kind for number in range(200_000) if (deed := tape.get(number))} == set(ALL_KINDS)
