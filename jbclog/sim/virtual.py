"""A whole virtual station without I/O, as described in a line file.

It combines line timing, frame reader, device, physics and faults. `serve.py` serves it on a
pseudo-terminal or a TCP port; a test calls it directly::

    station = VirtualStation(spec, now=clock.monotonic())
    for reply in station.receive(question, clock.monotonic()):
        ...  # reply.data has arrived whole at reply.at
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from random import Random
from typing import Generic, NamedTuple, TypeVar
from zlib import crc32

from jbclog.config.line import StationSpec
from jbclog.config.sim_spec import FaultSpec, SimSpec
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.frame import CorruptFrame, Frame, FrameReader, check_byte
from jbclog.protocol.omega import OmegaReader, encode
from jbclog.sim.build import build_device
from jbclog.sim.device import (
    WRONG_CHECK,
    WRONG_FORMAT,
    Answer,
    Device,
    FaultyAnswer,
    RobotDevice,
    StationLog,
)
from jbclog.sim.faults import FaultSchedule, apply_fault
from jbclog.sim.omega import SLOWEST_S, OmegaAnswer, OmegaDevice, OmegaPlant, build_omega
from jbclog.sim.soldering import SolderingPlant
from jbclog.sim.soldering_station import SolderingStation

KNOWN_QUESTIONS = 512  # cached requests; the same ones recur
MOVED: Answer = ("A", "SAD")  # acknowledgement of a change of address


class Reply(NamedTuple):
    """Bytes of the station; the last one arrives at `at` (monotonic seconds)."""

    at: float
    data: bytes


class LineTiming:
    """Transmission times on a full-duplex line that carries one character after the other."""

    __slots__ = ("_character_s", "_heard", "_sent_at", "_turnaround_s")

    def __init__(self, character_s: float, turnaround_s: float) -> None:
        self._character_s = character_s
        self._turnaround_s = turnaround_s
        self._heard = self._sent_at = float("-inf")

    def heard(self, characters: int, now: float) -> float:
        """Return when the station has received the last of `characters` written at `now`."""
        self._heard = max(self._heard, now) + characters * self._character_s
        return self._heard

    def sent_at(self, characters: int, after: float) -> float:
        """Return when the last of `characters` arrives, begun at `after`."""
        self._sent_at = (
            max(self._sent_at, after + self._turnaround_s) + characters * self._character_s
        )
        return self._sent_at


D = TypeVar("D", bound=Device)


class ServedStation(ABC, Generic[D]):
    """What all virtual stations share: a name, a line, faults, and a device with its plant."""

    def __init__(self, spec: StationSpec, sim: SimSpec, device: D, turnaround_s: float) -> None:
        self.name = spec.name
        self.device = device
        self.faults = FaultSchedule(sim.fault, seed_of(spec))
        line = LineFormat(spec.baudrate, spec.format)
        self._character_s = line.character_s if sim.wire else 0.0
        self._pace = LineTiming(self._character_s, turnaround_s)

    @property
    def log(self) -> StationLog:
        return self.device.log

    def is_unplugged(self, now: float) -> bool:
        """Return True if the cable is disconnected: there is no port."""
        return self.faults.unplugged(now)

    def next_plugging(self, now: float) -> float | None:
        """Return when `is_unplugged` changes next, as far as known."""
        return self.faults.next_plugging(now)

    def advance_to(self, moment: float) -> None:
        """Simulate physics and faults without a request."""
        for change in self.faults.changes(moment):
            apply_fault(change, self.device)
        self.device.face.advance_to(moment)

    def receive(self, data: bytes, now: float) -> list[Reply]:
        """Return the answers to bytes written at `now`, and later messages caused by them."""
        if self.is_unplugged(now):
            return []
        return self._answers(data, self._pace.heard(len(data), now))

    @abstractmethod
    def _answers(self, data: bytes, heard: float) -> list[Reply]:
        """Return the replies to `data`, whose last byte the station has received at `heard`."""

    def _spoil(
        self, clean: bytes, struck: Sequence[FaultSpec], moment: float
    ) -> tuple[bytes, float]:
        """Apply faults to an answer; return what is sent (b"": nothing), and the delay in s."""
        if not struck:
            return clean, 0.0
        sent, late_s = self.faults.spoil(clean, struck)
        self.log.struck.extend(FaultyAnswer(moment, fault.kind, clean, sent) for fault in struck)
        return sent, late_s


def seed_of(spec: StationSpec) -> int:
    """Return the seed of a station's random numbers: by its name, unless the line file has one."""
    if spec.sim is None or spec.sim.seed is None:
        return crc32(spec.name.encode())
    return spec.sim.seed


class VirtualStation(ServedStation[RobotDevice]):
    """One station, switched on at `now`. `log` is its log, `plant` the physics of a soldering
    station.
    """

    def __init__(self, spec: StationSpec, *, now: float) -> None:
        sim = spec.sim or SimSpec()
        device = build_device(spec, now, seed_of(spec))
        super().__init__(spec, sim, device, sim.turnaround_ms / 1000)
        self._faults_from = sim.faults_from
        self._reader = FrameReader()
        self._whole = True  # the reader holds no partial frame
        self._known: dict[bytes, Frame] = {}

    @property
    def plant(self) -> SolderingStation:
        """The physics of a soldering station. Raises `TypeError` on another."""
        face = self.device.face
        if not isinstance(face, SolderingPlant):
            raise TypeError(f"{self.name} is no soldering station")
        return face.station

    def _answers(self, data: bytes, heard: float) -> list[Reply]:
        replies = (self._reply(found, heard) for found in self._frames(data))
        return [reply for reply in replies if reply is not None]

    def _frames(self, data: bytes) -> Sequence[Frame | CorruptFrame]:
        """Parse the frames in `data`; a chunk that is a cached request is not parsed again."""
        known = self._known.get(data)
        if known is not None and self._whole:
            return (known,)
        found = self._reader.feed(data)
        frame = found[0] if len(found) == 1 else None
        self._whole = isinstance(frame, Frame) and frame.encode() == data
        if isinstance(frame, Frame) and self._whole and len(self._known) < KNOWN_QUESTIONS:
            self._known[data] = frame
        return found

    def _reply(self, found: Frame | CorruptFrame, heard: float) -> Reply | None:
        """Reply to one frame; None is silence: another address, other framing, a restart."""
        frame = found if isinstance(found, Frame) else _partial_frame(found.raw)
        if frame.target != self.device.identity.address:
            return self._refuse_other(frame, heard) if self.device.quirks.refuses_others else None
        self._let_faults_happen(heard)
        if not self.device.hears(heard):
            return None
        if isinstance(found, CorruptFrame):
            answer = self.device.refuse(frame.text, _why_corrupt(found.raw), heard)
            return self._send(self._addressed(answer, frame), [], heard)
        return self._answer(frame, heard)

    def _refuse_other(self, frame: Frame, heard: float) -> Reply | None:
        return self._send(
            self._addressed(self.device.refuse(frame.text, WRONG_FORMAT, heard), frame), [], heard
        )

    def _answer(self, frame: Frame, heard: float) -> Reply | None:
        asked = self.device.asked(frame.header, frame.text)
        struck = self.faults.strikes(asked, frame.header, heard)
        refusal = next((fault for fault in struck if fault.kind == "nak"), None)
        if refusal is not None:
            return self._send(
                self._addressed(self.device.refuse(frame.text, refusal.code, heard), frame),
                struck,
                heard,
            )
        answer = self.device.answer(frame.header, frame.text, heard)
        return None if answer is None else self._send(self._addressed(answer, frame), struck, heard)

    def _addressed(self, answer: Answer, question: Frame) -> bytes:
        """Encode an answer; its source is the address that was asked
        (docs/reference/contradictions.md, B-6).
        """
        usual, own = (question.target, question.source), self.device.identity.address
        return _encoded(*answer, *self.device.quirks.addresses(usual, own, moves=answer == MOVED))

    def _let_faults_happen(self, heard: float) -> None:
        if self.faults.zero is None and (zero := self._zero(heard)) is not None:
            self.faults.start(zero)
        for change in self.faults.changes(heard):
            apply_fault(change, self.device)

    def _zero(self, heard: float) -> float | None:
        """Return what the times of the faults count from; None until it has come."""
        if self._faults_from == "question":
            return heard
        return next((write.at for write in self.log.written("status")), None)

    def _send(self, clean: bytes, struck: Sequence[FaultSpec], heard: float) -> Reply | None:
        sent, late_s = self._spoil(clean, struck, heard)
        if not sent:
            return None
        at = self._pace.sent_at(len(sent), heard + late_s)
        return None if self.is_unplugged(at) else Reply(at, sent)


@lru_cache(maxsize=4096)
def _encoded(header: str, text: str, source: int | None, target: int | None) -> bytes:
    """Encode a frame; cached, because stations repeat themselves."""
    return Frame(header, text, source, target).encode()


def _why_corrupt(raw: bytes) -> int:
    return WRONG_FORMAT if check_byte(raw[:-1]) == raw[-1] else WRONG_CHECK


def _partial_frame(raw: bytes) -> Frame:
    """Return addresses and text of a corrupt request, as far as possible."""
    text = raw[1:-2].decode("ascii")
    addresses = text[:4]
    if len(addresses) == 4 and addresses.isdigit():
        return Frame(text[4:5], text[5:], int(addresses[:2]), int(addresses[2:]))
    return Frame(text[:1], text[1:])


class VirtualOmega(ServedStation[OmegaDevice]):
    """One controller, switched on at `now`. `plant` is its machine."""

    def __init__(self, spec: StationSpec, *, now: float) -> None:
        sim = spec.sim or SimSpec()
        super().__init__(spec, sim, build_omega(spec, now, seed_of(spec)), 0.0)
        self._random = Random(seed_of(spec))
        self._turnaround_s: float | None = None
        if "turnaround_ms" in sim.model_fields_set:
            self._turnaround_s = sim.turnaround_ms / 1000
        self._reader = OmegaReader()

    @property
    def plant(self) -> OmegaPlant:
        return self.device.plant

    def _answers(self, data: bytes, heard: float) -> list[Reply]:
        requests = [found for found in self._reader.feed(data) if isinstance(found, str)]
        replies = [self._reply(text, heard) for text in requests]
        return [reply for reply in replies if reply is not None]

    def _reply(self, text: str, heard: float) -> Reply | None:
        """Reply to one request; None is silence."""
        if self.faults.zero is None:
            self.faults.start(heard)
        self.advance_to(heard)
        if not self.device.hears(heard):
            return None
        asked = self.device.asked(text)
        header = "W" if asked and asked.command.writable else "R"
        struck = self.faults.strikes(asked, header, heard)
        answer: OmegaAnswer | None = None
        if not any(fault.kind == "nak" for fault in struck):
            answer = self.device.answer(asked, text, heard)
        if answer is None:
            self.device.refuse(text, heard)
            return None
        return self._send(answer, struck)

    def _send(self, answer: OmegaAnswer, struck: Sequence[FaultSpec]) -> Reply | None:
        sent, late_s = self._spoil(encode(answer.text), struck, answer.at)
        if not sent:
            return None
        after = answer.at + late_s
        if answer.is_unsolicited:
            at = after + len(sent) * self._character_s
        else:
            at = self._pace.sent_at(len(sent), after + self._delay_s())
        return None if self.is_unplugged(at) else Reply(at, sent)

    def _delay_s(self) -> float:
        if self._turnaround_s is None:
            return self._random.uniform(0.0, SLOWEST_S)
        return self._turnaround_s
