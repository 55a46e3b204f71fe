"""What an answer can be at all: by the manuals, by what the station itself told, by what tools are made for.

Anything else is no value, however often it is said. A run asks again before that is believed, too (`session.doubt`), and so
does reading by hand (`byhand.believed`).
"""

from __future__ import annotations

import math
from collections.abc import Callable

from jbclog.core.quantities import Value
from jbclog.protocol.commands.family import Family

TEMPERATURES = frozenset({"temperature_c", "external_c", "transistor_c", "transformer_c"})
"""Signals that are temperatures of something that takes its time to change."""
STILL_C = 25  # between two answers to the same question, one right after the other
NO_COUNTDOWN = frozenset({99999, 65535})  # what a station says when no countdown runs (docs/reference/contradictions.md, B-25)
COUNTED_DOWN = ("sleep_delay", "hibernation_delay")
# What is above full is kept and flagged (docs/reference/contradictions.md, B-32, B-33); so far above it is nothing at all.
MOST_OF_FULL = 1.5

Possible = Callable[[Value], bool]


def possible_as(signal: str | None, family: Family) -> Possible | None:
    """What tells whether an answer can be true as `signal`; None where nothing is known to be impossible."""
    if signal in TEMPERATURES:
        plausible_c = family.plausible_c
        return lambda value: value in plausible_c
    if signal == "delay_s":
        longest_s = longest_countdown_s(family)
        return lambda value: value in NO_COUNTDOWN or (isinstance(value, int) and 0 <= value <= longest_s)
    return _is_power if signal == "power_permille" else None


def longest_countdown_s(family: Family) -> float:
    """The longest delay that can be set on a station of the family, in s; without a bound where its manual prints no range."""
    ends = [family.commands[name].limits.high for name in COUNTED_DOWN if name in family.commands]
    return max((math.inf if minutes is None else 60.0 * minutes for minutes in ends), default=math.inf)


def _is_power(value: Value) -> bool:
    return is_share(value, 1000)


def is_share(value: Value, whole: int) -> bool:
    """Whether this is not much more than the whole."""
    return isinstance(value, int) and 0 <= value <= MOST_OF_FULL * whole
