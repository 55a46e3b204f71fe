"""Options of a recipe's `[joints]`, and the settings that joints are found with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import Final

RECOVERED_WITHIN_C: Final = 3.0
LEAST_DWELL_S, LEAST_DWELL_PERIODS = 0.25, 0.6
MERGE_GAP_S, MERGE_GAP_PERIODS = 0.25, 1.0
LEAST_TIMES: Final = 10  # intervals between joints, for a regular interval
REGULAR_WITHIN, REGULAR_SHARE = 0.1, 0.8  # share of the median; share of the intervals
LEARNT: Final = ("least_dwell_s", "merge_gap_s", "wire_decides")


@dataclass(frozen=True, slots=True)
class JointOptions:
    """The options of a recipe; None: from the run. `expected_every_s` helps to separate two
    contacts and never makes a joint.
    """

    least_dwell_s: float | None = None
    merge_gap_s: float | None = None
    expected_every_s: float | None = None
    recovered_within_c: float = RECOVERED_WITHIN_C
    wire_decides: bool | None = None


def options_of(table: Mapping[str, object]) -> JointOptions:
    """Return the options in a recipe's `[joints]`; a value of the wrong type counts as missing."""
    numbers = {
        name: float(value)
        for name in ("least_dwell_s", "merge_gap_s", "expected_every_s", "recovered_within_c")
        if isinstance(value := table.get(name), int | float) and not isinstance(value, bool)
    }
    decides = table.get("wire_decides")
    return JointOptions(**numbers, wire_decides=decides if isinstance(decides, bool) else None)


@dataclass(frozen=True, slots=True)
class JointSettings:
    """Settings that the joints of a run were found with. `learnt` has the keys that the recipe
    leaves open.

    `every_s` is the regular interval between the joints found; it is for reports and does not
    affect the search.
    """

    least_dwell_s: float
    merge_gap_s: float
    expected_every_s: float | None
    recovered_within_c: float
    wire_decides: bool
    learnt: tuple[str, ...] = ()
    every_s: float | None = None


def settings_for(options: JointOptions, period_s: float, wire_decides: bool) -> JointSettings:
    """Return the options, completed by the shortest draw and gap that this period shows and whether
    the feeder decides.
    """
    least, gap = options.least_dwell_s, options.merge_gap_s
    return JointSettings(
        max(LEAST_DWELL_S, LEAST_DWELL_PERIODS * period_s) if least is None else least,
        max(MERGE_GAP_S, MERGE_GAP_PERIODS * period_s) if gap is None else gap,
        options.expected_every_s,
        options.recovered_within_c,
        wire_decides if options.wire_decides is None else options.wire_decides and wire_decides,
        tuple(name for name in LEARNT if getattr(options, name) is None),
    )


def regular_every_s(starts: Sequence[float]) -> float | None:
    """Return the regular interval in s between the starts of joints; None if most intervals differ,
    or if they are few.
    """
    times = [after - before for before, after in pairwise(starts)]
    if len(times) < LEAST_TIMES:
        return None
    usual = median(times)
    regular = sum(abs(one - usual) <= REGULAR_WITHIN * usual for one in times)
    return usual if regular >= REGULAR_SHARE * len(times) else None
