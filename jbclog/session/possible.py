"""What a reading can be at all: by the manuals, by what the station itself told, by what tools are made for.

Anything else is no value, however often it is said. It is asked again before that is believed, too (`doubt.py`).
"""

from __future__ import annotations

from collections.abc import Callable

from jbclog.commands.command import Command
from jbclog.quantities import Value
from jbclog.scheduler import Reading
from jbclog.session.columns import NO_COUNTDOWN, whole_of
from jbclog.session.order import Desk

TEMPERATURES = frozenset({"temperature_c", "external_c", "transistor_c", "transformer_c"})
"""Signals that are temperatures of something that takes its time to change."""
LONGEST_COUNTDOWN_S = 3600  # the longest delay that can be set is that to hibernation, 60 min (002, W-Hxy)
MOST_OF_FULL = 1.5  # what is above full is kept and flagged (digest B-32, B-33); so far above it is nothing at all

Possible = Callable[[Value], bool]


def possible_of(desk: Desk, reading: Reading) -> Possible | None:
    """What tells whether an answer to `reading` can be true; None where nothing is known to be impossible."""
    command = reading.command
    if reading.name in TEMPERATURES:
        plausible_c = desk.family.plausible_c
        return lambda value: value in plausible_c
    if reading.name == "delay_s":
        return _is_countdown
    if command.share_of is not None:
        return _share_of(command, desk)
    if reading.name == "power_permille":
        return _is_power
    return None


def _is_countdown(value: Value) -> bool:
    return value in NO_COUNTDOWN or (isinstance(value, int) and 0 <= value <= LONGEST_COUNTDOWN_S)


def _is_power(value: Value) -> bool:
    return isinstance(value, int) and 0 <= value <= MOST_OF_FULL * 1000


def _share_of(command: Command, desk: Desk) -> Possible:
    """Not much more than the whole, as soon as that is known."""

    def is_share(value: Value) -> bool:
        whole = whole_of(command, desk)
        return whole is None or (isinstance(value, int) and 0 <= value <= MOST_OF_FULL * whole)

    return is_share
