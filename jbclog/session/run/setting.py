"""Write one setting on one station until it is read back.

A setting is idempotent, so a failed write is repeated, `REPEATS` times at most:

1. A refusal is final, unless the write was not understood (N 1, N 2).
2. It is repeated if two answers have the value from before. A third value is a mismatch.
3. If it cannot be read back, it is repeated once the link has answered another request; a setting
   that can heat (`config.recipe.CAN_HEAT`) never is without those two answers.
4. Nothing is repeated once the run is ending: `RunEnded` passes through here.

Each repeated write is a row of `settings` (``repeated``), an event and a count in the station's
facts. `session/setting_write.py` has the single write.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NoReturn

from jbclog.config.recipe import CAN_HEAT
from jbclog.core.errors import LinkError, NotReceived, Refusal, StartRefused, StationError
from jbclog.core.io_requests import RunEnded, wait
from jbclog.core.quantities import Value, text_of
from jbclog.core.rows import SettingOutcome, SettingRow, Severity
from jbclog.core.text import count_text
from jbclog.protocol.client.confirmed_reads import SETTLE_S
from jbclog.protocol.commands.command import Command, Scope
from jbclog.session.run.context import SessionContext
from jbclog.session.run.identify import StationAbsent
from jbclog.session.run.state import PortState
from jbclog.session.setting_write import WHOLE_STATION, Attempt, Place, SettingWrite

ROBOT_MODE_OFF: Final = (
    ", Robot mode is off, although it answers reads; switch it on in the station's menu"
)
ROBOT_MODE_NAK: Final = 5
REPEATS: Final = 3
MOST_WRITES: Final = 1 + REPEATS


@dataclass(frozen=True, slots=True)
class SettingTarget:
    """A setting of a port, of the tool in it, or of the whole station (`port` None)."""

    context: SessionContext
    command: Command
    port: PortState | None

    @property
    def held(self) -> dict[str, Value]:
        """Values last read or confirmed at this port or station, by command name."""
        return self.context.state.held if self.port is None else self.port.held

    @property
    def value(self) -> Value | None:
        """Value last read or confirmed; None if unknown."""
        return self.held.get(self.command.name)

    @property
    def number(self) -> int | None:
        """Number of the port."""
        return None if self.port is None else self.port.number

    @property
    def place(self) -> Place:
        """Port and tool for the command's code."""
        if self.port is None or self.command.scope is Scope.STATION:
            return WHOLE_STATION
        if self.command.scope is Scope.TOOL:
            return Place(self.port.number, self.port.tool)
        return Place(self.port.number)

    @property
    def title(self) -> str:
        """Format: ``sleep delay of port 1``."""
        name = self.command.name.replace("_", " ")
        return name if self.port is None else f"{name} of port {self.port.number}"

    async def read(self, known: Value | None = None) -> Value:
        """Read until two answers are equal; one is enough if it equals `known`."""
        port, tool, _ = self.place
        return await self.context.reads.confirmed(self.command, port, tool, known=known)

    def record(
        self,
        outcome: SettingOutcome,
        *,
        requested: Value | None = None,
        written: Value | None = None,
        readback: Value | None = None,
        nak: int | None = None,
    ) -> None:
        """Add a row to `settings`."""
        log = self.context.log
        tool_name = None
        if self.port is not None and self.command.scope is Scope.TOOL:
            tool_name = self.context.state.tool_text(self.port.tool)
        row = SettingRow(
            time=log.utc.micros(log.now),
            station=self.context.name,
            port=self.number,
            tool_name=tool_name,
            setting=self.command.name,
            uom=self.command.unit,
            requested=None if requested is None else text_of(requested),
            written=None if written is None else text_of(written),
            readback=None if readback is None else text_of(readback),
            nak=nak,
            outcome=outcome,
        )
        log.journal.setting(row)

    def touch(self) -> None:
        """Register that this run may change the port or the feeder, which is then made safe at the
        end.
        """
        state = self.context.state
        if self.port is None:
            is_registered = state.feeder_touched
            state.feeder_touched = True
        else:
            is_registered = self.port.number in state.facts.touched
            self.port.touched = True
        if not is_registered:
            self.context.publish()  # guard and recovery must know hot tools before they are hot


class RepeatedWrite:
    """A setting on its way to the station, by the rules above."""

    def __init__(self, target: SettingTarget, value: Value) -> None:
        self.target = target
        self.value = value
        self.previous = target.value
        self.write = SettingWrite(
            target.context.station, target.command, target.place, value, target.read, repeats=True
        )

    async def run(self) -> None:
        """Write until the value is read back. Raises `StartRefused` if it is not, `StationAbsent`
        if the link breaks.

        After an exception the write may or may not have been executed.
        """
        if self.previous is not None:
            # the only record of the previous value
            self.target.record(SettingOutcome.READ, readback=self.previous)
        self.target.touch()
        try:
            await self._repeat()
        except RunEnded:
            self._record(SettingOutcome.UNCONFIRMED, Attempt())
            raise
        except LinkError as error:
            self._record(SettingOutcome.UNCONFIRMED, Attempt())
            raise StationAbsent(self._failure(f"it could not be read back ({error})")) from error

    async def _repeat(self) -> None:
        for number in range(1, MOST_WRITES + 1):
            attempt = await self.write.attempt()
            if self._is_confirmed(attempt):
                self._confirm(attempt)
                return
            if number == MOST_WRITES or not await self._may_repeat(attempt):
                self._refuse(attempt, number)
            self._record(SettingOutcome.REPEATED, attempt)
            self._report_repeat(attempt, number)

    def _is_confirmed(self, attempt: Attempt) -> bool:
        context = self.target.context
        # a recipe that keeps suction does not set it: anybody may switch it
        is_suction_free = context.order.recipe.suction == "keep"
        return attempt.readback is not None and self.write.is_confirmed(
            attempt.readback, context.state.family.status, is_suction_free=is_suction_free
        )

    async def _may_repeat(self, attempt: Attempt) -> bool:
        """Return True if the link has settled and the previous value is still in force; for a
        setting that cannot heat, if it may be.
        """
        if attempt.is_refused:
            return False
        context = self.target.context
        if attempt.readback is not None:
            if attempt.readback != self.previous:
                return False
            context.station.unasked(await wait(context.now + SETTLE_S))
            return True
        if self.target.command.name in CAN_HEAT or _is_meant(attempt.read_error):
            return False
        try:
            await context.reads.confirmed(context.command("model"), known=context.state.facts.model)
        except StationError:
            return False
        return True

    def _confirm(self, attempt: Attempt) -> None:
        command = self.target.command
        self.target.context.state.written.append(
            f"{self.target.title} {command.shown(self.value)} (was {self._previous_text()})"
        )
        self._record(SettingOutcome.CONFIRMED, attempt)
        self._keep(attempt)

    def _refuse(self, attempt: Attempt, number: int) -> NoReturn:
        """Raise `StartRefused` with the reason and the number of writes."""
        if attempt.nak is not None and attempt.readback in (None, self.previous):
            outcome = SettingOutcome.REFUSED
            why = f"the station refused it with N {attempt.nak:05d}"
            if attempt.nak == ROBOT_MODE_NAK:
                why += ROBOT_MODE_OFF
            attempt.readback = None
        elif attempt.readback is None:
            outcome = SettingOutcome.UNCONFIRMED
            why = f"it could not be read back ({attempt.read_error})"
        else:
            outcome = SettingOutcome.MISMATCH
            why = f"{self.target.command.shown(attempt.readback)} was read back"
        self._record(outcome, attempt)
        self._keep(attempt)
        if not attempt.is_refused:
            why += f", in {count_text(number, 'write')}"
        raise StartRefused(self._failure(why)) from (attempt.read_error or attempt.write_error)

    def _report_repeat(self, attempt: Attempt, number: int) -> None:
        target, command = self.target, self.target.command
        target.context.state.facts.settings_repeated += 1
        lost = "acknowledged" if attempt.write_error is None else str(attempt.write_error)
        stands = "it could not be read back"
        if attempt.readback is not None:
            stands = f"{command.shown(attempt.readback)} is still set"
        target.context.log.note(
            "setting.repeated",
            Severity.WARNING,
            f"{target.title[:1].upper()}{target.title[1:]}: {command.shown(self.value)} did not"
            f" take effect ({lost}; {stands}). It is written again (write {number + 1} of at most"
            f" {MOST_WRITES}).",
            port=target.number,
            value=number + 1,
        )

    def _record(self, outcome: SettingOutcome, attempt: Attempt) -> None:
        is_refused = outcome in (SettingOutcome.REFUSED, SettingOutcome.REPEATED)
        self.target.record(
            outcome,
            requested=self.value,
            written=self.value,
            readback=attempt.readback,
            nak=attempt.nak if is_refused else None,
        )

    def _keep(self, attempt: Attempt) -> None:
        if attempt.readback is not None:
            self.target.held[self.target.command.name] = attempt.readback

    def _failure(self, why: str) -> str:
        command = self.target.command
        return (
            f"{self.target.context.name}: {self.target.title}: requested"
            f" {command.shown(self.value)}, but {why}; previous value: {self._previous_text()}"
        )

    def _previous_text(self) -> str:
        return "unknown" if self.previous is None else self.target.command.shown(self.previous)


def _is_meant(error: StationError | None) -> bool:
    return isinstance(error, Refusal) and not isinstance(error, NotReceived)
