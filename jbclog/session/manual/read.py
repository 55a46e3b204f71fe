"""Read values by command: one, all, or a tip while a thermometer measures it.

No value rests on a single answer, and an impossible value is never returned. A value that is
cleared by reading is read only by name, and once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TypeVar

from jbclog.core.errors import (
    ImplausibleAnswer,
    NotSupported,
    Refusal,
    RobotModeOff,
    StartRefused,
    StationError,
    StationSilent,
    UsageError,
)
from jbclog.core.io_requests import wait
from jbclog.core.quantities import Value
from jbclog.protocol.client.confirmed_reads import ANSWERS
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.omega import WITHOUT_DIGIT
from jbclog.protocol.commands.ranges import (
    STILL_C,
    TEMPERATURES,
    Possible,
    is_share,
    plausibility_check,
)
from jbclog.session.manual.contact import (
    Contact,
    Target,
    everywhere,
    find_ports,
    find_tool,
    open_contact,
    places,
    sentence,
    title,
)
from jbclog.session.manual.names import find, readable, why_only_by_name
from jbclog.session.setting_write import WHOLE_STATION, Place

# A steady value (name, tool, error, setting, counter) is read until two answers are equal; a moving
# one until two are close, or one of three lies between the others; a value that is cleared by
# reading, once.
COMPARE = "read it again, and compare with the station's display"
APART: Mapping[str, int] = MappingProxyType(
    # s: the countdown continues between answers
    {**dict.fromkeys(TEMPERATURES, STILL_C), "power_permille": 100, "delay_s": 2}
)
"""Maximum difference of two answers to the same request, in the signal's unit."""


async def believed(contact: Contact, command: Command, place: Place) -> Value:
    """Read until an answer is confirmed. Raises what reading raises, or `ImplausibleAnswer`."""
    if command.sent_once:
        return await contact.read(command, place)
    signal = contact.family.signal_of(command.name)
    possible = plausibility_check(signal, contact.family)
    if signal is not None and possible is not None:
        return await _moving(contact, command, place, possible, APART[signal])
    greatest = None
    if command.share_of is not None:
        greatest = await contact.value(command.share_of, WHOLE_STATION)
    is_counter = any(counter.command == command.name for counter in contact.family.counters)
    value = await contact.read_confirmed(command, place, grows=is_counter)
    if isinstance(greatest, int) and greatest > 0 and not is_share(value, greatest):
        raise _cannot_be(command, place, [value])
    return value


async def _moving(
    contact: Contact, command: Command, place: Place, possible: Possible, apart: int
) -> Value:
    given: list[Value] = []
    while len(given) < ANSWERS:
        answer = await contact.read(command, place)
        is_said_again = answer in given
        given.append(answer)
        if possible(answer):
            value = settled(list(filter(possible, given)), apart)
            if value is not None:
                return value
        elif is_said_again:
            raise _cannot_be(command, place, [answer])
    if not any(map(possible, given)):
        raise _cannot_be(command, place, given)
    answers_text = ", ".join(map(command.shown, given))
    raise ImplausibleAnswer(
        f"{title(command, place)}: the station says {answers_text} when asked {len(given)} times;"
        f" {COMPARE}"
    )


def _cannot_be(command: Command, place: Place, given: Sequence[Value]) -> ImplausibleAnswer:
    answers_text = ", ".join(dict.fromkeys(map(command.shown, given)))
    return ImplausibleAnswer(
        f"{title(command, place)}: the station says {answers_text}, which is impossible; {COMPARE}"
    )


def settled(given: Sequence[Value], apart: int) -> Value | None:
    """Return the value confirmed by the last of `given`, oldest first, within `apart`; None if
    there is none yet.
    """
    numbers = [one for one in given if isinstance(one, int | float)]
    *before, last = numbers
    if any(abs(one - last) <= apart for one in before):
        return last
    if len(before) < 2:
        return None
    first, middle = before[-2:]
    return middle if first <= middle <= last or first >= middle >= last else None


T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ReadResult:
    """A value, or why there is none: then `value` is None, `reason` the word used in records, and
    `problem` a sentence.

    `data` is the raw data field (of an implausible value, the last one); `heard` is its time of
    arrival in monotonic seconds. `is_void`: the value has no meaning in the port's present state.
    `is_absent`: the station lacks it.
    """

    command: Command
    place: Place
    value: Value | None
    data: str
    heard: float
    reason: str = ""
    problem: str = ""
    is_void: bool = False
    is_absent: bool = False


OnReading = Callable[[Contact, ReadResult], None]
"""Receives each reading as it arrives, with its station."""


async def read_value(target: Target, name: str, asked: Place, on_reading: OnReading) -> None:
    """Read the value of that name at each place addressed.

    Raises `StartRefused` if no usable station answers or the family has no such value, and
    `LinkError`.
    """
    contact = await open_contact(target)
    command = found_after_all(contact, lambda: find(name, contact.family, readable))
    for place in await places(contact, command, asked):
        on_reading(contact, await _reading(contact, command, place))


async def read_all(target: Target, on_reading: OnReading) -> None:
    """Read everything that has no side effect, everywhere. Raises as `read_value` does."""
    contact = await open_contact(target)
    for command, place in await everywhere(contact, harmless(contact.family)):
        on_reading(contact, await _reading(contact, command, place))


def harmless(family: Family) -> list[Command]:
    """Return the commands that can be read any number of times, and without a number."""
    return [
        command
        for command in family.commands.values()
        if command.readable and not why_only_by_name(command)
    ]


def only_by_name(family: Family) -> list[Command]:
    """Return the commands that `read_all` leaves out."""
    return [
        command
        for command in family.commands.values()
        if command.readable and why_only_by_name(command)
    ]


def found_after_all(contact: Contact, look: Callable[[], T]) -> T:
    """Run `look` now that the family is known. Turns its `UsageError` into `StartRefused`, because
    the station was contacted.
    """
    try:
        return look()
    except UsageError as error:
        raise StartRefused(f"{contact.name} is a {contact.model}: {error}") from error


async def _reading(contact: Contact, command: Command, place: Place) -> ReadResult:
    """Read one value. Raises only if nothing more can be read."""
    client = contact.client
    try:
        value = await believed(contact, command, place)
    except (StationSilent, RobotModeOff) as error:
        raise StartRefused(f"{contact.name}: {error}") from error
    except StationError as error:
        answers_text = client.data if isinstance(error, ImplausibleAnswer) else ""
        is_absent = isinstance(error, NotSupported)
        failed = ReadResult(
            command,
            place,
            None,
            answers_text,
            client.now,
            error.reason,
            sentence(error),
            is_absent=is_absent,
        )
        return (
            await _unless_void(contact, failed)
            if isinstance(error, Refusal | ImplausibleAnswer)
            else failed
        )
    if value == WITHOUT_DIGIT:
        return ReadResult(
            command, place, None, client.data, client.heard, "no_digit", WITHOUT_DIGIT, is_void=True
        )
    return await _unless_void(
        contact,
        ReadResult(command, place, value, command.raw_text(client.data, value), client.heard),
    )


async def _unless_void(contact: Contact, reading: ReadResult) -> ReadResult:
    """Remove the value if it has no meaning without a tool, or during the port's error.

    See docs/reference/contradictions.md, B-44.
    """
    family, port = contact.family, reading.place.port
    signal = family.signal_of(reading.command.name)
    if port is None or signal is None or not family.may_be_void(signal):
        return reading
    tool = await find_tool(contact, port) if family.tools else None
    error = await contact.value("port_error", Place(port))
    if not isinstance(error, int):
        error = None
    why = family.void(signal, tool, error)
    if why is None:
        return reading
    number = f" (port error {error})" if error else ""
    return replace(
        reading, value=None, reason=why, problem=why.replace("_", " ") + number, is_void=True
    )


# Read a tip while a thermometer measures it: its temperature several times, its settings before and
# after. Sends only reads.
READINGS, EVERY_S = 12, 0.5


@dataclass(slots=True)
class TipReadings:
    """The station's readings: `temperatures` in °C in order, `states` and `settings` (°C) before
    and after them.
    """

    model: str | None
    tool_name: str | None
    adjust_c: float | None
    temperatures: list[float] = field(default_factory=list)
    states: list[str] = field(default_factory=list)
    settings: list[float] = field(default_factory=list)


async def read_tip(target: Target, port: int) -> TipReadings:
    """Read the tip of `port` for `READINGS` × `EVERY_S` s.

    Raises `StartRefused` if no usable station answers, or there is no such port, tool or
    temperature.
    """
    contact = await open_contact(target)
    ports = await find_ports(contact)
    if port not in ports:
        raise StartRefused(
            f"{contact.name}: there is no port {port}; it has"
            f" {', '.join(map(str, ports)) or 'none'}"
        )
    temperature = contact.family.command_of("temperature_c")
    if temperature is None:
        raise StartRefused(
            f"{contact.name}: a {contact.family.name} reports no temperature; read it off its"
            " display: --station-c"
        )
    tool = await find_tool(contact, port) if contact.family.tools else None
    if contact.family.tools and not tool:
        raise StartRefused(f"{contact.name}: there is no tool in port {port}")
    adjust = await _number(contact, "adjust", Place(port, tool))
    found = TipReadings(contact.model, contact.family.tool_name(tool) if tool else None, adjust)
    await _state(contact, port, found)
    try:
        for _ in range(READINGS):
            value = await believed(contact, temperature, Place(port))
            if isinstance(value, int | float):
                found.temperatures.append(float(value))
            contact.client.unasked(await wait(contact.client.now + EVERY_S))
    except StationError as error:
        raise StartRefused(
            f"{contact.name}: its tip could not be read: {sentence(error)}"
        ) from error
    await _state(contact, port, found)
    return found


async def _state(contact: Contact, port: int, found: TipReadings) -> None:
    status = contact.family.command_of("status")
    if status is not None:
        value = await contact.value(status.name, Place(port))
        if isinstance(value, tuple):
            found.states.append(contact.family.status.state(value))
    selected = contact.family.command_of("setpoint_c")
    setting = None if selected is None else await _number(contact, selected.name, Place(port))
    found.settings += [] if setting is None else [setting]


async def _number(contact: Contact, name: str, place: Place) -> float | None:
    value = await contact.value(name, place)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
