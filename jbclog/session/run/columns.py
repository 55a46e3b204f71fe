"""From a value read to the columns of a row: one small function a signal, found by the signal's name."""

from __future__ import annotations

from collections.abc import Callable

from jbclog.core.quantities import Value, permille_of
from jbclog.core.rows import COLUMN, SampleRow
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.omega import OMEGA_SIGNALS, SAYS_YES
from jbclog.protocol.commands.omega_values import UNTOLD
from jbclog.protocol.commands.possible import NO_COUNTDOWN
from jbclog.protocol.commands.signals import STATUS_COLUMNS
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.scheduler import Reading

Fill = Callable[[SampleRow, Value], None]

MOTOR = ("off", "forward", "backward")
NOT_COUNTING = "not_counting"
NO_MAXIMUM = "no_maximum"
NO_DIGIT = "no_digit"

_STATUS, _COOLING, _DESOLDERING, _MOTOR = (COLUMN[name] for name in STATUS_COLUMNS)
_HIGH, _LOW, _FEEDING = COLUMN["alarm_high"], COLUMN["alarm_low"], COLUMN["feeding"]


def _status(family: Family) -> Fill:
    """``0MDES``: motor, desoldering, extractor or cooling, status (docs/reference/protocol.md, Status word)."""
    names, has_motor = family.status.names, family.has_feeder

    def fill(row: SampleRow, word: Value) -> None:
        assert isinstance(word, tuple)
        row[_STATUS] = names[word[4]]
        row[_COOLING] = word[3] == 1
        row[_DESOLDERING] = word[2] == 1
        if has_motor:
            row[_MOTOR] = MOTOR[word[1]]

    return fill


def _alarm_flags(row: SampleRow, word: Value) -> None:
    """Units high, tens low (manual 002, R-TAx)."""
    assert isinstance(word, tuple)
    row[_HIGH] = word[4] == 1
    row[_LOW] = word[3] == 1


def _feeding(row: SampleRow, mode: Value) -> None:
    row[_FEEDING] = mode == "running"


def _flags(*columns: str) -> Fill:
    """OMEGA's states: each answer says yes or no to one column or more."""
    places = [(COLUMN[column], SAYS_YES[column]) for column in columns]

    def fill(row: SampleRow, value: Value) -> None:
        for place, yes in places:
            row[place] = value in yes

    return fill


def _plain(column: str) -> Fill:
    place = COLUMN[column]

    def fill(row: SampleRow, value: Value) -> None:
        row[place] = value

    return fill


def _share(column: str, command: Command, context: SessionContext) -> Fill:
    """Per mille of the station's greatest; the raw number is a row of `settings` (docs/reference/contradictions.md, B-33)."""
    place = COLUMN[column]

    def fill(row: SampleRow, value: Value) -> None:
        whole = whole_of(command, context)
        row[place] = permille_of(value, whole) if isinstance(value, int) and whole is not None else None

    return fill


SPECIAL: dict[str, Fill] = {
    "alarm_high": _alarm_flags,
    "feeding": _feeding,
    **{signal.name: _flags(*signal.columns) for signal in OMEGA_SIGNALS},
}


def fill_of(reading: Reading, context: SessionContext) -> Fill:
    """How the answer to a reading fills its columns."""
    signal = reading.name
    if signal == "status":
        return _status(context.family)
    if reading.command.share_of is not None:
        return _share(signal, reading.command, context)
    return SPECIAL.get(signal) or _plain(signal)


def whole_of(command: Command, context: SessionContext) -> int | None:
    """What the number that `command` tells is a share of, as the station told it; None where it did not."""
    whole = context.held.get(str(command.share_of))
    return whole if isinstance(whole, int) and whole > 0 else None


def unusable(reading: Reading, value: Value, port: PortState, context: SessionContext) -> str | None:
    """Why a well-formed value is not taken, or None.

    A countdown that does not run has no remaining time, a share of something unknown is none, and an answer without its digit
    tells no state.
    """
    if reading.name == "delay_s" and (value in NO_COUNTDOWN or (value == 0 and not _is_counting(port))):
        return NOT_COUNTING
    if value == UNTOLD:
        return NO_DIGIT
    if reading.command.share_of is not None and whole_of(reading.command, context) is None:
        return NO_MAXIMUM
    return void(reading.name, port, context)


def void(signal: str, port: PortState, context: SessionContext) -> str | None:
    """Why no answer means anything while the port's error lasts, or None (docs/reference/contradictions.md, B-44)."""
    return context.family.port_errors.void(port.error, signal)


def _is_counting(port: PortState) -> bool:
    """Whether the tool stands, and so a countdown to sleep or hibernation can be running."""
    return port.status is not None and port.status[4] in (1, 2)
