"""What is known of each kind of counter: how finely it counts, where it rolls over, and how fast it can plausibly go.

Counters are five digits wide, decimal, and hexadecimal for the dispensed length (docs/reference/contradictions.md, B-35).
No manual prints what comes
after the last number; that it is zero is supposed, and said of every difference that rests on it. The fastest plausible pace
is this program's own supposition, too: it only decides how many roll-overs are thinkable while nobody looked.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

FIVE_DIGITS: Final = 100_000.0
HEX_DIGITS: Final = 5
DRIFT: Final = 1.01  # by which a station's clock may differ from ours
LEAST_MODULUS: Final = 16.0**HEX_DIGITS / 10


@dataclass(frozen=True, slots=True)
class Trait:
    """`step`: two readings that differ by d stand for d - step to d + step. `fastest`: an hour of `hours`, the counters of time
    that it goes with, the first that there is; none of them: of time on the wall."""

    step: float
    fastest: float
    hours: tuple[str, ...] = ()

    @property
    def is_time(self) -> bool:
        return not self.hours


HOURS: Final = Trait(step=1.0, fastest=DRIFT)
TRAITS: Final = {
    "sleep_cycles": Trait(0.0, 60.0, ("plugged_h", "on_h")),
    "desolder_cycles": Trait(0.0, 600.0, ("work_h",)),
    "dispensed_cycles": Trait(0.0, 2000.0, ("work_h",)),
    "dispensed_mm": Trait(0.1, 4000.0, ("work_h",)),
    "tool_cycles": Trait(0.0, 60.0, ("on_h",)),
    "suction_cycles": Trait(0.0, 600.0, ("on_h",)),
}


def trait_of(counter: str) -> Trait:
    """Hours unless the table knows better."""
    return TRAITS.get(counter, HOURS)


def modulus_of(counter: str, shown: Iterable[float]) -> float:
    """What the counter goes on from zero after; of a length that showed more than five digits, the next width that holds it."""
    if counter != "dispensed_mm":
        return FIVE_DIGITS
    modulus, most = LEAST_MODULUS, max(shown, default=0.0)
    while most >= modulus:
        modulus *= 16
    return modulus
