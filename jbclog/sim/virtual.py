"""A whole virtual station without I/O, as described in a line file.

It combines line timing, frame reader, device, physics and faults. `serve.py` serves it on a
pseudo-terminal or a TCP port; a test calls it directly::

    station = VirtualStation(spec, now=clock.monotonic())
    for reply in station.receive(question, clock.monotonic()):
        ...  # reply.data has arrived whole at reply.at
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from random import Random
from typing import NamedTuple
from zlib import crc32

from jbclog.config.line import AUTO, StationSpec
from jbclog.config.sim_spec import FaultSpec, SimSpec
from jbclog.core.errors import UsageError
from jbclog.core.quantities import OFF, Value
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.commands.command import Scope
from jbclog.protocol.commands.family import FAMILIES, Family, family_of
from jbclog.protocol.commands.hotair import AIR_STATUS
from jbclog.protocol.commands.signals import DISPENSING_COUNTERS
from jbclog.protocol.frame import CorruptFrame, Frame, FrameReader, check_byte
from jbclog.sim.device import WRONG_CHECK, WRONG_FORMAT, Answer, Device, FaultyAnswer, StationLog
from jbclog.sim.faults import OF_OMEGA, FaultSchedule, apply_fault
from jbclog.sim.hotair import PORT as AIR_PORT
from jbclog.sim.hotair import AirModel, AirStation, AirTraits, Heater
from jbclog.sim.plant import Feeder, Plant, StationSettings
from jbclog.sim.port import PortTraits, SimPort, fresh
from jbclog.sim.quirks import QUIRKS, Quirks
from jbclog.sim.soldering import Identity, SolderingModel, StationModel, TableRequest
from jbclog.sim.tip import JointSchedule, Tip

MODELS = {"soldering": "DDR", "ucr": "UCR245"}  # model of a family; otherwise its name
PORTS_IF_UNPRINTED = (1, 2)
TIP_W, HOT_AIR_W = 130.0, 900.0


def family_for(spec: StationSpec) -> Family:
    """Return the family of a virtual station; ``auto`` is resolved by its model."""
    name = spec.sim.family if spec.sim and spec.sim.family else spec.family
    given = spec.sim.model if spec.sim else None
    family = FAMILIES.get(name) if name != AUTO else family_of(given or "")
    if family is None:
        raise UsageError(
            f"{spec.name}: there is no virtual station of family {spec.family}; [station.sim] model"
            " can name one"
        )
    return family


def build_device(spec: StationSpec, now: float, seed: int) -> Device:
    """Build the device of a station that is switched on at `now`."""
    sim = spec.sim or SimSpec()
    family = family_for(spec)
    model = sim.model or spec.model or MODELS.get(family.name, family.name.upper())
    face = _face(sim, family, spec.ports or family.ports or PORTS_IF_UNPRINTED, model, now, seed)
    _check_names(spec.name, sim, family, face)
    quirks = Quirks(sim.quirks)
    quirks.begin(face)
    device = Device(
        family, face, Identity(model, sim.software, spec.address, sim.robot_mode), quirks
    )
    for name, value in sim.settings.items():
        _set_initial(device, spec.name, name, value, now)
    return device


def _face(
    sim: SimSpec, family: Family, ports: tuple[int, ...], model: str, now: float, seed: int
) -> StationModel:
    if family.status is AIR_STATUS:
        return AirModel(_air_station(sim, now, seed))
    return SolderingModel(
        family, _plant(sim, family, ports, model, now, seed), strict=sim.refuses_unprinted
    )


def _check_names(station: str, sim: SimSpec, family: Family, face: StationModel) -> None:
    """Reject a counter, command or port that does not exist, because it would silently have no
    effect.
    """
    counters = {counter.command for counter in (*family.counters, *DISPENSING_COUNTERS)} & set(
        family.commands
    )
    wrong = [f"counters: {name}" for name in sim.counters if name not in counters]
    wrong += [f"tools: {port}" for port in sim.tools if port not in face.ports]
    wrong += [f"quirks: {name}" for name in sim.quirks if name not in QUIRKS]
    for fault in sim.fault:
        wrong += [f"fault {fault.kind}"] if fault.kind in OF_OMEGA else []
        wrong += (
            [f"fault {fault.kind}: {fault.command}"]
            if fault.command and fault.command not in family.commands
            else []
        )
        wrong += (
            [f"fault {fault.kind}: port {fault.port}"]
            if fault.port and fault.port not in face.ports
            else []
        )
    if wrong:
        raise UsageError(
            f"{station}: [station.sim] {', '.join(wrong)}: a {family.name} with ports"
            f" {list(face.ports)} has none"
        )


def _plant(
    sim: SimSpec, family: Family, ports: tuple[int, ...], model: str, now: float, seed: int
) -> Plant:
    feeder = Feeder()
    on_joint = feeder.start if sim.feed_each_joint else None
    return Plant(
        began=now,
        ports={number: _port(sim, number, now, seed * 5 + number, on_joint) for number in ports},
        feeder=feeder,
        factory=fresh(StationSettings, family.defaults, model),
        start_counts=sim.counters,
    )


def _air_station(sim: SimSpec, now: float, seed: int) -> AirStation:
    character = AirTraits(
        sim.noise_c, sim.sensor_error_c, sim.thermocouple, sim.suction_each_joint, Random(seed)
    )
    heater = Heater(sim.ambient_c, sim.rated_power_w or HOT_AIR_W)
    joints = JointSchedule(sim.joints_per_minute, sim.joint_seconds, seed, now)
    return AirStation(
        now, sim.tools.get(AIR_PORT, sim.tool), heater, joints, character, sim.counters
    )


def _port(
    sim: SimSpec, number: int, now: float, seed: int, on_joint: Callable[[float], None] | None
) -> SimPort:
    character = PortTraits(
        sim.noise_c, sim.sensor_error_c, sim.extractor_cools, Random(seed), on_joint
    )
    joints = JointSchedule(sim.joints_per_minute, sim.joint_seconds, seed, now)
    return SimPort(
        now,
        sim.tools.get(number, sim.tool),
        Tip(sim.ambient_c, sim.rated_power_w or TIP_W),
        joints,
        character,
    )


def _set_initial(
    device: Device, station: str, name: str, given: int | float | str, now: float
) -> None:
    """Apply an initial setting on all ports and tools."""
    command = device.family.commands.get(name)
    value = _value(device, name, given)
    if command is None or "rw" not in command.access or not device.face.allowed(command, value):
        raise UsageError(
            f"{station}: [station.sim] settings: {name} = {given} is nothing that a"
            f" {device.family.name} can begin with"
        )
    ports = [0] if command.scope is Scope.STATION else list(device.face.ports)
    tools = [tool for tool in device.family.tools if tool] if command.scope is Scope.TOOL else [0]
    for port in ports:
        for tool in tools:
            device.face.apply(TableRequest(command, "", port, tool), value, now)
    device.face.keep()


def _value(device: Device, name: str, given: int | float | str) -> Value:
    if name == "status" and isinstance(given, str):
        return device.family.status.orders.get(given, given)
    return OFF if given == "off" and name.endswith("_delay") else given


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


class FaultyStation:
    """The name, seed and faults of a virtual station."""

    def __init__(self, spec: StationSpec, sim: SimSpec) -> None:
        self.name = spec.name
        self.seed = crc32(spec.name.encode()) if sim.seed is None else sim.seed
        self.faults = FaultSchedule(sim.fault, self.seed)

    def is_unplugged(self, now: float) -> bool:
        """Return True if the cable is disconnected: there is no port."""
        return self.faults.unplugged(now)

    def next_plugging(self, now: float) -> float | None:
        """Return when `is_unplugged` changes next, as far as known."""
        return self.faults.next_plugging(now)


class VirtualStation(FaultyStation):
    """One station, switched on at `now`. `log` is its log, `plant` the physics of a soldering
    station.
    """

    def __init__(self, spec: StationSpec, *, now: float) -> None:
        sim = spec.sim or SimSpec()
        super().__init__(spec, sim)
        line = LineFormat(spec.baudrate, spec.format)
        self.device = build_device(spec, now, self.seed)
        self._pace = LineTiming(line.character_s if sim.wire else 0.0, sim.turnaround_ms / 1000)
        self._faults_from = sim.faults_from
        self._reader = FrameReader()
        self._whole = True  # the reader holds no partial frame
        self._known: dict[bytes, Frame] = {}

    @property
    def log(self) -> StationLog:
        return self.device.log

    @property
    def plant(self) -> Plant:
        """The physics of a soldering station. Raises `TypeError` on another."""
        face = self.device.face
        if not isinstance(face, SolderingModel):
            raise TypeError(f"{self.name} is no soldering station")
        return face.plant

    def advance_to(self, moment: float) -> None:
        """Simulate physics and faults without a request."""
        for change in self.faults.changes(moment):
            apply_fault(change, self.device)
        self.device.face.advance_to(moment)

    def receive(self, data: bytes, now: float) -> list[Reply]:
        """Return the answers to bytes written to its port at `now`."""
        if self.is_unplugged(now):
            return []
        heard = self._pace.heard(len(data), now)
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

    def _send(self, clean: bytes, struck: list[FaultSpec], heard: float) -> Reply | None:
        """Send an answer after applying its faults."""
        sent, late_s = self.faults.spoil(clean, struck) if struck else (clean, 0.0)
        if struck:
            self.log.struck.extend(FaultyAnswer(heard, fault.kind, clean, sent) for fault in struck)
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
