"""The physics of one whole station: ports, feeder, transformer, hours. Nothing of the protocol; time is passed in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from jbclog.sim.feeder import Feeder, fresh_feeder
from jbclog.sim.parts import WarmPart
from jbclog.sim.port import Port
from jbclog.sim.state import HIBERNATION, SLEEP, STAND, WORKING

AMBIENT_C = 23.0


@dataclass(slots=True)
class StationSettings:
    """What the station itself keeps."""

    maximum_temperature: int
    minimum_temperature: int


@dataclass(slots=True)
class Plant:
    """A station since `began`. `start_counts` are what its counters showed then, by command name."""

    began: float
    ports: dict[int, Port]
    feeder: Feeder
    factory: StationSettings
    start_counts: Mapping[str, float] = field(default_factory=dict)
    station_error: int = 0
    settings: StationSettings = field(init=False)
    transformer: WarmPart = field(init=False)

    def __post_init__(self) -> None:
        self.transformer = WarmPart(900.0, 0.15, AMBIENT_C + 12, self.began)
        self.settings = replace(self.factory)

    def advance_to(self, moment: float) -> None:
        """Let time go on to `moment` in all ports."""
        for port in self.ports.values():
            port.advance_to(moment)

    def transformer_temperature(self, now: float) -> float:
        """In °C, after what all ports have drawn."""
        self.advance_to(now)
        return self.transformer.temperature_c(now, sum(port.energy_j for port in self.ports.values()))

    def count(self, name: str, port: Port, now: float) -> float:
        """What the counter with the command name `name` shows: hours, cycles or mm."""
        return self.start_counts.get(name, 0.0) + self._counted(name, port, now)

    def _counted(self, name: str, port: Port, now: float) -> float:
        doing = port.doing
        match name:
            case "plugged_hours":
                return (now - port.began) / 3600
            case "no_tool_hours":
                return port.no_tool_s / 3600
            case "sleep_hours":
                return doing.hours(now, SLEEP)
            case "hibernation_hours":
                return doing.hours(now, HIBERNATION)
            case "work_hours":
                return max(doing.hours(now, WORKING, STAND) - port.no_tool_s / 3600, 0.0)
            case "sleep_cycles":
                return doing.sleep_cycles
            case "dispensed_cycles":
                return self.feeder.dispensed_cycles(now)
            case "dispensed_length":
                return self.feeder.dispensed_mm(now)
            case "desolder_cycles":
                return 0.0
        raise KeyError(name)

    def store(self) -> None:
        """Keep the selected temperatures in the EEPROM."""
        for port in self.ports.values():
            port.stored_c = port.settings.selected_temperature

    def restart(self, now: float) -> None:
        """Lose what is volatile, as after the mains switch."""
        self.advance_to(now)
        self.feeder.stop(now)
        for port in self.ports.values():
            port.restart()

    def factory_reset(self, now: float) -> None:
        """Put every setting back to the factory's; counters stay."""
        self.settings = replace(self.factory)
        self.feeder.stop(now)
        self.feeder.settings = fresh_feeder()
        for port in self.ports.values():
            port.factory_reset()
