"""A virtual hot air station: its physics, and its answers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from math import exp, inf, log
from types import MappingProxyType

from jbclog.config.sim_spec import FaultSpec
from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.defaults import AIR_DEFAULTS
from jbclog.sim.plant import COUNTER_ROOM, TableRequest, set_value, setting
from jbclog.sim.port import HeatedPort, SensorTraits, fresh
from jbclog.sim.tip import NEVER, JointSchedule, SimJoint

# The heater is one heat capacity that gives its heat to the air stream; the tool's thermocouple
# measures the heater. The regulator knows the holding power and adds a proportional part, so it
# never overshoots. Each step is the exact exponential of its regime, so steps may be long while
# nothing changes.

CAPACITY_J_PER_K = 15.0  # 25 to 350 °C in about ten seconds at 900 W and half the air
STILL_W_PER_K = 0.1  # with the pump off
STREAM_W_PER_K = 0.9  # carried away by 45 l/min of air
GAIN_W_PER_K = 20.0
PROBE_LAG_S = 4.0  # a thermocouple on a board
# share of the air's rise at the work, under the nozzle and beside it
ON_WORK, BESIDE_WORK = 0.7, 0.1


class Heater:
    """Temperature and heating power of one heater; `step` simulates."""

    __slots__ = ("ambient_c", "power_w", "rated_w", "temperature_c")

    def __init__(self, ambient_c: float, rated_w: float) -> None:
        self.ambient_c = ambient_c
        self.rated_w = rated_w
        self.temperature_c = ambient_c
        self.power_w = 0.0

    def step(self, seconds: float, target_c: float | None, stream: float) -> None:
        """Simulate `seconds` towards `target_c` (None: off) in a `stream` of 0 to 1 (maximum)."""
        loss = STILL_W_PER_K + STREAM_W_PER_K * stream
        if target_c is None:
            self.power_w = 0.0
            self._drift(seconds, 0.0, loss)
            return
        seconds = self._leave_limit(seconds, target_c, loss)
        if seconds > 0:
            lag = CAPACITY_J_PER_K / (loss + GAIN_W_PER_K)
            self.temperature_c = target_c + (self.temperature_c - target_c) * exp(-seconds / lag)
            self.power_w = self._asked_w(target_c, loss)

    def _asked_w(self, target_c: float, loss: float) -> float:
        return loss * (target_c - self.ambient_c) + GAIN_W_PER_K * (target_c - self.temperature_c)

    def _leave_limit(self, seconds: float, target_c: float, loss: float) -> float:
        """Simulate while the regulator's output is limited; return the remaining seconds."""
        asked_w = self._asked_w(target_c, loss)
        if 0.0 <= asked_w <= self.rated_w:
            return seconds
        self.power_w = min(max(asked_w, 0.0), self.rated_w)
        edge = self.temperature_c + (asked_w - self.power_w) / GAIN_W_PER_K
        end = self.ambient_c + self.power_w / loss
        reached = (edge - end) / (self.temperature_c - end) if self.temperature_c != end else 1.0
        until_edge = -log(reached) * CAPACITY_J_PER_K / loss if 0.0 < reached < 1.0 else seconds
        self._drift(min(seconds, until_edge), self.power_w, loss)
        return seconds - until_edge

    def _drift(self, seconds: float, power_w: float, loss: float) -> None:
        end = self.ambient_c + power_w / loss
        self.temperature_c = end + (self.temperature_c - end) * exp(
            -seconds * loss / CAPACITY_J_PER_K
        )


class Thermocouple:
    """A thermocouple on the work, which follows the air with a lag."""

    __slots__ = ("ambient_c", "temperature_c")

    def __init__(self, ambient_c: float) -> None:
        self.ambient_c = ambient_c
        self.temperature_c = ambient_c

    def step(self, seconds: float, air_c: float | None, *, on_work: bool) -> None:
        """Simulate `seconds` in air of `air_c` (None: no air)."""
        share = ON_WORK if on_work else BESIDE_WORK
        end = self.ambient_c if air_c is None else self.ambient_c + share * (air_c - self.ambient_c)
        self.temperature_c = end + (self.temperature_c - end) * exp(-seconds / PROBE_LAG_S)


# Where the manuals are silent: cooling blows at the maximum, and ends by itself below `COLD_C`; off
# switches off at once, without cooling; removing the tool keeps the state; the tool cycles count
# each switching on, the suction cycles each start of suction. The external temperature regulates
# nothing.

STEP_S = 0.05
COLD_C = 50.0
READY_C = 30.0  # no work begins while the air is more than this below its setpoint
LIFT_S = 1.0  # suction time for lifting a part
NO_TOOL = 0
NO_TOOL_ERROR, NO_THERMOCOUPLE_ERROR = 9, 4

StatusWord = tuple[int, ...]


@dataclass(slots=True)
class AirSettings:
    selected_air_temperature: int
    selected_air_flow: int
    selected_external_temperature: int
    work_mode: str


@dataclass(slots=True)
class AirLimits:
    maximum_air_temperature: int
    minimum_air_temperature: int
    maximum_air_flow: int
    minimum_air_flow: int
    maximum_external_temperature: int
    minimum_external_temperature: int


@dataclass(slots=True)
class AirTraits(SensorTraits):
    """Constant properties of sensors and user."""

    has_thermocouple: bool = True
    lifts_parts: bool = False  # suction after each joint


def _settings() -> AirSettings:
    return fresh(AirSettings, AIR_DEFAULTS)


def _limits() -> AirLimits:
    return fresh(AirLimits, AIR_DEFAULTS)


def _adjustments() -> dict[int, int]:
    return dict.fromkeys((1, 2), 0)


@dataclass(slots=True)
class AirStation(HeatedPort):
    """A hot air station with one port and tool number `tool`, from `now` (monotonic seconds) on."""

    now: float
    tool: int
    heater: Heater
    joints: JointSchedule
    character: AirTraits = field(default_factory=AirTraits)
    start_counts: Mapping[str, float] = field(default_factory=dict)
    settings: AirSettings = field(default_factory=_settings)
    limits: AirLimits = field(default_factory=_limits)
    adjust: dict[int, int] = field(default_factory=_adjustments)
    probe: Thermocouple = field(init=False)
    is_on: bool = False
    is_cooling: bool = False
    has_suction: bool = False
    station_error: int = 0
    began: float = field(init=False)
    work_s: float = 0.0
    tool_cycles: int = 0
    suction_cycles: int = 0
    _work: SimJoint | None = None
    _next: SimJoint = NEVER
    _let_go: float = inf  # when suction ends automatically
    _quiet_since: float = field(init=False)

    def __post_init__(self) -> None:
        self.began = self._quiet_since = self.now
        self.probe = Thermocouple(self.heater.ambient_c)

    def order(self, word: StatusWord) -> None:
        """Switch on, off or to cooling, with or without suction, as W-PS does."""
        self.tool_cycles += word[4] == 1 and not self.is_on
        self.is_on, self.is_cooling = word[4] == 1, word[3] == 1
        self.suck(on=word[2] == 1)
        self.changed()

    def suck(self, *, on: bool) -> None:
        """Switch suction on or off, as its key does."""
        self.suction_cycles += on and not self.has_suction
        self.has_suction, self._let_go = on, inf

    def plug(self, tool: int) -> None:
        """Replace the tool with a cold one of number `tool`; 0 removes it."""
        self.tool_before, self.tool = self.tool, tool
        self.heater.temperature_c = self.heater.ambient_c
        self._work = None
        self.changed()

    def restart(self) -> None:
        """Power cycle: everything is off. No manual prints what is volatile; here no setting is."""
        self.order((0, 0, 0, 0, 0))

    def reset_settings(self) -> None:
        """Reset settings: W-RST is listed as "reset station settings"."""
        self.settings, self.adjust = _settings(), _adjustments()
        self.changed()

    def factory_reset(self) -> None:
        """Restore settings and limits; keep counters."""
        self.limits = _limits()
        self.reset_settings()

    def changed(self) -> None:
        """Recompute after a change of setting, state or tool."""
        self._quiet_since = self.now
        self._next = self.joints.after(self.now) if self.target_c is not None else NEVER

    @property
    def target_c(self) -> float | None:
        """The heater's target; None if off."""
        if self.tool == NO_TOOL or not self.is_on or self.is_cooling:
            return None
        return self.settings.selected_air_temperature + (self.runaway_by_c or 0.0) - self._offset_c

    @property
    def stream(self) -> float:
        """Present share of the maximum air flow, 0 to 1."""
        if self.is_cooling:
            return 1.0
        if self.is_on:
            return self.settings.selected_air_flow / max(self.limits.maximum_air_flow, 1)
        return 0.0

    @property
    def status(self) -> StatusWord:
        return (0, 0, int(self.has_suction), int(self.is_cooling), int(self.is_on))

    def air_temperature(self) -> int:
        """Return the displayed air temperature in °C; 0 without a tool."""
        if self.stuck_c is not None:
            return self.stuck_c
        noise = self.character.noise_now()
        if self.tool == NO_TOOL:
            return 0
        return round(self.heater.temperature_c + self._offset_c + noise)

    def external_temperature(self) -> int:
        """Return the thermocouple's temperature in °C; 0 without one: no manual prints the
        value.
        """
        return round(self.probe.temperature_c) if self.character.has_thermocouple else 0

    def power(self) -> int:
        """Return the heating power in per mille of the rated power."""
        return round(1000 * self.heater.power_w / self.heater.rated_w)

    def port_error(self) -> int:
        if self.tool == NO_TOOL:
            return NO_TOOL_ERROR
        if self.error or self.character.has_thermocouple:
            return self.error
        return NO_THERMOCOUPLE_ERROR

    def count(self, name: str) -> int:
        """Return the counter with the command name `name`."""
        counted = {
            "plugged_hours": (self.now - self.began) / 3600,
            "work_hours": self.work_s / 3600,
            "tool_cycles": self.tool_cycles,
            "suction_cycles": self.suction_cycles,
        }
        return int(self.start_counts.get(name, 0.0) + counted[name])

    @property
    def _offset_c(self) -> float:
        """Reading minus true temperature."""
        return self.character.sensor_error_c - self.adjust.get(self.tool, 0)

    def advance_to(self, moment: float) -> None:
        """Simulate until `moment`; ignore a moment in the past."""
        while self.now < moment:
            coarse = self.now + max(STEP_S, (self.now - self._quiet_since) / 4)
            due = min(self._work.end if self._work else self._next.start, self._let_go)
            self._step(max(min(moment, due, coarse), self.now))
            if self.now >= due:
                self._turn()

    def _step(self, end: float) -> None:
        seconds, self.now = end - self.now, end
        self.heater.step(seconds, self.target_c, self.stream)
        self.probe.step(
            seconds,
            self.heater.temperature_c if self.stream else None,
            on_work=self._work is not None,
        )
        if self.is_on:
            self.work_s += seconds
        if self.is_cooling and self.heater.temperature_c < COLD_C:
            self.is_cooling, self._quiet_since = False, self.now

    def _turn(self) -> None:
        """Process the due event: start or end of work, or end of suction."""
        self._quiet_since = self.now
        if self.now >= self._let_go:
            self.suck(on=False)
        elif self._work is not None:
            self._end_work()
        else:
            target = self.target_c
            if target is not None and self.heater.temperature_c > target - READY_C:
                self._work = self._next
            self._next = self.joints.after(self.now)

    def _end_work(self) -> None:
        self._work = None
        if self.character.lifts_parts:
            self.suck(on=True)
            self._let_go = self.now + LIFT_S


# Accepts the status words that manual 001 prints, with and without suction; refuses on and cooling
# together.

PORT = 1


class AirPlant:
    """A hot air station as the device sees it."""

    def __init__(self, station: AirStation) -> None:
        self.station = station

    @property
    def ports(self) -> Collection[int]:
        return (PORT,)

    def advance_to(self, moment: float) -> None:
        self.station.advance_to(moment)

    def value_of(self, asked: TableRequest, now: float) -> Value:
        self.station.advance_to(now)
        command = asked.command
        name = command.name
        if name in _READINGS:
            return _READINGS[name](self.station)
        if command.scope is Scope.TOOL:
            return self.station.adjust[asked.tool]
        if command.writable:
            return setting(self._settings(command), name)
        return self.station.count(name) % COUNTER_ROOM

    def allowed(self, command: Command, value: Value) -> bool:
        if command.limits.problem(value) is not None:
            return False
        if command.name == "status" and isinstance(value, tuple):
            return value[3:] != (1, 1)
        lowest, highest = self._range(command)
        return not isinstance(value, int) or lowest <= value <= highest

    def apply(self, asked: TableRequest, value: Value, now: float) -> None:
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
                set_value(self._settings(command), command.name, value)
        station.changed()

    def restart(self, now: float) -> None:
        self.station.advance_to(now)
        self.station.restart()

    def keep(self) -> None:
        """Do nothing: no setting is volatile."""

    def strike(self, fault: FaultSpec, port: int, *, begins: bool) -> None:
        self.station.strike(fault, self.station.air_temperature, begins=begins)

    def _settings(self, command: Command) -> object:
        """Return the object that holds the setting."""
        return self.station.settings if command.scope is Scope.PORT else self.station.limits

    def _range(self, command: Command) -> tuple[float, float]:
        """Return minimum and maximum of a setting; a limit is bounded by its counterpart."""
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
