"""The interface between a virtual station's device and its plant.

A plant is what there is without a link: heater, sensors, control, and the settings in force. A
device (`device.py`, `omega.py`) speaks the protocol: it looks a request up in the family's command
table, and asks its plant for the value or gives it the one written. `soldering.py`, `hotair.py` and
`omega.py` have the plants.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Protocol

from jbclog.config.sim_spec import FaultSpec
from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import FAMILIES, Family


class Plant(Protocol):
    """The physics of one kind of station, for the device. Times are monotonic seconds; `port` is 0
    for the station itself.
    """

    @property
    def ports(self) -> Collection[int]:
        """The existing ports."""

    def advance_to(self, moment: float) -> None:
        """Simulate until `moment`."""

    def value_of(self, asked: TableRequest, now: float) -> Value:
        """Return the value of an answer to `asked`; OFF is sent as 99999."""

    def allowed(self, command: Command, value: Value) -> bool:
        """Return True if the station accepts this value of a well-formed write."""

    def apply(self, asked: TableRequest, value: Value, now: float) -> None:
        """Apply an accepted write."""

    def restart(self, now: float) -> None:
        """Lose volatile values, as after a power cycle."""

    def keep(self) -> None:
        """Store the present settings, so that a restart keeps them."""

    def strike(self, fault: FaultSpec, port: int, *, begins: bool) -> None:
        """Begin or end a fault of the physics on `port`."""


@dataclass(frozen=True, slots=True)
class TableRequest:
    """A request of the table; `port`, `tool` and `condition` (OMEGA) are 0 if it has none."""

    command: Command
    code: str
    port: int = 0
    tool: int = 0
    condition: int = 0


@cache
def questions(family: str, ports: tuple[int, ...]) -> Mapping[str, TableRequest]:
    """Return all requests by header and code (``RTT1``, ``WA12``) of a `family` with `ports`."""
    return MappingProxyType(dict(_all(FAMILIES[family], ports)))


def _all(family: Family, ports: tuple[int, ...]) -> Iterator[tuple[str, TableRequest]]:
    tools = [tool for tool in family.tools if tool]
    for command in family.commands.values():
        for asked in _places(command, ports, tools):
            for header in command.access.upper():
                yield header + asked.code, asked


def _places(command: Command, ports: tuple[int, ...], tools: list[int]) -> Iterator[TableRequest]:
    if command.scope is Scope.STATION:
        yield TableRequest(command, command.code())
        return
    for port in ports:
        if command.scope is Scope.PORT:
            yield TableRequest(command, command.code(port), port)
        else:
            yield from (
                TableRequest(command, command.code(port, tool), port, tool) for tool in tools
            )


COUNTER_ROOM = 100_000  # counters have five digits and roll over; no manual says so


def setting(holder: object, name: str) -> Value:
    """Return the setting `name`; the class has slots, so an unknown name raises."""
    value: Value = getattr(holder, name)
    return value


def set_value(holder: object, name: str, value: Value) -> None:
    """Set the setting `name`; the class has slots, so an unknown name raises."""
    setattr(holder, name, value)
