"""Write a setting once and read it back. A run and `jbclog write` prove a setting this way.

1. A refusal is final: nothing is read back. If the caller repeats writes, N 1 and N 2 (the station
   did not understand the write) are no refusal.
2. Otherwise only the value read back decides, also after a lost acknowledgement: a station may
   execute a write without acknowledging it, and acknowledge one that it does not execute.
3. A tool's state is confirmed by one that follows from it: stand may have become sleep, and hot air
   may have cooled down.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from jbclog.core.errors import NotReceived, Refusal, StationError
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value
from jbclog.protocol.client.interface import Client
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.status import StatusTable


class Place(NamedTuple):
    """Where a command goes; all None is the whole station. `condition` is the number of an OMEGA
    solder condition.
    """

    port: int | None = None
    tool: int | None = None
    condition: int | None = None

    def __str__(self) -> str:
        """Format: ``port 1, tool 2``; empty for the whole station."""
        return ", ".join(
            f"{name} {number}" for name, number in self._asdict().items() if number is not None
        )


WHOLE_STATION = Place()


@dataclass(slots=True)
class Attempt:
    """One write and its read-back. `readback` None: unknown, because of the refusal or of
    `read_error`. `write_error`: what came instead of an acknowledgement.
    """

    is_refused: bool = False
    readback: Value | None = None
    write_error: StationError | None = None
    read_error: StationError | None = None

    @property
    def nak(self) -> int | None:
        """Communication error with which the station refused or did not understand the write."""
        error = self.write_error
        return error.code if isinstance(error, Refusal) else None


@dataclass(frozen=True, slots=True)
class SettingWrite:
    """A value for one place of a station; `read_back` reads that place by confirmed answers.

    `repeats`: the caller repeats what the station did not understand, so the client does not.
    """

    client: Client
    command: Command
    place: Place
    value: Value
    read_back: Callable[[], Steps[Value]]
    repeats: bool = False

    async def attempt(self) -> Attempt:
        """Write once and read back. Raises `LinkError`; errors of the station are in the result."""
        attempt = Attempt()
        port, tool, _ = self.place
        try:
            await self.client.write(self.command, self.value, port, tool, once=self.repeats)
        except StationError as error:
            attempt.write_error = error
            attempt.is_refused = self._is_refusal(error)
            if attempt.is_refused:
                return attempt
        try:
            attempt.readback = await self.read_back()
        except StationError as error:
            attempt.read_error = error
        return attempt

    def _is_refusal(self, error: StationError) -> bool:
        if self.repeats and isinstance(error, NotReceived):
            return False
        return isinstance(error, Refusal)

    def is_confirmed(
        self, readback: Value, status: StatusTable, *, is_suction_free: bool = False
    ) -> bool:
        """Return True if `readback` confirms the value; `status` has the family's status words.
        `is_suction_free`: anybody may switch suction.
        """
        value = self.value
        if self.command.name != "status" or not (
            isinstance(readback, tuple) and isinstance(value, tuple)
        ):
            return readback == value
        is_suction_right = is_suction_free or status.sucks(readback) == status.sucks(value)
        return status.confirms(readback, value) and is_suction_right
