"""A whole virtual OMEGA without any I/O: bytes in, bytes with their due times out, as `virtual.py` has it for JBC's stations.

It answers after 0 to 250 ms, as it likes, or after `turnaround_ms` where the line file says so. A wrong sum, an unknown
command, an unknown number and a value out of range are met with silence (003, 11.2; docs/reference/protocol.md). H is
answered when the joint
is made, however late that is.
"""

from __future__ import annotations

from random import Random
from typing import Final
from zlib import crc32

from jbclog.config.line import StationSpec
from jbclog.config.sim_spec import FaultSpec, SimSpec
from jbclog.core.errors import UsageError
from jbclog.core.line_format import LineFormat
from jbclog.protocol.commands.family import FAMILIES
from jbclog.protocol.commands.omega_values import ConditionNumber, SetTemperature, Stored, StoredCondition, is_condition
from jbclog.protocol.omega import OmegaReader, encode
from jbclog.sim.faults import OF_OMEGA, Change, Tape
from jbclog.sim.omega_plant import OmegaPlant
from jbclog.sim.questions import Asked
from jbclog.sim.tip import Joints
from jbclog.sim.virtual import Pace, Reply
from jbclog.sim.wire_log import Refused, Struck, WireLog, Written

SLOWEST_S = 0.25  # 003 11.1
IN_DEGREES: Final = "temperature_in_degrees"
OMEGA_QUIRKS: Final = {IN_DEGREES: 51}
"""Ways to differ, with their rows of docs/reference/contradictions.md."""

PHYSICS: Final = OF_OMEGA | {"restart"}
KINDS: Final = PHYSICS | {"silence", "noise", "flip", "late", "nak", "dropout"}
COMMANDS = FAMILIES["omega"].commands
BY_LETTER = {command.letters: command for command in COMMANDS.values()}
RECORD, NUMBER = StoredCondition(), ConditionNumber()
SET_C = 350  # of condition 399, which sets a temperature


class VirtualOmega:
    """One controller, switched on at `now`. `log` is its own memory of the wire, `plant` what it drives."""

    def __init__(self, spec: StationSpec, *, now: float, seed: int | None = None) -> None:
        sim = spec.sim or SimSpec()
        _check_names(spec.name, sim)
        line = LineFormat(spec.baudrate, spec.format)
        self.name = spec.name
        self.seed = next(given for given in (seed, sim.seed, crc32(spec.name.encode())) if given is not None)
        self.log = WireLog()
        self.faults = Tape(sim.fault, self.seed)
        joints = Joints(sim.joints_per_minute, sim.joint_seconds, self.seed, now)
        self.plant = OmegaPlant(now, joints, _stored(spec.name, sim))
        self._random = Random(self.seed)
        self._turnaround_s = sim.turnaround_ms / 1000 if "turnaround_ms" in sim.model_fields_set else None
        self._character_s = line.character_s if sim.wire else 0.0
        self._pace = Pace(self._character_s, 0.0)
        self._reader = OmegaReader()
        self._silent_until = float("-inf")

    def hung_up(self, now: float) -> bool:
        """Whether the cable is out: there is no port to write to or read from."""
        return self.faults.unplugged(now)

    def next_plugging(self, now: float) -> float | None:
        """When `hung_up` changes next, as far as is known."""
        return self.faults.next_plugging(now)

    def advance_to(self, moment: float) -> None:
        """Let the physics, with the faults in it, go on without any question."""
        for change in self.faults.changes(moment):
            self._happen(change)
        self.plant.advance_to(moment)

    def receive(self, data: bytes, now: float) -> list[Reply]:
        """What it says to bytes that were written to its port at `now`: what answers them, and what comes of them later."""
        if self.hung_up(now):
            return []
        heard = self._pace.heard(len(data), now)
        return [reply for found in self._reader.feed(data) if isinstance(found, str) for reply in self._replies(found, heard)]

    def _replies(self, text: str, heard: float) -> list[Reply]:
        if self.faults.zero is None:
            self.faults.start(heard)
        self.advance_to(heard)
        if heard < self._silent_until:
            return []
        command = BY_LETTER.get(text[0])
        asked = Asked(command, text, 1) if command else None
        struck = self.faults.strikes(asked, "W" if command and command.writable else "R", heard)
        if any(fault.kind == "nak" for fault in struck):
            return self._ignore(text, heard)
        if text[0] == "H":
            return self._run(text, struck, heard)
        answer = self._answer(text, heard)
        return self._ignore(text, heard) if answer is None else self._send(answer, struck, heard)

    # -- what is answered ------------------------------------------------------------------------------------------

    def _answer(self, text: str, now: float) -> str | None:
        """The answer to a question with a good sum; None is its way to refuse."""
        letter, data = text[0], text[1:]
        if letter == "C":
            return self._condition(data)
        if letter == "D":
            return self._store(data, now)
        command = BY_LETTER.get(letter)
        if command is None or data:
            return None
        told = {
            "A": self.plant.information,
            "B": lambda: self.plant.control(now),
            "F": lambda: self.plant.at_temperature(now),
            "G": self.plant.mode,
        }
        self.log.reads += 1
        return letter.lower() + command.quantity.encode(told[letter]())

    def _condition(self, data: str) -> str | None:
        number = _number(data)
        if number is None:
            return None
        self.log.reads += 1
        return "c" + RECORD.encode(self.plant.condition(number))

    def _store(self, data: str, now: float) -> str | None:
        try:
            value = RECORD.decode(data)
        except ValueError:
            return None
        if not self.plant.takes(value):
            return None
        self.plant.store(value)
        self.log.writes.append(Written(now, "store_condition", 0, 0, value))
        return "d"

    def _run(self, text: str, struck: list[FaultSpec], heard: float) -> list[Reply]:
        number = _number(text[1:])
        if number is None or not is_condition(number):
            return self._ignore(text, heard)
        self.log.writes.append(Written(heard, "run_condition", 0, 0, number))
        letter, done = self.plant.run(number, heard)
        return self._send(letter, struck, done, by_itself=True)

    def _ignore(self, text: str, now: float) -> list[Reply]:
        self.log.refused.append(Refused(now, text, 0))
        return []

    # -- the wire --------------------------------------------------------------------------------------------------

    def _send(self, text: str, struck: list[FaultSpec], after: float, *, by_itself: bool = False) -> list[Reply]:
        """Put an answer on the wire, as the faults that strike it leave it. What it says by itself waits for no answer."""
        clean = encode(text)
        sent, late_s = self.faults.spoil(clean, struck)
        self.log.struck.extend(Struck(after, fault.kind, clean, sent) for fault in struck)
        if not sent:
            return []
        if by_itself:
            at = after + late_s + len(sent) * self._character_s
        else:
            at = self._pace.said(len(sent), after + late_s + self._delay_s())
        return [] if self.hung_up(at) else [Reply(at, sent)]

    def _delay_s(self) -> float:
        return self._random.uniform(0.0, SLOWEST_S) if self._turnaround_s is None else self._turnaround_s

    # -- faults ----------------------------------------------------------------------------------------------------

    def _happen(self, change: Change) -> None:
        kind = change.fault.kind
        if kind == "restart":
            if change.begins and change.fault.for_s is not None:
                self._silent_until = change.at + change.fault.for_s
                self.plant.restart(self._silent_until)
        elif change.begins:
            self.plant.faults.add(kind)
        else:
            self.plant.faults.discard(kind)


def _number(data: str) -> int | None:
    """The number of a condition that there is; None for all others."""
    try:
        return 0 if data == "0000" else NUMBER.decode(data)
    except ValueError:
        return None


def _stored(station: str, sim: SimSpec) -> dict[int, Stored]:
    """What the line file lets it begin with, and one condition that sets a temperature, in tenths or in whole degrees."""
    set_temperature = SetTemperature(399, SET_C if IN_DEGREES in sim.quirks else 10 * SET_C, 0)
    found: dict[int, Stored] = {set_temperature.condition: set_temperature}
    for name, told in sim.settings.items():
        try:
            value = RECORD.decode(str(told).replace(" ", ""))
        except ValueError as error:
            raise UsageError(f"{station}: [station.sim] settings: {name}: {error}") from error
        if name != f"condition_{value.condition}":
            raise UsageError(f"{station}: [station.sim] settings: {name} is nothing that an omega can begin with; {value}")
        found[value.condition] = value
    return found


def _check_names(station: str, sim: SimSpec) -> None:
    """A name that is not there would silently do nothing."""
    wrong = [f"counters: {name}" for name in sim.counters]
    wrong += [f"quirks: {name}" for name in sim.quirks if name not in OMEGA_QUIRKS]
    wrong += [f"fault {fault.kind}" for fault in sim.fault if fault.kind not in KINDS]
    wrong += [f"fault {fault.kind}: {fault.command}" for fault in sim.fault if fault.command and fault.command not in COMMANDS]
    wrong += [f"fault {fault.kind}: port {fault.port}" for fault in sim.fault if fault.port not in (None, 1)]
    if wrong:
        raise UsageError(f"{station}: [station.sim] {', '.join(wrong)}: an omega has none")
