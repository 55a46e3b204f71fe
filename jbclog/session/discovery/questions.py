"""Which bytes are harmless questions, by name: what a scan may send, and how it says what it sent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from types import MappingProxyType

from jbclog.protocol import frame, omega
from jbclog.protocol.commands.command import Command, Effect, Scope
from jbclog.protocol.commands.family import FAMILIES, OMEGA, ROBOT
from jbclog.protocol.frame import Frame
from jbclog.protocol.reader import FrameReader

PORTS = (1, 2, 3, 4)


def is_harmless(data: bytes) -> bool:
    """Whether `data` is one whole question that changes nothing; R-TA, which clears, is none."""
    return question_text(data) is not None


def question_text(data: bytes) -> str | None:
    """What a harmless question asks, for people: ``model, to address 01``; None where it is none."""
    if frame.only_reads(data):
        (asked,) = FrameReader().feed(data)
        assert isinstance(asked, Frame)
        name = _names(ROBOT).get(asked.text)
        return name and f"{name}, {'without addresses' if asked.target is None else f'to address {asked.target:02d}'}"
    return _names(OMEGA).get(data[1:-3].decode("ascii")) if omega.only_reads(data) else None


@cache
def _names(protocol: str) -> Mapping[str, str]:
    """All harmless questions of a protocol: the characters behind the header, and what they ask for."""
    tables = (family.commands.values() for family in FAMILIES.values() if family.protocol == protocol)
    return MappingProxyType({code: name for table in tables for command in table for code, name in _questions(command)})


def _questions(command: Command) -> Iterator[tuple[str, str]]:
    name = command.name.replace("_", " ")
    if not command.readable or command.effect is not Effect.NONE:
        return
    if command.scope is Scope.STATION:
        yield command.code(), name
    elif command.scope is Scope.PORT:
        yield from ((command.code(port), f"{name} of port {port}") for port in PORTS)
