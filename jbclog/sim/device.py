"""A virtual station as seen on the serial link, and its log.

Where the manuals are silent: W-RST is acknowledged, then nothing is answered for `BOOT_S` (B-40); a
delay that does not run reads 99999 (B-25), and so does an alarm limit that is not set (B-23); a
request for a missing port or tool is refused like an unknown command; N repeats the code, if there
was one (B-11). `quirks.py` has the alternatives.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import NamedTuple

from jbclog.core.quantities import OFF, OFF_ON_WIRE, AlarmDelay, Value
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import Family
from jbclog.sim.plant import Plant, TableRequest, questions
from jbclog.sim.quirks import Quirks


class AcceptedWrite(NamedTuple):
    """An accepted write; `at` in monotonic seconds, `port` and `tool` 0 if it has none."""

    at: float
    name: str
    port: int
    tool: int
    value: Value


class RefusedRequest(NamedTuple):
    """A request refused with communication error `code`."""

    at: float
    text: str
    code: int


class FaultyAnswer(NamedTuple):
    """An answer changed by a fault: before and after."""

    at: float
    kind: str
    clean: bytes
    sent: bytes


@dataclass(slots=True)
class StationLog:
    """Requests and answers of a station, in order, for tests. `reads` counts those answered."""

    reads: int = 0
    writes: list[AcceptedWrite] = field(default_factory=list)
    refused: list[RefusedRequest] = field(default_factory=list)
    struck: list[FaultyAnswer] = field(default_factory=list)

    def written(self, name: str) -> list[AcceptedWrite]:
        """Return the accepted writes of one command."""
        return [write for write in self.writes if write.name == name]


WITHOUT_DATA = ("start_feeding", "stop_feeding", "restart", "factory_reset", "ignore_fuse_error")
"""Orders whose data no manual prints: accepted with 00000 and without any (B-37)."""

WRONG_CHECK, WRONG_FORMAT, OUT_OF_RANGE, UNKNOWN_COMMAND, ROBOT_OFF = 1, 2, 3, 4, 5
BOOT_S = 3.0

Answer = tuple[str, str]
"""Header and text of an answer."""


@dataclass(slots=True)
class Identity:
    model: str
    software: str
    address: int | None
    robot_mode: bool = True


_NUMBER = re.compile(r"-?\d+", re.ASCII)
_DELAY = re.compile(r"\d\d\.\d\d|99999", re.ASCII)


def well_formed(command: Command, data: str) -> bool:
    """Return True if `data` has the form of this command's data, whatever the value."""
    form = _DELAY if isinstance(command.quantity, AlarmDelay) else _NUMBER
    return len(data) == 5 and form.fullmatch(data) is not None


class Device:
    """A station's electronics in front of its plant, `face`. Each protocol has its own."""

    def __init__(self, face: Plant) -> None:
        self.face = face
        self.log = StationLog()
        self._silent_until = float("-inf")

    def hears(self, now: float) -> bool:
        """Return True unless it is restarting and receives nothing."""
        return now >= self._silent_until

    def restart(self, now: float, silent_s: float = BOOT_S) -> None:
        """Restart: volatile values are lost, and there is no answer for `silent_s`."""
        self.face.restart(now)
        self._silent_until = now + silent_s


class RobotDevice(Device):
    """A station with JBC's protocol: takes and returns headers and texts, without addresses and
    check bytes.
    """

    def __init__(
        self, family: Family, face: Plant, identity: Identity, quirks: Quirks | None = None
    ) -> None:
        super().__init__(face)
        self.family = family
        self.quirks = quirks or Quirks()
        self.identity = identity
        self._questions = questions(family.name, tuple(face.ports))

    def asked(self, header: str, text: str) -> TableRequest | None:
        """Look up a request; None if the table does not have it."""
        return self._questions.get(header + (text if header == "R" else text[:3]))

    def answer(self, header: str, text: str, now: float) -> Answer | None:
        """Answer a request with a correct check byte; None is silence."""
        if not self.identity.robot_mode:
            return self.refuse(text, ROBOT_OFF, now)
        heard = self.quirks.hear(header + text)
        if isinstance(heard, int):
            return self.refuse(text, heard, now)
        header, text = heard[:1], heard[1:]
        asked = self.asked(header, text)
        if asked is None:
            return self.refuse(text, self._why_unknown(header, text), now)
        answer = self._read(asked, now) if header == "R" else self._write(asked, text[3:], now)
        if answer[0] == "N":
            return answer
        answer_text = self.quirks.say(asked, text, answer[1])
        return None if answer_text is None else ("A", answer_text)

    def refuse(self, text: str, code: int, now: float) -> Answer:
        """Refuse with N and communication error `code`."""
        self.log.refused.append(RefusedRequest(now, text, code))
        return "N", self.quirks.refusal(f"{text[:3]}{code:05d}")

    def _why_unknown(self, header: str, text: str) -> int:
        read_with_data = header == "R" and "R" + text[:3] in self._questions
        return WRONG_FORMAT if read_with_data or header not in ("R", "W") else UNKNOWN_COMMAND

    def _read(self, asked: TableRequest, now: float) -> Answer:
        match asked.command.name:
            case "model":
                value: Value = self.identity.model
            case "software_version":
                value = self.identity.software
            case _:
                value = self.face.value_of(asked, now)
        self.log.reads += 1
        if value is OFF:
            return "A", asked.code + OFF_ON_WIRE
        return "A", asked.code + asked.command.quantity.encode(value)

    def _write(self, asked: TableRequest, data: str, now: float) -> Answer:
        command = asked.command
        if not data and command.name in WITHOUT_DATA:
            data = "00000"
        if not well_formed(command, data):
            return self.refuse(asked.code + data, WRONG_FORMAT, now)
        try:
            value = command.quantity.decode(data)
        except ValueError:
            return self.refuse(asked.code + data, OUT_OF_RANGE, now)
        if not self.face.allowed(command, value):
            return self.refuse(asked.code + data, OUT_OF_RANGE, now)
        return self._accept(asked, value, now)

    def _accept(self, asked: TableRequest, value: Value, now: float) -> Answer:
        self.log.writes.append(
            AcceptedWrite(now, asked.command.name, asked.port, asked.tool, value)
        )
        self.face.apply(asked, value, now)
        if asked.command.name == "restart":
            self.restart(now)
        if asked.command.name == "address" and isinstance(value, int):
            # 00000 switches addresses off (manual 002, W-SAD)
            self.identity.address = value or None
        return "A", asked.code
