"""Flipped bits: one is always noticed, two are not if an XOR hides them. What then passes is
counted, and decides nothing.

The check byte is the XOR of a frame: the same bit flipped in two characters leaves it unchanged.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

import pytest

from support.campaigns.each_row import each_row
from support.clients.corrupted import flipped, taken, taken_by_omega, taken_of_two_bits
from support.golden import FRAMES, Golden, manual_003
from support.product import FAMILIES, Command, Value
from support.readers.texts import ROOT

FAMILIES_OF = {
    "000": ("soldering",),
    "001": ("jtse",),
    "002": ("dde", "ale", "ucr"),
    "004": ("ucr",),
}
RECORD = " ".join(
    (ROOT / "docs/decisions/0017-decisive-values-are-read-twice.md")
    .read_text(encoding="utf-8")
    .split()
)
ANSWERS = [golden for golden in FRAMES if golden.text[0] == "A" and golden.value is not None]


def command_of(golden: Golden) -> Command:
    families = (FAMILIES[name] for name in FAMILIES_OF[golden.manual])
    return next(
        family.commands[golden.command] for family in families if golden.command in family.commands
    )


def _forms(golden: Golden) -> list[tuple[bytes, int | None]]:
    return [(golden.addressed, 1), (golden.bare, None)]


@each_row((f"{golden.where} {golden.text}", (golden,)) for golden in ANSWERS)
def test_no_single_flipped_bit_is_taken(golden: Golden) -> None:
    command = command_of(golden)
    for wire, address in _forms(golden):
        assert taken(command, golden.port, golden.tool, wire, address) is not None
        for sent in flipped(wire, 1):
            assert taken(command, golden.port, golden.tool, sent, address) is None, sent


# -- two bits: counted, and published --------------------------------------------------------------


class Kind(NamedTuple):
    """An answer, by its name in the decision record."""

    name: str
    where: str
    text: str


PUBLISHED = [
    Kind("tip temperature", "002 R-TTx", "ATT100183"),
    Kind("selected temperature", "002 R-STx", "AST100350"),
    Kind("power", "002 R-PPx", "APP100840"),
    Kind("counter", "000 3.1", "ACC312345"),
    Kind("port error", "002 R-PEx", "APE100004"),
    Kind("delay", "004 R-Dxy", "AD1299999"),
    Kind("alarm delay", "000 4.8.23", "AHD301.60"),
    Kind("status", "002 Tool Operating Status", "APS100002"),
    Kind("pair of alarm flags", "002 R-TAx", "ATA100001"),
    Kind("model name", "000 4.8.28", "ASMN  DDR"),
]


def golden_of(kind: Kind) -> Golden:
    (golden,) = [one for one in ANSWERS if (one.where, one.text) == (kind.where, kind.text)]
    return golden


def passing(golden: Golden) -> list[tuple[bytes, Value]]:
    return taken_of_two_bits(command_of(golden), golden.port, golden.tool, golden.addressed)


def published() -> dict[str, int]:
    """Return the numbers in the sentence of the decision record, by the names there."""
    sentence = re.search(r"of the 8128 that flip two,([^.]*)", RECORD)
    assert sentence, "the record no longer says how many corruptions of two bits pass"
    return {
        name: int(number)
        for number, name in re.findall(
            r"(\d+)(?: pass)? as an? ([a-z ]+?)(?=,| and \d|$)", sentence[1]
        )
    }


def test_how_many_corruptions_of_two_bits_pass_is_published() -> None:
    counted = {kind.name: len(passing(golden_of(kind))) for kind in PUBLISHED}
    assert published() == counted


@each_row((kind.name, (kind,)) for kind in PUBLISHED)
def test_what_passes_hides_from_an_xor_or_is_the_same_value(kind: Kind) -> None:
    golden = golden_of(kind)
    for sent, value in passing(golden):
        changed = {
            place: one ^ other
            for place, (one, other) in enumerate(zip(golden.addressed, sent, strict=True))
            if one != other
        }
        assert len(changed) == 2
        assert len(set(changed.values())) == 1, "two different bits would show in the check byte"
        in_data_or_check = all(place >= 5 + 1 + 3 for place in changed)
        assert in_data_or_check or value == command_of(golden).quantity.decode(golden.text[4:])


# -- OMEGA: a sum of the text's characters ---------------------------------------------------------

OMEGA = {
    "a0": "information",
    "a3": "information",
    "b1": "temperature_control",
    "f0": "set_temperature_state",
}
OMEGA_ANSWERS = [golden for golden in manual_003.BY_HAND if golden.text in OMEGA]


@pytest.mark.parametrize("golden", OMEGA_ANSWERS, ids=lambda golden: golden.text)
def test_of_omega_no_single_flipped_bit_is_taken_and_at_most_one_pair(
    golden: manual_003.OmegaGolden,
) -> None:
    """A pair passes if one bit changes a digit of the text and the other changes the sum by as
    much.
    """
    command = FAMILIES["omega"].commands[OMEGA[golden.text]]
    assert taken_by_omega(command, golden.wire) is not None
    assert [
        sent for sent in flipped(golden.wire, 1) if taken_by_omega(command, sent) is not None
    ] == []
    pairs = list(flipped(golden.wire, 2))
    passed = [sent for sent in pairs if taken_by_omega(command, sent) is not None]
    sentence = re.search(r"Of the (\d+) in an answer of OMEGA at most (\d+) passes", RECORD)
    assert sentence
    assert len(pairs) == int(sentence[1])
    assert len(passed) <= int(sentence[2])


@pytest.mark.campaign
@pytest.mark.parametrize("golden", ANSWERS, ids=lambda golden: f"{golden.where} {golden.text}")
def test_less_than_one_in_fifty_passes(golden: Golden, counted: Callable[..., None]) -> None:
    """Of every golden answer, with and without addresses."""
    for wire, address in _forms(golden):
        tried = len(list(flipped(wire, 2)))
        found = taken_of_two_bits(command_of(golden), golden.port, golden.tool, wire, address)
        right = command_of(golden).quantity.decode(
            golden.text[1 + len(command_of(golden).code(golden.port, golden.tool)) :]
        )
        counted(
            answers=1,
            corruptions=tried,
            taken=len(found),
            taken_for_another_value=sum(value != right for _, value in found),
        )
        assert len(found) < tried / 50
