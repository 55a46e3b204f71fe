"""One station's session: what it has to do, what it knows, and where it writes that down."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field

from jbclog.core.clock import UtcOffset
from jbclog.core.quantities import Value
from jbclog.core.rows import Journal
from jbclog.protocol.client.confirmed_reads import read_confirmed, with_retries
from jbclog.protocol.client.interface import Client, PreparedRead
from jbclog.protocol.client.make import client_for
from jbclog.protocol.client.timing import AnswerTime, answer_time
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.status import StatusWord
from jbclog.session.run.log import SessionLog
from jbclog.session.run.state import PREPARED, PortState, StationState
from jbclog.session.run.task import StationTask

AnswerTimes = defaultdict[int, list[tuple[str, AnswerTime]]]
"""Port -> answers so far, each with its command's name."""


@dataclass(slots=True)
class DecisiveReads:
    """Reads of values on which something is decided; two answers must be equal
    (`protocol/client/confirmed_reads.py`).
    """

    station: Client
    tries: int = 1  # more during the start
    # answers read again before they were accepted, by command
    doubted: Counter[str] = field(default_factory=Counter)
    # None once the response time is known
    answer_times: AnswerTimes | None = field(default_factory=lambda: AnswerTimes(list))

    async def confirmed(
        self,
        command: Command,
        port: int | None = None,
        tool: int | None = None,
        *,
        known: Value | None = None,
        grows: bool = False,
    ) -> Value:
        """Read until two answers are equal, with more tries during the start."""

        async def ask() -> Value:
            return await read_confirmed(
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
            if self.answer_times is not None and port is not None:
                time = answer_time(self.station, question)
                self.answer_times[port].append((command.name, time))

        return await with_retries(self.station, ask, self.tries)


@dataclass(frozen=True, slots=True)
class SessionContext:
    """What the steps of one session work with.

    `order`: what the run is. `station`: the client of its link. `state`: what is known of the
    station. `log`: where rows and events go. `reads`: decisive reads over the link.
    """

    order: StationTask
    station: Client
    state: StationState
    log: SessionLog
    reads: DecisiveReads

    @classmethod
    def of(cls, order: StationTask, journal: Journal, utc: UtcOffset) -> SessionContext:
        station = client_for(order.family, order.line, order.address)
        log = SessionLog(order.name, station, journal, utc)
        return cls(order, station, StationState.of(order), log, DecisiveReads(station))

    @property
    def name(self) -> str:
        return self.order.name

    @property
    def now(self) -> float:
        """Time of the last result, or of the answer being handed over, monotonic seconds."""
        return self.log.now

    def command(self, name: str) -> Command:
        return self.state.command(name)

    @property
    def safe_state(self) -> str:
        """The family's safe state for touched tools at the end."""
        return self.order.recipe.safe_state(self.state.family.name)

    def start_word(self, port: PortState) -> StatusWord | None:
        """Return the status word to order on `port` at the start; None if the recipe leaves it
        alone, or it is unknown.

        One word orders the tool's state and, on hot air, suction; anything that the recipe does not
        set stays as read.
        """
        recipe, status = self.order.recipe, self.state.family.status
        ordered = recipe.run.status
        held = port.held.get("status")
        known = held if isinstance(held, tuple) else None
        word = known if ordered is None else status.orders[ordered]
        if ordered is None and (word is None or not status.has_suction or recipe.suction == "keep"):
            return None
        if word is None or not status.has_suction:
            return word
        if recipe.suction == "keep":
            return status.with_suction(word, on=known is not None and status.sucks(known))
        return status.with_suction(word, on=recipe.suction == "on")

    @property
    def spares_resting(self) -> bool:
        """True if a safe order leaves a resting tool alone. Before the third step of the start this
        run has ordered no status and no setpoint, and an order to stand would heat a sleeping tool,
        or one in its extractor.
        """
        return self.state.step <= PREPARED

    def keeps_suction(self, port: PortState) -> bool:
        """Return True if a safe order keeps suction on at `port`. Unknown counts as off."""
        return (
            self.state.family.status.has_suction
            and self.order.recipe.run.safe_suction == "keep"
            and port.has_suction is True
        )

    def publish(self) -> None:
        """Send the current facts to the journal."""
        state, facts, station = self.state, self.state.facts, self.station
        family, ports = state.known_family, state.ports.values()
        if family is None or family.tools:
            facts.tool_names = {port.number: state.tool_text(port.tool) for port in ports}
        facts.touched = [port.number for port in ports if port.touched]
        facts.may_feed = state.may_feed
        if family is not None:
            facts.signals = [signal.name for signal in family.signals]
            facts.asked_safe_state = self.safe_state
            facts.suction = [port.number for port in ports if self.keeps_suction(port)]
        facts.not_supported = sorted(state.not_supported)
        facts.garbage_bytes = station.garbage_bytes
        facts.strays = dict(station.strays)
        self.log.report_anomalies()
        facts.anomalies = dict(sorted(station.anomalies.counts.items()))
        facts.doubted = dict(self.reads.doubted)
        facts.last_temperature_c = {
            port.number: port.temperature_c for port in ports if port.temperature_c is not None
        }
        self.log.journal.facts(facts)
