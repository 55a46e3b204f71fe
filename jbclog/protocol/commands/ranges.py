"""What a command's value may be, in words for the person who wrote one that it may not be."""

from __future__ import annotations

from jbclog.core.quantities import Choice, Off, Value, text_of
from jbclog.protocol.commands.command import Command, Limits
from jbclog.protocol.commands.omega_values import CONDITIONS, ConditionNumber


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
