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
from jbclog.core.quantities import Value
from jbclog.protocol.client import timing
from jbclog.protocol.client.robot import BADLY_FORMED, Station
from jbclog.protocol.commands.command import Command, Effect, Scope
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.feeder import FeederState
from jbclog.protocol.commands.omega import ConditionNumber, StoredRecord
from jbclog.session.manual.contact import (
    Contact,
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
from jbclog.session.manual.value_text import names_suction, shown, value_in
from jbclog.session.setting_write import WHOLE_STATION, Attempt, Place, SettingWrite


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
    """One write in progress. `is_sent`: the station may have received it.

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
    outcome: str = ""
    problem: str = ""
    at_work: bool | None = None
    is_empty: bool = False
    seconds: float | None = None

    @property
    def is_fine(self) -> bool:
        return self.outcome in FINE


async def write_value(
    target: Target, change: WriteRequest, keep: Keep, written: WriteResult
) -> None:
    """Write `change` once; `written` has the result so far, even after an exception.

    Raises `StartRefused`, `RecordError` (from `keep`) and `LinkError` before anything was sent.
    """
    contact = written.contact = await open_contact(target)
    await expect_proven(contact)
    command, value = found_after_all(contact, lambda: change.meant(contact.family))
    written.command = command
    written.value = None if is_order(command) else value
    try:
        expect_one_port(command, change.place, contact.ports)
    except UsageError as error:
        raise StartRefused(f"{contact.name}: {error}") from error
    (written.place,) = await places(contact, command, change.place)
    write = ManualWrite(contact, command, value, written)
    await write.check(keeps_suction=not names_suction(change.text))
    if written.outcome == WriteOutcome.UNCHANGED:
        return
    if command.dangerous:
        await write.prepare(keep)
    await write.send()
    await write.look_at_work()


def expect_one_port(command: Command, place: Place, ports: tuple[int, ...] | None) -> None:
    """Raise `UsageError` if a port must be named: nothing is written to several at once."""
    if command.scope not in (Scope.PORT, Scope.TOOL) or place.port is not None:
        return
    which = ""
    if ports is not None:
        if len(ports) == 1:
            return
        which = f", one of {', '.join(map(str, ports))}"
    raise UsageError(f"{command.name} belongs to a port: name it with --port{which}")


class ManualWrite:
    """One write on its way: `check`, `prepare` if it is dangerous, `send`, `look_at_work`."""

    def __init__(
        self, contact: Contact, command: Command, value: Value, written: WriteResult
    ) -> None:
        self.contact = contact
        self.command = command
        self.value = value
        self.written = written
        self.is_status = command is contact.family.command_of("status")
        # what reads the write back, and where; C reads OMEGA's D back
        self.mirror: tuple[Command, Place] | None = None
        if command.readable:
            self.mirror = command, written.place
        elif isinstance(value, StoredRecord):
            condition = Place(condition=value.condition)
            self.mirror = contact.family.commands["condition"], condition

    async def check(self, *, keeps_suction: bool) -> None:
        """Check the station's own limits and read the value before; the outcome is UNCHANGED if
        there is nothing to write. Raises `StartRefused`.

        `keeps_suction`: an order about heat must not drop the part. Unknown counts as off.
        """
        written = self.written
        await self._expect_within()
        await self._read_before()
        if self.is_status:
            if keeps_suction and isinstance(self.value, tuple):
                status, before = self.contact.family.status, written.before
                is_on = isinstance(before, tuple) and status.sucks(before)
                self.value = written.value = status.with_suction(self.value, on=is_on)
        elif written.before == self.value:
            written.outcome = WriteOutcome.UNCHANGED
            written.readback = written.before

    async def _expect_within(self) -> None:
        """Check the value against the station's own limits."""
        if self.command.within is None or not isinstance(self.value, int | float):
            return
        lowest, highest = self.command.within
        least = None if lowest is None else await self._limit(lowest)
        if least is not None and self.value < least:
            raise self._refusal(self._outside("below the station's minimum", least))
        most = None if highest is None else await self._limit(highest)
        if most is None:
            raise self._refusal(f"the station does not answer its {highest}")
        if self.value > most:
            raise self._refusal(self._outside("above the station's maximum", most))

    def _outside(self, bound: str, limit: float) -> str:
        return f"{self.command.shown(self.value)} is {bound} of {self.command.shown(limit)}"

    def _refusal(self, why: str) -> StartRefused:
        return StartRefused(f"{self.contact.name}: {why}; nothing was written")

    async def _limit(self, name: str) -> float | None:
        """Return the limit that the station reports under this name; None if it has none."""
        command = self.contact.family.commands.get(name)
        if command is None:
            return None
        try:
            limit = await self.contact.read_confirmed(command, WHOLE_STATION)
        except NotSupported:
            return None
        except StationError as error:
            raise self._refusal(f"{name} cannot be read ({sentence(error)})") from error
        return limit if isinstance(limit, int | float) else None

    async def _read_before(self) -> None:
        """Read the value before. An unreadable tool state does not prevent an order, which may stop
        the tool.
        """
        if self.mirror is None:
            return
        try:
            self.written.before = await self.contact.read_confirmed(*self.mirror)
        except StationError as error:
            if not self.is_status:
                name = title(self.command, self.written.place)
                raise self._refusal(f"{name} cannot be read ({sentence(error)})") from error

    async def prepare(self, keep: Keep) -> None:
        """Before a dangerous write: expect cold tools, and keep the settings."""
        if self.command.name in ONLY_COLD:
            await expect_cold(self.contact)
        condition = None  # the number of the solder condition to write or run
        if isinstance(self.value, StoredRecord):
            condition = self.value.condition
        elif isinstance(self.command.quantity, ConditionNumber) and isinstance(self.value, int):
            condition = self.value
        keep(await take_snapshot(self.contact, condition))

    async def send(self) -> None:
        """Write once and prove the result. Does not raise errors of station or link."""
        written = self.written
        written.is_sent = True
        written.outcome = WriteOutcome.UNCONFIRMED
        try:
            await self._send()
        except Refusal as error:
            written.outcome = WriteOutcome.REFUSED
            written.problem = sentence(error) + self._refused_form(error)
        except (StationError, LinkError) as error:
            written.outcome = WriteOutcome.UNCONFIRMED
            written.problem = str(error)

    async def _send(self) -> None:
        contact, command, value, written = self.contact, self.command, self.value, self.written
        client = contact.client
        if command.name == "restart":
            written.seconds = await timing.restart(client, command)
            written.outcome = WriteOutcome.SENT
        elif command.name == "address" and isinstance(client, Station) and isinstance(value, int):
            await timing.change_address(client, command, value or None)
            written.outcome = WriteOutcome.CONFIRMED
        elif command.name in SHOWN_BY:
            await self._send_to_feeder()
        elif self.mirror is not None:
            await self._send_and_read(*self.mirror)
        else:
            await client.write(command, value)
            written.outcome = WriteOutcome.SENT
            if command.name == "factory_reset":
                await self._check_reachable()

    async def _check_reachable(self) -> None:
        """Check that the station answers: a reset may change address, format and Robot mode."""
        try:
            await self.contact.client.read(timing.MODEL)
        except StationError as error:
            self.written.problem = (
                f"the station no longer answers as before ({sentence(error)}); find it with"
                " `jbclog scan`"
            )

    async def _send_and_read(self, mirror: Command, place: Place) -> None:
        """Write and read back; the read-back decides even after a lost acknowledgement."""
        written, family = self.written, self.contact.family
        write = self._single_write(mirror, place, self.value)
        await self._attempt(write)
        if written.readback is None:
            return
        if write.is_confirmed(written.readback, family.status):
            written.outcome = WriteOutcome.CONFIRMED
        else:
            written.outcome = WriteOutcome.MISMATCH
            written.problem = f"{shown(written.readback, self.command, family)} was read back"

    async def _send_to_feeder(self) -> None:
        """Write an order and check the feeder. A feed may end unseen: only a stop must show."""
        written = self.written
        written.at_work = True  # until known otherwise
        expected = SHOWN_BY[self.command.name]
        feeding = self.contact.family.commands[FEEDING]
        attempt = await self._attempt(self._single_write(feeding, WHOLE_STATION, expected))
        if written.readback is None:
            return
        written.at_work = written.readback != FeederState.STOPPED
        if written.readback == expected:
            written.outcome = WriteOutcome.CONFIRMED
        elif attempt.write_error is not None:
            raise attempt.write_error
        elif self.command.effect is Effect.STOPS:
            written.outcome = WriteOutcome.MISMATCH
            written.problem = f"{FEEDING} is {written.readback}"
        else:
            written.outcome = WriteOutcome.SENT

    def _single_write(self, mirror: Command, place: Place, expected: Value) -> SettingWrite:
        """Return the write that `mirror` reads back; one answer is enough if it is the expected
        one.
        """
        contact = self.contact
        return SettingWrite(
            contact.client,
            self.command,
            self.written.place,
            self.value,
            lambda: contact.read_confirmed(mirror, place, known=expected),
        )

    async def _attempt(self, write: SettingWrite) -> Attempt:
        """Write once and read back; the outcome stays UNCONFIRMED if that fails. Raises a refusal
        of the write.
        """
        attempt = await write.attempt()
        if attempt.is_refused and attempt.write_error is not None:
            raise attempt.write_error
        self.written.readback = attempt.readback
        if attempt.read_error is not None:
            self.written.problem = str(attempt.read_error)
        return attempt

    def _refused_form(self, error: Refusal) -> str:
        """Explain why an order refused for its form is not tried in another form
        (docs/reference/contradictions.md, B-37).
        """
        if error.code != BADLY_FORMED or not (is_order(self.command) and self.command.sent_once):
            return ""
        return (
            "; it was not done. The manuals print no data for this order, and an order that acts or"
            " erases is not tried in a second form: give it at the station"
        )

    async def look_at_work(self) -> None:
        """Determine whether a tool is at work after an order to it, or after selecting another
        temperature for it.
        """
        written, family = self.written, self.contact.family
        is_refused = written.outcome == WriteOutcome.REFUSED
        word: Value | None
        if self.is_status:
            word = written.before if is_refused else written.readback
        elif self.command is family.command_of("setpoint_c") and not is_refused:
            word = await self._status_now()
            if word is None:
                return
        else:
            return
        # unknown counts as at work
        written.at_work = not isinstance(word, tuple) or family.status.is_working(word)
        written.is_empty = written.at_work and await self._is_empty()

    async def _is_empty(self) -> bool:
        """Return True if the station reports no tool in the port."""
        port = self.written.place.port
        if port is None or self.contact.family.command_of("tool") is None:
            return False
        try:
            return self.contact.family.is_empty(await find_tool(self.contact, port), None)
        except (StationError, LinkError):
            return False

    async def _status_now(self) -> Value | None:
        """Return the state of the tool in the port; None if unknown."""
        status = self.contact.family.command_of("status")
        if status is None:
            return None
        try:
            return await self.contact.read(status, Place(self.written.place.port))
        except (StationError, LinkError):
            return None


def is_order_to_rest(contact: Contact, written: WriteResult) -> bool:
    """Return True if it orders a safe state or stops a motor, so that its failure must be
    reported.
    """
    command = written.command
    if command is None:
        return False
    if command is contact.family.command_of("status"):
        status = contact.family.status
        plain = (
            status.with_suction(written.value, on=False)
            if isinstance(written.value, tuple)
            else None
        )
        return plain in [status.orders[name] for name in contact.family.safe_states]
    return command.effect is Effect.STOPS
