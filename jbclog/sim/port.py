"""One port of a virtual station: its tool, settings, states and hours.

Stand keeps the selected temperature, sleep the sleep temperature. In hibernation the heater is off,
and so it is in the extractor state of robots unless `extractor_cools` is false. A port is simulated
only on demand: its steps grow from 50 ms while nothing happens, and end at each joint and each
change of state. All classes have slots, so a misspelt attribute raises.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields
from math import inf
from random import Random
from typing import TypeVar

from jbclog.config.sim_spec import FaultSpec
from jbclog.core.quantities import OFF, Off
from jbclog.protocol.commands.defaults import SOLDERING_DEFAULTS, Default, values_of
from jbclog.sim.tip import LOAD_C, NEVER, Comparator, JointSchedule, SimJoint, Tip, WarmPart

T = TypeVar("T")


def fresh(kind: type[T], defaults: Iterable[Default], model: str = "") -> T:
    """Create a dataclass of factory settings, whose fields are named after their commands."""
    values = values_of(defaults, model)
    return kind(**{one.name: values[one.name] for one in fields(kind)})  # type: ignore[arg-type]  # a dataclass, as all settings are


# States of a tool::
#
#     working ──stand──▶ stand ──sleep delay──▶ sleep ──hibernation delay──▶ hibernation
#        ▲                 │                      │                             │
#        └─────working─────┴──────────────────────┴─────────────────────────────┘
#
# A stand order restarts the sleep delay, except for a tool that sleeps or hibernates. A delay that
# is off never ends, and hibernation counts from the sleep (manual 002, W-Dxy and W-Hxy).

WORKING, STAND, SLEEP, HIBERNATION = range(4)


@dataclass(slots=True)
class ToolSettings:
    """A port's settings for one kind of tool: °C and minutes."""

    adjust: int
    sleep_temperature: int
    sleep_delay: int | Off
    hibernation_delay: int | Off


def _no_seconds() -> dict[int, float]:
    return dict.fromkeys((WORKING, STAND, SLEEP, HIBERNATION), 0.0)


@dataclass(slots=True)
class ToolState:
    """The state since `began`. The factory setting is "Extract (stand by)" (manuals 002, 004)."""

    began: float
    state: int = WORKING
    extractor: bool = True
    sleep_cycles: int = 0
    seconds: dict[int, float] = field(default_factory=_no_seconds)

    def order(self, state: int, extractor: bool, now: float) -> None:
        """Order work (0), stand (1) or extract."""
        asleep = self.state in (SLEEP, HIBERNATION)
        self.extractor = extractor
        if not (state == STAND and asleep):
            self._enter(state, now)

    def due(self, delays: ToolSettings) -> float:
        """Return when the state changes by itself; infinity for never."""
        minutes: int | Off = OFF
        if self.state == STAND:
            minutes = delays.sleep_delay
        elif self.state == SLEEP:
            minutes = delays.hibernation_delay
        return inf if isinstance(minutes, Off) else self.began + 60.0 * minutes

    def next_state(self, now: float) -> None:
        """Change from stand to sleep, or from sleep to hibernation."""
        if self.state == STAND:
            self.sleep_cycles += 1
        self._enter(self.state + 1, now)

    def hours(self, now: float, *states: int) -> float:
        """Return the hours spent in `states` so far."""
        running = now - self.began if self.state in states else 0.0
        return (sum(self.seconds[state] for state in states) + running) / 3600

    def _enter(self, state: int, now: float) -> None:
        self.seconds[self.state] += now - self.began
        self.state, self.began = state, now


STEP_S = 0.05
READY_C = 30.0  # no joint begins while the tip is more than this below its target
NO_TOOL = 0
NO_TOOL_ERROR = 4


@dataclass(slots=True)
class PortSettings:
    """A port's settings for every tool."""

    selected_temperature: int
    alarm_high_limit: int | Off
    alarm_low_limit: int | Off
    alarm_high_delay: float | Off
    alarm_low_delay: float | Off


@dataclass(slots=True)
class SensorTraits:
    """Constant properties of a sensor."""

    noise_c: float = 0.0
    sensor_error_c: float = 0.0
    noise: Random = field(default_factory=lambda: Random(0))

    def noise_now(self) -> float:
        """Return the noise of one reading in kelvin."""
        return self.noise.gauss(0.0, self.noise_c) if self.noise_c else 0.0


@dataclass(slots=True)
class PortTraits(SensorTraits):
    """Constant properties of a port: sensor, extractor state and user."""

    extractor_cools: bool = True
    on_joint: Callable[[float], None] | None = None


def _port_settings() -> PortSettings:
    return fresh(PortSettings, SOLDERING_DEFAULTS)


def _tool_settings() -> dict[int, ToolSettings]:
    return {tool: fresh(ToolSettings, SOLDERING_DEFAULTS) for tool in range(10)}


@dataclass(slots=True, kw_only=True)
class HeatedPort(ABC):
    """What the ports of all stations with a heater share: errors, and the faults of the physics."""

    error: int = 0
    tool_before: int = NO_TOOL
    runaway_by_c: float | None = None
    stuck_c: int | None = None

    @abstractmethod
    def plug(self, tool: int) -> None:
        """Replace the tool with a cold one of number `tool`; 0 removes it."""

    @abstractmethod
    def changed(self) -> None:
        """Recompute after a change of setting, state or tool."""

    def strike(self, fault: FaultSpec, reading: Callable[[], int], *, begins: bool) -> None:
        """Begin or end a fault of the physics (``stuck``, ``overheat``, ``tool``). `reading` is the
        displayed temperature.
        """
        match fault.kind:
            case "stuck":
                self.stuck_c = reading() if begins else None
            case "overheat":
                self.runaway_by_c = fault.by_c if begins else None
                self.changed()
            case "tool":
                self.plug(fault.code if begins else self.tool_before)


@dataclass(slots=True)
class SimPort(HeatedPort):
    """A port from `now` (monotonic seconds) on, with tool number `tool`."""

    now: float
    tool: int
    tip: Tip
    joints: JointSchedule
    character: PortTraits = field(default_factory=PortTraits)
    settings: PortSettings = field(default_factory=_port_settings)
    tools: dict[int, ToolSettings] = field(default_factory=_tool_settings)
    doing: ToolState = field(init=False)
    transistor: WarmPart = field(init=False)
    high: Comparator = field(default_factory=Comparator)
    low: Comparator = field(default_factory=Comparator)
    stored_c: int = field(init=False)  # the selected temperature in the EEPROM
    energy_j: float = 0.0
    no_tool_s: float = 0.0
    began: float = field(init=False)
    _offset_c: float = 0.0  # reading minus true tip temperature
    _target_c: float | None = None
    _load: SimJoint | None = None
    _next: SimJoint = NEVER
    _due: float = inf
    _quiet_since: float = field(init=False)

    def __post_init__(self) -> None:
        self.began = self._quiet_since = self.now
        self.stored_c = self.settings.selected_temperature
        self.doing = ToolState(self.now)
        self.transistor = WarmPart(60.0, 0.3, self.tip.ambient_c + 10, self.now)
        self.changed()

    def order(self, state: int, extractor: bool) -> None:
        """Order work, stand or extract, as W-PS does."""
        self.doing.order(state, extractor, self.now)
        self.changed()

    def plug(self, tool: int) -> None:
        """Replace the tool with a cold one of number `tool`; 0 removes it."""
        self.tool_before, self.tool = self.tool, tool
        self.tip.temperature_c = self.tip.ambient_c
        self._load = None
        self.high, self.low = (
            Comparator(latched=self.high.latched),
            Comparator(latched=self.low.latched),
        )
        self.changed()

    def factory_reset(self) -> None:
        self.settings, self.tools = _port_settings(), _tool_settings()
        self.stored_c = self.settings.selected_temperature
        self.restart()

    def restart(self) -> None:
        """Lose volatile values: selected temperature, state and alarm flags."""
        self.settings.selected_temperature = self.stored_c
        self.high, self.low = Comparator(), Comparator()
        self.order(WORKING, True)

    def changed(self) -> None:
        """Recompute target and next event after a change of setting, state or tool."""
        self._quiet_since = self.now
        delays = self.tools[self.tool]
        self._offset_c = self.character.sensor_error_c - delays.adjust
        aim = self._aim_c() if self.tool != NO_TOOL else None
        self._target_c = None if aim is None else aim - self._offset_c
        soldering = (
            self._target_c is not None and self.doing.state == WORKING and not self.doing.extractor
        )
        self._next = self.joints.after(self.now) if soldering else NEVER
        state_due = self.doing.due(delays) if self.tool != NO_TOOL else inf
        self._due = min(state_due, self._load.end if self._load else self._next.start)

    def temperature(self) -> int:
        """Return the displayed tip temperature in °C; 0 without a tool."""
        if self.stuck_c is not None:
            return self.stuck_c
        if self.tool == NO_TOOL:
            return 0
        return round(self.seen_c + self.character.noise_now())

    @property
    def seen_c(self) -> float:
        """The measured tip temperature, without noise."""
        return self.tip.temperature_c + self._offset_c

    def power(self) -> int:
        """Return the heating power in per mille of the rated power."""
        return round(1000 * self.tip.power_w / self.tip.rated_w)

    def port_error(self) -> int:
        return NO_TOOL_ERROR if self.tool == NO_TOOL else self.error

    def seconds_to_sleep(self) -> int | None:
        """Return the seconds to the next automatic change of state, or None."""
        due = self.doing.due(self.tools[self.tool])
        return None if due == inf or self.tool == NO_TOOL else max(round(due - self.now), 0)

    def transistor_temperature(self) -> float:
        return self.transistor.temperature_c(self.now, self.energy_j)

    def advance_to(self, moment: float) -> None:
        """Simulate until `moment`; ignore a moment in the past."""
        while self.now < moment:
            coarse = self.now + max(STEP_S, (self.now - self._quiet_since) / 4)
            self._step(min(moment, self._due, coarse))
            if self.now >= self._due:
                self._turn()

    def _step(self, end: float) -> None:
        seconds, self.now = end - self.now, end
        tip, load = self.tip, self._load
        before = tip.temperature_c
        tip.step(seconds, self._target_c, load.load_w_per_k if load else 0.0, LOAD_C)
        self.energy_j += tip.power_w * seconds
        if self.tool == NO_TOOL:
            self.no_tool_s += seconds
        else:
            self._compare(before, tip.temperature_c, seconds)

    def _compare(self, before: float, after: float, seconds: float) -> None:
        settings, offset = self.settings, self._offset_c
        if not isinstance(settings.alarm_high_limit, Off):
            limit = settings.alarm_high_limit - offset
            self.high.see(
                before - limit, after - limit, seconds, self.now, settings.alarm_high_delay
            )
        if not isinstance(settings.alarm_low_limit, Off):
            limit = settings.alarm_low_limit - offset
            self.low.see(limit - before, limit - after, seconds, self.now, settings.alarm_low_delay)

    def _turn(self) -> None:
        """Process the due event: the next state, or the start or end of a joint."""
        if self.now >= self.doing.due(self.tools[self.tool]):
            self.doing.next_state(self.now)
        elif self._load is not None:
            self._load = None
        elif self._target_c is not None and self.tip.temperature_c > self._target_c - READY_C:
            self._load = self._next
            if self.character.on_joint:
                self.character.on_joint(self.now)
        self.changed()

    def _aim_c(self) -> float | None:
        """Return the reading to regulate to; None with the heater off."""
        if self.runaway_by_c is not None:
            limit = self.settings.alarm_high_limit
            if isinstance(limit, Off):
                limit = self.settings.selected_temperature
            return limit + self.runaway_by_c
        if self.doing.state == HIBERNATION or (
            self.doing.extractor and self.character.extractor_cools
        ):
            return None
        if self.doing.state == SLEEP:
            return self.tools[self.tool].sleep_temperature
        return self.settings.selected_temperature
