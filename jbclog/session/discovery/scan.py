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
from jbclog.core.io_requests import Reopen, Steps, Wait
from jbclog.core.quantities import Value
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.client.confirmed_reads import read_confirmed
from jbclog.protocol.client.interface import Client
from jbclog.protocol.client.make import client_for
from jbclog.protocol.client.timing import LEAST_ANSWERED, READS, ResponseTime, response_time
from jbclog.protocol.commands.error_tables import COMMUNICATION_ERRORS
from jbclog.protocol.commands.family import FAMILIES, Family, family_of
from jbclog.protocol.frame import Frame
from jbclog.session.discovery.found import (
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
from jbclog.session.discovery.probe import (
    HOST,
    MODEL,
    MOST_KEPT,
    OMEGA_QUESTION,
    Probe,
    Received,
    is_binary,
    model_question,
    omega_answer,
    robot_answer,
)

# The identity: model, family, software, ports and tools, response time. It goes into a line file,
# so model, software, tool and error need two equal answers.
ROBOT_OFF = 5
FAULT_IN_FRAME = (1, 2)  # communication errors: the station did not understand the request
PORTS = (1, 2, 3, 4)
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


def learn(found: StationFound, now: float) -> Steps[float]:
    """Read the rest of the identity into `found`; return the time."""
    if found.refusal is not None:
        return now
    client = client_for(found.family, found.line, found.address)
    client.now = now
    try:
        yield from _learn_station(client, found)
        yield from _learn_tools(client, found)
        yield from _learn_turnaround(client, found)
    except StationError as error:
        found.trouble, found.contradicts = str(error), isinstance(error, ImplausibleAnswer)
    return client.now


def _table(found: StationFound) -> Family:
    return found.family or COMMON_TO_ALL


def _learn_station(client: Client, found: StationFound) -> Steps[None]:
    table = _table(found)
    software = yield from _value_of(client, table, "software_version")
    found.software = None if software is None else str(software)
    error = yield from _value_of(client, table, "station_error")
    if isinstance(error, int) and error:
        found.error = table.station_errors.text(error)


def _value_of(client: Client, table: Family, name: str) -> Steps[Value | None]:
    """Return the value of a command; None if the family lacks it, or the station refuses or sends
    nothing readable.
    """
    if name not in table.commands:
        return None
    try:
        return (yield from read_confirmed(client, table.commands[name]))
    except (StationSilent, ImplausibleAnswer):
        raise
    except StationError:
        return None


def _learn_tools(client: Client, found: StationFound) -> Steps[None]:
    """Find the ports that answer R-CT, and their tools."""
    table = _table(found)
    if "tool" not in table.commands:
        return
    for port in table.ports or PORTS:
        try:
            tool = yield from read_confirmed(client, table.commands["tool"], port)
        except (NotSupported, OutOfRange):
            continue
        except (StationSilent, ImplausibleAnswer):
            raise
        except StationError:
            tool = None
        found.tools[port] = _tool_name(found.family, tool)


def _tool_name(family: Family | None, tool: Value | None) -> str | None:
    if not isinstance(tool, int):
        return None
    if tool == NO_TOOL:
        return "none"
    return f"tool_{tool}" if family is None else family.tool_name(tool)


def _learn_turnaround(client: Client, found: StationFound) -> Steps[None]:
    measured, answered = yield from response_time(
        client, _table(found), min(found.tools, default=1)
    )
    found.turnaround = None if measured is None else _turnaround(measured, found.line)
    found.not_answered = () if measured is None else measured.ignored
    if answered < LEAST_ANSWERED:
        found.trouble = f"only {answered} of {READS} questions were answered in time"


def _turnaround(measured: ResponseTime, line: LineFormat) -> Turnaround:
    median_ms, longest_ms = round(measured.median / 1000, 3), round(measured.longest / 1000, 3)
    return Turnaround(median_ms, longest_ms, len(measured.took), READS, measured.faster_text(line))


OMEGA = "omega"
AGAIN = 4  # more requests for the model, at most


@dataclass(slots=True)
class ScanControl:
    """State shared by the scan and the opener of its port: `line` is the format for the next
    opening; `stop` ends the scan soon.
    """

    line: LineFormat
    stop: bool = False


def scan(plan: ScanPlan, dial: ScanControl, report: PortReport) -> Steps[None]:
    """Fill `report`. Does not raise errors of port or station."""
    began = (yield Wait(0.0)).now
    report.asked = plan.addresses
    this = _Scan(plan, dial, report, began)
    try:
        yield from this.try_all()
    except LinkError as error:
        report.broken = error
    report.flood = this.probe.flood
    report.seconds = this.probe.now - began
    report.stopped = dial.stop


class _Scan:
    def __init__(self, plan: ScanPlan, dial: ScanControl, report: PortReport, began: float) -> None:
        self.probe = Probe()
        self.probe.now = began
        self._plan = plan
        self._dial = dial
        self._report = report
        self._until = began + plan.seconds

    def try_all(self) -> Steps[None]:
        for place, trial in enumerate(self._plan.trials):
            if self._is_over():
                self._report.untried += [rest.line for rest in self._plan.trials[place:]]
                return
            if (yield from self._try(trial)):
                return

    def _is_over(self) -> bool:
        return self._dial.stop or self.probe.now >= self._until

    def _try(self, trial: Trial) -> Steps[bool]:
        """Try one line format; return True if it ends the scan."""
        self._dial.line = trial.line
        self.probe.now = (yield Reopen()).now
        self._report.tried.append(trial.line)
        if trial.listens_s and (yield from self._hears_binary(trial)):
            return True
        if (yield from self._finds_robot(trial)):
            return True
        return trial.asks_omega and (yield from self._finds_omega(trial))

    def _hears_binary(self, trial: Trial) -> Steps[bool]:
        came = yield from self.probe.listen(trial.listens_s)
        self._keep(trial.line, came)
        if is_binary(came.rest):
            self._report.binary = trial.line
        return self._report.binary is not None

    def _finds_robot(self, trial: Trial) -> Steps[bool]:
        patience_s = ANSWER_S + trial.line.seconds(EXCHANGE)
        refused: StationFound | None = None
        for address in self._plan.addresses:
            if self._is_over():
                break
            came = yield from self.probe.ask(model_question(address), patience_s, robot_answer)
            answer = robot_answer(came.rest)
            if answer is None:
                self._keep(trial.line, came)
                continue
            found, is_meant = of_answer(answer, trial.line)
            if is_meant:
                yield from self._settle(answer, found, address, patience_s)
                return True
            # it may need the other addressing (docs/reference/contradictions.md, B-14)
            refused = refused or found
        self._report.station = refused
        return refused is not None

    def _settle(
        self, first: Frame, found: StationFound, address: int | None, patience_s: float
    ) -> Steps[None]:
        """Repeat R-SMN until two answers agree on model and address, then read the rest.

        Alternates between the address that answered and the one tried.
        """
        given = [first]
        for target in islice(cycle((found.address, address)), AGAIN):
            if self._dial.stop:
                break
            came = yield from self.probe.ask(model_question(target), patience_s, robot_answer)
            answer = robot_answer(came.rest)
            if answer is not None and answer in given:
                yield from self._learn(of_answer(answer, found.line)[0])
                return
            given += [] if answer is None else [answer]
        self._report.station = not_settled(found.line, given)

    def _finds_omega(self, trial: Trial) -> Steps[bool]:
        """Send A more than once: the end of a JBC frame can turn the first STX into a digit of its
        sum.
        """
        for _ in range(OMEGA_ASKED):
            if self._is_over():
                break
            came = yield from self.probe.ask(
                OMEGA_QUESTION, OMEGA_ANSWER_S + trial.line.seconds(EXCHANGE), omega_answer
            )
            if omega_answer(came.rest) is not None:
                yield from self._learn(StationFound(trial.line, None, FAMILIES[OMEGA]))
                return True
            self._keep(trial.line, came)
        return False

    def _learn(self, found: StationFound) -> Steps[None]:
        self._report.station = found
        try:
            self.probe.now = yield from learn(found, self.probe.now)
        except LinkError:
            found.trouble = "the link broke while it was asked"
            raise

    def _keep(self, line: LineFormat, came: Received) -> None:
        """Keep bytes that were no answer."""
        self._report.echoed |= came.echoed
        if came.rest:
            kept = self._report.garbage.get(line, b"") + came.rest
            self._report.garbage[line] = kept[:MOST_KEPT]
