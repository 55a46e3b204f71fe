"""What an alarm on our own samples is: a limit, how long it must be passed, and how far and long back it must come.

Limit and delay are the station's, as read back (`settings`), so that both sides speak of the same thing. What no station
holds is in `Rules`. An alarm whose limit or delay is off or not known is not evaluated.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Final


class Side(StrEnum):
    """Which limit is passed."""

    HIGH = "high"
    LOW = "low"


class Condition(Enum):
    """What one reading says of one alarm."""

    GAP = "gap"  # nothing: it was not read
    NOT_COUNTED = "not counted"  # the tool does not work, has not come to its setting yet, or the alarm is off
    BEYOND = "beyond"
    IN_BAND = "in band"  # within the limit, and not yet by the dead band
    BACK = "back"


@dataclass(frozen=True, slots=True)
class Rules:
    """What the evaluation of samples adds to a station's limit and delay.

    `dead_band_c`: so far within the limit a reading must be to count as back. `off_delay_s`: so long must it be back; None is
    as long as the delay of the alarm. `stale_s`: without a reading for so long it is uncertain whether an alarm still stands.
    """

    dead_band_c: float = 2.0
    off_delay_s: float | None = None
    stale_s: float = 60.0


@dataclass(frozen=True, slots=True)
class Definition:
    """One alarm of one port, in °C and seconds."""

    side: Side
    limit_c: float
    on_delay_s: float = 0.0
    off_delay_s: float = 0.0
    dead_band_c: float = 0.0

    def condition(self, value: float) -> Condition:
        """What a reading of a tool that counts says. At the limit is not beyond it."""
        excess = value - self.limit_c if self.side is Side.HIGH else self.limit_c - value
        if excess > 0:
            return Condition.BEYOND
        return Condition.BACK if excess <= -self.dead_band_c else Condition.IN_BAND


LIMIT: Final = {Side.HIGH: "alarm_high_limit", Side.LOW: "alarm_low_limit"}
DELAY: Final = {Side.HIGH: "alarm_high_delay", Side.LOW: "alarm_low_delay"}
SETPOINTS: Final = frozenset(["selected_temperature", "selected_air_temperature"])
WATCHED: Final = frozenset([*LIMIT.values(), *DELAY.values(), *SETPOINTS])
"""The settings that an evaluation follows, by their names in `settings`."""


def number(text: str | None) -> float | None:
    """A setting as a number, ``380``, ``0.50 s``; None where it is off or not known."""
    try:
        return float(str(text).split(" ", 1)[0])
    except ValueError:
        return None


def defined(side: Side, held: dict[str, float | None], rules: Rules) -> Definition | None:
    """The alarm by what the station holds; None where it is off or not known."""
    limit, delay = held.get(LIMIT[side]), held.get(DELAY[side])
    if limit is None or delay is None:
        return None
    return Definition(side, limit, delay, delay if rules.off_delay_s is None else rules.off_delay_s, rules.dead_band_c)


def bare(definition: Definition | None) -> Definition | None:
    """The same limit without delays and dead band: every excursion that was sampled."""
    return None if definition is None else Definition(definition.side, definition.limit_c)
