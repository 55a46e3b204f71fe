"""Send one harmless request on a link whose station is unknown."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import TypeVar

from jbclog.core.errors import LinkFlooded
from jbclog.core.io_requests import IoResult, ask, listen
from jbclog.protocol import frame, omega
from jbclog.protocol.client.interface import MOST_TIMES, SECOND
from jbclog.protocol.commands.command import Command, Effect, Scope
from jbclog.protocol.commands.family import FAMILIES, OMEGA, ROBOT
from jbclog.protocol.commands.robot import COMMON
from jbclog.protocol.frame import Frame, FrameReader
from jbclog.protocol.omega import OmegaReader, encode

PORTS = (1, 2, 3, 4)


def is_harmless(data: bytes) -> bool:
    """Return True if `data` is exactly one read without side effect, so not R-TA, which clears."""
    return question_text(data) is not None


def question_text(data: bytes) -> str | None:
    """Describe a harmless request for people: ``model, to address 01``; None for any other data."""
    if frame.only_reads(data):
        (asked,) = FrameReader().feed(data)
        assert isinstance(asked, Frame)
        name = _names(ROBOT).get(asked.text)
        to = "without addresses" if asked.target is None else f"to address {asked.target:02d}"
        return name and f"{name}, {to}"
    return _names(OMEGA).get(data[1:-3].decode("ascii")) if omega.only_reads(data) else None


@cache
def _names(protocol: str) -> Mapping[str, str]:
    """Return a protocol's harmless requests: the characters after the header, and their names."""
    tables = (
        family.commands.values() for family in FAMILIES.values() if family.protocol == protocol
    )
    return MappingProxyType(
        {code: name for table in tables for command in table for code, name in _questions(command)}
    )


def _questions(command: Command) -> Iterator[tuple[str, str]]:
    name = command.name.replace("_", " ")
    if not command.readable or command.effect is not Effect.NONE:
        return
    if command.scope is Scope.STATION:
        yield command.code(), name
    elif command.scope is Scope.PORT:
        yield from ((command.code(port), f"{name} of port {port}") for port in PORTS)


T = TypeVar("T")

MOST_KEPT = 256  # bytes
MEASURES = 3
# bytes a second; ten times that exceeds a link at 19200, where noise may have another cause
USUAL_ANSWERS = 200
HOST = 0
MODEL = next(command for command in COMMON if command.name == "model")
OMEGA_QUESTION = encode("A")  # 003, 11.3.1
# 003, 11.3.1 prints a without its digit
OMEGA_ANSWERS = frozenset(("a", *(f"a{state}" for state in "0123")))

# of JBC's binary protocol: a frame begins with DLE STX, a refusal is NAK
DLE, NAK, STX = b"\x10", b"\x15", b"\x02"


def model_question(address: int | None) -> bytes:
    """Return R-SMN, which every JBC station answers, to `address` or without addresses."""
    target = (None, None) if address is None else (HOST, address)
    return Frame("R", MODEL.letters, *target).encode()


@dataclass(frozen=True, slots=True)
class Received:
    """Bytes that arrived after a request, or without one. `rest` excludes the request's own
    echo.
    """

    rest: bytes
    echoed: bool = False


class Probe:
    """Collects what arrives. `now` is the time of the last result, in monotonic seconds.

    If more arrives at once than an answer has, it listens for a second, up to `MEASURES` times, and
    sets `flood` if it continues.
    """

    def __init__(self) -> None:
        self.now = 0.0
        self.flood: LinkFlooded | None = None
        self._measures_left = MEASURES

    async def ask(
        self, question: bytes, patience_s: float, answer_in: Callable[[bytes], object | None]
    ) -> Received:
        """Send `question` and collect until `answer_in` finds an answer, or for `patience_s`."""
        heard = await ask(question, patience_s)
        until = heard.sent + patience_s
        return await self._collect(heard, until, question, answer_in)

    async def listen(self, seconds: float) -> Received:
        """Collect bytes without a request."""
        until = self.now + seconds
        heard = await listen(until)
        return await self._collect(heard, until, b"", lambda _: None)

    async def _collect(
        self,
        heard: IoResult,
        until: float,
        question: bytes,
        answer_in: Callable[[bytes], object | None],
    ) -> Received:
        data = heard.data
        while heard.data and len(data) < MOST_KEPT and answer_in(_without(question, data)) is None:
            heard = await listen(until)
            data += heard.data
        self.now = heard.now
        if len(data) >= MOST_KEPT and self._measures_left and self.flood is None:
            await self._measure(heard.now)
        return Received(_without(question, data)[:MOST_KEPT], bool(question) and question in data)

    async def _measure(self, began: float) -> None:
        """Count the bytes of one second without requests."""
        self._measures_left -= 1
        came = 0
        while self.now < began + SECOND:
            heard = await listen(began + SECOND)
            self.now, came = heard.now, came + len(heard.data)
        limit = MOST_TIMES * USUAL_ANSWERS
        if came > limit:
            self.flood = LinkFlooded(came, USUAL_ANSWERS, self.now - began, limit)


def _without(question: bytes, data: bytes) -> bytes:
    return data.replace(question, b"", 1) if question else data


def robot_answer(data: bytes) -> Frame | None:
    """Return the first answer or refusal in `data` that fits R-SMN."""
    frames = (found for found in FrameReader().feed(data) if isinstance(found, Frame))
    return next((frame for frame in frames if _is_answer(frame)), None)


def _is_answer(frame: Frame) -> bool:
    if frame.header == "N":
        return frame.text[-5:].isdigit()
    return (
        frame.header == "A"
        and frame.text.startswith(MODEL.letters)
        and len(frame.text) > len(MODEL.letters)
    )


def omega_answer(data: bytes) -> str | None:
    """Return the answer of an OMEGA to its information request in `data`."""
    return next((text for text in OmegaReader().feed(data) if text in OMEGA_ANSWERS), None)


def is_binary(data: bytes) -> bool:
    """Return True for the binary protocol: frames after DLE, or repeated NAK."""
    return DLE + STX in data or (bool(data) and not data.strip(NAK + DLE))
