"""Versions of rules and methods. A manifest names the version that judged its run; without one it
is 1.

A sealed verdict is compared by its own version. If a later version changed a rule, the earlier form
is either kept here or gone; a rule that is gone is not applied to runs of earlier versions, which
never counts against their verdict. To change a rule or a method, add a row with its name, and
whether the earlier form is kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Version:
    """A version. `changed`: rules that are new in it, or give other figures than before.

    `keeps_earlier`: the earlier forms of these rules are kept, except those in `gone`. `means`:
    what changed, as a sentence.
    """

    number: int
    means: str
    changed: frozenset[str] = frozenset()
    keeps_earlier: bool = True
    gone: frozenset[str] = frozenset()


BOUNDS_HOLD: Final = 3
"""First version with bounds corrected for autocorrelation; a limit needs a bound since then."""

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
        "only readings of a tip at rest are idle; bounds hold under slow drift; a limit without a"
        " bound is not kept; joints are found by the tip's own heat balance; a tip is back at the"
        " level at which it rests",
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
        "joints are placed by the power where the station shows the temperature later than the"
        " power",
        frozenset(OF_JOINTS),
        gone=frozenset(OF_JOINTS),
    ),
    Version(
        6,
        "without a heat-up, contacts are not taken for the rest of a heavier tip; joints are also"
        " placed by the lag that the heat balance shows",
        frozenset(OF_JOINTS),
        gone=frozenset(OF_JOINTS),
    ),
    Version(
        7,
        "where a joint would not stand out from the noise, none found is not known; with a feeder,"
        " weak draws without a feed are no joints, and joints begin no later than their feeds",
        frozenset(OF_JOINTS),
        gone=frozenset(OF_JOINTS),
    ),
)
RULES: Final = VERSIONS[-1].number
"""The version that judges new runs."""


def is_known(number: int) -> bool:
    """Whether this jbclog knows the version."""
    return any(one.number == number for one in VERSIONS)


def not_kept(number: int) -> frozenset[str]:
    """Return the rules of version `number` whose form of then is gone."""
    later = [
        one.gone if one.keeps_earlier else one.changed for one in VERSIONS if one.number > number
    ]
    return frozenset().union(*later)
