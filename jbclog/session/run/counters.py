"""Rows of the hour and cycle counters.

Each is read at the start and at the end of a run, until two answers are equal.
"""

from __future__ import annotations

from jbclog.core.errors import LinkError, NotSupported, RobotModeOff, StationError, StationSilent
from jbclog.core.rows import CounterRow
from jbclog.protocol.commands.signals import UsageCounter
from jbclog.session.run.context import SessionContext
from jbclog.session.run.state import PortState


async def read_counters(context: SessionContext) -> None:
    """Record a row for every counter of every port; null with its reason if it cannot be read.

    Raises `LinkError`, `StationSilent` or `RobotModeOff` if nothing more can be read.
    """
    state = context.state
    for port in state.ports.values():
        for counter in state.family.counters:
            if counter.name not in state.not_supported:
                await _read(context, port, counter)


async def _read(context: SessionContext, port: PortState, counter: UsageCounter) -> None:
    command, known = context.command(counter.command), port.counted.get(counter.name)
    try:
        found = await context.reads.confirmed(command, port.number, known=known, grows=True)
    except NotSupported:
        context.state.not_supported.add(counter.name)
    except (LinkError, StationError) as error:
        _keep(context, port, counter, None, f"<{error.reason}>")
        if isinstance(error, LinkError | StationSilent | RobotModeOff):
            raise
    else:
        port.counted[counter.name] = found
        _keep(
            context,
            port,
            counter,
            float(found) if isinstance(found, int | float) else None,
            command.raw_text(context.station.data, found),
        )


def _keep(
    context: SessionContext, port: PortState, counter: UsageCounter, value: float | None, raw: str
) -> None:
    due = context.state.facts.due.setdefault(str(port.number), {})
    due[counter.name] = due.get(counter.name, 0) + 1
    counter_row(context, port, counter, value, raw)


def counter_row(
    context: SessionContext, port: PortState, counter: UsageCounter, value: float | None, raw: str
) -> None:
    """Record a row of a counter; `value` None with its reason in `raw` if it was not read."""
    time = context.log.utc.micros(context.now)
    context.log.journal.counter(
        CounterRow(time, context.name, port.number, counter.name, value, counter.unit, raw)
    )
