"""What a station tells when it is asked: the value of each command, taken from the physics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from jbclog.core.quantities import OFF, Value
from jbclog.protocol.commands.command import Scope
from jbclog.sim.plant import Plant
from jbclog.sim.port import Port
from jbclog.sim.questions import Asked

COUNTER_ROOM = 100_000  # counters have five digits and go round; no manual says that they do


@dataclass(slots=True)
class Identity:
    """What a station says of itself."""

    model: str
    software: str
    address: int | None
    robot_mode: bool = True


def value_of(asked: Asked, plant: Plant, identity: Identity, now: float) -> Value:
    """The value that an answer to `asked` carries; OFF is told as 99999. Reading alarm flags clears them."""
    port = plant.ports.get(asked.port)
    if port is None:
        return _station_value(asked.command.name, plant, identity, now)
    port.advance_to(now)
    name = asked.command.name
    if (reading := _PORT_READINGS.get(name)) is not None:
        return reading(port)
    if name == "status":
        return (0, plant.feeder.motor(now), 0, int(port.doing.extractor), port.doing.state)
    if asked.command.writable:
        return setting(port.settings if asked.command.scope is Scope.PORT else port.tools[asked.tool], name)
    count = plant.count(name, port, now)
    return count if name == "dispensed_length" else int(count) % COUNTER_ROOM


def setting(holder: object, name: str) -> Value:
    """The attribute `name` of some settings; they have slots, so that a foreign name raises."""
    value: Value = getattr(holder, name)
    return value


def _alarm_flags(port: Port) -> Value:
    return (0, 0, 0, int(port.low.take()), int(port.high.take()))


def _seconds_to_sleep(port: Port) -> Value:
    seconds = port.seconds_to_sleep()
    return OFF if seconds is None else seconds


_PORT_READINGS: Mapping[str, Callable[[Port], Value]] = MappingProxyType(
    {
        "tip_temperature": Port.temperature,
        "power": Port.power,
        "port_error": Port.port_error,
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
            return "running" if plant.feeder.motor(now) else "stopped"
        case "maximum_temperature" | "minimum_temperature":
            return setting(plant.settings, name)
    return setting(plant.feeder.settings, name)
