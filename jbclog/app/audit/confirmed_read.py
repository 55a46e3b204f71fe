"""What an audit believes: two of at most three answers that are the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from jbclog.core.errors import LinkError, RobotModeOff, StationError, StationSilent
from jbclog.core.io_requests import Steps
from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command
from jbclog.session.manual.contact import NOWHERE, Contact, Place

MOST_READS: Final = 3
NO_TIME: Final = "no time left for it"


@dataclass(frozen=True, slots=True)
class Answer:
    """What was said, and what of it is believed. Without a value and without `why`, no two answers were the same."""

    given: tuple[Value, ...] = ()
    value: Value | None = None
    why: str = ""


@dataclass(slots=True)
class Asking:
    """One station being asked until `until` (monotonic seconds). `over` says why nothing more can be had of it."""

    contact: Contact
    until: float
    over: str = ""
    over_reason: str = ""

    def twice(self, command: Command, place: Place = NOWHERE) -> Steps[Answer]:
        """Ask until two answers are the same. Never raises for what the station or its cable does."""
        given: list[Value] = []
        try:
            while len(given) < MOST_READS and not self._is_over():
                given.append((yield from self.contact.read(command, place)))
                if given[-1] in given[:-1]:
                    return Answer(tuple(given), given[-1])
        except (StationSilent, RobotModeOff, LinkError) as error:
            self.over, self.over_reason = str(error), error.reason
        except StationError as error:
            return Answer(tuple(given), None, error.reason)
        return Answer(tuple(given), None, self.over_reason)

    def _is_over(self) -> bool:
        if not self.over and self.contact.client.now > self.until:
            self.over = self.over_reason = NO_TIME
        return bool(self.over)
