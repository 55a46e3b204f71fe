"""Put the value of an answer into the columns of a row."""

from __future__ import annotations

from collections.abc import Callable

from jbclog.core.quantities import Value, permille_of
from jbclog.core.rows import COLUMN, SampleRow
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.feeder import FeederState
from jbclog.protocol.commands.omega import OMEGA_SIGNALS, TRUE_ANSWERS
from jbclog.protocol.commands.signals import STATUS_COLUMNS
from jbclog.session.run.state import StationState
from jbclog.session.scheduler import ScheduledRead

_STATUS, _COOLING, _DESOLDERING, _MOTOR = (COLUMN[name] for name in STATUS_COLUMNS)
_HIGH, _LOW, _FEEDING = COLUMN["alarm_high"], COLUMN["alarm_low"], COLUMN["feeding"]
MOTOR = ("off", "forward", "backward")

Fill = Callable[[SampleRow, Value], None]
"""Writes the values of an answer into the columns of a row."""


def _status(family: Family) -> Fill:
    """Return the filler for ``0MDES``: motor, desoldering, tens, status
    (docs/reference/protocol.md, Status word).
    """
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
    """Fill the flags: units high, tens low (manual 002, R-TAx)."""
    assert isinstance(word, tuple)
    row[_HIGH] = word[4] == 1
    row[_LOW] = word[3] == 1


def _feeding(row: SampleRow, mode: Value) -> None:
    row[_FEEDING] = mode == FeederState.RUNNING


def _flags(*columns: str) -> Fill:
    """Return the filler for OMEGA's states: each answer sets one column or more."""
    places = [(COLUMN[column], TRUE_ANSWERS[column]) for column in columns]

    def fill(row: SampleRow, value: Value) -> None:
        for place, yes in places:
            row[place] = value in yes

    return fill


def _plain(column: str) -> Fill:
    place = COLUMN[column]

    def fill(row: SampleRow, value: Value) -> None:
        row[place] = value

    return fill


def _share(column: str, command: Command, state: StationState) -> Fill:
    """Return the filler for a share of the station's maximum; the raw number is a row of `settings`
    (B-33).
    """
    place = COLUMN[column]

    def fill(row: SampleRow, value: Value) -> None:
        whole = state.whole_of(command)
        if isinstance(value, int) and whole is not None:
            row[place] = permille_of(value, whole)

    return fill


SPECIAL: dict[str, Fill] = {
    "alarm_high": _alarm_flags,
    "feeding": _feeding,
    **{signal.name: _flags(*signal.columns) for signal in OMEGA_SIGNALS},
}


def fill_of(reading: ScheduledRead, state: StationState) -> Fill:
    """Return the filler for the columns of a reading."""
    signal = reading.name
    if signal == "status":
        return _status(state.family)
    if reading.command.share_of is not None:
        return _share(signal, reading.command, state)
    return SPECIAL.get(signal) or _plain(signal)
