"""What a session wants of whoever speaks to its station, whatever the protocol."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Protocol

from jbclog.core.io_requests import Heard, Steps
from jbclog.core.quantities import Value
from jbclog.protocol.client.anomalies import Anomalies
from jbclog.protocol.client.flow import Flow
from jbclog.protocol.commands.command import Command

Permit = Callable[[Command, Value, int | None, int | None], None]
"""Asked before each write with its command, value, port and tool; raises `WriteForbidden`, and then nothing is sent."""


def anything(_command: Command, _value: Value, _port: int | None, _tool: int | None) -> None:
    """Permits every write: a person who types one has said what is meant."""


class Asking(Protocol):
    """A read made once and asked often. Who made it knows its bytes; others its name and how long it takes."""

    @property
    def command(self) -> Command: ...

    @property
    def wire_s(self) -> float: ...

    def title(self) -> str:
        """How messages name it: ``tip temperature of port 1``."""


class Client(Protocol):
    """One client of one station, as generators that do no I/O (`core.io_requests`).

    Times are monotonic seconds. `sent` and `heard` are the moments at which the last question left and its answer was
    whole; `now` is the last moment that anything was heard of, or not. `first_sent` is the first question sent since
    somebody set it to None. `data` is the data field of the last answer that carried one, as it came. `strays` counts by
    kind what was on the line and answered nothing, `anomalies` what was taken although it is not as recommended.
    `permit` is asked before each write. `flow` is what came over the link against what was due: reads raise `LinkFlooded`.
    """

    permit: Permit

    now: float
    sent: float
    heard: float
    first_sent: float | None
    exchanges: int
    data: str
    strays: Counter[str]
    anomalies: Anomalies
    flow: Flow

    @property
    def garbage_bytes(self) -> int:
        """Bytes that belonged to no frame."""

    def question(self, command: Command, port: int | None = None, tool: int | None = None) -> Asking:
        """The read of `command`, made once and kept."""

    def read(self, command: Command, port: int | None = None, tool: int | None = None) -> Steps[Value]:
        """Read a value. Raises `StationError` when no try gave one; `StationSilent` when nothing answers any more."""

    def ask(self, question: Asking) -> Steps[Value]:
        """The same with a question that this client made before."""

    def write(
        self,
        command: Command,
        value: Value,
        port: int | None = None,
        tool: int | None = None,
        *,
        hurry: bool = False,
        once: bool = False,
    ) -> Steps[None]:
        """Write a value. An acknowledgement is not proof: read back. In a `hurry` it is waited for as a read's answer is.

        A setting that the station did not understand was not done and is sent again, unless it is to go out `once`, whatever
        the station says. Raises what `permit` raises; then nothing is sent.
        """

    def unasked(self, heard: Heard) -> None:
        """Take note of the moment, and of bytes that came although nothing was asked."""
