"""What a write does to a station, and which writes it refuses."""

from __future__ import annotations

import re

from jbclog.core.quantities import AlarmDelay, Value
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.status import EXTRACTOR, STAND, WORKING
from jbclog.sim.plant import Plant
from jbclog.sim.port import Port
from jbclog.sim.questions import Asked

WITHOUT_DATA = ("start_feeding", "stop_feeding", "restart", "factory_reset", "ignore_fuse_error")
"""Orders whose data no manual prints: taken with 00000 and without any (B-37)."""

ORDERS: dict[tuple[int, ...], tuple[int, bool]] = {WORKING: (0, False), STAND: (1, False), EXTRACTOR: (0, True)}
"""State and extractor of the status words that can be written (manual 002, W-PSx)."""

_NUMBER = re.compile(r"-?\d+", re.ASCII)
_DELAY = re.compile(r"\d\d\.\d\d|99999", re.ASCII)


def well_formed(command: Command, data: str) -> bool:
    """Whether `data` has the form of this command's data, whatever its value."""
    form = _DELAY if isinstance(command.quantity, AlarmDelay) else _NUMBER
    return len(data) == 5 and form.fullmatch(data) is not None


def is_beyond_inferred(command: Command, value: Value) -> bool:
    """Whether the value lies where the station's own manual prints nothing, and another does."""
    return command.inferred is not None and command.inferred.limits.problem(value) is not None


def allowed(command: Command, value: Value, family: Family, plant: Plant) -> bool:
    """Whether the station takes this value: printed limits, and what lies within its own limits."""
    if command.limits.problem(value) is not None:
        return False
    limits = plant.settings
    match command.name:
        case "status":
            return isinstance(value, tuple) and value in ORDERS and (value != EXTRACTOR or family.manual != "000")
        case "selected_temperature":
            return isinstance(value, int) and limits.minimum_temperature <= value <= limits.maximum_temperature
        case "maximum_temperature":
            return isinstance(value, int) and limits.minimum_temperature < value <= plant.factory.maximum_temperature
        case "minimum_temperature":
            return isinstance(value, int) and plant.factory.minimum_temperature <= value < limits.maximum_temperature
    return True


def apply(asked: Asked, value: Value, plant: Plant, now: float) -> None:
    """Let the physics know of an accepted write to a port, a tool, the feeder or the station's limits."""
    plant.advance_to(now)
    command, port = asked.command, plant.ports.get(asked.port)
    if port is None:
        _apply_to_station(command.name, value, plant, now)
    elif command.name == "status":
        _order(port, value)
    else:
        set_value(port.settings if command.scope is Scope.PORT else port.tools[asked.tool], command.name, value)
        port.changed()


def set_value(holder: object, name: str, value: Value) -> None:
    """Set the attribute `name` of some settings; they have slots, so that a foreign name raises."""
    setattr(holder, name, value)


def _order(port: Port, word: Value) -> None:
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
            return  # the device's own business
        case _:
            set_value(plant.feeder.settings, name, value)
