"""What an audit asks one station: only what is harmless, and until it is confirmed.

Nothing but questions that change nothing, and never the alarm flags, which reading clears. One attempt: what does not answer
costs no more than its questions' time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Final

from jbclog.app import connection
from jbclog.core.errors import LinkError, RobotModeOff, StationError, StationSilent
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value, text_of
from jbclog.maintenance.counter_totals.observed import Count, Errors, Identity, Observation, Standing
from jbclog.protocol.commands.command import TOOLS_WITH_A_PLACE, Command, Effect, Scope
from jbclog.protocol.commands.family import FAMILIES, OMEGA, Family
from jbclog.session.manual.contact import PORTS, WHOLE_STATION, Contact, Place, Target, open_contact
from jbclog.transport.read_only import OnlyReads

# -- harmless -----------------------------------------------------------------------------------------------------------------
# What may go out over a port that an audit has open: questions, and of these none that changes anything by being asked (R-TA).


def harmless_for(family: Family | None) -> OnlyReads:
    """Whether these bytes are such a question in the protocol of `family`."""
    only_reads, clearing = connection.only_reads_for(family), _clearing()
    return lambda data: only_reads(data) and not any(code in data for code in clearing)


@cache
def _clearing() -> frozenset[bytes]:
    """Every question of any family that does more than ask, at every port."""
    commands = [one for family in FAMILIES.values() for one in family.commands.values()]
    doing = [one for one in commands if one.readable and one.effect is not Effect.NONE and one.scope is Scope.PORT]
    return frozenset(f"R{one.code(port)}".encode() for one in doing for port in PORTS)


# -- confirmed read -----------------------------------------------------------------------------------------------------------
# What an audit believes: two of at most three answers that are the same.

MOST_READS: Final = 3
NO_TIME: Final = "no time left for it"


@dataclass(frozen=True, slots=True)
class Answer:
    """What was said, and what of it is believed. Without a value and without `why`, no two answers were the same."""

    given: tuple[Value, ...] = ()
    value: Value | None = None
    why: str = ""


@dataclass(slots=True)
class Asking:
    """One station being asked until `until` (monotonic seconds). `over` says why nothing more can be had of it."""

    contact: Contact
    until: float
    over: str = ""
    over_reason: str = ""

    def twice(self, command: Command, place: Place = WHOLE_STATION) -> Steps[Answer]:
        """Ask until two answers are the same. Never raises for what the station or its cable does."""
        given: list[Value] = []
        try:
            while len(given) < MOST_READS and not self._is_over():
                given.append((yield from self.contact.read(command, place)))
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


# -- questions ----------------------------------------------------------------------------------------------------------------

QUESTIONS: Final = 400  # more than a station of four ports is asked
SPARE_S: Final = 10.0
OF_THE_JOB: Final = frozenset({"status", "work_mode"})  # each run sets them as it likes, as all that is `SELECTED`
SELECTED: Final = "selected_"
TOLD_ALONE: Final = frozenset({"mode", "fuse"})  # what is set at the station itself


@dataclass(frozen=True, slots=True)
class SurveyTarget:
    """A station that is to be looked at. `audit` is when the audit began, `since` when the station was last seen: UTC as text."""

    audit: str
    line: str
    target: Target
    since: str | None = None

    def unseen(self, time: str, why: str) -> Observation:
        """It was not seen at `time`, and why."""
        name, url = self.target.name, self.target.url
        return Observation(time, self.audit, self.line, name, url, False, why.removeprefix(f"{name}: "))


@dataclass(slots=True)
class _Seen:
    """What has been learnt so far."""

    asking: Asking
    ports: list[int] = field(default_factory=list)
    tools: dict[int, int] = field(default_factory=dict)
    counts: list[Count] = field(default_factory=list)
    parameters: dict[str, str] = field(default_factory=dict)
    errors: Errors = field(default_factory=Errors)
    software: str | None = None

    @property
    def family(self) -> Family:
        return self.asking.contact.family


def look(wanted: SurveyTarget, utc_of: Callable[[float], str]) -> Steps[Observation]:
    """Ask the station; what it does not say is in the observation, with the reason. `utc_of` gives a monotonic moment as UTC.

    Raises `StartRefused` where nobody usable answers, and `LinkError` where there is no port to be had.
    """
    contact = yield from open_contact(wanted.target)
    client = contact.client
    if not contact.is_proven:
        unread = wanted.unseen(utc_of(client.now), f"{contact.stranger()}; its counters were not read")
        return replace(unread, identity=Identity(contact.family.name, contact.model))
    seen = _Seen(Asking(contact, client.now + SPARE_S + QUESTIONS * wanted.target.line.read_s()))
    yield from _everything(seen)
    return Observation(
        utc_of(client.heard),
        wanted.audit,
        wanted.line,
        wanted.target.name,
        wanted.target.url,
        seen=True,
        why=seen.asking.over.removeprefix(f"{wanted.target.name}: "),
        identity=Identity(seen.family.name, contact.model, seen.software),
        counts=tuple(seen.counts),
        tools={port: seen.family.tool_name(code) for port, code in seen.tools.items()},
        parameters=seen.parameters,
        errors=seen.errors,
    )


def _everything(seen: _Seen) -> Steps[None]:
    software = seen.family.commands.get("software_version")
    if software is not None:
        told = (yield from seen.asking.twice(software)).value
        seen.software = None if told is None else str(told)
    yield from _find_ports(seen)
    yield from _count(seen)
    yield from _find_errors(seen)
    yield from _find_parameters(seen)


def _find_ports(seen: _Seen) -> Steps[None]:
    """The ports that there are, with what is connected to them: those of the line file or family, or that answer R-CT."""
    known, command = seen.asking.contact.ports, seen.family.command_of("tool")
    for port in known or PORTS:
        tool = None if command is None else (yield from seen.asking.twice(command, Place(port))).value
        if isinstance(tool, int):
            seen.tools[port] = tool
        if known is not None or tool is not None:
            seen.ports.append(port)


def _count(seen: _Seen) -> Steps[None]:
    for port in seen.ports:
        for counter in seen.family.counters:
            answer = yield from seen.asking.twice(seen.family.commands[counter.command], Place(port))
            seen.counts.append(_counted(port, counter.name, counter.unit, answer))


def _counted(port: int, name: str, unit: str, answer: Answer) -> Count:
    values = tuple(float(one) for one in answer.given if isinstance(one, int | float))
    if isinstance(answer.value, int | float):
        return Count(port, name, unit, float(answer.value), Standing.OK, values)
    return Count(port, name, unit, None, Standing.UNREAD if answer.why else Standing.MOVING, values, answer.why)


# -- what is wrong with it --------------------------------------------------------------------------------------------------


def _find_errors(seen: _Seen) -> Steps[None]:
    family = seen.family
    if family.protocol == OMEGA:
        seen.errors = Errors((yield from _omega_says(seen.asking)))
        return
    station = (yield from seen.asking.twice(family.commands["station_error"])).value
    ports = {}
    for port in seen.ports:
        error = (yield from seen.asking.twice(family.commands["port_error"], Place(port))).value
        if isinstance(error, int):
            ports[port] = family.port_errors.text(error)
    seen.errors = Errors(family.station_errors.text(station) if isinstance(station, int) else None, ports)


def _omega_says(asking: Asking) -> Steps[str | None]:
    """What OMEGA tells in the place of error numbers: whether there is solder, and whether it is ready."""
    said = []
    for name in ("information", "temperature_control"):
        told = (yield from asking.twice(asking.contact.family.commands[name])).value
        said += [] if told is None else [text_of(told)]
    return ", ".join(said) or None


# -- how it is set ----------------------------------------------------------------------------------------------------------


def _find_parameters(seen: _Seen) -> Steps[None]:
    for command in filter(is_parameter, seen.family.commands.values()):
        for place in _places(command, seen):
            told = (yield from seen.asking.twice(command, place)).value
            if told is not None:
                seen.parameters[parameter_name(command.name, place.port)] = text_of(told)


def is_parameter(command: Command) -> bool:
    """Whether this is a setting that stays as it is from job to job, and that can be asked without a number."""
    is_set = command.access == "rw" or (command.readable and command.name in TOLD_ALONE)
    is_kept = command.name not in OF_THE_JOB and not command.name.startswith(SELECTED)
    return is_set and is_kept and command.effect is Effect.NONE and command.scope is not Scope.CONDITION


def parameter_name(setting: str, port: int | None) -> str:
    """``2.sleep_delay``; of the whole station without a port."""
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
