"""How often a lost link is tried again, and what is said of it: each number from both sides."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest

from support.product import (
    FAMILIES,
    FIRST_AFTER_FLOOD_S,
    FIRST_SEEK_S,
    FORGOTTEN_S,
    HOT_C,
    LONGEST_AFTER_FLOOD_S,
    LONGEST_SEEK_S,
    LinkError,
    LinkFlooded,
    Severity,
    first_pause_s,
    next_pause_s,
    note_flood_over,
    report_flood,
    report_loss,
)

FLOOD = LinkFlooded(9000, 40, 1.0, 400)


class Desk(SimpleNamespace):
    """As much of a desk as a loss concerns."""

    def __init__(self) -> None:
        ports = {1: SimpleNamespace(number=1, touched=True, temperature_c=None)}
        super().__init__(
            now=100.0,
            ports=ports,
            family=FAMILIES["dde"],
            facts=SimpleNamespace(outages=0),
            connected=True,
        )
        self.is_flooded, self.flood_ended, self.flood_pause_s = False, None, FIRST_AFTER_FLOOD_S
        self.noted: list[tuple[Any, ...]] = []

    def note(self, kind: str, severity: Severity, text: str, **more: object) -> None:
        self.noted.append((kind, severity, text, more))


def pauses(context: Any, count: int) -> list[float]:
    """How long is waited before each try."""
    found = [first_pause_s(context)]
    while len(found) < count:
        found.append(next_pause_s(context, found[-1]))
    return found


def test_a_lost_link_is_sought_a_little_more_rarely_each_time() -> None:
    found = pauses(Desk(), 20)
    assert found[0] == FIRST_SEEK_S
    assert all(before < after <= 1.5 * before for before, after in pairwise(found[:11]))
    assert found[-1] == LONGEST_SEEK_S


def test_a_flooded_one_is_left_alone_for_twice_as_long_each_time() -> None:
    context: Any = Desk()
    report_flood(context, FLOOD)
    assert pauses(context, 6) == [1.0, 2.0, 4.0, 8.0, LONGEST_AFTER_FLOOD_S, LONGEST_AFTER_FLOOD_S]


@pytest.mark.parametrize(("later_s", "first"), [(FORGOTTEN_S - 0.1, 2.0), (FORGOTTEN_S + 0.1, 1.0)])
def test_one_that_is_flooded_again_goes_on_from_there_until_it_is_forgotten(
    later_s: float, first: float
) -> None:
    context: Any = Desk()
    report_flood(context, FLOOD)
    report_flood(context, FLOOD)  # it goes on
    assert [kind for kind, *_ in context.noted] == ["link.flooded"]
    note_flood_over(context)
    context.now += later_s
    report_flood(context, FLOOD)
    assert first_pause_s(context) == first
    assert len(context.noted) == 2


def test_a_link_that_comes_back_from_silence_was_not_flooded() -> None:
    context: Any = Desk()
    note_flood_over(context)
    report_flood(context, FLOOD)
    assert first_pause_s(context) == FIRST_AFTER_FLOOD_S


@pytest.mark.parametrize(("last_c", "is_hot"), [(HOT_C, False), (HOT_C + 1, True), (None, False)])
@pytest.mark.parametrize("cause", [FLOOD, LinkError("gone")], ids=["flood", "gone"])
def test_a_tip_that_was_last_seen_hot_makes_the_loss_critical(
    cause: LinkError, last_c: int | None, is_hot: bool
) -> None:
    assert HOT_C == 60
    context: Any = Desk()
    context.ports[1].temperature_c = last_c
    report_loss(context, cause)
    ((_, severity, text, _),) = context.noted
    assert severity is (Severity.CRITICAL if is_hot else Severity.ERROR)
    assert (f"port 1 at {last_c} °C" in text) == is_hot
    assert (context.facts.outages, context.connected) == (1, False)
    context.ports[1].touched = False  # it is as somebody else set it
    report_loss(context, LinkError("gone"))
    assert context.noted[-1][1] is Severity.ERROR
