"""What a command's value may be, in words for the person who wrote one that it may not be."""

from __future__ import annotations

from dataclasses import replace

from jbclog.commands.command import Command, Limits
from jbclog.commands.omega_values import CONDITIONS, ConditionNumber
from jbclog.quantities import Choice, Off, Value, text_of


def range_problem(command: Command, value: Value) -> str | None:
    """Why the command cannot carry the value, with what is allowed, or None."""
    if command.limits.problem(value) is not None:
        return f"{_as_written(value, command.unit)} is not allowed; {allowed(command)}"
    try:
        command.quantity.encode(value)
    except ValueError as error:
        return f"{str(error).removesuffix(f'; {allowed(command)}')}; {allowed(command)}"  # once, where it says so itself
    return None


def allowed(command: Command) -> str:
    """What a manual prints as allowed, what the station itself knows, or that nobody says."""
    limits, unit = command.limits, f" {command.unit}".rstrip()
    if isinstance(command.quantity, Choice):
        return f"one of {', '.join(command.quantity.names)}"
    if isinstance(command.quantity, ConditionNumber):
        return CONDITIONS
    if not limits.printed:
        return "no manual prints a range"
    if command.within is not None and limits.step:
        ends = _range(replace(limits, step=None), unit)
        return f"steps of {limits.step:g}{unit}, within what the station itself allows, and never outside {ends}"
    if limits.low is None and limits.high is None:
        return "anything"
    return _range(limits, unit) + ("; no manual prints the ends" if limits.ours else "") + (', or "off"' if limits.off else "")


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
