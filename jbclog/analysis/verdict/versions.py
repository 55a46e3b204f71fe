"""The versions of rules and methods. A manifest names the one that its run was judged by; without one it is 1.

A sealed verdict is held against its own version. Where a later version changed a rule, either the earlier form of it is still
here, or a run of an earlier version cannot be judged by that rule any more; then nothing is said against its verdict.
To change a rule or a method: a new row with its name, and what becomes of the earlier form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Version:
    """One version. `changed`: rules that are new in it or find another figure than before, by name.

    `keeps_earlier`: whether the judge can still do what these rules were before; but for those that are `gone`.
    """

    number: int
    means: str
    changed: frozenset[str] = frozenset()
    keeps_earlier: bool = True
    gone: frozenset[str] = frozenset()


BOUNDS_HOLD: Final = 3
"""The version from which on a figure has a bound that holds where readings follow each other, and no limit is kept without one."""

OF_JOINTS: Final = ("recovery_p95", "recovered_before_next", "joints_against_counter")

VERSIONS: Final = (
    Version(1, "the first release"),
    Version(
        2,
        "a temperature that was set has to be reached; what the computer skipped breaks no limit; "
        "per cent are judged with the resolution of the run",
        frozenset({"reached", "coverage", "longest_gap"}),
    ),
    Version(
        BOUNDS_HOLD,
        "only readings of a tip at rest are idle; bounds hold under slow drift; a limit without a bound is not kept; "
        "joints are found by the tip's own heat balance; a tip is back at the level at which it rests",
        frozenset({"idle_error", "idle_sd", *OF_JOINTS}),
        gone=frozenset(OF_JOINTS),
    ),
    Version(
        4,
        "the number of joints is known only where they stay the same under other assumptions",
        frozenset(OF_JOINTS),
        gone=frozenset(OF_JOINTS),
    ),
    Version(
        5,
        "joints are placed by the power where the station shows the temperature later than the power",
        frozenset(OF_JOINTS),
        gone=frozenset(OF_JOINTS),
    ),
)
RULES: Final = VERSIONS[-1].number
"""By which runs are judged from now on."""


def is_known(number: int) -> bool:
    """Whether it is one of `VERSIONS`; a later jbclog has more."""
    return any(one.number == number for one in VERSIONS)


def not_kept(number: int) -> frozenset[str]:
    """The rules of version `number` that cannot be judged here as they were then."""
    later = [one.gone if one.keeps_earlier else one.changed for one in VERSIONS if one.number > number]
    return frozenset().union(*later)
