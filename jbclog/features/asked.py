"""What a recipe may say of joints (`[joints]`), and what is taken where it says nothing, which a report shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

RECOVERED_WITHIN_C: Final = 3.0
LEAST_DWELL_S, LEAST_DWELL_PERIODS = 0.25, 0.6
MERGE_GAP_S, MERGE_GAP_PERIODS = 0.25, 1.0
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
    """What joints of a run were found with. `learnt`: the keys of which the recipe says nothing and the run told the value."""

    least_dwell_s: float
    merge_gap_s: float
    expected_every_s: float | None
    recovered_within_c: float
    wire_decides: bool
    learnt: tuple[str, ...] = ()


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
