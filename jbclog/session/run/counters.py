"""The hour and cycle counters, read whole at the start and at the end of a run; each counts when two answers say the same."""

from __future__ import annotations

from jbclog.core.errors import LinkError, NotSupported, RobotModeOff, StationError, StationSilent
from jbclog.core.io_requests import Steps
from jbclog.core.rows import CounterRow
from jbclog.protocol.commands.signals import Counter
from jbclog.session.run.context import PortState, SessionContext


def read_counters(desk: SessionContext) -> Steps[None]:
    """A row for every counter of every port; null with its reason where it could not be read.

    Raises `LinkError`, `StationSilent` or `RobotModeOff` where nothing can be read any more.
    """
    for port in desk.ports.values():
        for counter in desk.family.counters:
            if counter.name not in desk.not_supported:
                yield from _read(desk, port, counter)


def _read(desk: SessionContext, port: PortState, counter: Counter) -> Steps[None]:
    command, known = desk.command(counter.command), port.counted.get(counter.name)
    try:
        found = yield from desk.agreed(command, port.number, known=known, grows=True)
    except NotSupported:
        desk.not_supported.add(counter.name)
    except (LinkError, StationError) as error:
        _keep(desk, port, counter, None, f"<{error.reason}>")
        if isinstance(error, LinkError | StationSilent | RobotModeOff):
            raise
    else:
        port.counted[counter.name] = found
        _keep(
            desk,
            port,
            counter,
            float(found) if isinstance(found, int | float) else None,
            command.as_it_came(desk.station.data, found),
        )


def _keep(desk: SessionContext, port: PortState, counter: Counter, value: float | None, raw: str) -> None:
    due = desk.facts.due.setdefault(str(port.number), {})
    due[counter.name] = due.get(counter.name, 0) + 1
    time = desk.utc.micros(desk.now)
    desk.journal.counter(CounterRow(time, desk.name, port.number, counter.name, value, counter.unit, raw))
