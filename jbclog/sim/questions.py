"""The command tables served backwards: which characters behind the header ask for what."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import FAMILIES, Family


@dataclass(frozen=True, slots=True)
class Asked:
    """One question of the table: `code` is the control command on the wire, `port` and `tool` are 0 where it has none."""

    command: Command
    code: str
    port: int = 0
    tool: int = 0


@cache
def questions(family: str, ports: tuple[int, ...]) -> Mapping[str, Asked]:
    """All questions by header and code (``RTT1``, ``WA12``) that a station of `family` with these ports knows."""
    return MappingProxyType(dict(_all(FAMILIES[family], ports)))


def _all(family: Family, ports: tuple[int, ...]) -> Iterator[tuple[str, Asked]]:
    tools = [tool for tool in family.tools if tool]
    for command in family.commands.values():
        for asked in _places(command, ports, tools):
            for header in command.access.upper():
                yield header + asked.code, asked


def _places(command: Command, ports: tuple[int, ...], tools: list[int]) -> Iterator[Asked]:
    if command.scope is Scope.STATION:
        yield Asked(command, command.code())
        return
    for port in ports:
        if command.scope is Scope.PORT:
            yield Asked(command, command.code(port), port)
        else:
            yield from (Asked(command, command.code(port, tool), port, tool) for tool in tools)
