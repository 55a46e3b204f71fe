"""Values that a command accepts, plausible answers, and accepted odd forms."""

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


def range_problem(command: Command, value: Value) -> str | None:
    """Describe why the command cannot carry the value, and what is allowed; None if it can."""
    if command.limits.problem(value) is not None:
        return f"{_as_written(value, command.unit)} is not allowed; {allowed(command)}"
    try:
        command.quantity.encode(value)
    except ValueError as error:
        # do not repeat the range
        return f"{str(error).removesuffix(f'; {allowed(command)}')}; {allowed(command)}"
    return None


def inferred_note(command: Command, value: Value, manual: str) -> str | None:
    """Say, for a plan, that the value exceeds inferred limits; None if it does not. `manual`: the
    family's own.
    """
    if command.inferred is None or command.inferred.limits.problem(value) is None:
        return None
    usual = _usual(command.inferred.limits, f" {command.unit}".rstrip())
    return (
        f"{command.shown(value)} is not within {usual} ({command.inferred.source}). Manual {manual}"
        f" prints no such limit of {command.name}, so it is sent, and the station accepts it or"
        " refuses it with N 00003"
    )


def unit_note(command: Command, manual: str) -> str | None:
    """Say, for a plan, that the unit is from another manual; None if it is the family's own."""
    if command.inferred is None or not command.inferred.unit:
        return None
    return (
        f"manual {manual} prints no unit of {command.name}; {command.unit} is taken from"
        f" {command.inferred.source}"
    )


def allowed(command: Command) -> str:
    """Describe what a manual allows, or say that only the station knows."""
    limits, unit = command.limits, f" {command.unit}".rstrip()
    if isinstance(command.quantity, Choice):
        return f"one of {', '.join(command.quantity.names)}"
    if isinstance(command.quantity, ConditionNumber):
        return CONDITIONS
    off = ', or "off"' if limits.off else ""
    if not limits.printed:
        manual = "its manual prints no range" if command.inferred else "no manual prints a range"
        return manual + off
    if limits.low is None and limits.high is None:
        if not limits.step:
            return "anything"
        own = ", within what the station itself allows" if command.within is not None else ""
        return f"steps of {limits.step:g}{unit}{own}"
    return _range(limits, unit) + off


def _usual(limits: Limits, unit: str) -> str:
    """Describe inferred limits, which may be just a step."""
    return (
        f"steps of {limits.step:g}{unit}"
        if limits.low is None and limits.high is None
        else _range(limits, unit)
    )


def _range(limits: Limits, unit: str) -> str:
    """Describe a range: ``5 °C or more, in steps of 5``."""
    if limits.low is not None and limits.high is not None:
        text = f"{limits.low:g} to {limits.high:g}{unit}"
    elif limits.low is not None:
        text = f"{limits.low:g}{unit} or more"
    else:
        text = f"{limits.high:g}{unit} or less"
    if limits.step:
        text += f", in steps of {limits.step:g}"
    return text


def _as_written(value: Value, unit: str) -> str:
    """Format the value with all its digits, as in the file: rounded, it might look allowed."""
    if isinstance(value, Off):
        return '"off"'
    digits = repr(value).removesuffix(".0") if isinstance(value, float) else text_of(value)
    return f"{digits} {unit}".rstrip()


# Plausibility by the manuals, the station's own limits, and what tools are made for. Anything else
# is not a value, however often it is repeated; it is read again before that is decided.

TEMPERATURES = frozenset({"temperature_c", "external_c", "transistor_c", "transformer_c"})
"""Signals that are temperatures and change slowly."""
STILL_C = 25  # maximum change between two consecutive answers
# sent while no countdown runs (docs/reference/contradictions.md, B-25)
NO_COUNTDOWN = frozenset({99999, 65535})
COUNTED_DOWN = ("sleep_delay", "hibernation_delay")
# A value above full is kept and flagged (docs/reference/contradictions.md, B-32, B-33); above this
# it is invalid.
MOST_OF_FULL = 1.5

Possible = Callable[[Value], bool]


def plausibility_check(signal: str | None, family: Family) -> Possible | None:
    """Return a check whether an answer is plausible as `signal`; None if every answer is."""
    if signal in TEMPERATURES:
        plausible_c = family.plausible_c
        return lambda value: value in plausible_c
    if signal == "delay_s":
        longest_s = longest_countdown_s(family)
        return lambda value: (
            value in NO_COUNTDOWN or (isinstance(value, int) and 0 <= value <= longest_s)
        )
    if signal == "power_permille":
        return lambda value: is_share(value, 1000)
    return None


def longest_countdown_s(family: Family) -> float:
    """Return the family's longest delay in s; infinite if its manual prints no range."""
    ends = [family.commands[name].limits.high for name in COUNTED_DOWN if name in family.commands]
    return max(
        (math.inf if minutes is None else 60.0 * minutes for minutes in ends), default=math.inf
    )


def is_share(value: Value, whole: int) -> bool:
    """Return True if `value` is at most `MOST_OF_FULL` times the whole."""
    return isinstance(value, int) and 0 <= value <= MOST_OF_FULL * whole


# Odd forms accepted from a station, by command name, with their rows in
# docs/reference/contradictions.md. jbclog itself sends only two of them, R-TT with a blank and
# orders without data, and only after the station has refused the recommended form.


@dataclass(frozen=True, slots=True)
class OddForm:
    """Valid data fields that deviate from the recommended form; `data` matches the whole field."""

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
        "selected_air_flow": _odd(33, r".*"),  # its unit is not known: always flagged
        "dispensed_length": _odd(35, r"(?![0-9A-F]{5}$).*|(?!0000\d)\d{5}"),
    }
)
"""Odd data fields of each answer."""

READ_ANSWERED_AS: Mapping[str, tuple[int, str]] = MappingProxyType({"dispensed_cycles": (36, "CD")})
"""Reads that may be answered under another command's letters, with those letters."""

WRITE_ANSWERED_AS: Mapping[str, tuple[int, str]] = MappingProxyType(
    {"alarm_high_delay": (53, "LD")}
)
"""Writes that may be acknowledged under another command's letters."""

ACKNOWLEDGED_WITH_VALUE: Mapping[str, int] = MappingProxyType({"status": 43})
"""Writes whose acknowledgement may repeat the value."""

WITHOUT_DATA: Mapping[str, int] = MappingProxyType({"stop_feeding": 37, "ignore_fuse_error": 37})
"""Orders that may be sent without data after 00000 was refused as badly formed. None of them acts
or erases.
"""


def odd_form(command: str, data: str) -> int | None:
    """Return the B-number of an odd data field in a `command`'s answer; None for the usual form."""
    form = ODD_FORMS.get(command)
    return form.number if form is not None and form.data.fullmatch(data) else None
