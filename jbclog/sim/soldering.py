"""Virtual soldering stations: the values in their answers, and the effects of writes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType

from jbclog.config.sim_spec import FaultSpec
from jbclog.core.quantities import OFF, Value
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.feeder import FeederState
from jbclog.protocol.commands.status import EXTRACTOR, STAND, WORKING
from jbclog.sim.plant import COUNTER_ROOM, TableRequest, set_value, setting
from jbclog.sim.port import SimPort
from jbclog.sim.soldering_station import SolderingStation


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


_STATION_READINGS: Mapping[str, Callable[[SolderingStation, float], Value]] = MappingProxyType(
    {
        "station_error": lambda station, _now: station.station_error,
        "transformer_temperature": lambda station, now: round(station.transformer_temperature(now)),
        "fuse": lambda _station, _now: "present",
        "feeding": lambda station, now: (
            FeederState.RUNNING if station.feeder.motor(now) else FeederState.STOPPED
        ),
    }
)

ORDERS: dict[tuple[int, ...], tuple[int, bool]] = {
    WORKING: (0, False),
    STAND: (1, False),
    EXTRACTOR: (0, True),
}
"""State and extractor of the status words that can be written (manual 002, W-PSx)."""


class SolderingPlant:
    """A soldering station of `family`. `strict`: it also enforces limits that only another manual
    prints.
    """

    def __init__(self, family: Family, station: SolderingStation, *, strict: bool = False) -> None:
        self.family = family
        self.station = station
        self.strict = strict

    @property
    def ports(self) -> Collection[int]:
        return self.station.ports

    def advance_to(self, moment: float) -> None:
        self.station.advance_to(moment)

    def value_of(self, asked: TableRequest, now: float) -> Value:
        """Return the value of an answer to `asked`. Reading alarm flags clears them."""
        name = asked.command.name
        port = self.station.ports.get(asked.port)
        if port is None:
            if name in _STATION_READINGS:
                return _STATION_READINGS[name](self.station, now)
            return setting(self._settings(asked), name)
        port.advance_to(now)
        if name in _PORT_READINGS:
            return _PORT_READINGS[name](port)
        if name == "status":
            motor = self.station.feeder.motor(now)
            return (0, motor, 0, int(port.doing.extractor), port.doing.state)
        if asked.command.writable:
            return setting(self._settings(asked), name)
        count = self.station.count(name, port, now)
        return count if name == "dispensed_length" else int(count) % COUNTER_ROOM

    def allowed(self, command: Command, value: Value) -> bool:
        if command.limits.problem(value) is not None:
            return False
        inferred = command.inferred
        if self.strict and inferred is not None and inferred.limits.problem(value) is not None:
            return False
        if command.name == "status":
            is_old = self.family.manual == "000"
            return value in ORDERS and not (is_old and value == EXTRACTOR)
        temperatures = self._allowed_temperatures(command.name)
        return temperatures is None or (isinstance(value, int) and value in temperatures)

    def _allowed_temperatures(self, name: str) -> range | None:
        """Return the °C that a station takes; None for other settings."""
        limits = self.station.settings
        factory = self.station.factory
        match name:
            case "selected_temperature":
                return range(limits.minimum_temperature, limits.maximum_temperature + 1)
            case "maximum_temperature":
                return range(limits.minimum_temperature + 1, factory.maximum_temperature + 1)
            case "minimum_temperature":
                return range(factory.minimum_temperature, limits.maximum_temperature)
        return None

    def apply(self, asked: TableRequest, value: Value, now: float) -> None:
        station = self.station
        station.advance_to(now)
        name = asked.command.name
        match name:
            case "restart" | "address" | "ignore_fuse_error":
                return  # handled by the device
            case "start_feeding":
                station.feeder.start(now)
            case "stop_feeding":
                station.feeder.stop(now)
            case "store":
                station.store()
            case "factory_reset":
                station.factory_reset(now)
            case "status":
                if isinstance(value, tuple):
                    station.ports[asked.port].order(*ORDERS[value])
            case _:
                set_value(self._settings(asked), name, value)
                if asked.port:
                    station.ports[asked.port].changed()

    def restart(self, now: float) -> None:
        self.station.restart(now)

    def keep(self) -> None:
        self.station.store()

    def strike(self, fault: FaultSpec, port: int, *, begins: bool) -> None:
        struck = self.station.ports[port]
        struck.strike(fault, struck.temperature, begins=begins)

    def _settings(self, asked: TableRequest) -> object:
        """Return the object that holds the setting."""
        if asked.command.scope is Scope.TOOL:
            return self.station.ports[asked.port].tools[asked.tool]
        if asked.command.scope is Scope.PORT:
            return self.station.ports[asked.port].settings
        if asked.command.name in ("maximum_temperature", "minimum_temperature"):
            return self.station.settings
        return self.station.feeder.settings
