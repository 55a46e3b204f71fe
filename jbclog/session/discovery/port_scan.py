"""Scan one port: one line format after the other, then the identity of the station that answers.

::

    open at a format -> listen for the binary protocol -> R-SMN to 01, without address, to 10
         ↑ no answer                                      (-> OMEGA's A, twice)
         └──────────────────────────────────────────────────────┤
                                                                ↓ answer
                       R-SMN until two answers are equal -> read the identity

Sends only reads, and none that clears anything. Keeps bytes that are no answer for the diagnosis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle, islice

from jbclog.core.errors import (
    ImplausibleAnswer,
    LinkError,
    NotSupported,
    OutOfRange,
    StationError,
    StationSilent,
)
from jbclog.core.io_requests import reopen, wait
from jbclog.core.quantities import Value
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.client.confirmed_reads import read_confirmed
from jbclog.protocol.client.make import client_for
from jbclog.protocol.client.timing import LEAST_ANSWERED, READS, response_time
from jbclog.protocol.commands.error_tables import COMMUNICATION_ERRORS
from jbclog.protocol.commands.family import FAMILIES, family_of
from jbclog.protocol.frame import Frame
from jbclog.session.discovery.probe import (
    HOST,
    MODEL,
    MOST_KEPT,
    OMEGA_QUESTION,
    PORTS,
    Probe,
    Received,
    is_binary,
    model_question,
    omega_answer,
    robot_answer,
)
from jbclog.session.discovery.scan_plan import (
    ANSWER_S,
    EXCHANGE,
    OMEGA_ANSWER_S,
    OMEGA_ASKED,
    PortReport,
    ScanPlan,
    StationFound,
    Trial,
    Turnaround,
)

# The identity: model, family, software, ports and tools, response time. It goes into a line file,
# so model, software, tool and error need two equal answers.
ROBOT_OFF = 5
FAULT_IN_FRAME = (1, 2)  # communication errors: the station did not understand the request
NO_TOOL = 0
COMMON_TO_ALL = FAMILIES["soldering"]  # the table for an unknown family


def of_answer(answer: Frame, line: LineFormat) -> tuple[StationFound, bool]:
    """Return the sender of this answer to R-SMN, and whether the answer counts: a frame error may
    mean wrong addressing.
    """
    found = StationFound(line, address_of(answer))
    if answer.header == "A":
        found.model = str(MODEL.quantity.decode(answer.text[len(MODEL.letters) :]))
        found.family = family_of(found.model)
        return found, True
    number = int(answer.text[-5:])
    found.robot_mode = False if number == ROBOT_OFF else None
    found.refusal = (
        f"N {number:05d}, {COMMUNICATION_ERRORS.get(number, 'unknown communication error')}"
    )
    return found, number not in FAULT_IN_FRAME


def address_of(answer: Frame) -> int | None:
    """Return the address that is not the host's (docs/reference/contradictions.md, B-6)."""
    if answer.source is None or answer.target is None:
        return None
    return answer.source if answer.source != HOST else answer.target


def not_settled(line: LineFormat, given: Sequence[Frame]) -> StationFound:
    """Return a station whose answers to R-SMN never agree: nothing is known about it."""
    found = StationFound(line, address_of(given[0]), contradicts=len(given) > 1)
    answers = ", ".join(_answer_text(answer) for answer in given)
    found.trouble = (
        f"it answered its model as {answers}"
        if found.contradicts
        else f"it answered its model, {answers}, once only"
    )
    return found


def _answer_text(answer: Frame) -> str:
    """Format an answer: ``'DDE' from address 01``."""
    address = address_of(answer)
    what = (
        f"'{answer.text[len(MODEL.letters) :].strip()}'"
        if answer.header == "A"
        else f"N {answer.text[-5:]}"
    )
    return what if address is None else f"{what} from address {address:02d}"


class IdentityReader:
    """Reads the rest of the identity of a station that has answered into `station`."""

    def __init__(self, station: StationFound, now: float) -> None:
        self.station = station
        self.client = client_for(station.family, station.line, station.address)
        self.client.now = now
        self._table = station.family or COMMON_TO_ALL

    async def read(self) -> None:
        """Read software, error, tools and response time. Raises `LinkError`."""
        try:
            await self._read_station()
            await self._read_tools()
            await self._measure_turnaround()
        except StationError as error:
            self.station.trouble = str(error)
            self.station.contradicts = isinstance(error, ImplausibleAnswer)

    async def _read_station(self) -> None:
        software = await self._value("software_version")
        self.station.software = None if software is None else str(software)
        error = await self._value("station_error")
        if isinstance(error, int) and error:
            self.station.error = self._table.station_errors.text(error)

    async def _value(self, name: str) -> Value | None:
        """Return a confirmed value; None if the family lacks it, or the station refuses it or sends
        nothing readable. Raises `StationSilent`, `ImplausibleAnswer`.
        """
        if name not in self._table.commands:
            return None
        try:
            return await read_confirmed(self.client, self._table.commands[name])
        except (StationSilent, ImplausibleAnswer):
            raise
        except StationError:
            return None

    async def _read_tools(self) -> None:
        """Find the ports that answer R-CT, and their tools."""
        if "tool" not in self._table.commands:
            return
        for port in self._table.ports or PORTS:
            try:
                tool = await read_confirmed(self.client, self._table.commands["tool"], port)
            except (NotSupported, OutOfRange):
                continue
            except (StationSilent, ImplausibleAnswer):
                raise
            except StationError:
                tool = None
            self.station.tool_names[port] = self._tool_name(tool)

    def _tool_name(self, tool: Value | None) -> str | None:
        if not isinstance(tool, int):
            return None
        if tool == NO_TOOL:
            return "none"
        family = self.station.family
        return f"tool_{tool}" if family is None else family.tool_name(tool)

    async def _measure_turnaround(self) -> None:
        station = self.station
        port = min(station.tool_names, default=1)
        measured, answered = await response_time(self.client, self._table, port)
        if measured is not None:
            station.turnaround = Turnaround(
                round(measured.median / 1000, 3),
                round(measured.longest / 1000, 3),
                len(measured.took),
                READS,
                measured.faster_text(station.line),
            )
            station.not_answered = measured.ignored
        if answered < LEAST_ANSWERED:
            station.trouble = f"only {answered} of {READS} questions were answered in time"


OMEGA = "omega"
AGAIN = 4  # more requests for the model, at most


@dataclass(slots=True)
class ScanControl:
    """State shared by the scan and the opener of its port: `line` is the format for the next
    opening; `stop` ends the scan soon.
    """

    line: LineFormat
    stop: bool = False


async def scan(plan: ScanPlan, control: ScanControl, report: PortReport) -> None:
    """Fill `report`. Does not raise errors of port or station."""
    began = (await wait(0.0)).now
    report.asked = plan.addresses
    search = _Search(plan, control, report, began)
    try:
        await search.try_all()
    except LinkError as error:
        report.broken = error
    report.flood = search.probe.flood
    report.seconds = search.probe.now - began
    report.stopped = control.stop


class _Search:
    def __init__(
        self, plan: ScanPlan, control: ScanControl, report: PortReport, began: float
    ) -> None:
        self.probe = Probe()
        self.probe.now = began
        self._plan = plan
        self._control = control
        self._report = report
        self._until = began + plan.seconds

    async def try_all(self) -> None:
        for place, trial in enumerate(self._plan.trials):
            if self._is_over():
                self._report.untried += [rest.line for rest in self._plan.trials[place:]]
                return
            if await self._try(trial):
                return

    def _is_over(self) -> bool:
        return self._control.stop or self.probe.now >= self._until

    async def _try(self, trial: Trial) -> bool:
        """Try one line format; return True if it ends the scan."""
        self._control.line = trial.line
        self.probe.now = (await reopen()).now
        self._report.tried.append(trial.line)
        if trial.listens_s and await self._hears_binary(trial):
            return True
        if await self._finds_robot(trial):
            return True
        return trial.asks_omega and await self._finds_omega(trial)

    async def _hears_binary(self, trial: Trial) -> bool:
        came = await self.probe.listen(trial.listens_s)
        self._keep(trial.line, came)
        if is_binary(came.rest):
            self._report.binary = trial.line
        return self._report.binary is not None

    async def _finds_robot(self, trial: Trial) -> bool:
        patience_s = ANSWER_S + trial.line.seconds(EXCHANGE)
        refused: StationFound | None = None
        for address in self._plan.addresses:
            if self._is_over():
                break
            came = await self.probe.ask(model_question(address), patience_s, robot_answer)
            answer = robot_answer(came.rest)
            if answer is None:
                self._keep(trial.line, came)
                continue
            found, is_meant = of_answer(answer, trial.line)
            if is_meant:
                await self._settle(answer, found, address, patience_s)
                return True
            # it may need the other addressing (docs/reference/contradictions.md, B-14)
            refused = refused or found
        self._report.station = refused
        return refused is not None

    async def _settle(
        self, first: Frame, found: StationFound, address: int | None, patience_s: float
    ) -> None:
        """Repeat R-SMN until two answers agree on model and address, then read the rest.

        Alternates between the address that answered and the one tried.
        """
        given = [first]
        for target in islice(cycle((found.address, address)), AGAIN):
            if self._control.stop:
                break
            came = await self.probe.ask(model_question(target), patience_s, robot_answer)
            answer = robot_answer(came.rest)
            if answer is not None and answer in given:
                await self._learn(of_answer(answer, found.line)[0])
                return
            given += [] if answer is None else [answer]
        self._report.station = not_settled(found.line, given)

    async def _finds_omega(self, trial: Trial) -> bool:
        """Send A more than once: the end of a JBC frame can turn the first STX into a digit of its
        sum.
        """
        for _ in range(OMEGA_ASKED):
            if self._is_over():
                break
            came = await self.probe.ask(
                OMEGA_QUESTION, OMEGA_ANSWER_S + trial.line.seconds(EXCHANGE), omega_answer
            )
            if omega_answer(came.rest) is not None:
                await self._learn(StationFound(trial.line, None, FAMILIES[OMEGA]))
                return True
            self._keep(trial.line, came)
        return False

    async def _learn(self, found: StationFound) -> None:
        self._report.station = found
        if found.refusal is not None:
            return
        reader = IdentityReader(found, self.probe.now)
        try:
            await reader.read()
        except LinkError:
            found.trouble = "the link broke while it was asked"
            raise
        self.probe.now = reader.client.now

    def _keep(self, line: LineFormat, came: Received) -> None:
        """Keep bytes that were no answer."""
        self._report.echoed |= came.echoed
        if came.rest:
            kept = self._report.garbage.get(line, b"") + came.rest
            self._report.garbage[line] = kept[:MOST_KEPT]
