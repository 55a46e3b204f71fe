"""What a session knows of its station: identity, ports, settings in force, link."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from jbclog.core.quantities import Value
from jbclog.core.rows import StationFacts
from jbclog.protocol.commands.command import TOOLS_WITH_A_PLACE, Command
from jbclog.protocol.commands.family import Family
from jbclog.session.run.reconnection import Reconnection
from jbclog.session.run.task import StationTask

# the steps of a start, named after what is complete at their ends (`station_run.py`)
EXAMINED, PREPARED, HEATED = 1, 2, 3

LIKE_HOURS = 1  # counters count whole hours: two that differ by one can be the same


@dataclass(frozen=True, slots=True)
class Identity:
    """What a station says of itself; None and missing ports: not known. `hours`: port -> plugged
    hours.
    """

    model: str | None = None
    software: str | None = None
    hours: Mapping[int, int] = field(default_factory=dict)

    def may_be(self, other: Identity) -> bool:
        """Return True if nothing that is known of both tells them apart."""
        if self.model is None or self.model != other.model:
            return False
        if None not in (self.software, other.software) and self.software != other.software:
            return False
        return all(
            abs(hours - other.hours[port]) <= LIKE_HOURS
            for port, hours in self.hours.items()
            if port in other.hours
        )

    def compared(self) -> str:
        """Name what a return can be checked by: ``model, software version and plugged hours``."""
        names = ["model"]
        if self.software is not None:
            names.append("software version")
        if self.hours:
            names.append("plugged hours")
        return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


@dataclass(slots=True)
class PortState:
    """What is known about one port during a run; None means unknown."""

    number: int
    tool: int | None = None
    error: int | None = None
    # command name -> value last read or confirmed
    held: dict[str, Value] = field(default_factory=dict)
    status: tuple[int, ...] | None = None
    has_suction: bool | None = None  # the hundreds digit of the status, confirmed by two answers
    temperatures_c: dict[str, int] = field(default_factory=dict)  # signal -> last accepted value
    # when the last one of tip or air was read; None if another tool was in the port then
    temperature_at: float | None = None
    pulled_c: int | None = None  # last reading that no tip can have cooled to, since that
    hottest_c: int | None = None  # since the last reading of the alarm flags, while alarms count
    coolest_c: int | None = None
    has_counted: bool = False  # alarms have counted since the last reading of the flags
    at_temperature: bool = False  # has reached ±10 °C of its setpoint while working
    # before that: since when it was hotter than its setpoint, and how hot
    found_above: tuple[float, int] | None = None
    # counter -> value confirmed by two answers
    counted: dict[str, Value] = field(default_factory=dict)
    # OMEGA's states as last read, and when
    states: dict[str, tuple[Value, float]] = field(default_factory=dict)
    row_time: int = 0  # of its last row, UTC in µs
    touched: bool = False
    tool_is_new: bool = False  # connected or changed; its settings not read yet

    @property
    def temperature_c(self) -> int | None:
        """Last accepted temperature of tip or air."""
        return self.temperatures_c.get("temperature_c")

    @property
    def has_tool(self) -> bool:
        return self.tool not in (None, 0)

    @property
    def can_be_spoken_to(self) -> bool:
        """True if a command can address the tool, so that its settings can be read and written."""
        return self.tool in TOOLS_WITH_A_PLACE

    def celsius(self, name: str) -> float | None:
        """Return a held temperature or limit; None if it is off or unknown."""
        value = self.held.get(name)
        return float(value) if isinstance(value, int | float) else None


class ReadingCount(NamedTuple):
    """Readings that count for a port's coverage: due, and obtained."""

    due: int
    obtained: int


@dataclass(slots=True)
class StationState:
    """What is known of one station now. `facts` is the part of it that is recorded."""

    facts: StationFacts
    known_family: Family | None
    ports: dict[int, PortState] = field(default_factory=dict)
    held: dict[str, Value] = field(default_factory=dict)  # station-wide settings
    not_supported: set[str] = field(default_factory=set)
    connected: bool = False
    # of a port so far, for display
    count_readings: Callable[[int], ReadingCount] = lambda port: ReadingCount(0, 0)

    # the start, and what this run has changed
    step: int = EXAMINED  # current step of the start
    has_started: bool = False
    has_ordered_status: bool = False  # of any tool; earlier readings may no longer hold
    # settings changed at the start, with their previous values
    written: list[str] = field(default_factory=list)
    feeder_touched: bool = False
    feeder_stopped: bool = False  # at the end, as read back

    # identity
    has_identity: bool = False  # the station was identified as the right one at the start
    is_proven: bool = False  # the link has not broken since the station was identified
    # by port, with the time of the reading
    plugged_hours: dict[int, tuple[int, float]] = field(default_factory=dict)
    # when model and software were last confirmed; empty after signs of another station
    identity_at: dict[str, float] = field(default_factory=dict)
    stranger: str | None = None  # description of another station found in its place
    answers_as: Identity | None = None  # what that station said of itself
    # stations of the line that nothing on the link tells from it
    alike: list[str] = field(default_factory=list)
    mix_up: str | None = None  # why another station answers, once that is known

    # link
    link_is_faster: str | None = None  # than its stated line format, in words
    reconnection: Reconnection = field(default_factory=Reconnection)

    @classmethod
    def of(cls, task: StationTask) -> StationState:
        """Return what is known before the station has answered."""
        facts = StationFacts(
            name=task.name,
            url=task.url,
            family=task.family.name if task.family else "auto",
            address=task.address,
            baudrate=task.line.baudrate,
            format=task.line.format,
            recipe=task.recipe_file,
            rated_power_w=task.rated_power_w,
            alarm_rules=task.recipe.episodes.rules(),
        )
        return cls(facts, task.family)

    @property
    def family(self) -> Family:
        """The family. Raises LookupError while "auto" is not resolved."""
        if self.known_family is None:
            raise LookupError(f"the family of {self.facts.name} is not known yet")
        return self.known_family

    @family.setter
    def family(self, family: Family) -> None:
        self.known_family = family
        self.facts.family = family.name

    @property
    def family_known(self) -> bool:
        return self.known_family is not None

    def command(self, name: str) -> Command:
        return self.family.commands[name]

    @property
    def set_name(self) -> str:
        """Name of the temperature setting; empty if the family has none."""
        command = self.family.command_of("setpoint_c")
        return "" if command is None else command.name

    def setpoint_c(self, port: PortState) -> float | None:
        """Return the setpoint of `port`, as last read."""
        return port.celsius(self.set_name)

    def is_at_work(self, port: PortState) -> bool:
        """Return True if the last status is at work."""
        return port.status is not None and self.family.status.is_working(port.status)

    def alarms_count(self, port: PortState) -> bool:
        """Return True while working, after first entering setpoint ±10 °C
        (docs/reference/exit-codes.md).
        """
        return port.at_temperature and self.is_at_work(port)

    def is_empty(self, port: PortState) -> bool:
        """Return True if the station last reported no tool in `port`, so that its temperature has
        no meaning.
        """
        return self.family.is_empty(port.tool, port.error)

    def whole_of(self, command: Command) -> int | None:
        """Return the station's maximum, the base of `command`'s number; None if unknown."""
        whole = self.held.get(str(command.share_of))
        return whole if isinstance(whole, int) and whole > 0 else None

    def said_at_start(self, name: str) -> str | None:
        """Return the station's model or software version at the start; None if it reported none."""
        return {"model": self.facts.model, "software_version": self.facts.software}[name]

    def identity(self) -> Identity:
        """Return the identity of the station that the run started with."""
        hours = {port: known for port, (known, _) in self.plugged_hours.items()}
        return Identity(self.facts.model, self.facts.software, hours)

    def tool_text(self, code: int | None) -> str:
        return "unknown" if code is None else self.family.tool_name(code)

    @property
    def may_feed(self) -> bool:
        """True if this run has to stop a feeder: a robot's own switch can start it whenever its
        tool is at work.
        """
        has_feeder = self.family_known and self.family.has_feeder
        touched = self.feeder_touched or any(port.touched for port in self.ports.values())
        return has_feeder and touched and not self.feeder_stopped
