"""A session's task and its state."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from jbclog.config.recipe import Recipe
from jbclog.core.clock import UtcOffset
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value
from jbclog.core.rows import EventRow, Journal, Severity, StationFacts
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.client.confirmed_reads import read_confirmed, with_retries
from jbclog.protocol.client.interface import Client, PreparedRead
from jbclog.protocol.client.make import client_for
from jbclog.protocol.client.timing import AnswerTime, answer_time
from jbclog.protocol.commands.command import TOOLS_WITH_A_PLACE, Command
from jbclog.protocol.commands.decisions import DECISIONS
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.status import StatusWord

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


@dataclass(frozen=True, slots=True)
class StationTask:
    """What a run requires of one station.

    `family` None: "auto". `ports` None: those that answer. `model`: the name that the line file
    accepts for the station, if any. `rate` is in Hz, or ``auto`` (a usual rate with a fifth of the
    link's time in reserve), ``fit`` (the recipe's, or the best that fits), or ``max`` (without
    pause); None for the recipe's. `t0` is the run's zero on the monotonic clock; `duration_s` is
    None for a run without a stated end. `sharers` says which other programs have the port open.
    """

    name: str
    url: str
    family: Family | None
    line: LineFormat
    address: int | None
    ports: tuple[int, ...] | None
    recipe: Recipe
    recipe_file: str
    families: Mapping[str, Family]
    t0: float
    duration_s: float | None = None
    rate: float | str | None = None
    rated_power_w: float | None = None
    allow_omega_write: bool = False
    may_be_missing: bool = False  # the run may start without this station
    model: str | None = None
    sharers: Callable[[], str] = lambda: ""


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


class SessionContext:
    """The state that all steps of one session share: task, client, ports and journal."""

    def __init__(self, order: StationTask, journal: Journal, utc: UtcOffset) -> None:
        self.order = order
        self.recipe = order.recipe
        self.journal = journal
        self.utc = utc
        self.station: Client = client_for(order.family, order.line, order.address)
        self.ports: dict[int, PortState] = {}
        self.held: dict[str, Value] = {}  # station-wide settings
        self.not_supported: set[str] = set()
        self.step = EXAMINED  # current step of the start
        self.has_started = False
        self.has_ordered_status = False  # of any tool; earlier readings may no longer hold
        self.written: list[str] = []  # settings changed at the start, with their previous values
        self.tries = 1  # of decisive reads; more during the start
        self.feeder_touched = False
        self.feeder_stopped = False  # at the end, as read back
        self.after_safe: Callable[[], Steps[None]] | None = None  # last reads after sampling
        self.answered_at: float | None = None  # while an answer is handed over: when it came
        self.close_rows: Callable[[], None] = lambda: None  # writes those that wait at the end
        self.connected = False
        self.away_when: str | None = None  # why the run ended while the station was away
        self.is_proven = False  # the link has not broken since the station was identified
        # answers read again before they were accepted, by command
        self.doubted: Counter[str] = Counter()
        # of signals by port, until the response time is known
        self.answer_times: defaultdict[int, list[AnswerTime]] | None = defaultdict(list)
        self.link_is_faster: str | None = None  # than its stated line format, in words
        # by port, with the time of the reading
        self.plugged_hours: dict[int, tuple[int, float]] = {}
        # when model and software were last confirmed; empty after signs of another station
        self.identity_at: dict[str, float] = {}
        self.is_flooded = False  # its link is flooded, and that was reported
        self.flood_pause_s = 0.0  # before a flooded link is reopened
        self.flood_ended: float | None = None  # when the station was back after the last flood
        # of a port so far, for display
        self.count_readings: Callable[[int], ReadingCount] = lambda port: ReadingCount(0, 0)
        self.stranger: str | None = None  # description of another station found in its place
        self.answers_as: Identity | None = None  # what that station said of itself
        self.has_identity = False  # the station was identified as the right one at the start
        self.alike: list[str] = []  # stations of the line that nothing on the link tells from it
        self.mix_up: str | None = None  # why another station answers, once that is known
        self._family = order.family
        self.facts = StationFacts(
            name=order.name,
            url=order.url,
            family=order.family.name if order.family else "auto",
            address=order.address,
            baudrate=order.line.baudrate,
            format=order.line.format,
            recipe=order.recipe_file,
            rated_power_w=order.rated_power_w,
            alarm_rules=order.recipe.episodes.rules(),
        )

    @property
    def name(self) -> str:
        return self.order.name

    @property
    def family(self) -> Family:
        """The family. Raises LookupError while "auto" is not resolved."""
        if self._family is None:
            raise LookupError(f"the family of {self.name} is not known yet")
        return self._family

    @family.setter
    def family(self, family: Family) -> None:
        self._family = family
        self.facts.family = family.name

    @property
    def family_known(self) -> bool:
        return self._family is not None

    @property
    def set_name(self) -> str:
        """Name of the temperature setting; empty if the family has none."""
        command = self.family.command_of("set_c")
        return "" if command is None else command.name

    def set_c(self, port: PortState) -> float | None:
        """Return the setpoint of `port`, as last read."""
        return port.celsius(self.set_name)

    @property
    def safe_state(self) -> str:
        """The family's safe state for touched tools at the end."""
        return self.recipe.safe_state(self.family.name)

    def start_word(self, port: PortState) -> StatusWord | None:
        """Return the status word to order on `port` at the start; None if the recipe leaves it
        alone, or it is unknown.

        One word orders the tool's state and, on hot air, suction; anything that the recipe does not
        set stays as read.
        """
        status, state, held = self.family.status, self.recipe.run.status, port.held.get("status")
        known = held if isinstance(held, tuple) else None
        word = known if state is None else status.orders[state]
        if word is None or not status.has_suction:
            return None if state is None else word
        if self.recipe.suction == "keep":
            return (
                None
                if state is None
                else status.with_suction(word, on=known is not None and status.sucks(known))
            )
        return status.with_suction(word, on=self.recipe.suction == "on")

    @property
    def spares_resting(self) -> bool:
        """True if a safe order leaves a resting tool alone. Before the third step of the start this
        run has ordered no status and no setpoint, and an order to stand would heat a sleeping tool,
        or one in its extractor.
        """
        return self.step <= PREPARED

    def keeps_suction(self, port: PortState) -> bool:
        """Return True if a safe order keeps suction on at `port`. Unknown counts as off."""
        return (
            self.family.status.has_suction
            and self.recipe.run.safe_suction == "keep"
            and port.has_suction is True
        )

    @property
    def may_feed(self) -> bool:
        """True if this run has to stop a feeder: a robot's own switch can start it whenever its
        tool is at work.
        """
        has_feeder = self.family_known and self.family.has_feeder
        touched = self.feeder_touched or any(port.touched for port in self.ports.values())
        return has_feeder and touched and not self.feeder_stopped

    @property
    def now(self) -> float:
        """Time of the last result, or of the answer being handed over, monotonic seconds."""
        return self.station.now if self.answered_at is None else self.answered_at

    def command(self, name: str) -> Command:
        return self.family.commands[name]

    def read_confirmed(
        self,
        command: Command,
        port: int | None = None,
        tool: int | None = None,
        *,
        known: Value | None = None,
        grows: bool = False,
    ) -> Steps[Value]:
        """Read a decisive value until two answers are equal, with more tries during the start
        (`protocol/client/confirmed_reads.py`).
        """

        def ask() -> Steps[Value]:
            return read_confirmed(
                self.station,
                command,
                port,
                tool,
                known=known,
                grows=grows,
                doubted=self.doubted,
                answered=answered,
            )

        def answered(question: PreparedRead) -> None:
            times = self.answer_times
            if times is not None and port is not None and self.family.signal_of(command.name):
                times[port].append(answer_time(self.station, question))

        return with_retries(self.station, ask, self.tries)

    def note(
        self,
        kind: str,
        severity: Severity,
        text: str,
        *,
        port: int | None = None,
        since: float | None = None,
        code: int | None = None,
        value: float | None = None,
        limit: float | None = None,
        raw: str | None = None,
        at_once: bool = False,
    ) -> None:
        """Record an event. `since`: the earliest time at which it can have happened."""
        time = self.utc.micros(self.now)
        earliest = None if since is None else self.utc.micros(since)
        event = EventRow(
            time, kind, severity, text, self.name, port, earliest, code, value, limit, raw
        )
        self.journal.event(event, at_once=at_once)

    def report_anomalies(self) -> None:
        """Record new anomalies of the station; each kind once."""
        for one in self.station.anomalies.take():
            decision = DECISIONS[one.number]
            severity = (
                Severity.WARNING if decision.doubtful and not decision.usual else Severity.INFO
            )
            text = f"{decision.met} First met: {one.place}."
            self.note(
                "protocol.anomaly", severity, text, port=one.port, code=one.number, raw=one.raw
            )

    def publish(self) -> None:
        """Send the current facts to the journal."""
        has_tools = self._family is None or self._family.tools
        self.facts.tools = {
            port.number: self.tool_text(port.tool) for port in self.ports.values() if has_tools
        }
        self.facts.signals = (
            [] if self._family is None else [signal.name for signal in self._family.signals]
        )
        self.facts.touched = [port.number for port in self.ports.values() if port.touched]
        self.facts.asked_safe_state = self.safe_state if self.family_known else ""
        self.facts.may_feed = self.may_feed
        self.facts.suction = [
            port.number
            for port in self.ports.values()
            if self.family_known and self.keeps_suction(port)
        ]
        self.facts.not_supported = sorted(self.not_supported)
        self.facts.garbage_bytes = self.station.garbage_bytes
        self.facts.strays = dict(self.station.strays)
        self.report_anomalies()
        self.facts.anomalies = dict(sorted(self.station.anomalies.counts.items()))
        self.facts.doubted = dict(self.doubted)
        self.facts.last_temperature_c = {
            p.number: p.temperature_c for p in self.ports.values() if p.temperature_c is not None
        }
        self.journal.facts(self.facts)

    def tool_text(self, code: int | None) -> str:
        return "unknown" if code is None else self.family.tool_name(code)
