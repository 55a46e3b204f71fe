"""What the value of a command may be, what an answer can be at all, and what is tolerated beside it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from jbclog.core.quantities import Choice, Off, Value, text_of
from jbclog.protocol.commands.command import Command, Limits
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.omega import CONDITIONS, ConditionNumber

# -- ranges -------------------------------------------------------------------------------------------------------------------


def range_problem(command: Command, value: Value) -> str | None:
    """Why the command cannot carry the value, with what is allowed, or None."""
    if command.limits.problem(value) is not None:
        return f"{_as_written(value, command.unit)} is not allowed; {allowed(command)}"
    try:
        command.quantity.encode(value)
    except ValueError as error:
        return f"{str(error).removesuffix(f'; {allowed(command)}')}; {allowed(command)}"  # once, where it says so itself
    return None


def inferred_note(command: Command, value: Value, manual: str) -> str | None:
    """Where the value is beyond what was inferred, for a plan; None where it is not. `manual`: the family's own."""
    if command.inferred is None or command.inferred.limits.problem(value) is None:
        return None
    usual = _usual(command.inferred.limits, f" {command.unit}".rstrip())
    return (
        f"{command.shown(value)} is not within {usual} ({command.inferred.source}). Manual {manual} prints no such limit of "
        f"{command.name}, so it is sent, and the station accepts it or refuses it with N 00003"
    )


def unit_note(command: Command, manual: str) -> str | None:
    """That the unit is another manual's, for a plan; None where the family's own prints it."""
    if command.inferred is None or not command.inferred.unit:
        return None
    return f"manual {manual} prints no unit of {command.name}; {command.unit} is taken from {command.inferred.source}"


def allowed(command: Command) -> str:
    """What a manual prints as allowed, what the station itself knows, or that nobody says."""
    limits, unit = command.limits, f" {command.unit}".rstrip()
    if isinstance(command.quantity, Choice):
        return f"one of {', '.join(command.quantity.names)}"
    if isinstance(command.quantity, ConditionNumber):
        return CONDITIONS
    off = ', or "off"' if limits.off else ""
    if not limits.printed:
        return ("its manual prints no range" if command.inferred else "no manual prints a range") + off
    if limits.low is None and limits.high is None:
        if not limits.step:
            return "anything"
        own = ", within what the station itself allows" if command.within is not None else ""
        return f"steps of {limits.step:g}{unit}{own}"
    return _range(limits, unit) + off


def _usual(limits: Limits, unit: str) -> str:
    """Inferred limits, of which there can be a step alone."""
    return f"steps of {limits.step:g}{unit}" if limits.low is None and limits.high is None else _range(limits, unit)


def _range(limits: Limits, unit: str) -> str:
    """``5 °C or more, in steps of 5``."""
    low, high = (None if end is None else f"{end:g}" for end in (limits.low, limits.high))
    text = f"{low} to {high}{unit}" if low and high else f"{low}{unit} or more" if low else f"{high}{unit} or less"
    return text + (f", in steps of {limits.step:g}" if limits.step else "")


def _as_written(value: Value, unit: str) -> str:
    """The value with all its digits, as the file has it: rounded it might look allowed."""
    if isinstance(value, Off):
        return '"off"'
    digits = repr(value).removesuffix(".0") if isinstance(value, float) else text_of(value)
    return f"{digits} {unit}".rstrip()


# -- possible -----------------------------------------------------------------------------------------------------------------
# What an answer can be at all: by the manuals, by what the station itself told, by what tools are made for.
#
# Anything else is no value, however often it is said. A run asks again before that is believed, too (`session.doubt`), and so
# does reading by hand (`byhand.believed`).

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


# -- tolerated ----------------------------------------------------------------------------------------------------------------
# What is taken from a station beside the recommended form, by command name; each with its row of
# docs/reference/contradictions.md.
#
# Nothing of this is ever sent by itself, but for R-TT with a blank and orders without data, once the station has refused the
# recommended form.


@dataclass(frozen=True, slots=True)
class OddForm:
    """Data fields that mean something and are not what the manuals recommend; `data` matches the whole field."""

    number: int
    data: re.Pattern[str]


def _odd(number: int, pattern: str) -> OddForm:
    return OddForm(number, re.compile(pattern, re.ASCII))


_NO_DOT = _odd(22, r"0\d{4}")
_NO_LIMIT = _odd(23, r"00000|(?!99999|00600|00[0-5]\d\d)\d{5}")

ODD_FORMS: Mapping[str, OddForm] = MappingProxyType(
    {
        "adjust": _odd(3, r"\.\d{4}"),
        "software_version": _odd(5, r"(?!.{5}$).*"),
        "alarm_high_delay": _NO_DOT,
        "alarm_low_delay": _NO_DOT,
        "alarm_high_limit": _NO_LIMIT,
        "alarm_low_limit": _NO_LIMIT,
        "alarm_flags": _odd(24, r"000(?![01]{2})\d\d"),
        "time_to_sleep": _odd(25, r"65535"),
        "port_error": _odd(28, r"80000"),
        "power": _odd(32, r"(?!00\d{3}|01000)\d{5}"),
        "model": _odd(34, r"(?!.{5}$).*|.* |UCR24|UCR47"),
        "selected_air_flow": _odd(33, r".*"),  # whose unit nothing decides: always marked
        "dispensed_length": _odd(35, r"(?![0-9A-F]{5}$).*|(?!0000\d)\d{5}"),
    }
)
"""Which data fields of which answer are odd."""

READ_ANSWERED_AS: Mapping[str, tuple[int, str]] = MappingProxyType({"dispensed_cycles": (36, "CD")})
"""Reads that may be answered under the letters of another, with those letters."""

WRITE_ANSWERED_AS: Mapping[str, tuple[int, str]] = MappingProxyType({"alarm_high_delay": (53, "LD")})
"""Writes that may be acknowledged under the letters of another."""

ACKNOWLEDGED_WITH_VALUE: Mapping[str, int] = MappingProxyType({"status": 43})
"""Writes whose acknowledgement may repeat the value."""

WITHOUT_DATA: Mapping[str, int] = MappingProxyType({"stop_feeding": 37, "ignore_fuse_error": 37})
"""Orders that may be sent without data once 00000 was badly formed; those that act or erase are not among them."""


def odd_form(command: str, data: str) -> int | None:
    """The B-number by which the data field of an answer to `command` is odd; None where it is as recommended."""
    form = ODD_FORMS.get(command)
    return form.number if form is not None and form.data.fullmatch(data) else None
