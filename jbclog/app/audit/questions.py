"""Reads one station for an audit, each value until it is confirmed.

Sends only reads that change nothing, and never reads the alarm flags, because reading clears them.
There is one attempt per station, so one that does not answer costs only the time of its reads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Final

from jbclog.app import connection
from jbclog.core.errors import LinkError, RobotModeOff, StationError, StationSilent
from jbclog.core.quantities import Value, text_of
from jbclog.maintenance.counter_totals.observed import (
    Count,
    Errors,
    Identity,
    Observation,
    Standing,
)
from jbclog.protocol.commands.command import TOOLS_WITH_A_PLACE, Command, Effect, Scope
from jbclog.protocol.commands.family import FAMILIES, OMEGA, Family
from jbclog.session.manual.contact import (
    PORTS,
    Contact,
    Target,
    open_contact,
)
from jbclog.session.setting_write import WHOLE_STATION, Place
from jbclog.transport.read_only import OnlyReads

# -- harmless reads --------------------------------------------------------------------------------
# The port of an audit passes only reads that change nothing (R-TA clears the alarm flags).


def harmless_for(family: Family | None) -> OnlyReads:
    """Return the filter for reads of the protocol of `family` that change nothing."""
    only_reads, clearing = connection.only_reads_for(family), _clearing()
    return lambda data: only_reads(data) and not any(code in data for code in clearing)


@cache
def _clearing() -> frozenset[bytes]:
    """Return every read of any family that has an effect, at every port."""
    commands = [one for family in FAMILIES.values() for one in family.commands.values()]
    doing = [
        one
        for one in commands
        if one.readable and one.effect is not Effect.NONE and one.scope is Scope.PORT
    ]
    return frozenset(f"R{one.code(port)}".encode() for one in doing for port in PORTS)


# -- confirmed read --------------------------------------------------------------------------------
# A value is confirmed when two of at most three readings are equal.

MOST_READS: Final = 3
NO_TIME: Final = "no time left for it"


@dataclass(frozen=True, slots=True)
class Answer:
    """Values read and the confirmed one. If it is None and there is no `why`, no two readings were
    equal.
    """

    given: tuple[Value, ...] = ()
    value: Value | None = None
    why: str = ""


@dataclass(slots=True)
class StationReader:
    """Reads one station until `until` (monotonic seconds); `over`: why it cannot be read."""

    contact: Contact
    until: float
    over: str = ""
    over_reason: str = ""

    async def twice(self, command: Command, place: Place = WHOLE_STATION) -> Answer:
        """Read until two values are equal. Never raises for a fault of the station or its cable."""
        given: list[Value] = []
        try:
            while len(given) < MOST_READS and not self._is_over():
                given.append(await self.contact.read(command, place))
                if given[-1] in given[:-1]:
                    return Answer(tuple(given), given[-1])
        except (StationSilent, RobotModeOff, LinkError) as error:
            self.over, self.over_reason = str(error), error.reason
        except StationError as error:
            return Answer(tuple(given), None, error.reason)
        return Answer(tuple(given), None, self.over_reason)

    def _is_over(self) -> bool:
        if not self.over and self.contact.client.now > self.until:
            self.over = self.over_reason = NO_TIME
        return bool(self.over)


# -- observation -----------------------------------------------------------------------------------

QUESTIONS: Final = 400  # more than the reads of a station with four ports
SPARE_S: Final = 10.0
OF_THE_JOB: Final = frozenset({"status", "work_mode"})  # each run sets them, like all `SELECTED`
SELECTED: Final = "selected_"
READ_ONLY: Final = frozenset({"mode", "fuse"})  # set at the station itself


@dataclass(frozen=True, slots=True)
class SurveyTarget:
    """A station to be read. `audit`: start of the audit, `since`: when the station was last read,
    UTC as text.
    """

    audit: str
    line: str
    target: Target
    since: str | None = None

    def unseen(self, time: str, why: str) -> Observation:
        """Return an observation without a reading at `time`, for the reason `why`."""
        name, url = self.target.name, self.target.url
        return Observation(
            time, self.audit, self.line, name, url, False, why.removeprefix(f"{name}: ")
        )


@dataclass(slots=True)
class _Seen:
    reader: StationReader
    ports: list[int] = field(default_factory=list)
    tools: dict[int, int] = field(default_factory=dict)
    counts: list[Count] = field(default_factory=list)
    parameters: dict[str, str] = field(default_factory=dict)
    errors: Errors = field(default_factory=Errors)
    software: str | None = None

    @property
    def family(self) -> Family:
        return self.reader.contact.family


async def look(wanted: SurveyTarget, utc_of: Callable[[float], str]) -> Observation:
    """Read the station; the observation has the reason for each missing value. `utc_of` converts
    monotonic times to UTC.

    Raises `StartRefused` if no usable station answers, and `LinkError` if there is no port.
    """
    contact = await open_contact(wanted.target)
    client = contact.client
    if not contact.is_proven:
        unread = wanted.unseen(
            utc_of(client.now), f"{contact.stranger()}; its counters were not read"
        )
        return replace(unread, identity=Identity(contact.family.name, contact.model))
    seen = _Seen(
        StationReader(contact, client.now + SPARE_S + QUESTIONS * wanted.target.line.read_s())
    )
    await _everything(seen)
    return Observation(
        utc_of(client.heard),
        wanted.audit,
        wanted.line,
        wanted.target.name,
        wanted.target.url,
        seen=True,
        why=seen.reader.over.removeprefix(f"{wanted.target.name}: "),
        identity=Identity(seen.family.name, contact.model, seen.software),
        counts=tuple(seen.counts),
        tool_names={port: seen.family.tool_name(code) for port, code in seen.tools.items()},
        parameters=seen.parameters,
        errors=seen.errors,
    )


async def _everything(seen: _Seen) -> None:
    software = seen.family.commands.get("software_version")
    if software is not None:
        version = (await seen.reader.twice(software)).value
        seen.software = None if version is None else str(version)
    await _find_ports(seen)
    await _count(seen)
    await _find_errors(seen)
    await _find_parameters(seen)


async def _find_ports(seen: _Seen) -> None:
    """Find the ports and their tools: those of the line file or family, else those answering
    R-CT.
    """
    known, command = seen.reader.contact.ports, seen.family.command_of("tool")
    for port in known or PORTS:
        tool = None if command is None else (await seen.reader.twice(command, Place(port))).value
        if isinstance(tool, int):
            seen.tools[port] = tool
        if known is not None or tool is not None:
            seen.ports.append(port)


async def _count(seen: _Seen) -> None:
    for port in seen.ports:
        for counter in seen.family.counters:
            answer = await seen.reader.twice(seen.family.commands[counter.command], Place(port))
            seen.counts.append(_counted(port, counter.name, counter.unit, answer))


def _counted(port: int, name: str, unit: str, answer: Answer) -> Count:
    values = tuple(float(one) for one in answer.given if isinstance(one, int | float))
    if isinstance(answer.value, int | float):
        return Count(port, name, unit, float(answer.value), Standing.OK, values)
    return Count(
        port,
        name,
        unit,
        None,
        Standing.UNREAD if answer.why else Standing.MOVING,
        values,
        answer.why,
    )


# -- errors ----------------------------------------------------------------------------------------


async def _find_errors(seen: _Seen) -> None:
    family = seen.family
    if family.protocol == OMEGA:
        seen.errors = Errors(await _omega_state(seen.reader))
        return
    station = (await seen.reader.twice(family.commands["station_error"])).value
    ports = {}
    for port in seen.ports:
        error = (await seen.reader.twice(family.commands["port_error"], Place(port))).value
        if isinstance(error, int):
            ports[port] = family.port_errors.text(error)
    seen.errors = Errors(
        family.station_errors.text(station) if isinstance(station, int) else None, ports
    )


async def _omega_state(reader: StationReader) -> str | None:
    """Return the state of an OMEGA, which has no errors: whether there is solder and it is
    ready.
    """
    texts = []
    for name in ("information", "temperature_control"):
        value = (await reader.twice(reader.contact.family.commands[name])).value
        texts += [] if value is None else [text_of(value)]
    return ", ".join(texts) or None


# -- settings --------------------------------------------------------------------------------------


async def _find_parameters(seen: _Seen) -> None:
    for command in filter(is_parameter, seen.family.commands.values()):
        for place in _places(command, seen):
            value = (await seen.reader.twice(command, place)).value
            if value is not None:
                seen.parameters[parameter_name(command.name, place.port)] = text_of(value)


def is_parameter(command: Command) -> bool:
    """Whether a setting does not change from job to job and can be read without a number."""
    is_set = command.access == "rw" or (command.readable and command.name in READ_ONLY)
    is_kept = command.name not in OF_THE_JOB and not command.name.startswith(SELECTED)
    return (
        is_set
        and is_kept
        and command.effect is Effect.NONE
        and command.scope is not Scope.CONDITION
    )


def parameter_name(setting: str, port: int | None) -> str:
    """Return a setting's name at a port, ``2.sleep_delay``; without a port for a whole station."""
    return setting if port is None else f"{port}.{setting}"


def _places(command: Command, seen: _Seen) -> Iterator[Place]:
    if command.scope is Scope.STATION:
        yield WHOLE_STATION
        return
    for port in seen.ports:
        if command.scope is Scope.PORT:
            yield Place(port)
        elif seen.tools.get(port) in TOOLS_WITH_A_PLACE:
            yield Place(port, seen.tools[port])
