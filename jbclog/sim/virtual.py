"""A whole virtual station without any I/O: bytes in, bytes with their due times out.

Put together here: the wire's pace, the frame reader, the device with the physics behind it, and the faults
in front of it. `serve.py` puts it behind a pseudo-terminal or a TCP port; a test calls it itself::

    station = VirtualStation(spec, now=clock.monotonic())
    for reply in station.receive(question, clock.monotonic()):
        ...  # reply.data has arrived whole at reply.at, and not before
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple
from zlib import crc32

from jbclog.config.line import StationSpec
from jbclog.config.sim_spec import FaultSpec, SimSpec
from jbclog.core.line_format import LineFormat
from jbclog.protocol.frame import Frame, check_byte
from jbclog.protocol.reader import Corrupt, FrameReader
from jbclog.sim.build import build_device
from jbclog.sim.device import WRONG_CHECK, WRONG_FORMAT, Answer
from jbclog.sim.faults import Tape, happen
from jbclog.sim.plant import Plant
from jbclog.sim.soldering import SolderingFace
from jbclog.sim.wire_log import Struck, WireLog

KNOWN_QUESTIONS = 512  # what is asked is asked again: as many whole frames are remembered
MOVED: Answer = ("A", "SAD")  # the acknowledgement of a change of address


class Reply(NamedTuple):
    """Bytes of the station; the last of them arrives at `at` (monotonic seconds)."""

    at: float
    data: bytes


class Pace:
    """When characters are through a wire that carries one after the other. Both directions at once."""

    __slots__ = ("_character_s", "_heard", "_said", "_turnaround_s")

    def __init__(self, character_s: float, turnaround_s: float) -> None:
        self._character_s = character_s
        self._turnaround_s = turnaround_s
        self._heard = self._said = float("-inf")

    def heard(self, characters: int, now: float) -> float:
        """When the station has the last of `characters` that were written at `now`."""
        self._heard = max(self._heard, now) + characters * self._character_s
        return self._heard

    def said(self, characters: int, after: float) -> float:
        """When the last of `characters` has arrived that the station sets out to say at `after`."""
        self._said = max(self._said, after + self._turnaround_s) + characters * self._character_s
        return self._said


class VirtualStation:
    """One station, switched on at `now`. `log` is its own memory of the wire, `plant` the physics of a soldering station."""

    def __init__(self, spec: StationSpec, *, now: float, seed: int | None = None) -> None:
        sim = spec.sim or SimSpec()
        line = LineFormat(spec.baudrate, spec.format)
        self.name = spec.name
        self.seed = next(given for given in (seed, sim.seed, crc32(spec.name.encode())) if given is not None)
        self.device = build_device(spec, now, self.seed)
        self.faults = Tape(sim.fault, self.seed)
        self._pace = Pace(line.character_s if sim.wire else 0.0, sim.turnaround_ms / 1000)
        self._reader = FrameReader()
        self._whole = True  # whether the reader holds nothing
        self._known: dict[bytes, Frame] = {}

    @property
    def log(self) -> WireLog:
        return self.device.log

    @property
    def plant(self) -> Plant:
        """The physics of a soldering station. Raises `TypeError` on another."""
        face = self.device.face
        if not isinstance(face, SolderingFace):
            raise TypeError(f"{self.name} is no soldering station")
        return face.plant

    def hung_up(self, now: float) -> bool:
        """Whether the cable is out: there is no port to write to or read from."""
        return self.faults.unplugged(now)

    def next_plugging(self, now: float) -> float | None:
        """When `hung_up` changes next, as far as is known."""
        return self.faults.next_plugging(now)

    def advance_to(self, moment: float) -> None:
        """Let the physics, with the faults in it, go on without any question."""
        for change in self.faults.changes(moment):
            happen(change, self.device)
        self.device.face.advance_to(moment)

    def receive(self, data: bytes, now: float) -> list[Reply]:
        """What the station says to bytes that were written to its port at `now`."""
        if self.hung_up(now):
            return []
        heard = self._pace.heard(len(data), now)
        replies = (self._reply(found, heard) for found in self._frames(data))
        return [reply for reply in replies if reply is not None]

    def _frames(self, data: bytes) -> Sequence[Frame | Corrupt]:
        """The frames in `data`; a chunk that is one whole known question is not taken apart again."""
        known = self._known.get(data)
        if known is not None and self._whole:
            return (known,)
        found = self._reader.feed(data)
        frame = found[0] if len(found) == 1 else None
        self._whole = isinstance(frame, Frame) and frame.encode() == data
        if isinstance(frame, Frame) and self._whole and len(self._known) < KNOWN_QUESTIONS:
            self._known[data] = frame
        return found

    def _reply(self, found: Frame | Corrupt, heard: float) -> Reply | None:
        """The reply to one frame; None where there is silence: another's address, the other framing, a restart."""
        frame = found if isinstance(found, Frame) else _remains(found.raw)
        if frame.target != self.device.identity.address:
            return self._refuse_other(frame, heard) if self.device.quirks.refuses_others else None
        self._let_faults_happen(heard)
        if not self.device.hears(heard):
            return None
        if isinstance(found, Corrupt):
            answer = self.device.refuse(frame.text, _why_corrupt(found.raw), heard)
            return self._send(self._addressed(answer, frame), [], heard)
        return self._answer(frame, heard)

    def _refuse_other(self, frame: Frame, heard: float) -> Reply | None:
        return self._send(self._addressed(self.device.refuse(frame.text, WRONG_FORMAT, heard), frame), [], heard)

    def _answer(self, frame: Frame, heard: float) -> Reply | None:
        asked = self.device.asked(frame.header, frame.text)
        struck = self.faults.strikes(asked, frame.header, heard)
        refusal = next((fault for fault in struck if fault.kind == "nak"), None)
        if refusal is not None:
            return self._send(self._addressed(self.device.refuse(frame.text, refusal.code, heard), frame), struck, heard)
        answer = self.device.answer(frame.header, frame.text, heard)
        return None if answer is None else self._send(self._addressed(answer, frame), struck, heard)

    def _addressed(self, answer: Answer, question: Frame) -> bytes:
        """The bytes of an answer; the station that was asked is its source (docs/reference/contradictions.md, B-6)."""
        usual, own = (question.target, question.source), self.device.identity.address
        return _encoded(*answer, *self.device.quirks.addresses(usual, own, moves=answer == MOVED))

    def _let_faults_happen(self, heard: float) -> None:
        if self.faults.zero is None:
            self.faults.start(heard)
        for change in self.faults.changes(heard):
            happen(change, self.device)

    def _send(self, clean: bytes, struck: list[FaultSpec], heard: float) -> Reply | None:
        """Put an answer on the wire, as the faults that strike it leave it."""
        sent, late_s = self.faults.spoil(clean, struck) if struck else (clean, 0.0)
        if struck:
            self.log.struck.extend(Struck(heard, fault.kind, clean, sent) for fault in struck)
        if not sent:
            return None
        at = self._pace.said(len(sent), heard + late_s)
        return None if self.hung_up(at) else Reply(at, sent)


@lru_cache(maxsize=4096)
def _encoded(header: str, text: str, source: int | None, target: int | None) -> bytes:
    """The bytes of a frame; stations say the same things over and over."""
    return Frame(header, text, source, target).encode()


def _why_corrupt(raw: bytes) -> int:
    return WRONG_FORMAT if check_byte(raw[:-1]) == raw[-1] else WRONG_CHECK


def _remains(raw: bytes) -> Frame:
    """What can be told of a corrupt question: its addresses and its text, as far as they are there."""
    text = raw[1:-2].decode("ascii")
    addresses = text[:4]
    if len(addresses) == 4 and addresses.isdigit():
        return Frame(text[4:5], text[5:], int(addresses[:2]), int(addresses[2:]))
    return Frame(text[:1], text[1:])
