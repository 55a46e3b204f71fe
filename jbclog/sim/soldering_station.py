"""The physics of a soldering station: its ports, solder feeder, transformer and counters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf

from jbclog.protocol.commands.defaults import FEEDER_DEFAULTS
from jbclog.sim.port import HIBERNATION, SLEEP, STAND, WORKING, SimPort, fresh
from jbclog.sim.tip import WarmPart

# The solder feeder pushes wire forward and then draws it back a little. In the modes continuous and
# reload it feeds until it is stopped; in discontinuous and program one start feeds one length. The
# counters count forward motion; no manual says whether drawing back is subtracted.

UNTIL_STOPPED = ("continuous", "reload")


@dataclass(slots=True)
class FeederSettings:
    """Settings in mm and mm/s."""

    feeder_mode: str
    feeder_length: float
    feeder_speed: float
    feeder_diameter: float
    feeder_backward: float
    clog_detection: str


def fresh_feeder() -> FeederSettings:
    """Return a virtual feeder's initial settings; no manual prints a real one's."""
    return fresh(FeederSettings, FEEDER_DEFAULTS)


@dataclass(slots=True)
class Feeder:
    """Motor and counters. A feed uses the `settings` at its start."""

    settings: FeederSettings = field(default_factory=fresh_feeder)
    fed_mm: float = 0.0
    cycles: int = 0
    _start: float = -inf
    _forward_until: float = -inf
    _stopped: float = -inf
    _speed: float = 1.0

    def start(self, now: float) -> None:
        """Start feeding; no effect while running."""
        if self.motor(now) != 0:
            return
        self._count()
        self._start, self._speed = now, max(self.settings.feeder_speed, 0.1)
        forward_s = (
            inf
            if self.settings.feeder_mode in UNTIL_STOPPED
            else self.settings.feeder_length / self._speed
        )
        self._forward_until = now + forward_s
        self._stopped = self._forward_until + self.settings.feeder_backward / self._speed

    def stop(self, now: float) -> None:
        self._forward_until = min(self._forward_until, now)
        self._stopped = min(self._stopped, now)
        self._count()

    def motor(self, now: float) -> int:
        """Return 0 off, 1 forward, 2 backward, as in the status word."""
        if now < self._forward_until:
            return 1
        return 2 if now < self._stopped else 0

    def dispensed_mm(self, now: float) -> float:
        """Return the length pushed forward so far."""
        if self._start == -inf:
            return self.fed_mm
        return self.fed_mm + (min(now, self._forward_until) - self._start) * self._speed

    def dispensed_cycles(self, now: float) -> int:
        """Return the number of finished feeds."""
        return self.cycles + (self._start > -inf and self.motor(now) == 0)

    def _count(self) -> None:
        if self._start > -inf:
            self.fed_mm = self.dispensed_mm(self._forward_until)
            self.cycles += 1
            self._start = -inf


AMBIENT_C = 23.0


@dataclass(slots=True)
class StationSettings:
    maximum_temperature: int
    minimum_temperature: int


@dataclass(slots=True)
class SolderingStation:
    """A station since `began`. `start_counts` are its counters then, by command name."""

    began: float
    ports: dict[int, SimPort]
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
        """Simulate all ports until `moment`."""
        for port in self.ports.values():
            port.advance_to(moment)

    def transformer_temperature(self, now: float) -> float:
        """Return the temperature in °C, computed from the energy of all ports."""
        self.advance_to(now)
        return self.transformer.temperature_c(
            now, sum(port.energy_j for port in self.ports.values())
        )

    def count(self, name: str, port: SimPort, now: float) -> float:
        """Return the counter with the command name `name`: hours, cycles or mm."""
        return self.start_counts.get(name, 0.0) + self._counted(name, port, now)

    def _counted(self, name: str, port: SimPort, now: float) -> float:
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
        """Store the selected temperatures in the EEPROM."""
        for port in self.ports.values():
            port.stored_c = port.settings.selected_temperature

    def restart(self, now: float) -> None:
        """Lose volatile values, as after a power cycle."""
        self.advance_to(now)
        self.feeder.stop(now)
        for port in self.ports.values():
            port.restart()

    def factory_reset(self, now: float) -> None:
        """Restore factory settings; keep counters."""
        self.settings = replace(self.factory)
        self.feeder.stop(now)
        self.feeder.settings = fresh_feeder()
        for port in self.ports.values():
            port.factory_reset()
