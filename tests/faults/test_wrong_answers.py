"""Late, doubled, merged, torn, foreign and echoed answers, swept over time and kind: no value for a
wrong question.

The station here answers each question with its running number, so a value shows which question it
belongs to. A value is right only if it is the number of its question: same signal, same port, and
asked just now. Where whole answers of this station came at the wrong moment (`Injector.forged`),
one of them may be accepted right then, and an answer to an earlier identical question may be taken
for the later one; nothing on the link could tell.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.clients.talk import sought
from support.golden import framed
from support.links.injector import FORGING, KINDS, Deed, Injector
from support.product import (
    FAMILIES,
    LineFormat,
    Reopen,
    Station,
    StationError,
    StationSilent,
    Value,
    VirtualClock,
    VirtualDriver,
    do,
)

DDE = FAMILIES["dde"].commands
ASKED = [
    ("tip_temperature", 1, "RTT1"),
    ("power", 1, "RPP1"),
    ("tip_temperature", 2, "RTT2"),
    ("power", 2, "RPP2"),
    ("transformer_temperature", None, "RTT"),
    ("selected_temperature", 1, "RST1"),
    ("plugged_hours", 2, "RCP2"),
    ("station_error", None, "RSER"),
]
"""Codes that differ in little: RTT, RTT1 and RTT2."""
# when an answer arrives, and how long to wait for one beyond its bytes
ANSWER_S, PATIENCE_S = 0.0151, 0.100
PAUSE_S = 0.012


class Numbered:
    """A station that answers with the running number of the question."""

    def __init__(self, *, addressed: bool) -> None:
        self.asked: list[str] = []
        self._addresses = "0100" if addressed else ""
        self._free = 0.0

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        text = data[5 if self._addresses else 1 : -2].decode("ascii")
        self.asked.append(text)
        data_field = "  DDE" if text == "RSMN" else f"{len(self.asked) - 1:05d}"
        self._free = max(self._free, now + ANSWER_S)
        return [(self._free, framed("A" + text[1:] + data_field, self._addresses))]


@dataclass(frozen=True)
class Taken:
    """An accepted answer and its question; the questions asked for it, and the time."""

    question: str
    value: Value
    begin: int
    end: int
    since: float
    until: float


def converse(
    plan: dict[int, Deed], *, addressed: bool = True, questions: int = 48
) -> tuple[list[Taken], Numbered, Injector]:
    """Read the signals in turn, as a run would, during `plan`."""
    plant = Numbered(addressed=addressed)
    injector = Injector(plant.receive, plan)
    station, clock = Station(LineFormat(), 1 if addressed else None), VirtualClock()
    taken: list[Taken] = []

    async def steps() -> None:
        station.unasked(await do(Reopen()))
        for turn in count():
            if len(plant.asked) >= questions:
                return
            name, port, text = ASKED[turn % len(ASKED)]
            begin, since = len(plant.asked), clock.monotonic()
            try:
                value = await station.read(DDE[name], port)
            except StationSilent:
                await sought(station, DDE["model"])
            except StationError:
                continue
            else:
                taken.append(Taken(text, value, begin, len(plant.asked), since, clock.monotonic()))

    driver = VirtualDriver(clock)
    driver.add(steps(), injector)
    driver.run()
    return taken, plant, injector


def wrong(taken: list[Taken], plant: Numbered, injector: Injector) -> list[str]:
    """Return every value that belongs to another question, or to an earlier identical one."""
    return [
        f"{one.value!r} was taken for {one.question}, asked as {one.begin}"
        for one in taken
        if not _is_right(one, plant, injector)
    ]


def _is_right(one: Taken, plant: Numbered, injector: Injector) -> bool:
    number = one.value if isinstance(one.value, int) else -1
    # "RTT " is RTT
    if not 0 <= number < len(plant.asked) or plant.asked[number].rstrip() != one.question:
        return _is_forged(one, injector)
    return number >= one.begin or any(forged.at <= one.until for forged in injector.forged)


def _is_forged(one: Taken, injector: Injector) -> bool:
    """Whether the injector sent it just then, whole and with the right letters."""
    said = f"{one.value:05d}" if isinstance(one.value, int) else ""
    return any(
        forged.question == one.question
        and forged.data == said
        and one.since <= forged.at <= one.until
        for forged in injector.forged
    )


# -- one disturbance, swept over time --------------------------------------------------------------

AROUND_THE_PATIENCE = [PATIENCE_S + step * 1e-4 for step in range(-60, 61, 4)]
TIMES_S = sorted(
    {*(0.004 * step for step in range(1, 60)), *AROUND_THE_PATIENCE, 0.3, 0.35, 0.5, 1.0, 2.0, 3.0}
)


@pytest.mark.parametrize("addressed", [True, False], ids=["addresses", "no addresses"])
@pytest.mark.parametrize("kind", KINDS)
def test_one_disturbed_answer(kind: str, addressed: bool) -> None:
    did: Counter[str] = Counter()
    for place in (9, 10, 12, 13):
        for by_s in TIMES_S if kind in ("late", "twice", "torn") else (0.0, 0.010, 0.090, 0.2):
            for instead in (False, True):
                plan = {place: Deed(kind, by_s, part=(place % 7) / 7, instead=instead)}
                outcome = converse(plan, addressed=addressed, questions=30)
                assert wrong(*outcome) == [], plan
                did += outcome[2].did
                if kind in (
                    "late",
                    "twice",
                    "torn",
                    "merged",
                    "lost",
                    "cut_short",
                    "foreign_within",
                ):
                    break  # nothing replaces these
    assert did[kind] >= 4


@pytest.mark.parametrize("kind", KINDS)
def test_a_series_of_disturbed_answers(kind: str) -> None:
    for by_s in (0.0, 0.02, 0.08, 0.0999, 0.1001, 0.12, 0.2, 0.4):
        for every in (1, 2, 3, 5):
            plan = {
                number: Deed(kind, by_s, part=0.4, instead=number % 2 == 0)
                for number in range(8, 40, every)
            }
            outcome = converse(plan)
            assert wrong(*outcome) == [], (by_s, every)


# -- everything at once ----------------------------------------------------------------------------

IN_THEIR_OWN_TIME = tuple(kind for kind in KINDS if kind not in FORGING)


def deeds(kinds: tuple[str, ...]) -> st.SearchStrategy[Deed]:
    by_s = st.one_of(
        st.floats(0.0, 0.25), st.floats(0.0, 4.0), st.sampled_from(AROUND_THE_PATIENCE)
    )
    return st.builds(Deed, st.sampled_from(kinds), by_s, st.floats(0.05, 0.95), st.booleans())


@pytest.mark.parametrize("kinds", [KINDS, IN_THEIR_OWN_TIME], ids=["all", "in their own time"])
@settings(deadline=None, max_examples=60)
@given(data=st.data(), addressed=st.booleans())
def test_any_deeds(kinds: tuple[str, ...], data: st.DataObject, addressed: bool) -> None:
    plan = data.draw(st.dictionaries(st.integers(0, 45), deeds(kinds), max_size=20))
    assert wrong(*converse(plan, addressed=addressed)) == []


def _random_plan(random: Random, questions: int) -> dict[int, Deed]:
    often, kinds = random.choice([0.02, 0.1, 0.3, 0.7]), random.choice([KINDS, IN_THEIR_OWN_TIME])
    return {
        number: _random_deed(random, kinds)
        for number in range(questions)
        if random.random() < often
    }


def _random_deed(random: Random, kinds: tuple[str, ...]) -> Deed:
    by_s = random.choice(
        [random.uniform(0, 0.25), random.uniform(0, 3), PATIENCE_S + random.uniform(-0.003, 0.003)]
    )
    return Deed(random.choice(kinds), by_s, random.random(), random.random() < 0.5)


@pytest.mark.campaign
@pytest.mark.parametrize("block", range(40))
def test_many_deeds(block: int, counted: Callable[..., None]) -> None:
    for number in range(500 * block, 500 * block + 500):
        random = Random(number)
        plan = _random_plan(random, 200)
        outcome = converse(plan, addressed=random.random() < 0.8, questions=200)
        assert wrong(*outcome) == [], number
        counted(
            conversations=1, questions=200, disturbed_answers=outcome[2].did.total(), wrong_values=0
        )
