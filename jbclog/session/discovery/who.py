"""Who it is that answers: model, family, software, ports and tools, how fast. Harmless reads only.

A model, a software, a tool and an error count when two answers say the same: a line file is made of them.
"""

from __future__ import annotations

from collections.abc import Sequence

from jbclog.core.errors import ImplausibleAnswer, NotSupported, OutOfRange, StationError, StationSilent
from jbclog.core.io_requests import Steps
from jbclog.core.line_format import LineFormat
from jbclog.core.quantities import Value
from jbclog.protocol.client.agreement import agreed
from jbclog.protocol.client.interface import Client
from jbclog.protocol.client.make import client_for
from jbclog.protocol.client.turnaround import LEAST_ANSWERED, READS, ResponseTime, response_time
from jbclog.protocol.commands.family import FAMILIES, Family, family_of
from jbclog.protocol.commands.robot import COMMUNICATION_ERRORS
from jbclog.protocol.frame import Frame
from jbclog.session.discovery.found import StationFound, Turnaround
from jbclog.session.discovery.probe import HOST, MODEL

ROBOT_OFF = 5
FAULT_IN_FRAME = (1, 2)  # communication errors: the station did not understand the question
PORTS = (1, 2, 3, 4)
NO_TOOL = 0
COMMON_TO_ALL = FAMILIES["soldering"]  # its table, where the family is not known


def of_answer(answer: Frame, line: LineFormat) -> tuple[StationFound, bool]:
    """Who sent this answer to R-SMN, and whether it was meant: a fault found with the frame may be the wrong addressing."""
    found = StationFound(line, address_of(answer))
    if answer.header == "A":
        found.model = str(MODEL.quantity.decode(answer.text[len(MODEL.letters) :]))
        found.family = family_of(found.model)
        return found, True
    number = int(answer.text[-5:])
    found.robot_mode = False if number == ROBOT_OFF else None
    found.refusal = f"N {number:05d}, {COMMUNICATION_ERRORS.get(number, 'unknown communication error')}"
    return found, number not in FAULT_IN_FRAME


def address_of(answer: Frame) -> int | None:
    """The address that is not the host's, whichever of the two stands first (docs/reference/contradictions.md, B-6)."""
    if answer.source is None or answer.target is None:
        return None
    return answer.source if answer.source != HOST else answer.target


def not_settled(line: LineFormat, given: Sequence[Frame]) -> StationFound:
    """Somebody who answers, where no two of `given`, the answers to R-SMN, were the same: nothing that they say is known."""
    found = StationFound(line, address_of(given[0]), contradicts=len(given) > 1)
    said = ", ".join(_said(answer) for answer in given)
    found.trouble = f"it answered its model as {said}" if found.contradicts else f"it answered its model, {said}, once only"
    return found


def _said(answer: Frame) -> str:
    """``'DDE' from address 01``."""
    address = address_of(answer)
    what = f"'{answer.text[len(MODEL.letters) :].strip()}'" if answer.header == "A" else f"N {answer.text[-5:]}"
    return what if address is None else f"{what} from address {address:02d}"


def learn(found: StationFound, now: float) -> Steps[float]:
    """Ask it what else it says of itself, and note that in `found`; give the moment."""
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
    software = yield from _told(client, table, "software_version")
    found.software = None if software is None else str(software)
    error = yield from _told(client, table, "station_error")
    if isinstance(error, int) and error:
        found.error = table.station_errors.text(error)


def _told(client: Client, table: Family, name: str) -> Steps[Value | None]:
    """The value of a command; None where the family has none, or the station says no or nothing that can be read."""
    if name not in table.commands:
        return None
    try:
        return (yield from agreed(client, table.commands[name]))
    except (StationSilent, ImplausibleAnswer):
        raise
    except StationError:
        return None


def _learn_tools(client: Client, found: StationFound) -> Steps[None]:
    """The ports that answer R-CT, and what is connected there."""
    table = _table(found)
    if "tool" not in table.commands:
        return
    for port in table.ports or PORTS:
        try:
            tool = yield from agreed(client, table.commands["tool"], port)
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
    measured, answered = yield from response_time(client, _table(found), min(found.tools, default=1))
    found.turnaround = None if measured is None else _turnaround(measured, found.line)
    found.not_answered = () if measured is None else measured.ignored
    if answered < LEAST_ANSWERED:
        found.trouble = f"only {answered} of {READS} questions were answered, and in time"


def _turnaround(measured: ResponseTime, line: LineFormat) -> Turnaround:
    median_ms, longest_ms = round(measured.median / 1000, 3), round(measured.longest / 1000, 3)
    return Turnaround(median_ms, longest_ms, len(measured.took), READS, measured.faster_text(line))
