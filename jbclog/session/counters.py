"""The hour and cycle counters, read whole at the start and at the end of a run."""

from __future__ import annotations

from jbclog.effects import Steps
from jbclog.errors import NotSupported, RobotModeOff, StationError, StationSilent
from jbclog.rows import CounterRow
from jbclog.session.order import Desk


def read_counters(desk: Desk) -> Steps[None]:
    """A row for every counter of every port; null with its reason where it could not be read.

    Raises `StationSilent` or `RobotModeOff` where nothing can be read any more.
    """
    for port in desk.ports.values():
        for counter in desk.family.counters:
            if counter.name in desk.not_supported:
                continue
            command, value, raw = desk.command(counter.command), None, ""
            try:
                found = yield from desk.station.read(command, port.number)
                value, raw = float(found) if isinstance(found, int | float) else None, command.quantity.encode(found)
            except NotSupported:
                desk.not_supported.add(counter.name)
                continue
            except (StationSilent, RobotModeOff):
                raise
            except StationError as error:
                raw = f"<{error.reason}>"
            time = desk.utc.micros(desk.now)
            desk.journal.counter(CounterRow(time, desk.name, port.number, counter.name, value, counter.unit, raw))
