"""Write a value by command: read the value before, write once, read back.

Raises only before anything was sent; later errors are in `WriteResult`. Nothing is sent twice,
nothing is restored, and nothing watches a tool put to work, so the person is warned.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Final

from jbclog.core.errors import (
    LinkError,
    NotSupported,
    Refusal,
    StartRefused,
    StationError,
    UsageError,
)
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value
from jbclog.protocol.client import timing
from jbclog.protocol.client.robot import BADLY_FORMED, Station
from jbclog.protocol.commands.command import Command, Effect, Scope
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.feeder import FeederState
from jbclog.protocol.commands.omega import ConditionNumber, StoredRecord
from jbclog.protocol.commands.status import StatusWord
from jbclog.session.manual.contact import (
    WHOLE_STATION,
    Contact,
    Place,
    Target,
    expect_proven,
    find_tool,
    open_contact,
    places,
    sentence,
    title,
)
from jbclog.session.manual.danger import ONLY_COLD, Keep, expect_cold, take_snapshot
from jbclog.session.manual.names import find, is_order, writable
from jbclog.session.manual.read import found_after_all
from jbclog.session.manual.values import names_suction, shown, value_in


class WriteOutcome(StrEnum):
    CONFIRMED = "confirmed"
    UNCHANGED = "unchanged"  # already so; nothing was sent
    SENT = "sent"  # acknowledged, with nothing to read back
    MISMATCH = "mismatch"
    REFUSED = "refused"
    UNCONFIRMED = "unconfirmed"


FINE: Final = (WriteOutcome.CONFIRMED, WriteOutcome.UNCHANGED, WriteOutcome.SENT)
FEEDING: Final = "feeding"
SHOWN_BY: Final[Mapping[str, str]] = MappingProxyType(
    {"start_feeding": FeederState.RUNNING, "stop_feeding": FeederState.STOPPED}
)
"""Orders without a value, and the state of `FEEDING` that shows them."""

Mirror = tuple[Command, Place]


@dataclass(frozen=True, slots=True)
class WriteRequest:
    """A write as typed by a person. `text` is None for an order without a value."""

    name: str
    text: str | None
    place: Place

    def meant(self, family: Family) -> tuple[Command, Value]:
        """Return the command and its value. Raises `UsageError`."""
        command = find(self.name, family, writable)
        if is_order(command):
            if self.text is not None:
                raise UsageError(f"{command.name} takes no value: omit {self.text!r}")
            return command, 0
        if self.text is None:
            raise UsageError(f"{command.name} needs a value")
        return command, value_in(self.text, command, family)


@dataclass(slots=True)
class WriteResult:
    """One write in progress. `is_sent`: the station may have received it. `is_answered`: it was
    acknowledged or timed out, so a later refusal is one of the read-back.

    `outcome` is a `WriteOutcome`, empty before it is sent; `problem` is its reason. `at_work`: the
    tool is, or may be, at work now; None if the write does not affect it. `is_empty`: the port has
    no tool, and a tool connected later starts to work. `seconds` is the duration of a restart.
    """

    contact: Contact | None = None
    command: Command | None = None
    place: Place = WHOLE_STATION
    value: Value | None = None
    before: Value | None = None
    readback: Value | None = None
    is_sent: bool = False
    is_answered: bool = False
    outcome: str = ""
    problem: str = ""
    at_work: bool | None = None
    is_empty: bool = False
    seconds: float | None = None

    @property
    def is_fine(self) -> bool:
        return self.outcome in FINE


def write_value(
    target: Target, change: WriteRequest, keep: Keep, written: WriteResult
) -> Steps[None]:
    """Write `change` once; `written` has the result so far, even after an exception.

    Raises `StartRefused`, `RecordError` (from `keep`) and `LinkError` before anything was sent.
    """
    contact = written.contact = yield from open_contact(target)
    yield from expect_proven(contact)
    command, value = found_after_all(contact, lambda: change.meant(contact.family))
    written.command, written.value = command, None if is_order(command) else value
    written.place = yield from _place(contact, command, change.place)
    yield from _expect_within(contact, command, value)
    yield from _read_before(contact, command, value, written)
    if _is_status(contact, command) and isinstance(value, tuple) and not names_suction(change.text):
        value = written.value = _with_suction_as_it_is(contact, value, written.before)
    if written.before == value and not _is_status(contact, command):
        written.outcome, written.readback = WriteOutcome.UNCHANGED, written.before
        return
    if command.dangerous:
        yield from _prepare(contact, command, value, keep)
    yield from _write(contact, command, value, written)
    yield from _look_at_work(contact, command, written)


def expect_one_port(command: Command, place: Place, ports: tuple[int, ...] | None) -> None:
    """Raise `UsageError` if a port must be named: nothing is written to several at once."""
    if (
        command.scope not in (Scope.PORT, Scope.TOOL)
        or place.port is not None
        or (ports is not None and len(ports) == 1)
    ):
        return
    which = f", one of {', '.join(map(str, ports))}" if ports is not None else ""
    raise UsageError(f"{command.name} belongs to a port: name it with --port{which}")


def _place(contact: Contact, command: Command, asked: Place) -> Steps[Place]:
    try:
        expect_one_port(command, asked, contact.ports)
    except UsageError as error:
        raise StartRefused(f"{contact.name}: {error}") from error
    (place,) = yield from places(contact, command, asked)
    return place


def _expect_within(contact: Contact, command: Command, value: Value) -> Steps[None]:
    """Check `value` against the station's own limits."""
    if command.within is None or not isinstance(value, int | float):
        return
    names = ("below", "minimum"), ("above", "maximum")
    for (side, which), limit_name in zip(names, command.within, strict=True):
        limit = None if limit_name is None else (yield from _limit(contact, limit_name))
        if limit is None and side == "above":
            raise StartRefused(
                f"{contact.name}: the station does not answer its {limit_name}; nothing was written"
            )
        if limit is not None and (value < limit if side == "below" else value > limit):
            bound = f"{side} the station's {which} of {command.shown(limit)}"
            raise StartRefused(
                f"{contact.name}: {command.shown(value)} is {bound}; nothing was written"
            )


def _limit(contact: Contact, name: str) -> Steps[float | None]:
    command = contact.family.commands.get(name)
    try:
        found = (
            None if command is None else (yield from contact.read_confirmed(command, WHOLE_STATION))
        )
    except NotSupported:
        return None
    except StationError as error:
        raise StartRefused(
            f"{contact.name}: {name} cannot be read ({sentence(error)}); nothing was written"
        ) from error
    return found if isinstance(found, int | float) else None


def _prepare(contact: Contact, command: Command, value: Value, keep: Keep) -> Steps[None]:
    if command.name in ONLY_COLD:
        yield from expect_cold(contact)
    keep((yield from take_snapshot(contact, _number_in(command, value))))


def _number_in(command: Command, value: Value) -> int | None:
    """Return the number of the solder condition to write or run."""
    if isinstance(value, StoredRecord):
        return value.condition
    return (
        value if isinstance(command.quantity, ConditionNumber) and isinstance(value, int) else None
    )


def _mirror(contact: Contact, command: Command, value: Value, place: Place) -> Mirror | None:
    """Return what reads a write back, and where; None if nothing does. C reads OMEGA's D back."""
    if command.readable:
        return command, place
    if isinstance(value, StoredRecord):
        return contact.family.commands["condition"], Place(condition=value.condition)
    return None


def _read_before(
    contact: Contact, command: Command, value: Value, written: WriteResult
) -> Steps[None]:
    """Read the value before. An unreadable tool state does not prevent an order, which may stop the
    tool.
    """
    mirror = _mirror(contact, command, value, written.place)
    if mirror is None:
        return
    try:
        written.before = yield from contact.read_confirmed(*mirror)
    except StationError as error:
        if not _is_status(contact, command):
            raise StartRefused(
                f"{contact.name}: {title(command, written.place)} cannot be read"
                f" ({sentence(error)}); nothing was written"
            ) from error


def _with_suction_as_it_is(contact: Contact, word: StatusWord, before: Value | None) -> StatusWord:
    """Keep suction unchanged: an order about heat must not drop the part. Unknown counts as off."""
    status = contact.family.status
    return status.with_suction(word, on=isinstance(before, tuple) and status.sucks(before))


def _is_status(contact: Contact, command: Command) -> bool:
    return command is contact.family.command_of("status")


def _write(contact: Contact, command: Command, value: Value, written: WriteResult) -> Steps[None]:
    written.is_sent, written.outcome = True, WriteOutcome.UNCONFIRMED
    try:
        yield from _send(contact, command, value, written)
    except (StationError, LinkError) as error:
        if isinstance(error, Refusal) and not written.is_answered:
            written.outcome, written.problem = (
                WriteOutcome.REFUSED,
                sentence(error) + _refused_form(command, error),
            )
        else:
            written.outcome, written.problem = WriteOutcome.UNCONFIRMED, str(error)


def _refused_form(command: Command, error: Refusal) -> str:
    """Explain why an order refused for its form is not tried in another form
    (docs/reference/contradictions.md, B-37).
    """
    if error.code != BADLY_FORMED or not (is_order(command) and command.sent_once):
        return ""
    return (
        "; it was not done. The manuals print no data for this order, and an order that acts or"
        " erases is not tried in a second form: give it at the station"
    )


def _send(contact: Contact, command: Command, value: Value, written: WriteResult) -> Steps[None]:
    client = contact.client
    if command.name == "restart":
        written.seconds = yield from timing.restart(client, command)
        written.outcome = WriteOutcome.SENT
    elif command.name == "address" and isinstance(client, Station) and isinstance(value, int):
        yield from timing.change_address(client, command, value or None)
        written.outcome = WriteOutcome.CONFIRMED
    elif command.name == "factory_reset":
        yield from client.write(command, value)
        written.outcome, written.is_answered = WriteOutcome.SENT, True
        yield from _check_reachable(contact, written)
    elif command.name in SHOWN_BY:
        yield from _send_and_look(contact, command, written)
    elif (mirror := _mirror(contact, command, value, written.place)) is not None:
        yield from _send_and_read(contact, command, value, mirror, written)
    else:
        yield from client.write(command, value)
        written.outcome = WriteOutcome.SENT


def _check_reachable(contact: Contact, written: WriteResult) -> Steps[None]:
    """Check that the station answers: a reset may change address, line format and Robot mode."""
    try:
        yield from contact.client.read(timing.MODEL)
    except StationError as error:
        written.problem = (
            f"the station no longer answers as before ({sentence(error)}); find it with `jbclog"
            " scan`"
        )


def _lost(
    contact: Contact, command: Command, value: Value, written: WriteResult
) -> Steps[StationError | None]:
    """Write once; return the error that came instead of an acknowledgement, if any. Raises
    `Refusal`.
    """
    lost = None
    try:
        yield from contact.client.write(command, value, written.place.port, written.place.tool)
    except Refusal:
        raise
    except StationError as error:
        lost = error
    written.is_answered = True
    return lost


def _send_and_read(
    contact: Contact, command: Command, value: Value, mirror: Mirror, written: WriteResult
) -> Steps[None]:
    """Write and read back; the read-back decides even after a lost acknowledgement."""
    yield from _lost(contact, command, value, written)
    found = written.readback = yield from contact.read_confirmed(*mirror, known=value)
    written.outcome = (
        WriteOutcome.CONFIRMED
        if _is_same(contact, command, found, value)
        else WriteOutcome.MISMATCH
    )
    if written.outcome == WriteOutcome.MISMATCH:
        written.problem = f"{shown(found, command, contact.family)} was read back"


def _is_same(contact: Contact, command: Command, found: Value, asked: Value) -> bool:
    if isinstance(found, tuple) and isinstance(asked, tuple) and _is_status(contact, command):
        status = contact.family.status
        return status.confirms(found, asked) and status.sucks(found) == status.sucks(asked)
    return found == asked


def _send_and_look(contact: Contact, command: Command, written: WriteResult) -> Steps[None]:
    """Write an order and check the feeder. A feed may end unseen: only a stop must show."""
    written.at_work = True  # until known otherwise
    lost = yield from _lost(contact, command, 0, written)
    expected = SHOWN_BY[command.name]
    found = written.readback = yield from contact.read_confirmed(
        contact.family.commands[FEEDING], WHOLE_STATION, known=expected
    )
    written.at_work = found != FeederState.STOPPED
    if found == expected:
        written.outcome = WriteOutcome.CONFIRMED
    elif lost is not None:
        raise lost
    elif command.effect is Effect.STOPS:
        written.outcome, written.problem = WriteOutcome.MISMATCH, f"{FEEDING} is {found}"
    else:
        written.outcome = WriteOutcome.SENT


def _look_at_work(contact: Contact, command: Command, written: WriteResult) -> Steps[None]:
    """Determine whether a tool is at work after an order to it, or after selecting another
    temperature for it.
    """
    is_refused = written.outcome == WriteOutcome.REFUSED
    if _is_status(contact, command):
        word = written.before if is_refused else written.readback
    elif command is contact.family.command_of("set_c") and not is_refused:
        word = yield from _status_now(contact, written.place.port)
        if word is None:
            return
    else:
        return
    # unknown counts as at work
    written.at_work = contact.family.status.is_working(word) if isinstance(word, tuple) else True
    written.is_empty = written.at_work and (yield from _is_empty(contact, written.place.port))


def _is_empty(contact: Contact, port: int | None) -> Steps[bool]:
    """Return True if the station reports no tool in `port`."""
    if port is None or contact.family.command_of("tool") is None:
        return False
    try:
        return contact.family.is_empty((yield from find_tool(contact, port)), None)
    except (StationError, LinkError):
        return False


def _status_now(contact: Contact, port: int | None) -> Steps[Value | None]:
    """Return the state of the tool in `port`; None if unknown."""
    status = contact.family.command_of("status")
    try:
        return None if status is None else (yield from contact.read(status, Place(port)))
    except (StationError, LinkError):
        return None


def is_order_to_rest(contact: Contact, written: WriteResult) -> bool:
    """Return True if it orders a safe state or stops a motor, so that its failure must be
    reported.
    """
    command = written.command
    if command is None:
        return False
    if _is_status(contact, command):
        status = contact.family.status
        plain = (
            status.with_suction(written.value, on=False)
            if isinstance(written.value, tuple)
            else None
        )
        return plain in [status.orders[name] for name in contact.family.safe_states]
    return command.effect is Effect.STOPS
