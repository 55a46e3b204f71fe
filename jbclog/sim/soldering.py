"""Virtual soldering stations: the values in their answers, and the effects of writes."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Protocol

from jbclog.config.sim_spec import FaultSpec
from jbclog.core.quantities import OFF, AlarmDelay, Value
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import FAMILIES, Family
from jbclog.protocol.commands.feeder import FeederState
from jbclog.protocol.commands.status import EXTRACTOR, STAND, WORKING
from jbclog.sim.plant import Plant
from jbclog.sim.port import SimPort


@dataclass(frozen=True, slots=True)
class TableRequest:
    """A request of the table; `port` and `tool` are 0 if it has none."""

    command: Command
    code: str
    port: int = 0
    tool: int = 0


@cache
def questions(family: str, ports: tuple[int, ...]) -> Mapping[str, TableRequest]:
    """Return all requests by header and code (``RTT1``, ``WA12``) of a `family` with `ports`."""
    return MappingProxyType(dict(_all(FAMILIES[family], ports)))


def _all(family: Family, ports: tuple[int, ...]) -> Iterator[tuple[str, TableRequest]]:
    tools = [tool for tool in family.tools if tool]
    for command in family.commands.values():
        for asked in _places(command, ports, tools):
            for header in command.access.upper():
                yield header + asked.code, asked


def _places(command: Command, ports: tuple[int, ...], tools: list[int]) -> Iterator[TableRequest]:
    if command.scope is Scope.STATION:
        yield TableRequest(command, command.code())
        return
    for port in ports:
        if command.scope is Scope.PORT:
            yield TableRequest(command, command.code(port), port)
        else:
            yield from (
                TableRequest(command, command.code(port, tool), port, tool) for tool in tools
            )


COUNTER_ROOM = 100_000  # counters have five digits and roll over; no manual says so


@dataclass(slots=True)
class Identity:
    model: str
    software: str
    address: int | None
    robot_mode: bool = True


def setting(holder: object, name: str) -> Value:
    """Return the setting `name`; the class has slots, so an unknown name raises."""
    value: Value = getattr(holder, name)
    return value


def _alarm_flags(port: SimPort) -> Value:
    return (0, 0, 0, int(port.low.take()), int(port.high.take()))


def _seconds_to_sleep(port: SimPort) -> Value:
    seconds = port.seconds_to_sleep()
    return OFF if seconds is None else seconds


_PORT_READINGS: Mapping[str, Callable[[SimPort], Value]] = MappingProxyType(
    {
        "tip_temperature": SimPort.temperature,
        "power": SimPort.power,
        "port_error": SimPort.port_error,
        "tool": lambda port: port.tool,
        "time_to_sleep": _seconds_to_sleep,
        "transistor_temperature": lambda port: round(port.transistor_temperature()),
        "alarm_flags": _alarm_flags,
    }
)


def _station_value(name: str, plant: Plant, identity: Identity, now: float) -> Value:
    match name:
        case "model":
            return identity.model
        case "software_version":
            return identity.software
        case "station_error":
            return plant.station_error
        case "transformer_temperature":
            return round(plant.transformer_temperature(now))
        case "fuse":
            return "present"
        case "feeding":
            return FeederState.RUNNING if plant.feeder.motor(now) else FeederState.STOPPED
        case "maximum_temperature" | "minimum_temperature":
            return setting(plant.settings, name)
    return setting(plant.feeder.settings, name)


WITHOUT_DATA = ("start_feeding", "stop_feeding", "restart", "factory_reset", "ignore_fuse_error")
"""Orders whose data no manual prints: accepted with 00000 and without any (B-37)."""

ORDERS: dict[tuple[int, ...], tuple[int, bool]] = {
    WORKING: (0, False),
    STAND: (1, False),
    EXTRACTOR: (0, True),
}
"""State and extractor of the status words that can be written (manual 002, W-PSx)."""

_NUMBER = re.compile(r"-?\d+", re.ASCII)
_DELAY = re.compile(r"\d\d\.\d\d|99999", re.ASCII)


def well_formed(command: Command, data: str) -> bool:
    """Return True if `data` has the form of this command's data, whatever the value."""
    form = _DELAY if isinstance(command.quantity, AlarmDelay) else _NUMBER
    return len(data) == 5 and form.fullmatch(data) is not None


def is_beyond_inferred(command: Command, value: Value) -> bool:
    """Return True if the value exceeds a limit that only another manual prints."""
    return command.inferred is not None and command.inferred.limits.problem(value) is not None


def set_value(holder: object, name: str, value: Value) -> None:
    """Set the setting `name`; the class has slots, so an unknown name raises."""
    setattr(holder, name, value)


def _order(port: SimPort, word: Value) -> None:
    if isinstance(word, tuple):
        port.order(*ORDERS[word])


def _apply_to_station(name: str, value: Value, plant: Plant, now: float) -> None:
    match name:
        case "start_feeding":
            plant.feeder.start(now)
        case "stop_feeding":
            plant.feeder.stop(now)
        case "store":
            plant.store()
        case "factory_reset":
            plant.factory_reset(now)
        case "maximum_temperature" | "minimum_temperature":
            set_value(plant.settings, name, value)
        case "restart" | "address" | "ignore_fuse_error":
            return  # handled by the device
        case _:
            set_value(plant.feeder.settings, name, value)


class StationModel(Protocol):
    """The physics of one kind of station, for the device. Times are monotonic seconds; `port` is 0
    for the station itself.
    """

    @property
    def ports(self) -> Collection[int]:
        """The existing ports."""

    def advance_to(self, moment: float) -> None:
        """Simulate until `moment`."""

    def value_of(self, asked: TableRequest, identity: Identity, now: float) -> Value:
        """Return the value of an answer to `asked`; OFF is sent as 99999."""

    def allowed(self, command: Command, value: Value) -> bool:
        """Return True if the station accepts this value of a well-formed write."""

    def apply(self, asked: TableRequest, value: Value, now: float) -> None:
        """Apply an accepted write."""

    def restart(self, now: float) -> None:
        """Lose volatile values, as after a power cycle."""

    def keep(self) -> None:
        """Store the present settings, so that a restart keeps them."""

    def strike(self, fault: FaultSpec, port: int, *, begins: bool) -> None:
        """Begin or end a fault of the physics (``stuck``, ``overheat``, ``tool``) on `port`."""


class SolderingModel:
    """A soldering station of `family`. `strict`: it also enforces inferred limits."""

    def __init__(self, family: Family, plant: Plant, *, strict: bool = False) -> None:
        self.family = family
        self.plant = plant
        self.strict = strict

    @property
    def ports(self) -> Collection[int]:
        return self.plant.ports

    def advance_to(self, moment: float) -> None:
        self.plant.advance_to(moment)

    def value_of(self, asked: TableRequest, identity: Identity, now: float) -> Value:
        """Return the value of an answer to `asked`. Reading alarm flags clears them."""
        port = self.plant.ports.get(asked.port)
        if port is None:
            return _station_value(asked.command.name, self.plant, identity, now)
        port.advance_to(now)
        name = asked.command.name
        if (reading := _PORT_READINGS.get(name)) is not None:
            return reading(port)
        if name == "status":
            return (0, self.plant.feeder.motor(now), 0, int(port.doing.extractor), port.doing.state)
        if asked.command.writable:
            return setting(
                port.settings if asked.command.scope is Scope.PORT else port.tools[asked.tool], name
            )
        count = self.plant.count(name, port, now)
        return count if name == "dispensed_length" else int(count) % COUNTER_ROOM

    def allowed(self, command: Command, value: Value) -> bool:
        if command.limits.problem(value) is not None or (
            self.strict and is_beyond_inferred(command, value)
        ):
            return False
        limits = self.plant.settings
        match command.name:
            case "status":
                return (
                    isinstance(value, tuple)
                    and value in ORDERS
                    and (value != EXTRACTOR or self.family.manual != "000")
                )
            case "selected_temperature":
                return (
                    isinstance(value, int)
                    and limits.minimum_temperature <= value <= limits.maximum_temperature
                )
            case "maximum_temperature":
                return (
                    isinstance(value, int)
                    and limits.minimum_temperature < value <= self.plant.factory.maximum_temperature
                )
            case "minimum_temperature":
                return (
                    isinstance(value, int)
                    and self.plant.factory.minimum_temperature <= value < limits.maximum_temperature
                )
        return True

    def apply(self, asked: TableRequest, value: Value, now: float) -> None:
        self.plant.advance_to(now)
        command, port = asked.command, self.plant.ports.get(asked.port)
        if port is None:
            _apply_to_station(command.name, value, self.plant, now)
        elif command.name == "status":
            _order(port, value)
        else:
            set_value(
                port.settings if command.scope is Scope.PORT else port.tools[asked.tool],
                command.name,
                value,
            )
            port.changed()

    def restart(self, now: float) -> None:
        self.plant.restart(now)

    def keep(self) -> None:
        self.plant.store()

    def strike(self, fault: FaultSpec, port: int, *, begins: bool) -> None:
        struck = self.plant.ports[port]
        match fault.kind:
            case "stuck":
                struck.stuck_c = struck.temperature() if begins else None
            case "overheat":
                struck.runaway_by_c = fault.by_c if begins else None
                struck.changed()
            case "tool":
                struck.plug(fault.code if begins else struck.tool_before)
