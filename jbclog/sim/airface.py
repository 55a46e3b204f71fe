"""The face of hot air: what the station tells when it is asked, what a write does to it, and which writes it refuses.

It takes the words of status that manual 001 prints, with and without suction, and refuses on and cooling at once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType

from jbclog.config.sim_spec import FaultSpec
from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command, Scope
from jbclog.sim.airstation import AirStation
from jbclog.sim.questions import Asked
from jbclog.sim.readings import COUNTER_ROOM, Identity, setting
from jbclog.sim.writings import set_value

PORT = 1


class AirFace:
    """A hot air station as its command table sees it."""

    def __init__(self, station: AirStation) -> None:
        self.station = station

    @property
    def ports(self) -> Collection[int]:
        return (PORT,)

    def advance_to(self, moment: float) -> None:
        self.station.advance_to(moment)

    def value_of(self, asked: Asked, identity: Identity, now: float) -> Value:
        self.station.advance_to(now)
        command, name = asked.command, asked.command.name
        if name == "model":
            return identity.model
        if (reading := _READINGS.get(name)) is not None:
            return reading(self.station)
        if command.scope is Scope.TOOL:
            return self.station.adjust[asked.tool]
        if command.writable:
            return setting(self._holder(command), name)
        return self.station.count(name) % COUNTER_ROOM

    def allowed(self, command: Command, value: Value) -> bool:
        if command.limits.problem(value) is not None:
            return False
        if command.name == "status" and isinstance(value, tuple):
            return value[3:] != (1, 1)
        lowest, highest = self._range(command)
        return not isinstance(value, int) or lowest <= value <= highest

    def apply(self, asked: Asked, value: Value, now: float) -> None:
        self.station.advance_to(now)
        command, station = asked.command, self.station
        match command.name:
            case "status":
                station.order(value if isinstance(value, tuple) else station.status)
            case "restart":
                station.reset_settings()
            case "factory_reset":
                station.factory_reset()
            case "adjust":
                station.adjust[asked.tool] = value if isinstance(value, int) else 0
            case _:
                set_value(self._holder(command), command.name, value)
        station.changed()

    def restart(self, now: float) -> None:
        self.station.advance_to(now)
        self.station.restart()

    def keep(self) -> None:
        """Nothing here is volatile."""

    def strike(self, fault: FaultSpec, port: int, *, begins: bool) -> None:
        station = self.station
        match fault.kind:
            case "stuck":
                station.stuck_c = station.air_temperature() if begins else None
            case "overheat":
                station.runaway_by_c = fault.by_c if begins else None
                station.changed()
            case "tool":
                station.plug(fault.code if begins else station.tool_before)

    def _holder(self, command: Command) -> object:
        """Where the value of a setting is kept."""
        return self.station.settings if command.scope is Scope.PORT else self.station.limits

    def _range(self, command: Command) -> tuple[float, float]:
        """Lowest and highest value of a setting, or of a limit itself; a limit does not pass its counterpart."""
        limits = self.station.limits
        if command.within is not None:
            lowest, highest = (setting(limits, name) if name else -9999 for name in command.within)
        elif command.name.startswith("maximum_"):
            lowest, highest = setting(limits, command.name.replace("maximum", "minimum", 1)), 99999
        elif command.name.startswith("minimum_"):
            lowest, highest = 0, setting(limits, command.name.replace("minimum", "maximum", 1))
        else:
            lowest, highest = -9999, 99999
        assert isinstance(lowest, int)
        assert isinstance(highest, int)
        return lowest, highest


_READINGS: Mapping[str, Callable[[AirStation], Value]] = MappingProxyType(
    {
        "air_temperature": AirStation.air_temperature,
        "external_temperature": AirStation.external_temperature,
        "power": AirStation.power,
        "port_error": AirStation.port_error,
        "tool": lambda station: station.tool,
        "status": lambda station: station.status,
        "station_error": lambda station: station.station_error,
    }
)
