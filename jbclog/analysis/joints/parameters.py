"""What a recipe may say of joints (`[joints]`), and what is taken where it says nothing, which a report shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import Final

RECOVERED_WITHIN_C: Final = 3.0
LEAST_DWELL_S, LEAST_DWELL_PERIODS = 0.25, 0.6
MERGE_GAP_S, MERGE_GAP_PERIODS = 0.25, 1.0
LEAST_TIMES: Final = 10  # from one joint to the next, for a regular time
REGULAR_WITHIN, REGULAR_SHARE = 0.1, 0.8  # of the median; of the times
LEARNT: Final = ("least_dwell_s", "merge_gap_s", "wire_decides")


@dataclass(frozen=True, slots=True)
class Asked:
    """None: learnt from the run. `expected_every_s` is a prior for telling two contacts apart; it never makes a joint."""

    least_dwell_s: float | None = None
    merge_gap_s: float | None = None
    expected_every_s: float | None = None
    recovered_within_c: float = RECOVERED_WITHIN_C
    wire_decides: bool | None = None


def asked_of(table: Mapping[str, object]) -> Asked:
    """What a recipe's `[joints]` asks for; what is no number where one is due is not asked for."""
    numbers = {
        name: float(value)
        for name in ("least_dwell_s", "merge_gap_s", "expected_every_s", "recovered_within_c")
        if isinstance(value := table.get(name), int | float) and not isinstance(value, bool)
    }
    decides = table.get("wire_decides")
    return Asked(**numbers, wire_decides=decides if isinstance(decides, bool) else None)


@dataclass(frozen=True, slots=True)
class Taken:
    """What joints of a run were found with. `learnt`: the keys of which the recipe says nothing and the run told the value.

    `every_s`: the regular time from one joint to the next, learnt from the joints found; it is shown, and finds none itself.
    """

    least_dwell_s: float
    merge_gap_s: float
    expected_every_s: float | None
    recovered_within_c: float
    wire_decides: bool
    learnt: tuple[str, ...] = ()
    every_s: float | None = None


def taken(asked: Asked, period_s: float, wire_decides: bool) -> Taken:
    """The values asked for; else the shortest draw and gap that this sampling rate shows, and what the feeder's use tells."""
    least, gap = asked.least_dwell_s, asked.merge_gap_s
    return Taken(
        max(LEAST_DWELL_S, LEAST_DWELL_PERIODS * period_s) if least is None else least,
        max(MERGE_GAP_S, MERGE_GAP_PERIODS * period_s) if gap is None else gap,
        asked.expected_every_s,
        asked.recovered_within_c,
        wire_decides if asked.wire_decides is None else asked.wire_decides and wire_decides,
        tuple(name for name in LEARNT if getattr(asked, name) is None),
    )


def regular_every_s(starts: Sequence[float]) -> float | None:
    """The time from one joint's start to the next, where most of the times are alike; None where they are not, or are few."""
    times = [after - before for before, after in pairwise(starts)]
    if len(times) < LEAST_TIMES:
        return None
    usual = median(times)
    alike = sum(abs(one - usual) <= REGULAR_WITHIN * usual for one in times)
    return usual if alike >= REGULAR_SHARE * len(times) else None
