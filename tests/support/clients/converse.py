"""One virtual station of a family and the client that a run would use, on a clock that jumps.

``Pair("dde").read(TIP, 1)``: nothing in between but bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from support.clients.talk import in_turn
from support.product import (
    FAMILIES,
    Client,
    Command,
    Scope,
    Steps,
    Value,
    VirtualClock,
    client_for,
    parse_line,
    virtual_station,
)

T = TypeVar("T")
Place = tuple[Command, int | None, int | None]
LINE = (
    '[line]\nname = "test"\n[[station]]\nname = "it"\nurl = "it"\nfamily ='
    ' "{family}"\n{keys}\n[station.sim]\n{sim}\n'
)
# as many as any station has, where the manual does not say how many
IF_UNPRINTED = "ports = [1, 2, 3, 4]"


class Pair:
    """A virtual station that has just been switched on, and its client."""

    def __init__(self, family: str, keys: str = "", sim: str = "") -> None:
        keys = keys or (IF_UNPRINTED if FAMILIES[family].ports is None else "")
        spec = parse_line(
            LINE.format(family=family, keys=keys, sim=sim), Path("line.toml")
        ).stations[0]
        self.family = FAMILIES[family]
        self.clock = VirtualClock()
        self.station = virtual_station(spec, now=self.clock.monotonic())
        self.ports = spec.ports or self.family.ports or ()
        self.client = client_for(self.family, spec.line_format, spec.address)

    def do(self, ask: Callable[[Client], Steps[T]]) -> T:
        """Do it and give what came out; what it raises comes out too."""
        return in_turn(self.client, self.station, self.clock, [ask])[0]

    def read(self, command: Command, port: int | None = None, tool: int | None = None) -> Value:
        return self.do(lambda client: client.read(command, port, tool))

    def write(
        self, command: Command, value: Value, port: int | None = None, tool: int | None = None
    ) -> None:
        self.do(lambda client: client.write(command, value, port, tool))

    def places(self, command: Command) -> Iterator[Place]:
        """Everywhere that the station has this command: with port and tool, as far as its code has
        them.
        """
        match command.scope:
            case Scope.STATION:
                yield command, None, None
            case Scope.CONDITION:
                yield from ((command.numbered(number), None, None) for number in (101, 201))
            case Scope.PORT:
                yield from ((command, port, None) for port in self.ports)
            case Scope.TOOL:
                yield from (
                    (command, port, tool)
                    for port in self.ports
                    for tool in self.family.tools
                    if tool
                )
