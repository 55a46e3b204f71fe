"""A virtual OMEGA: its process, and its answers.

It answers after a random 0 to 250 ms, or after `turnaround_ms` if the line file sets it. A wrong
sum, an unknown command, an unknown number and a value out of range get no answer (003, 11.2;
docs/reference/protocol.md). H is answered when the joint is completed, however late.
"""

from __future__ import annotations

from collections.abc import Mapping
from random import Random
from typing import Final

from jbclog.config.line import StationSpec
from jbclog.config.sim_spec import FaultSpec, SimSpec
from jbclog.core.errors import UsageError
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.commands.family import FAMILIES
from jbclog.protocol.commands.omega import (
    AT_TEMPERATURE,
    CLEANING,
    CONTROL,
    INFORMATION,
    MODES,
    Cleaning,
    ConditionNumber,
    ConditionRecord,
    SetTemperature,
    StoredCondition,
    StoredRecord,
    is_condition,
)
from jbclog.protocol.omega import OmegaReader, encode
from jbclog.sim.device import AcceptedWrite, FaultyAnswer, RefusedRequest, StationLog
from jbclog.sim.faults import OF_OMEGA, FaultChange
from jbclog.sim.soldering import TableRequest
from jbclog.sim.tip import JointSchedule
from jbclog.sim.virtual import FaultyStation, LineTiming, Reply

# Where no document describes a controller: it prepares for `WARM_UP_S` after switching on; its
# temperature leaves the range in the later part of each joint and is back at its end; a condition
# takes as long as its times and its feeds, and 0 mm/s moves nothing; its solder wire moves at most
# at `MOST_MM_S`. That proves nothing about a real one.

WARM_UP_S = 5.0
DIPS_AFTER = 0.4  # share of a joint after which its temperature leaves the range
MOST_MM_S = 60.0
MODE_OF_HUNDRED = {1: 0, 2: 1, 3: 4}  # special point, special slide, pre-solder
SLIDES = (1, 3)
FEEDS = (("feed1_mm", "feed1_mm_s"), ("feed2_mm", "feed2_mm_s"), ("feed3_mm", "feed3_mm_s"))
BACK = (
    ("reverse1_mm", "reverse1_mm_s"),
    ("reverse2_mm", "reverse2_mm_s"),
    ("reverse3_mm", "reverse3_mm_s"),
)


def usual(number: int) -> StoredRecord:
    """Return the initial record of a number."""
    if number == CLEANING:
        return Cleaning(0.5)
    mode = MODE_OF_HUNDRED[number // 100]
    return ConditionRecord(
        number, mode, 0.3, 2.0, 10.0, 0.5, 10.0, 0.8, 3.0, 8.0, 0.5, 10.0, 1.0, 0.0, 0.0, 1.0, 20.0
    )


class OmegaPlant:
    """One controller and its machine. Times are monotonic seconds. `judges_optimum`: F says whether
    the temperature is optimal, which it is not from the beginning of a joint on.
    """

    def __init__(
        self,
        began: float,
        joints: JointSchedule,
        stored: Mapping[int, StoredRecord],
        *,
        judges_optimum: bool = False,
    ) -> None:
        self.stored = dict(stored)
        self._dips_after = 0.0 if judges_optimum else DIPS_AFTER
        self.faults: set[str] = set()
        self._joints = joints
        self._joint = joints.after(began)
        self._ready_at = began + WARM_UP_S
        self._run_from = self._run_to = began  # the joint that H began

    def restart(self, now: float) -> None:
        """Switch off and on again."""
        self._ready_at = now + WARM_UP_S
        self._run_to = now

    def advance_to(self, moment: float) -> None:
        while self._joint.end <= moment:
            self._joint = self._joints.after(self._joint.start)

    def information(self) -> str:
        return INFORMATION.names[("solder_shortage" in self.faults) + 2 * ("clog" in self.faults)]

    def control(self, now: float) -> str:
        return CONTROL.names[now < self._ready_at or "not_ready" in self.faults]

    def at_temperature(self, now: float) -> str:
        self.advance_to(now)
        dips = any(
            begin + self._dips_after * (end - begin) <= now < end for begin, end in self._at_work()
        )
        return AT_TEMPERATURE.names[dips or now < self._ready_at or "out_of_range" in self.faults]

    def mode(self) -> str:
        return MODES[self.condition(301).mode]

    def condition(self, number: int) -> StoredRecord:
        return self.stored.get(number) or usual(number)

    def _at_work(self) -> list[tuple[float, float]]:
        return [(self._joint.start, self._joint.end), (self._run_from, self._run_to)]

    def takes(self, value: StoredRecord) -> bool:
        """Return True if every field is in its range."""
        return all(float(text) <= MOST_MM_S for _, unit, text in value.values() if unit == "mm/s")

    def store(self, value: StoredRecord) -> None:
        self.stored[value.condition] = value

    def run(self, number: int, now: float) -> tuple[str, float]:
        """Make the joint of this condition; return the completion message and its time."""
        condition = self.condition(number)
        slides = condition.mode in SLIDES
        self._run_from = now
        self._run_to = now + seconds_of(condition)
        return (
            ("i", now + seconds_of(condition, first_stage=True)) if slides else ("h", self._run_to)
        )


def seconds_of(condition: StoredRecord, *, first_stage: bool = False) -> float:
    """Return the duration of its joint in seconds; of a slide only the first stage."""
    if isinstance(condition, Cleaning):
        return condition.air_blow_s
    if not isinstance(condition, ConditionRecord):
        return 0.0
    stages = 1 if first_stage else len(FEEDS)
    times = (condition.rise_s, condition.preheat_s, 0.0 if first_stage else condition.heating_s)
    moves = [
        (float(getattr(condition, way)), float(getattr(condition, speed)))
        for way, speed in (*FEEDS[:stages], *BACK[:stages])
    ]
    return sum(times) + sum(way / speed for way, speed in moves if speed)


SLOWEST_S = 0.25  # 003 11.1
IN_DEGREES: Final = "temperature_in_degrees"
IS_OPTIMAL: Final = "in_range_is_optimal"
OMEGA_QUIRKS: Final = {IN_DEGREES: 51, IS_OPTIMAL: 55}
"""Quirks, with their rows of docs/reference/contradictions.md."""

PHYSICS: Final = OF_OMEGA | {"restart"}
KINDS: Final = PHYSICS | {"silence", "noise", "flip", "late", "nak", "dropout"}
COMMANDS = FAMILIES["omega"].commands
BY_LETTER = {command.letters: command for command in COMMANDS.values()}
RECORD, NUMBER = StoredCondition(), ConditionNumber()
SET_C = 350  # temperature of condition 399


class VirtualOmega(FaultyStation):
    """One controller, switched on at `now`. `log` is its log, `plant` its machine."""

    def __init__(self, spec: StationSpec, *, now: float) -> None:
        sim = spec.sim or SimSpec()
        _check_names(spec.name, sim)
        super().__init__(spec, sim)
        line = LineFormat(spec.baudrate, spec.format)
        self.log = StationLog()
        joints = JointSchedule(sim.joints_per_minute, sim.joint_seconds, self.seed, now)
        self.plant = OmegaPlant(
            now, joints, _stored(spec.name, sim), judges_optimum=IS_OPTIMAL in sim.quirks
        )
        self._random = Random(self.seed)
        self._turnaround_s = (
            sim.turnaround_ms / 1000 if "turnaround_ms" in sim.model_fields_set else None
        )
        self._character_s = line.character_s if sim.wire else 0.0
        self._pace = LineTiming(self._character_s, 0.0)
        self._reader = OmegaReader()
        self._silent_until = float("-inf")

    def advance_to(self, moment: float) -> None:
        """Simulate physics and faults without a request."""
        for change in self.faults.changes(moment):
            self._happen(change)
        self.plant.advance_to(moment)

    def receive(self, data: bytes, now: float) -> list[Reply]:
        """Return the answers to bytes written at `now`, and later messages caused by them."""
        if self.is_unplugged(now):
            return []
        heard = self._pace.heard(len(data), now)
        return [
            reply
            for found in self._reader.feed(data)
            if isinstance(found, str)
            for reply in self._replies(found, heard)
        ]

    def _replies(self, text: str, heard: float) -> list[Reply]:
        if self.faults.zero is None:
            self.faults.start(heard)
        self.advance_to(heard)
        if heard < self._silent_until:
            return []
        command = BY_LETTER.get(text[0])
        asked = TableRequest(command, text, 1) if command else None
        struck = self.faults.strikes(asked, "W" if command and command.writable else "R", heard)
        if any(fault.kind == "nak" for fault in struck):
            return self._ignore(text, heard)
        if text[0] == "H":
            return self._run(text, struck, heard)
        answer = self._answer(text, heard)
        return self._ignore(text, heard) if answer is None else self._send(answer, struck, heard)

    def _answer(self, text: str, now: float) -> str | None:
        """Answer a request with a correct sum; None is a refusal."""
        letter, data = text[0], text[1:]
        if letter == "C":
            return self._condition(data)
        if letter == "D":
            return self._store(data, now)
        command = BY_LETTER.get(letter)
        if command is None or data:
            return None
        values = {
            "A": self.plant.information,
            "B": lambda: self.plant.control(now),
            "F": lambda: self.plant.at_temperature(now),
            "G": self.plant.mode,
        }
        self.log.reads += 1
        return letter.lower() + command.quantity.encode(values[letter]())

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
        self.log.writes.append(AcceptedWrite(now, "store_condition", 0, 0, value))
        return "d"

    def _run(self, text: str, struck: list[FaultSpec], heard: float) -> list[Reply]:
        number = _number(text[1:])
        if number is None or not is_condition(number):
            return self._ignore(text, heard)
        self.log.writes.append(AcceptedWrite(heard, "run_condition", 0, 0, number))
        letter, done = self.plant.run(number, heard)
        return self._send(letter, struck, done, by_itself=True)

    def _ignore(self, text: str, now: float) -> list[Reply]:
        self.log.refused.append(RefusedRequest(now, text, 0))
        return []

    def _send(
        self, text: str, struck: list[FaultSpec], after: float, *, by_itself: bool = False
    ) -> list[Reply]:
        """Send an answer after applying its faults. An unsolicited message waits for no answer."""
        clean = encode(text)
        sent, late_s = self.faults.spoil(clean, struck)
        self.log.struck.extend(FaultyAnswer(after, fault.kind, clean, sent) for fault in struck)
        if not sent:
            return []
        if by_itself:
            at = after + late_s + len(sent) * self._character_s
        else:
            at = self._pace.sent_at(len(sent), after + late_s + self._delay_s())
        return [] if self.is_unplugged(at) else [Reply(at, sent)]

    def _delay_s(self) -> float:
        return (
            self._random.uniform(0.0, SLOWEST_S)
            if self._turnaround_s is None
            else self._turnaround_s
        )

    def _happen(self, change: FaultChange) -> None:
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
    """Return the number of an existing condition; None for others."""
    try:
        return 0 if data == "0000" else NUMBER.decode(data)
    except ValueError:
        return None


def _stored(station: str, sim: SimSpec) -> dict[int, StoredRecord]:
    """Return the initial conditions of the line file, and one that sets a temperature, in tenths or
    in whole degrees.
    """
    set_temperature = SetTemperature(399, SET_C if IN_DEGREES in sim.quirks else 10 * SET_C, 0)
    found: dict[int, StoredRecord] = {set_temperature.condition: set_temperature}
    for name, values in sim.settings.items():
        try:
            value = RECORD.decode(str(values).replace(" ", ""))
        except ValueError as error:
            raise UsageError(f"{station}: [station.sim] settings: {name}: {error}") from error
        if name != f"condition_{value.condition}":
            raise UsageError(
                f"{station}: [station.sim] settings: {name} is nothing that an omega can begin"
                f" with; {value}"
            )
        found[value.condition] = value
    return found


def _check_names(station: str, sim: SimSpec) -> None:
    """Reject a name that does not exist, because it would silently have no effect."""
    wrong = [f"counters: {name}" for name in sim.counters]
    wrong += [f"quirks: {name}" for name in sim.quirks if name not in OMEGA_QUIRKS]
    wrong += [f"fault {fault.kind}" for fault in sim.fault if fault.kind not in KINDS]
    wrong += [
        f"fault {fault.kind}: {fault.command}"
        for fault in sim.fault
        if fault.command and fault.command not in COMMANDS
    ]
    wrong += [
        f"fault {fault.kind}: port {fault.port}"
        for fault in sim.fault
        if fault.port not in (None, 1)
    ]
    if wrong:
        raise UsageError(f"{station}: [station.sim] {', '.join(wrong)}: an omega has none")
